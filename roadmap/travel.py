"""Fingers wherever they are: solids that hold a link over its joint's whole travel.

Between two values of one joint every corner of a solid runs along a line or an arc.
The hull of the corners at both ends, grown by how far an arc leaves its chord, holds
the solid all along; several such hulls hold a whole turn.
"""

from collections.abc import Callable, Sequence

import numpy as np

from roadmap.body_tree import BodyTree
from roadmap.description import MOVABLE, Description, Link
from roadmap.errors import BadRobot
from roadmap.polytope import shell
from roadmap.robot import BOX, HULL
from roadmap.solids import Solid

_TURN = 0.1  # [rad] largest turn of one hull: an arc of 0.1 m leaves it by 0.13 mm
_SIDES = (-0.5, 0.5)
_CORNERS = np.array([[x, y, z] for x in _SIDES for y in _SIDES for z in _SIDES])


def travelling_links(
    description: Description, tree: BodyTree, travel: Sequence[str]
) -> dict[str, str]:
    """Return the links that a travelling joint carries, and the joint that drives it.

    Raises:
        BadRobot: There is no such joint, it is one that moves, follows another or has
            no two limits; or a link would travel with two joints, or with the tool.
    """
    for name in travel:
        _check(description, tree, name)
    found: dict[str, str] = {}
    for link in description.links:
        own = [
            joint
            for joint in description.path(link)
            if joint.kind in MOVABLE and driver_of(description, joint.name) in travel
        ]
        if len(own) > 1:
            raise BadRobot(
                f"link {link!r} would travel with {' and '.join(j.name for j in own)}; "
                "lock all but one of them"
            )
        if own:
            found[link] = driver_of(description, own[0].name)
    return found


def _check(description: Description, tree: BodyTree, name: str) -> None:
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
        driver = driver_of(description, name)
        raise BadRobot(f"joint {name!r} mimics {driver!r}; name {driver!r} instead")
    if joint.kind == "continuous" or joint.lower is None or joint.upper is None:
        raise BadRobot(
            f"joint {name!r} has no two limits to travel between; lock it, or give it "
            "a <limit>"
        )


def driver_of(description: Description, name: str) -> str:
    """Return the joint that a joint follows, itself where it follows none."""
    while description.joints[name].mimic is not None:
        name = description.joints[name].mimic[0]
    return name


def swept_solids(
    solids: list[Solid],
    owners: list[Link],
    description: Description,
    tree: BodyTree,
    links: dict[str, str],
    tree_at: Callable[[str, float], BodyTree],
) -> list[Solid]:
    """Put hulls over the whole travel in the place of the solids that travel.

    Args:
        solids: Of all links, body frames.
        owners: The links they belong to.
        description: The robot.
        tree: Its bodies, as the solids were placed.
        links: From `travelling_links`.
        tree_at: Bodies with a joint locked at a value.
    """
    result = []
    for solid in solids:
        name = owners[solid.link].name
        if name not in links:
            result.append(solid)
            continue
        joint = description.joints[links[name]]
        ends = (joint.lower, joint.upper)
        T_link_body = np.linalg.inv(tree.T_body_link[name])
        corners = corners_of(solid) @ T_link_body[:3, :3].T + T_link_body[:3, 3]
        turn = _turn(description, name, links[name]) * (ends[1] - ends[0])
        values = np.linspace(*ends, 1 + max(1, int(np.ceil(turn / _TURN))))
        poses = [tree_at(joint.name, float(v)).T_body_link[name] for v in values]
        rows = [corners @ T[:3, :3].T + T[:3, 3] for T in poses]
        part = turn / (len(values) - 1)
        result += [
            Solid(HULL, solid.link, np.eye(4), (0.0, 0.0, 0.0), _hull(a, b, part))
            for a, b in zip(rows, rows[1:], strict=False)
        ]
    return result


def corners_of(solid: Solid) -> np.ndarray:
    """Return corners (n, 3) whose hull holds a solid, body frame [m]."""
    if solid.kind == HULL:
        return solid.body_points()
    if solid.kind == BOX:
        T = solid.T_body_solid
        return (_CORNERS * solid.size) @ T[:3, :3].T + T[:3, 3]
    return shell(solid)


def _turn(description: Description, link: str, driver: str) -> float:
    """Return how much the link turns per unit of its travelling joint [rad]."""
    for joint in description.path(link):
        if joint.kind in MOVABLE and driver_of(description, joint.name) == driver:
            if joint.kind == "prismatic":
                return 0.0
            factor, name = 1.0, joint.name
            while description.joints[name].mimic is not None:
                name, own, _ = description.joints[name].mimic
                factor *= own
            return abs(factor)
    raise AssertionError(link)


def _hull(a: np.ndarray, b: np.ndarray, turn: float) -> np.ndarray:
    """Return the corners of a hull that holds corners on their way from a to b."""
    from scipy.spatial import ConvexHull

    points = np.concatenate([a, b])
    chord = np.linalg.norm(b - a, axis=1).max()
    sag = 0.5 * chord * np.tan(turn / 4.0) + 1e-9
    # an octahedron of this half diagonal holds the ball of radius sag
    around = np.sqrt(3.0) * sag * np.concatenate([np.eye(3), -np.eye(3)])
    points = (points[:, None] + around).reshape(-1, 3)
    return points[ConvexHull(points).vertices]
