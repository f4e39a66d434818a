"""Which points of a person are near, and how each of them moves."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def near_points(points, centers, far, near):
    """Write the points (n, 3) near a robot to near (n, 3); return how many.

    Near is at most `far` outside the box around the centers (m, 3) of its spheres.
    """
    low, high = np.empty(3), np.empty(3)
    for a in range(3):
        low[a], high[a] = math.inf, -math.inf
        for i in range(centers.shape[0]):
            low[a] = min(low[a], centers[i, a])
            high[a] = max(high[a], centers[i, a])
        low[a] -= far
        high[a] += far
    n = 0
    for i in range(points.shape[0]):
        inside = True
        for a in range(3):
            inside &= low[a] < points[i, a] < high[a]
        if inside:
            near[n] = points[i]
            n += 1
    return n


@njit(cache=True, nogil=True)
def velocities(points, ends, before, passed, radii, out):
    """Write the velocity of points (n, 3) on capsules to out (n, 3).

    The capsules' ends stand in ends (k, 2, 3) now and in before (k, 2, 3) `passed`
    seconds ago; radii (k,). A point moves as the place of the axis that it stands
    above, on the capsule whose surface it is nearest to.
    """
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        own, share, least = 0, 0.0, math.inf
        for k in range(radii.shape[0]):
            ax, ay, az = ends[k, 0, 0], ends[k, 0, 1], ends[k, 0, 2]
            bx, by, bz = ends[k, 1, 0] - ax, ends[k, 1, 1] - ay, ends[k, 1, 2] - az
            dx, dy, dz = x - ax, y - ay, z - az
            t = dx * bx + dy * by + dz * bz
            t /= max(bx * bx + by * by + bz * bz, 1e-12)
            t = min(max(t, 0.0), 1.0)
            dx, dy, dz = dx - t * bx, dy - t * by, dz - t * bz
            off = abs(math.sqrt(dx * dx + dy * dy + dz * dz) - radii[k])
            if off < least:
                own, share, least = k, t, off
        for a in range(3):
            u = (ends[own, 0, a] - before[own, 0, a]) / passed
            v = (ends[own, 1, a] - before[own, 1, a]) / passed
            out[i, a] = (1.0 - share) * u + share * v
