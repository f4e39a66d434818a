"""Points in another frame."""

from numba import njit

from roadmap.jit_options import LEAN


@njit(**LEAN)
def place(points, T, out):
    """Write T @ p of points (n, 3) to `out` (n, 3); T (4, 4) is rigid."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for a in range(3):
            out[i, a] = T[a, 0] * x + T[a, 1] * y + T[a, 2] * z + T[a, 3]
