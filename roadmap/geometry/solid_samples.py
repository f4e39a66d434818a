"""Deterministic points of a solid: over its volume and over its surface."""

import numpy as np

from roadmap.geometry.polytope import polytope, support
from roadmap.geometry.solids import Solid
from roadmap.robot.robot import BOX, CYLINDER, SPHERE

_MOST = 500  # parts of a side; a tube 1000 times as long as it is wide needs fewer


def grid(solid: Solid, n: int) -> tuple[np.ndarray, float]:
    """Return about `n` points of a grid over the solid's box, and its pitch [m].

    The grid follows the solid's own axes and has a layer in the middle of every thin
    side; points in the box's corners may lie outside the solid. (m, 3), body frame.
    """
    axes, low, high = _oriented_box(solid)
    extent = high - low
    thick = np.ones(3, bool)
    for _ in range(3):
        # an axis thinner than the pitch gets one layer, the others share its points
        pitch = (np.prod(extent[thick]) / n) ** (1 / thick.sum())
        if (extent[thick] >= pitch).all() or thick.sum() == 1:
            break
        thick &= extent >= pitch
    counts = np.where(thick, np.maximum(1, np.round(extent / pitch)), 1).astype(int)
    steps = extent / counts
    ticks = [low[k] + (np.arange(counts[k]) + 0.5) * steps[k] for k in range(3)]
    points = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    return points @ axes, float(pitch)


def surface(solid: Solid, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return about `n` points of the surface and their normals, (m, 3) each.

    A lattice on each triangle of the polytope around the solid, thinned where
    triangles are small; moved onto a sphere where the solid is one. Body frame.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(polytope(solid).corners)
    step = np.sqrt(2 * hull.area / n)
    triangles = hull.points[hull.simplices]
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    parts = np.maximum(1, np.ceil(sides.max(axis=1) / step)).astype(int)
    points, normals = [], []
    for k in np.unique(parts):
        alike = triangles[parts == k]
        lattice = _lattices(alike, k) if k <= _MOST else _thin_lattices(alike, k, step)
        points.append(lattice.reshape(-1, 3))
        normal = hull.equations[parts == k, None, :3]
        normals.append(np.broadcast_to(normal, lattice.shape).reshape(-1, 3))
    points, normals = np.vstack(points), np.vstack(normals)
    # one point for each small cell of space: thin triangles bring far too many
    cells = np.floor(points / (0.7 * step)).astype(int)
    first = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    points, normals = points[first], normals[first]
    if solid.kind == SPHERE:
        center = solid.T_body_solid[:3, 3]
        normals = points - center
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        points = center + solid.size[0] * normals
    return points, normals


def _lattices(triangles: np.ndarray, k: int) -> np.ndarray:
    """Return the points of triangles (n, 3, 3) whose sides are parted k times."""
    u, v = np.meshgrid(np.arange(k + 1), np.arange(k + 1))
    u, v = u[u + v <= k, None] / k, v[u + v <= k, None] / k
    a, b, c = (triangles[:, None, i] for i in range(3))
    return a + u * (b - a) + v * (c - a)


def _thin_lattices(triangles: np.ndarray, k: int, step: float) -> np.ndarray:
    """Return as `_lattices` does points of thin triangles, no more across than need be.

    A lattice of k by k would be 5e7 points on a wire.
    """
    sides = np.linalg.norm(np.roll(triangles, 1, axis=1) - triangles, axis=2)
    across = np.argmin(sides, axis=1)  # the side from corner `across` to the one before
    rows = np.arange(len(triangles))
    b, c, a = (triangles[rows, (across + i) % 3, None] for i in (0, 2, 1))
    wide = int(np.ceil(sides.min(axis=1).max() / step))
    u, v = np.meshgrid(np.linspace(0.0, 1.0, k + 1), np.linspace(0.0, 1.0, wide + 1))
    u, v = u.reshape(-1, 1), v.reshape(-1, 1)
    return a + u * (b - a + v * (c - b))


def _oriented_box(solid: Solid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return axes (rows) and the solid's extent along them."""
    axes = solid.T_body_solid[:3, :3].T
    if solid.kind not in (BOX, CYLINDER):
        axes = np.linalg.eigh(np.cov(polytope(solid).corners.T))[1].T
    return axes, -support(solid, -axes), support(solid, axes)
