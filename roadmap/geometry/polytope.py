"""Convex polytopes around solids: half-spaces, vertices, and shells with few of them.

Every polytope of this module *contains* its solid. Normals come from qhull; offsets
are taken anew as the support of the solid in that direction, so that a facet merged
or rounded by qhull can never cut a piece off.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from roadmap.geometry.solids import Solid
from roadmap.robot.robot import BOX, CYLINDER, HULL

# Shells may stick out of their solid this far [m] ...
SHELL_TOLERANCE = 1e-3
# ... and grow coarser rather than get more vertices than this.
MAX_SHELL_VERTICES = 256
# Hulls of more facets are simplified by at most about 0.2 mm.
MAX_FACETS = 400
_ROUNDING = 1e-9
_MOST = 50_000_000  # products at once, 0.4 GB: a finely meshed ball has 3e9
# Vertices nearer than 1e-7 m are welded; growing first keeps the shell outside [m].
_WELDING = 1e-6


@dataclass(frozen=True, eq=False)
class Polytope:
    """{x: n.x <= d} in the body frame, with its vertices.

    Attributes:
        normals: (m, 3) outward unit normals.
        offsets: (m,) [m].
        corners: (k, 3) vertices [m].
    """

    normals: np.ndarray
    offsets: np.ndarray
    corners: np.ndarray


@lru_cache(maxsize=64)
def polytope(solid: Solid) -> Polytope:
    """Return a polytope that contains the solid closely.

    Exact for boxes and for hulls of up to MAX_FACETS facets (merged facets apart,
    below 1e-6 m); finer hulls are simplified, cylinders and spheres circumscribed.
    """
    normals = _normals(solid)
    offsets = support(solid, normals) + _ROUNDING
    if solid.kind != HULL:
        inside = solid.T_body_solid[:3, 3]
        return Polytope(normals, offsets, _vertices(normals, offsets, inside))
    if len(normals) <= MAX_FACETS:
        return Polytope(normals, offsets, solid.body_points())
    inside = _inner_point(normals, offsets)
    few = _few(normals, offsets, inside, 2e-4, 2 * MAX_FACETS)
    normals, offsets = normals[few], offsets[few] + _WELDING
    return Polytope(normals, offsets, _vertices(normals, offsets, inside))


def support(solid: Solid, directions: np.ndarray) -> np.ndarray:
    """Return max of n.x over the solid for each unit direction n (m, 3), (m,) [m]."""
    if solid.kind == HULL:
        points = solid.body_points()
        parts = np.array_split(directions, len(points) * len(directions) // _MOST + 1)
        return np.concatenate([(points @ part.T).max(axis=0) for part in parts])
    local = directions @ solid.T_body_solid[:3, :3]
    centre = directions @ solid.T_body_solid[:3, 3]
    if solid.kind == BOX:
        return centre + np.abs(local) @ (np.array(solid.size) / 2)
    radius, length = solid.size[:2]
    if solid.kind == CYLINDER:
        across = np.hypot(local[:, 0], local[:, 1])
        return centre + radius * across + length / 2 * np.abs(local[:, 2])
    return centre + radius


def depth(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Return how deep body-frame points (n, 3) lie in the solid, (n,) [m].

    The distance to the surface inside (of a simplified hull, to that of `polytope`);
    outside a negative number.
    """
    if solid.kind in (HULL, BOX):
        outer = polytope(solid)
        return (outer.offsets - points @ outer.normals.T).min(axis=1)
    local = (points - solid.T_body_solid[:3, 3]) @ solid.T_body_solid[:3, :3]
    radius, length = solid.size[:2]
    if solid.kind == CYLINDER:
        across = np.hypot(local[:, 0], local[:, 1])
        return np.minimum(radius - across, length / 2 - np.abs(local[:, 2]))
    return radius - np.linalg.norm(local, axis=1)


def shell(solid: Solid) -> np.ndarray:
    """Return the vertices (n, 3) of a polytope with few of them around the solid.

    It sticks out of the solid's facets by at most SHELL_TOLERANCE (more where that
    takes over MAX_SHELL_VERTICES vertices, or for a sphere). In the body frame.
    """
    outer = polytope(solid)
    normals, offsets = outer.normals, outer.offsets + _WELDING
    inside = _inner_point(normals, offsets)
    few = _few(normals, offsets, inside, SHELL_TOLERANCE, MAX_SHELL_VERTICES)
    return _containing(_vertices(normals[few], offsets[few], inside), solid, inside)


