"""An agent's whole body, exact: every link's solids and where they are for all joints.

Read from its URDF alone, without sphere cover: what scenes are drawn and checked with.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from odm.obstacles import shapes
from roadmap.errors import BadInput
from roadmap.geometry.solids import Solid, solid_of
from roadmap.loading.body_tree import bodies_of, link_poses
from roadmap.robot.description import MOVABLE, Description, read_description
from roadmap.robot.known import known_robot, robot_file
from roadmap.transforms import pose_of


@dataclass(frozen=True, eq=False)
class AgentBody:
    """Links, joints and solids of a URDF."""

    file: Path  # the URDF
    description: Description  # what it says
    # names of the joints that can be set; those that follow are left out
    joints: tuple[str, ...]
    limits: Mapping[str, tuple[float, float]]  # joint -> lower and upper end [rad or m]
    links: tuple[str, ...]  # names of all links, parents first; the first is the base
    # of all links; `link` counts `links`, poses are in the link's frame [m]
    solids: tuple[Solid, ...]
    # pairs of links that are not tested against each other: no third link with geometry
    # lies between them on the way from one to the other; links welded together by fixed
    # joints count as one
    neighbours: frozenset[tuple[str, str]]

    def checked(self, joints: Mapping[str, float], whose: str) -> dict[str, float]:
        """Return a value for every joint, in order, known and within limits.

        What is outside by 1e-3 at most is put on the limit.

        Raises:
            BadInput: A joint that it has not, or a value outside its limits.
        """
        for name, value in joints.items():
            if name not in self.joints:
                near = difflib.get_close_matches(name, self.joints, 3)
                told = (
                    f"did you mean {', '.join(near)}?"
                    if near
                    else (f"its joints are {', '.join(self.joints)}")
                )
                raise BadInput(f"{whose} has no joint {name!r} that can be set; {told}")
            low, high = self.limits[name]
            if not low - 1e-3 <= value <= high + 1e-3:
                raise BadInput(
                    f"{whose} has {name} at {value!r}, outside its limits {low:.6g} to "
                    f"{high:.6g}; give a value within them, in rad or m"
                )
        stand = {name: float(np.clip(0.0, *self.limits[name])) for name in self.joints}
        kept = {n: float(np.clip(v, *self.limits[n])) for n, v in joints.items()}
        return stand | kept

    def frames(self, joints: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Return T_base_link, (4, 4) [m], of every link."""
        return link_poses(self.description, joints)

    def shapes(
        self, joints: Mapping[str, float], T_world_base: np.ndarray
    ) -> list[tuple[str, shapes.Shape]]:
        """Return every solid as (link, shape in the world frame)."""
        poses = self.frames(joints)
        return [
            (
                self.links[solid.link],
                _shape(solid, T_world_base @ poses[self.links[solid.link]]),
            )
            for solid in self.solids
        ]


@cache
def agent_body(source: str) -> AgentBody:
    """Return the body of a known robot, or of a URDF file."""
    file, known = robot_file(source), known_robot(source)
    description = read_description(file, known.endless if known else ())
    links = [description.root, *(j.child for j in description.below(description.root))]
    movable = [j for j in description.joints.values() if j.kind in MOVABLE]
    names = [j.name for j in movable if j.mimic is None]
    limits = {
        j.name: (-np.pi, np.pi)
        if j.lower is None or j.upper is None
        else (j.lower, j.upper)
        for j in movable
    }
    driven = bodies_of(description, names, {}).limits  # those of followers count, too
    rows = np.stack([driven["lower"], driven["upper"]], axis=1).tolist()
    limits |= dict(zip(names, map(tuple, rows), strict=True))
    found = []
    for k, name in enumerate(links):
        link = description.links[name]
        for shape in link.collisions or link.visuals:
            found.append(solid_of(shape, link, k, np.eye(4), (file, ()))[0])
    solid = {links[s.link] for s in found}
    return AgentBody(
        file,
        description,
        tuple(names),
        limits,
        tuple(links),
        tuple(found),
        _neighbours(description, links, solid),
    )


def _neighbours(
    description: Description, links: list[str], solid: set[str]
) -> frozenset[tuple[str, str]]:
    """Return pairs of links with geometry that no third one lies between.

    Links welded together stand in one group; a group without geometry counts as none.
    """
    group = {links[0]: links[0]}
    for link in links[1:]:
        joint = description.parent_joint(link)
        group[link] = link if joint.kind in MOVABLE else group[joint.parent]
    full = {group[link] for link in solid}
    up = {}
    for link in dict.fromkeys(group.values()):
        joint = description.parent_joint(link)
        up[link] = None if joint is None else group[joint.parent]
    joined = {(g, g) for g in full}
    near: dict[str, str | None] = {}  # nearest group with geometry above
    for link in up:
        above = up[link]
        while above is not None and above not in full:
            above = up[above]
        near[link] = above
        if link in full and above is not None:
            joined |= {(link, above), (above, link)}
    for a in full:  # two that hang on one empty group
        for b in full:
            empty = up[a] == up[b] and up[a] is not None and up[a] not in full
            if a != b and empty:
                joined.add((a, b))
    return frozenset(
        (a, b) for a in solid for b in solid if (group[a], group[b]) in joined
    )


def _shape(solid: Solid, T_world_link: np.ndarray) -> shapes.Shape:
    T = T_world_link @ solid.T_body_solid
    # rotations that are multiplied twenty times lose digits
    u, _, vt = np.linalg.svd(T[:3, :3])
    T[:3, :3] = u @ vt
    return shapes.shape_of(solid.kind, solid.size, solid.points, T)


def reach_pose(
    body: AgentBody,
    joints: Mapping[str, float],
    arm: tuple[str, ...],
    link: str,
    T_base_link: np.ndarray,
) -> dict[str, float]:
    """Return all joints with one arm moved so that a link is at a pose.

    Damped least squares from `joints`, for postures that a scene draws: the same input
    gives the same bytes.

    Raises:
        BadInput: It ends more than 0.1 mm or 0.1 mrad away, or outside a limit.
    """
    from scipy.spatial.transform import Rotation

    q = np.array([joints[name] for name in arm])
    limits = np.array([body.limits[name] for name in arm])

    def error(q: np.ndarray) -> np.ndarray:
        now = body.frames({**joints, **dict(zip(arm, q, strict=True))})[link]
        spin = Rotation.from_matrix(T_base_link[:3, :3] @ now[:3, :3].T).as_rotvec()
        return np.concatenate([T_base_link[:3, 3] - now[:3, 3], spin])

    for _ in range(100):
        now = error(q)
        if np.abs(now).max() < 1e-6:
            break
        steps = 1e-6 * np.eye(len(q))
        J = np.stack([(now - error(q + step)) / 1e-6 for step in steps], axis=1)
        dq = J.T @ np.linalg.solve(J @ J.T + 1e-4 * (now @ now) * np.eye(6), now)
        q = np.clip(q + np.clip(dq, -0.3, 0.3), *limits.T)
    if np.abs(error(q)).max() > 1e-4:
        raise BadInput(
            f"no posture of {', '.join(arm)} brings {link} to "
            f"{np.round(T_base_link[:3, 3], 3).tolist()} m; it ends "
            f"{np.abs(error(q)[:3]).max():.3f} m away: move it nearer"
        )
    return {**joints, **dict(zip(arm, q.tolist(), strict=True))}


def upright(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    """Return the pose (4, 4) of something that stands upright, turned by `yaw`."""
    return pose_of((x, y, z), (0.0, 0.0, yaw))
