"""Distances of balls and capsules."""

import math

from numba import njit

from roadmap.jit_options import LEAN


@njit(**LEAN)
def ball_gaps(balls, capsules, gaps):
    """Write the gaps of balls (n, 4) and capsules (k, 7) to gaps (n, k) [m]."""
    for k in range(capsules.shape[0]):
        rod = capsules[k]
        ax, ay, az, radius = rod[0], rod[1], rod[2], rod[6]
        ux, uy, uz = rod[3] - ax, rod[4] - ay, rod[5] - az
        length = max(ux * ux + uy * uy + uz * uz, 1e-12)
        for n in range(balls.shape[0]):
            ball = balls[n]
            x, y, z = ball[0] - ax, ball[1] - ay, ball[2] - az
            s = min(1.0, max(0.0, (x * ux + y * uy + z * uz) / length))
            x, y, z = x - s * ux, y - s * uy, z - s * uz
            gaps[n, k] = math.sqrt(x * x + y * y + z * z) - radius - ball[3]
