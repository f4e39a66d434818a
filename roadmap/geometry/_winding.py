"""Whether a point is inside closed triangles, for who judges solids as they are.

Audits and grasps ask it; no proof of the planner's rests on it.
"""

import math

from numba import njit

from roadmap.compiling.jit_options import LEAN


@njit(**LEAN)
def winding(triangles, x, y, z):
    """Return how often a closed mesh (m, 3, 3) winds around a point: 0 is outside."""
    total = 0.0
    for t in range(triangles.shape[0]):
        p = triangles[t]
        ax, ay, az = p[0, 0] - x, p[0, 1] - y, p[0, 2] - z
        bx, by, bz = p[1, 0] - x, p[1, 1] - y, p[1, 2] - z
        cx, cy, cz = p[2, 0] - x, p[2, 1] - y, p[2, 2] - z
        la = math.sqrt(ax * ax + ay * ay + az * az)
        lb = math.sqrt(bx * bx + by * by + bz * bz)
        lc = math.sqrt(cx * cx + cy * cy + cz * cz)
        volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz)
        volume += az * (bx * cy - by * cx)
        below = la * lb * lc + (ax * bx + ay * by + az * bz) * lc
        below += (bx * cx + by * cy + bz * cz) * la + (cx * ax + cy * ay + cz * az) * lb
        total += 2.0 * math.atan2(volume, below)
    return total / (4.0 * math.pi)
