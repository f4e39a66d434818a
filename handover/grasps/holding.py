"""Whether a closed hand holds an object: force closure with friction.

Each contact pushes along the inward normal and, by Coulomb's law, up to the friction
coefficient sideways: a cone, taken as a pyramid inside of it. The wrenches of all
edges, forces of 1 N with their moments about the centre of mass over the object's
radius, are points in six dimensions. The grasp holds the object against any small
push if their convex hull has the origin inside [Ferrari1992]; the radius of the
largest ball about the origin inside of the hull is its quality.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from handover.grasps import _closing as kernels
from handover.grasps.hand import Hand
from handover.grasps.objects import GraspObject
from handover.grasps.settings import HOLD
from handover.grasps.surface import farthest, surface_points
from odm.exact._distances import Convexes
from odm.exact.distances import gather


@dataclass(frozen=True, eq=False)
class Skin:
    """Points (n, 3) of an object's surface [m] with normals outwards, for contacts."""

    points: np.ndarray
    normals: np.ndarray
    convexes: Convexes


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where a hand touches: points (n, 3), inward normals (n, 3), links (n,)."""

    points: np.ndarray
    normals: np.ndarray
    links: np.ndarray


def skin_of(thing: GraspObject, spacing: float, rng: np.random.Generator) -> Skin:
    """Return points of a surface, one to `spacing` squared [m] on average."""
    area = sum(
        0.5
        * np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum()
        for t in thing.triangles()
    )
    points, normals = surface_points(thing, int(np.ceil(area / spacing**2)), rng)
    each = [(point[None], 0.0, 0.0, 0.0) for point in points]
    return Skin(points, normals, gather(each, np.arange(len(points))))


def contacts_of(
    hand: Hand, state: kernels.HandState, skin: Skin, within: float
) -> Contacts:
    """Return where a closed hand touches, a few places a link.

    Fewer places than there are withstand less, so what is told to hold, holds. Pads
    give way by `within` [m]: what is nearer touches.
    """
    link = np.empty(len(skin.points), np.int64)
    gap = np.empty(len(skin.points))
    kernels.touching(hand.arrays, state, skin.convexes, within, link, gap)
    rows = []
    for one in np.unique(link[link >= 0]):
        near = np.flatnonzero(link == one)
        first = int(gap[near].argmin())
        rows += near[farthest(skin.points[near], HOLD.each, first)].tolist()
    rows = np.array(rows, np.int64)
    return Contacts(skin.points[rows], -skin.normals[rows], link[rows])


def wrenches(
    contacts: Contacts, center: np.ndarray, radius: float, friction: float, edges: int
) -> np.ndarray:
    """Return the wrenches (n * edges, 6) of the edges of all friction pyramids.

    Moments are about `center` (3,) [m] and divided by `radius` [m]; `friction` is
    Coulomb's coefficient.
    """
    n = contacts.normals
    helper = np.where(np.abs(n[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(n, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(n, u)
    turn = 2.0 * np.pi * np.arange(edges) / edges
    side = u[:, None] * np.cos(turn)[None, :, None]
    side = side + v[:, None] * np.sin(turn)[None, :, None]
    force = n[:, None] + friction * side
    force /= np.linalg.norm(force, axis=2, keepdims=True)
    arm = (contacts.points - center)[:, None] / radius
    moment = np.cross(np.broadcast_to(arm, force.shape), force)
    return np.concatenate([force, moment], axis=2).reshape(-1, 6)


def quality_bound(points: np.ndarray) -> float:
    """Return a bound that `closure_quality` of wrenches (n, 6) does not exceed.

    A push along a unit vector u is withstood no farther than the hull's farthest point
    along u: the smallest of many u, improved by descent.
    """
    if len(points) < 7:
        return 0.0
    u = _directions(HOLD.directions)
    along = (u @ points.T).max(axis=1)
    u, bound = u[along.argmin()], float(along.min())
    for k in range(HOLD.descent):
        push = points @ u
        far = int(push.argmax())
        bound = min(bound, float(push[far]))
        u = u - 0.5 / (k + 2.0) * points[far]
        u /= max(float(np.linalg.norm(u)), 1e-12)
    return bound


@cache
def _directions(n: int) -> np.ndarray:
    u = np.random.default_rng(0).normal(size=(n, 6))
    u = np.concatenate([u, np.eye(6), -np.eye(6)])
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def closure_quality(points: np.ndarray) -> float:
    """Return the radius of the largest ball about 0 in the hull of wrenches (n, 6).

    0 where the origin is not inside of the hull, or the hull is flat.
    """
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 7 or np.linalg.matrix_rank(points, tol=1e-6) < 6:
        return 0.0
    try:
        hull = ConvexHull(points)
    except QhullError:
        return 0.0
    return max(0.0, float(-hull.equations[:, -1].max()))
