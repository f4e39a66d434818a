"""Fingers wherever they are: solids that hold a link over its joints' whole travel.

Take a cell of the joints' values, d_i wide in joint i. The places p of one point over
the cell leave the hull of its places at the cell's corners by at most

    sum_i d_i^2 / 8 * max |d2p / dv_i2|,

the error of multilinear interpolation, whose values lie in that hull. All points of a
convex solid are mixtures of its corners, so the hull of its corners over all corners
of the cell, grown by that much, holds the solid all along. Hulls of many small cells
are merged where hardly any empty room comes with it.
"""

from collections.abc import Mapping
from itertools import product

import numpy as np

from roadmap.errors import BadRobot
from roadmap.geometry.polytope import polytope, shell
from roadmap.geometry.solids import Solid, hull_corners
from roadmap.loading.body_tree import BodyTree, drive
from roadmap.loading.finger_chain import Carried, has_limits
from roadmap.robot.description import MOVABLE, Description, Link
from roadmap.robot.robot import BOX, HULL
from roadmap.transforms import moved_points

WIDEST = 0.01  # [m] hulls grown by more than this are not worth having
_MANY_CORNERS = 200  # hulls of more corners are simplified (by 0.2 mm at most)
_SIDES = (-0.5, 0.5)
_CORNERS = np.array([[x, y, z] for x in _SIDES for y in _SIDES for z in _SIDES])
_OCTAHEDRON = np.sqrt(3.0) * np.concatenate([np.eye(3), -np.eye(3)])  # holds a ball


def check_travel(description: Description, tree: BodyTree, name: str) -> None:
    """Refuse the travel of a joint that moves, follows, or lacks two limits."""
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


def check_width(
    links: Mapping[str, Carried], radii: Mapping[str, float], tip: str
) -> None:
    """Refuse a travel that would carry the tip, or a link on too many joints."""
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

    `solids` are in body frames, `owners` their links, `links` from `carried_links`.
    """
    result = []
    for solid in solids:
        name = owners[solid.link].name
        if name not in links:
            result.append(solid)
            continue
        corners = _link_corners(solid, tree, name)
        result += [
            Solid(HULL, solid.link, np.eye(4), points=points)
            for points in _hulls(links[name], corners)
        ]
    return result


def corners_of(solid: Solid) -> np.ndarray:
    """Return corners (n, 3) whose hull holds a solid, body frame [m]."""
    if solid.kind == HULL:
        return _few(solid.body_points())
    if solid.kind == BOX:
        return moved_points(_CORNERS * solid.size, solid.T_body_solid)
    return shell(solid)


def _few(points: np.ndarray) -> np.ndarray:
    """Return the corners of a hull, or fewer ones whose hull holds it."""
    if len(points) <= _MANY_CORNERS:
        return points
    return polytope(Solid(HULL, 0, np.eye(4), points=points)).corners


def _link_corners(solid: Solid, tree: BodyTree, link: str) -> np.ndarray:
    T_link_body = np.linalg.inv(tree.T_body_link[link])
    return moved_points(corners_of(solid), T_link_body)


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
        points = hull_corners(points.reshape(-1, 3))
        grown = points[:, None] + sag * _OCTAHEDRON
        found.append(_few(hull_corners(grown.reshape(-1, 3))))
    return found
