"""A robot with something in its hand: one more link, fixed to the tool."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.geometry.self_collision import SelfCollision, carrier, relative_reach
from roadmap.geometry.solids import Solid, hull_corners
from roadmap.kinematics.axis_reach import group_reach, joint_span
from roadmap.kinematics.joint_tree import PARENT
from roadmap.robot.robot import SPHERE, Robot
from roadmap.transforms import pose_with

PAYLOAD = "payload"
_FEW_BALLS = 4  # up to so many, each gets a fine polytope


def with_payload(
    robot: Robot,
    spheres: np.ndarray,
    shell: np.ndarray | None = None,
    solids: list[Solid] | None = None,
) -> Robot:
    """Return the robot with a link `payload` that is fixed to its tool.

    The payload may touch the links that its tool's body carries, and the links that
    hang on that body, which hold the payload. It must stay clear of all others.

    Args:
        robot: The robot, without a payload.
        spheres: (n, 4) spheres that contain the payload, centre and radius, in the
            tool frame [m].
        shell: (k, 3) points, tool frame, whose convex hull contains the payload [m];
            None: one that contains the spheres.
        solids: Its exact convex solids, posed in the tool frame, for audits; empty
            where none is asked for; None: the spheres themselves.

    Raises:
        BadInput: The robot has a link of that name already.
    """
    if PAYLOAD in robot.link_names:
        raise BadInput(
            f"the robot has a link {PAYLOAD!r} already, the name of what it carries; "
            "rename it in the URDF"
        )
    R, p = robot.T_body_tip[:3, :3], robot.T_body_tip[:3, 3]
    if shell is None:
        shell = polytope_around(spheres)
    if solids is None:
        solids = [_ball(s) for s in spheres]
    centers, corners = spheres[:, :3] @ R.T + p, np.asarray(shell) @ R.T + p
    placed = np.concatenate([centers, spheres[:, 3:]], axis=1)
    body, link, n = int(robot.tip_body), len(robot.link_names), len(spheres)
    span = joint_span(robot.tree_i, robot.tree_f, robot.lower, robot.upper)
    bodies = np.array([body, body], np.int32)
    reach = group_reach(robot.tree_i, robot.tree_f, span, bodies, [centers, corners])
    held = hanging_on(robot, body)
    pairs = [[k, link] for k, b in enumerate(robot.link_body) if int(b) not in held]
    changed: dict[str, Any] = {
        "link_names": (*robot.link_names, PAYLOAD),
        "link_body": np.append(robot.link_body, body),
        "spheres": np.concatenate([robot.spheres, placed]),
        "sphere_body": np.append(robot.sphere_body, np.full(n, body)),
        "sphere_link": np.append(robot.sphere_link, np.full(n, link)),
        "sphere_reach": np.concatenate(
            [robot.sphere_reach, np.repeat(reach[:1], n, axis=0)]
        ),
        "shell_ptr": np.append(robot.shell_ptr, robot.shell_ptr[-1] + len(corners)),
        "shell_points": np.concatenate([robot.shell_points, corners]),
        "shell_link": np.append(robot.shell_link, link),
        "shell_reach": np.concatenate([robot.shell_reach, reach[1:]]),
        "self_pairs": np.concatenate(
            [robot.self_pairs, np.array(pairs, np.int32).reshape(-1, 2)]
        ),
    }
    return replace(robot, **changed, **_with_solids(robot, solids, link))


def hanging_on(robot: Robot, body: int) -> set[int]:
    """Return a body and all bodies that it carries."""
    below = {body}
    for b in range(body + 1, len(robot.tree_i)):  # parents come before children
        if int(robot.tree_i[b, PARENT]) in below:
            below.add(b)
    return below


def extended_collision(bare: SelfCollision, loaded: Robot) -> SelfCollision:
    """Return the self-collision model of `loaded` from that of the bare."""
    known = bare.model
    new, n = len(loaded.shell_link) - 1, len(loaded.link_names) - 1
    tested = {int(a) for a, b in loaded.self_pairs if b == n}
    body = loaded.link_body[loaded.shell_link]
    ptr = loaded.shell_ptr
    rows, reach = [], []
    for a in range(new):
        if int(loaded.shell_link[a]) in tested:
            rows.append((a, new, body[a], body[new], *ptr[a : a + 2], *ptr[new:]))
            reach.append(relative_reach(loaded, a, new))
    rows = np.array(rows, np.int64).reshape(-1, 8)
    pairs = np.concatenate([known.pairs, rows])
    reach = np.array(reach, float).reshape(-1, loaded.dof)
    carriers = [carrier(loaded, *row[2:4]) for row in rows.tolist()]
    ball = _loose_ball(loaded.shell_points[ptr[new] : ptr[new + 1]])
    model = known._replace(
        pairs=frozen(pairs, np.int32),
        reach=frozen(np.concatenate([known.reach, reach]), np.float64),
        balls=frozen(np.concatenate([known.balls, [ball]]), np.float64),
        points=loaded.shell_points,
        shell_body=frozen(body, np.int32),
        rods=frozen(np.concatenate([known.rods, [(*ball[:3], *ball)]]), np.float64),
        carrier=frozen(np.concatenate([known.carrier, carriers]), np.int32),
        shell_reach=frozen(loaded.shell_reach, np.float64),
    )
    return SelfCollision(frozen(loaded.shell_link[pairs[:, :2]], np.int32), model)


def _loose_ball(points: np.ndarray) -> tuple[float, ...]:
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return (*center, np.linalg.norm(points - center, axis=1).max() + 1e-9)


def polytope_around(spheres: np.ndarray) -> np.ndarray:
    """Return (k, 3) points whose convex hull contains the spheres (n, 4)."""
    template = _round(2 if len(spheres) <= _FEW_BALLS else 1)
    points = spheres[:, None, :3] + spheres[:, None, 3:] * template
    points = points.reshape(-1, 3)
    if len(points) <= 4 * len(_round(2)):
        return points
    return hull_corners(points)


@lru_cache(maxsize=2)
def _round(subdivisions: int) -> np.ndarray:
    """Return the vertices of a polytope that contains the unit sphere."""
    import trimesh
    from scipy.spatial import ConvexHull

    points = trimesh.creation.icosphere(subdivisions=subdivisions).vertices
    inradius = -ConvexHull(points).equations[:, 3].max()
    return np.asarray(points) * ((1.0 + 1e-9) / inradius)


def _ball(sphere: np.ndarray) -> Solid:
    T = pose_with(np.eye(3), sphere[:3])
    return Solid(SPHERE, 0, T, (float(sphere[3]), 0.0, 0.0))


def _with_solids(robot: Robot, solids: list[Solid], link: int) -> dict:
    if not solids:
        return {}
    sizes = np.cumsum([robot.solid_ptr[-1], *(len(s.points) for s in solids)])
    poses = [robot.T_body_tip @ s.T_body_solid for s in solids]
    return {
        "solid_kind": np.append(robot.solid_kind, [s.kind for s in solids]),
        "solid_link": np.append(robot.solid_link, np.full(len(solids), link)),
        "solid_pose": np.concatenate([robot.solid_pose, poses]),
        "solid_size": np.concatenate([robot.solid_size, [s.size for s in solids]]),
        "solid_ptr": np.append(robot.solid_ptr, sizes[1:]),
        "solid_points": np.concatenate(
            [robot.solid_points, *(s.points for s in solids)]
        ),
    }
