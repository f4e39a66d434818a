"""Samples of boxes that cover each face, edge and corner within itself.

Such samples need far less than their covering radius. Let c be the centre of a ball at
distance D from a convex polytope, x the nearest point and F the face, edge or corner
that x lies inside of. c - x is at right angles to F, and some sample p of F has
|p - x| <= rho, so

    |p - c|^2 = D^2 + |p - x|^2 <= D^2 + rho^2.

This is `odm.obstacles.surfaces.rounded_covering` with an infinite rounding: pass
`rounding=np.inf` to `step` where all obstacles are sampled like this.
"""

import numpy as np

from odm.obstacles import shapes as solid
from odm.obstacles.surfaces import SHRINK, Surface, check_spacing, face_points
from roadmap.errors import BadInput
from roadmap.transforms import moved_points


def box_faces(box: solid.Box, spacing: float = 0.01) -> Surface:
    """Sample a box so that points on each face, edge and corner cover it by themselves.

    No place is farther than `spacing` [m] from one.
    """
    if not isinstance(box, solid.Box):
        raise BadInput(f"{box!r} is no Box; sample other shapes with surface_of")
    check_spacing(spacing)
    rho, size = spacing * SHRINK, box.size
    lines = [_edge(length, rho) for length in size]
    parts = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        face = face_points(size[u], size[v], rho) - 0.5 * size[[u, v]]
        for side in (-0.5, 0.5):
            points = np.empty((len(face), 3))
            points[:, [u, v]], points[:, axis] = face, side * size[axis]
            parts.append(points)
            for other in (-0.5, 0.5):
                # the edge along w, where two faces meet; its ends are the corners
                edge = np.empty((len(lines[v]), 3))
                edge[:, axis], edge[:, u] = side * size[axis], other * size[u]
                edge[:, v] = lines[v]
                parts.append(edge)
    points = moved_points(np.concatenate(parts), box.T_base_shape)
    return Surface(points, spacing, "box", closed=True)


def _edge(length: float, rho: float) -> np.ndarray:
    n = max(1, int(np.ceil(length / (2.0 * rho))))
    return np.linspace(-0.5, 0.5, n + 1) * length
