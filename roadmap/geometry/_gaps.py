"""Distances of balls and capsules."""

import math

from numba import njit

from roadmap.jit_options import INNER, LEAN


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
