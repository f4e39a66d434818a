"""Distances of balls and capsules."""

import math

from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN


@njit(**INNER)
def nearest(x, y, z, rod):
    """Return where on the axis of a capsule (7,) a point is nearest, and how near.

    The place is a share of the way from a to b, the distance [m] is that of the axis.
    """
    ux, uy, uz = rod[3] - rod[0], rod[4] - rod[1], rod[5] - rod[2]
    length = max(ux * ux + uy * uy + uz * uz, 1e-12)
    x, y, z = x - rod[0], y - rod[1], z - rod[2]
    t = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / length))
    x, y, z = x - t * ux, y - t * uy, z - t * uz
    return t, math.sqrt(x * x + y * y + z * z)


@njit(**LEAN)
def ball_gaps(balls, capsules, gaps):
    """Write the gaps of balls (n, 4) and capsules (k, 7) to gaps (n, k) [m]."""
    for k in range(capsules.shape[0]):
        rod = capsules[k]
        for n in range(balls.shape[0]):
            ball = balls[n]
            far = nearest(ball[0], ball[1], ball[2], rod)[1]
            gaps[n, k] = far - rod[6] - ball[3]


@njit(**INNER)
def rod_gap(one, other):
    """Return the distance of the surfaces of two capsules (7,), below 0 inside [m]."""
    ux, uy, uz = one[3] - one[0], one[4] - one[1], one[5] - one[2]
    vx, vy, vz = other[3] - other[0], other[4] - other[1], other[5] - other[2]
    wx, wy, wz = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv, uw = ux * vx + uy * vy + uz * vz, ux * wx + uy * wy + uz * wz
    vw = vx * wx + vy * wy + vz * wz
    flat = uu * vv - uv * uv
    s = min(1.0, max(0.0, (uv * vw - vv * uw) / flat)) if flat > 1e-15 else 0.0
    t = (uv * s + vw) / vv if vv > 1e-15 else 0.0
    if not 0.0 <= t <= 1.0:
        t = min(1.0, max(0.0, t))
        s = min(1.0, max(0.0, (uv * t - uw) / uu)) if uu > 1e-15 else 0.0
    elif uu <= 1e-15:
        s = 0.0
    x, y, z = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return math.sqrt(x * x + y * y + z * z) - one[6] - other[6]


@njit(**LEAN)
def least_gap(rods, others):
    """Return the least distance of capsules (n, 7) from others (k, 7) [m].

    Infinite where there are none; NaN where that of two is.
    """
    least = math.inf
    for i in range(rods.shape[0]):
        for k in range(others.shape[0]):
            gap = rod_gap(rods[i], others[k])
            if gap < least or not gap == gap:
                least = gap
    return least
