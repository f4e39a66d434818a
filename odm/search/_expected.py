"""Where the obstacles are about to be: cells that new paths are wary of, ahead of time.

They are written where recent occupancy is kept (`_recent.py`), as if they had been
occupied in the last frame. So they rank paths, and neither free nor block a motion.
"""

import math

import numpy as np
from numba import njit

from odm.search._recent import PERIODS, this_period, turn_ring
from odm.search._state import view
from roadmap.jit_options import LEAN


@njit(**LEAN)
def expect(state, points):
    """Be wary of the cells of points (n, 3) from now on, as long as of occupied ones.

    Points outside the grid, and those that are not finite, are left out.
    """
    recent, cloud = view(state, "recent"), view(state, "cloud")
    now = recent.clock[0]
    period = this_period(state, now)
    last = recent.listed.shape[0] - 1
    shape, origin, inv = cloud.shape, cloud.origin, 1.0 / cloud.h
    for i in range(points.shape[0]):
        x = (points[i, 0] - origin[0]) * inv
        y = (points[i, 1] - origin[1]) * inv
        z = (points[i, 2] - origin[2]) * inv
        inside = x >= 0.0 and y >= 0.0 and z >= 0.0
        inside = inside and x < 4.0 * shape[0] and y < 4.0 * shape[1]
        if not (inside and z < 4.0 * shape[2]):
            continue
        ix, iy, iz = int(x), int(y), int(z)
        b = ((ix >> 2) * shape[1] + (iy >> 2)) * shape[2] + (iz >> 2)
        bit = ((ix & 3) << 4) | ((iy & 3) << 2) | (iz & 3)
        if recent.when[b] == -math.inf:
            recent.listed[recent.listed[last]] = b
            recent.listed[last] += 1
        turn_ring(recent, b, period)
        recent.when[b] = now
        row = (PERIODS + 1) * b + period % (PERIODS + 1)
        recent.cells[row] |= np.uint64(1) << np.uint64(bit)
