"""Points on an object's surface: a few, evenly spread, and many with their normals."""

import numpy as np

from handover.grasps.objects import GraspObject
from handover.grasps.settings import HOLD
from roadmap.geometry._winding import winding


def surface_points(
    thing: GraspObject, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return n points drawn by area from the union's surface, and outward normals.

    Args:
        thing: The object; what one of its parts hides of another is left out.
        n: How many are drawn before that.
        rng: Where they come from.

    Returns:
        (k, 3) points and (k, 3) unit normals, object frame, k <= n [m].
    """
    parts = thing.triangles()
    corners = np.concatenate(parts)
    part = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(corners), n, p=twice / twice.sum())
    u, v = rng.random((2, n))
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    a, b, c = (corners[face, k] for k in range(3))
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    normals = cross[face] / twice[face, None]
    keep = np.array(
        [
            not _hidden(parts, own, point)
            for own, point in zip(part[face], points, strict=True)
        ]
    )
    return points[keep], normals[keep]


def even_points(
    thing: GraspObject, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return n points spread evenly over the surface, and outward normals.

    Of many points drawn by area the farthest from those chosen is chosen next, so any
    first k of them are spread as evenly as all.

    Returns:
        (n, 3) points and (n, 3) unit normals, object frame [m].
    """
    points, normals = surface_points(thing, HOLD.drawn * n, rng)
    n = min(n, len(points))
    chosen = farthest(points, n)
    return points[chosen], normals[chosen]


def farthest(points: np.ndarray, n: int, first: int = 0) -> np.ndarray:
    """Return indices of n points, each the farthest from all before; `first` begins."""
    chosen = np.empty(min(n, len(points)), np.int64)
    distance = np.full(len(points), np.inf)
    at = first
    for k in range(len(chosen)):
        chosen[k] = at
        distance = np.minimum(distance, np.linalg.norm(points - points[at], axis=1))
        at = int(distance.argmax())
    return chosen


def _hidden(parts: list[np.ndarray], own: int, point: np.ndarray) -> bool:
    """Say whether a point of one part lies inside of another."""
    return any(
        abs(winding(np.ascontiguousarray(other), *point)) > 0.5
        for k, other in enumerate(parts)
        if k != own
    )
