"""Nearest places on straight segments, in space or in joint space."""

from numba import njit

from roadmap.jit_options import INNER


@njit(**INNER)
def nearest_share(a, b, p):
    """Return the share of the segment from a to b that is nearest to p, (n,) each."""
    along = 0.0
    length2 = 0.0
    for j in range(p.shape[0]):
        d = b[j] - a[j]
        along += (p[j] - a[j]) * d
        length2 += d * d
    return min(1.0, max(0.0, along / length2)) if length2 > 0.0 else 0.0
