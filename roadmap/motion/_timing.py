"""How fast a jerk-limited speed can change within a length."""

import math

from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN

_SLACK = 1.0 - 1e-6  # ruckig turns back where a length is short by a rounding


@njit(**INNER)
def length_to_change(v_a, v_b, a, j):
    """Return the arc length that the quickest change of speed takes, rest to rest."""
    dv = abs(v_b - v_a)
    t = 2.0 * math.sqrt(dv / j) if dv * j <= a * a else dv / a + a / j
    return 0.5 * (v_a + v_b) * t


@njit(**LEAN)
def reachable(v, length, limit, a, j):
    """Return the highest speed up to `limit` that can be had within a length from v."""
    if v >= limit or length_to_change(v, limit, a, j) <= _SLACK * length:
        return max(v, limit) if v < limit else v
    low, high = v, limit
    for _ in range(60):
        middle = 0.5 * (low + high)
        if length_to_change(v, middle, a, j) <= _SLACK * length:
            low = middle
        else:
            high = middle
    return low