def _normals(solid: Solid) -> np.ndarray:
    R = solid.T_body_solid[:3, :3]
    if solid.kind == HULL:
        from scipy.spatial import ConvexHull

        return _distinct(ConvexHull(solid.body_points()).equations[:, :3], 6)
    if solid.kind == BOX:
        return np.vstack([R.T, -R.T])
    if solid.kind == CYLINDER:
        return _prism_normals(solid.size[0]) @ R.T
    return _sphere_normals() @ R.T


def _prism_normals(radius: float) -> np.ndarray:
    """Return the side and end normals of a prism that sticks out <= the tolerance."""
    half_angle = np.arccos(radius / (radius + SHELL_TOLERANCE))
    sides = int(np.clip(4 * np.ceil(np.pi / half_angle / 4), 8, 32))
    angles = 2 * np.pi * np.arange(sides) / sides
    around = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    return np.vstack([around, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])


def _sphere_normals() -> np.ndarray:
    """Return 42 evenly spread directions: corners and edges of an icosahedron."""
    golden = (1 + np.sqrt(5)) / 2
    corners = [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    corners = np.array([np.roll(c, k) for c in corners for k in range(3)], float)
    near = [
        (i, j)
        for i in range(12)
        for j in range(i)
        if np.linalg.norm(corners[i] - corners[j]) < 2.1
    ]
    edges = np.array([corners[i] + corners[j] for i, j in near])
    directions = np.vstack([corners, edges])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _few(normals, offsets, inside, tolerance: float, limit: int) -> list[int]:
    """Choose facets whose polytope violates no other facet by more than `tolerance`.

    The facets that are violated most come first; ends earlier where the polytope
    would get more than `limit` vertices.
    """
    chosen, vertices = _first_facets(normals), None
    wanted: list[int] = []
    share = 0.34
    while share > 0:
        trial = chosen + wanted[: max(1, int(share * len(wanted)))]
        corners = _vertices(normals[trial], offsets[trial], inside)
        if len(corners) > limit and vertices is not None:
            # one at a time, then not at all
            share = share / 4 if share * len(wanted) > 1 else 0
            continue
        chosen, vertices = trial, corners
        sticking = vertices @ normals.T - offsets
        worst = sticking.argmax(axis=1)
        over = sticking[np.arange(len(vertices)), worst]
        if over.max() <= tolerance:
            break
        order = np.argsort(-over, kind="stable")
        wanted = list(dict.fromkeys(worst[order][over[order] > tolerance].tolist()))
    return chosen


def _first_facets(normals: np.ndarray) -> list[int]:
    """Return facets near the six axis directions, more until they bound a body."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    chosen = list(dict.fromkeys((normals @ axes.T).argmax(axis=0).tolist()))
    while not _bounded(normals[chosen]):
        # the facet that differs most from those chosen
        nearest = (normals @ normals[chosen].T).max(axis=1)
        chosen.append(int(nearest.argmin()))
    return chosen


def _bounded(normals: np.ndarray) -> bool:
    """Say if half-spaces with these normals bound a body, with some margin."""
    if len(normals) < 4 or np.linalg.matrix_rank(normals, tol=1e-6) < 3:
        return False
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(normals)
    except QhullError:
        return False
    return bool(hull.equations[:, 3].max() < -0.02)


def _vertices(normals, offsets, inside) -> np.ndarray:
    """Return the vertices of {x: n.x <= d} by the hull of its polar dual."""
    from scipy.spatial import ConvexHull

    reach = offsets - normals @ inside
    planes = ConvexHull(normals / reach[:, None]).equations
    return _distinct(inside - planes[:, :3] / planes[:, 3:], 7)


def _distinct(rows: np.ndarray, digits: int) -> np.ndarray:
    """Return the first of all rows that are one to so many digits, in their order."""
    first: dict[tuple, int] = {}  # a tenth of the time of `np.unique` over rows
    for k, row in enumerate(rows.round(digits).tolist()):
        first.setdefault(tuple(row), k)
    return rows[list(first.values())]


def _inner_point(normals: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the centre of the largest ball inside (Chebyshev centre)."""
    from scipy.optimize import linprog

    table = np.hstack([normals, np.ones((len(normals), 1))])
    bounds = [(None, None)] * 3 + [(0, None)]
    return linprog([0, 0, 0, -1], A_ub=table, b_ub=offsets, bounds=bounds).x[:3]


def _containing(vertices: np.ndarray, solid: Solid, inside: np.ndarray) -> np.ndarray:
    """Grow the polytope about `inside` until no facet of it cuts the solid."""
    from scipy.spatial import ConvexHull

    normals = ConvexHull(vertices).equations[:, :3]
    have = (vertices - inside) @ normals.T
    need = support(solid, normals) + _ROUNDING - normals @ inside
    return inside + (vertices - inside) * max(1.0, (need / have.max(axis=0)).max())
