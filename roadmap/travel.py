"""Fingers wherever they are: solids that hold a link over its joints' whole travel.

Take a cell of the joints' values, d_i wide in joint i. The places p of one point over
the cell leave the hull of its places at the cell's corners by at most

    sum_i d_i^2 / 8 * max |d2p / dv_i2|,

the error of multilinear interpolation, whose values lie in that hull. All points of a
convex solid are mixtures of its corners, so the hull of its corners over all corners
of the cell, grown by that much, holds the solid all along. Hulls of many small cells
are merged where hardly any empty room comes with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from roadmap.body_tree import BodyTree, drive
from roadmap.description import MOVABLE, Description, Joint, Link
from roadmap.errors import BadRobot
from roadmap.polytope import polytope, shell
from roadmap.robot import BOX, HULL
from roadmap.solids import Solid

WIDEST = 0.01  # [m] hulls grown by more than this are not worth having
_SAG = 5e-4  # [m] what a hull is grown by, where poses enough can be had
_BULGE = 5e-3  # [m] an arc that leaves its chord by more is held by several hulls
_MOST_HULLS = 12
_MOST_POSES = 800  # corners of small cells that go into one hull
_MANY_CORNERS = 200  # hulls of more corners are simplified (by 0.2 mm at most)
_SIDES = (-0.5, 0.5)
_CORNERS = np.array([[x, y, z] for x in _SIDES for y in _SIDES for z in _SIDES])
_OCTAHEDRON = np.sqrt(3.0) * np.concatenate([np.eye(3), -np.eye(3)])  # holds a ball


@dataclass(frozen=True, eq=False)
class Step:
    """A travelling joint on the way to a link, `T_before` its frame in the last one's.

    Its value is `factor * v + offset`, v that of driver number `driver`.
    """

    T_before: np.ndarray
    joint: Joint
    driver: int
    factor: float
    offset: float


@dataclass(frozen=True, eq=False)
class Carried:
    """How travelling joints carry a link, from its body on.

    Attributes:
        drivers: (k,) names of the joints that travel.
        lower, upper: (k,) their limits [rad or m].
        steps: The joints that follow them, the base's first.
        T_last_link: The link in the last joint's frame.
    """

    drivers: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    steps: tuple[Step, ...]
    T_last_link: np.ndarray

    def poses(self, values: np.ndarray) -> np.ndarray:
        """Return T_body_link (n, 4, 4) for values (n, k) of the drivers."""
        T = np.broadcast_to(np.eye(4), (len(values), 4, 4))
        for step in self.steps:
            value = step.factor * values[:, step.driver] + step.offset
            T = T @ step.T_before @ _motions(step.joint, value)
        return T @ self.T_last_link

    def derivatives(self, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Bound |dp / dv_i| and |d2p / dv_i2| over the whole travel.

        For revolute joints j before k, d2p / dq_j dq_k is axis_j x dp / dq_k, no
        longer than the lever of joint k; it is 0 where j is prismatic.

        Args:
            radius: p is this near to the link's origin [m].

        Returns:
            (k,) and (k,) [m per unit, m per unit squared].
        """
        first, second = np.zeros(len(self.drivers)), np.zeros(len(self.drivers))
        reach = radius + np.linalg.norm(self.T_last_link[:3, 3])
        for step in self.steps[::-1]:
            i, size, slide = step.driver, abs(step.factor), 0.0
            if step.joint.kind == "prismatic":
                ends = step.factor * np.array([self.lower[i], self.upper[i]])
                slide, own = np.abs(ends + step.offset).max(), size
            else:
                own = size * reach
                second[i] += size * (own + 2.0 * first[i])
            first[i] += own
            reach += slide + np.linalg.norm(step.T_before[:3, 3])
        return first, second

    def ways(self, radius: float) -> np.ndarray:
        """Return how far each driver moves points at most, (k,) [m]."""
        return self.derivatives(radius)[0] * (self.upper - self.lower)

    def cells(self, radius: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Return into how much the travel is cut.

        Returns:
            (k,) hulls a driver, (k,) small cells a hull, and what a hull is grown by
            [m].
        """
        span, bend = self.upper - self.lower, self.derivatives(radius)[1]
        k = len(span)
        hulls = _counts(span * np.sqrt(bend / (8 * _BULGE)), _MOST_HULLS, 0)
        small = span / hulls * np.sqrt(k * bend / (8 * _SAG))
        small = _counts(small, _MOST_POSES, 1)
        sag = ((span / hulls / small) ** 2 * bend).sum() / 8
        return hulls, small, float(sag) + 1e-9


def _counts(wanted: np.ndarray, most: int, ends: int) -> np.ndarray:
    """Return counts (k,) of at least 1, as wanted or as (count + ends) multiply to."""
    counts = np.maximum(1, np.ceil(np.minimum(wanted, most))).astype(int)
    while np.prod(counts + ends) > most and counts.max() > 1:
        counts[counts.argmax()] -= 1
    return counts


def carried_links(
    description: Description, tree: BodyTree, travel: Sequence[str]
) -> dict[str, Carried]:
    """Return the links that travelling joints carry.

    Args:
        description: The robot.
        tree: Its bodies; all joints but those that move stand still.
        travel: Names of the joints that travel; others may follow them.
    """
    found = {}
    for link in description.links:
        steps, names, T = [], [], np.eye(4)
        for joint in description.path(link):
            name, factor, offset = (
                drive(description, joint) if joint.kind in MOVABLE else ("", 0.0, 0.0)
            )
            T = T @ joint.T_parent_joint
            if name in tree.joint_names:
                steps, names, T = [], [], np.eye(4)
            elif name in travel:
                names += [] if name in names else [name]
                steps.append(Step(T, joint, names.index(name), factor, offset))
                T = np.eye(4)
            elif name:
                value = factor * tree.standing[name] + offset
                T = T @ _motions(joint, np.array([value]))[0]
        if steps:
            limits = np.array([_limits(description.joints[n]) for n in names])
            found[link] = Carried(tuple(names), *limits.T, tuple(steps), T)
    return found


def _limits(joint: Joint) -> tuple[float, float]:
    assert joint.lower is not None and joint.upper is not None
    return joint.lower, joint.upper


def check_travel(description: Description, tree: BodyTree, name: str) -> None:
    """Refuse a joint that cannot travel.

    Raises:
        BadRobot: There is no such joint, it is one that moves, follows another or has
            no two limits.
    """
    joint = description.joints.get(name)
    movable = [j.name for j in description.joints.values() if j.kind in MOVABLE]
    if joint is None or joint.kind not in MOVABLE:
        raise BadRobot(
            f"there is no joint {name!r} to travel; the joints are {movable}"
        )
    if name in tree.joint_names:
        raise BadRobot(
            f"joint {name!r} moves the tool, so it is planned for; leave it out of "
            "travel"
        )
    if joint.mimic is not None:
        driver = drive(description, joint)[0]
        raise BadRobot(f"joint {name!r} mimics {driver!r}; name {driver!r} instead")
    if not has_limits(joint):
        raise BadRobot(
            f"joint {name!r} has no two limits to travel between; lock it, or give it "
            "a <limit>"
        )


def has_limits(joint: Joint) -> bool:
    """Say if a joint has two limits."""
    ends = joint.kind != "continuous", joint.lower is not None, joint.upper is not None
    return all(ends)


def check_width(
    links: Mapping[str, Carried], radii: Mapping[str, float], tip: str
) -> None:
    """Refuse a travel of the tip, and one too wide for hulls.

    Raises:
        BadRobot: The tip would travel, or a link hangs on too many joints.
    """
    if tip in links:
        raise BadRobot(
            f"the tip {tip!r} would travel with {' and '.join(links[tip].drivers)}; "
            "choose a tip on the hand itself"
        )
    for link, carried in links.items():
        if link in radii and carried.cells(radii[link])[2] > WIDEST:
            raise BadRobot(
                f"link {link!r} would travel with {' and '.join(carried.drivers)}, "
                "too far to be held closely; lock some of them"
            )


def radii_of(
    solids: list[Solid], owners: list[Link], tree: BodyTree
) -> dict[str, float]:
    """Return how far each link's solids reach from its origin [m]."""
    radii: dict[str, float] = {}
    for solid in solids:
        name = owners[solid.link].name
        far = np.linalg.norm(_link_corners(solid, tree, name), axis=1).max()
        radii[name] = max(radii.get(name, 0.0), float(far))
    return radii


def swept_solids(
    solids: list[Solid],
    owners: list[Link],
    tree: BodyTree,
    links: Mapping[str, Carried],
) -> list[Solid]:
    """Put hulls over the whole travel in the place of the solids that travel.

    Args:
        solids: Of all links, body frames.
        owners: The links they belong to.
        tree: The bodies, as the solids were placed.
        links: From `carried_links`.
    """
    result = []
    for solid in solids:
        name = owners[solid.link].name
        if name not in links:
            result.append(solid)
            continue
        corners = _link_corners(solid, tree, name)
        result += [
            Solid(HULL, solid.link, np.eye(4), (0.0, 0.0, 0.0), points)
            for points in _hulls(links[name], corners)
        ]
    return result


def corners_of(solid: Solid) -> np.ndarray:
    """Return corners (n, 3) whose hull holds a solid, body frame [m]."""
    if solid.kind == HULL:
        return _few(solid.body_points())
    if solid.kind == BOX:
        T = solid.T_body_solid
        return (_CORNERS * solid.size) @ T[:3, :3].T + T[:3, 3]
    return shell(solid)


def _few(points: np.ndarray) -> np.ndarray:
    """Return the corners of a hull, or fewer ones whose hull holds it."""
    if len(points) <= _MANY_CORNERS:
        return points
    solid = Solid(HULL, 0, np.eye(4), (0.0, 0.0, 0.0), points)
    return polytope(solid).corners


def _link_corners(solid: Solid, tree: BodyTree, link: str) -> np.ndarray:
    T_link_body = np.linalg.inv(tree.T_body_link[link])
    return corners_of(solid) @ T_link_body[:3, :3].T + T_link_body[:3, 3]


def _hulls(carried: Carried, corners: np.ndarray) -> list[np.ndarray]:
    """Return corners of the hulls that hold a hull of `corners`, link frame, always."""
    radius = float(np.linalg.norm(corners, axis=1).max())
    hulls, small, sag = carried.cells(radius)
    span = (carried.upper - carried.lower) / hulls
    found = []
    for cell in product(*map(range, hulls)):
        lower = carried.lower + span * cell
        axes = [
            np.linspace(a, a + s, n + 1)
            for a, s, n in zip(lower, span, small, strict=True)
        ]
        values = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
        T = carried.poses(values)
        points = np.einsum("nij,mj->nmi", T[:, :3, :3], corners) + T[:, None, :3, 3]
        points = _extreme(points.reshape(-1, 3))
        grown = points[:, None] + sag * _OCTAHEDRON
        found.append(_few(_extreme(grown.reshape(-1, 3))))
    return found


def _extreme(points: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    return points[ConvexHull(points).vertices]


def _motions(joint: Joint, values: np.ndarray) -> np.ndarray:
    """Return the motion (n, 4, 4) of a joint for values (n,) [rad or m]."""
    T = np.tile(np.eye(4), (len(values), 1, 1))
    if joint.kind == "prismatic":
        T[:, :3, 3] = values[:, None] * joint.axis
        return T
    x, y, z = joint.axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(values)[:, None, None], np.cos(values)[:, None, None]
    T[:, :3, :3] += s * K + (1 - c) * (K @ K)
    return T
