"""Where the obstacles are about to be: cells that new paths are wary of, ahead of time.

They are written where recent occupancy is kept (`_recent.py`), as if they had been
occupied in the last frame. So they rank paths, and neither free nor block a motion.
"""

import math

import numpy as np
from numba import njit

from odm.obstacles._surfaces import tube_frame
from odm.search._recent import stamp, this_period
from odm.search._state import view
from roadmap.compiling.jit_options import INNER, LEAN

_EDGE = 1.4  # times the size of a cell: a square of points covers within its diagonal


@njit(**LEAN)
def expect(state, points, rods, T, frame):
    """Be wary of the cells of points and capsules from now on, as of occupied ones.

    Points (n, 3) are in the base frame, capsules `rods` (k, 7) in one whose pose there
    is T (4, 4) [m]. What is outside the grid, or not finite, is left out. `frame`
    (3, 3) is work space.
    """
    for i in range(points.shape[0]):
        be_wary(state, points[i, 0], points[i, 1], points[i, 2])
    for i in range(rods.shape[0]):
        expect_rod(state, rods[i], T, frame)


@njit(**INNER)
def expect_rod(state, rod, T, frame):
    """Be wary of where the surface of a capsule is; see `expect`.

    Its points are dense enough for every cell on the way through it to be met, and no
    fewer than that takes: to find the fewest takes longer than all of them.
    """
    length, radius = tube_frame(rod, frame), rod[6]
    edge = _EDGE * view(state, "cloud").h
    rings = 1 + int(math.ceil(length / edge))
    caps = int(math.ceil(0.5 * math.pi * radius / edge))
    for ring in range(-caps, rings + caps):
        size, height = radius, 0.0
        if ring < 0 or ring >= rings:
            angle = 0.5 * math.pi * (-ring if ring < 0 else ring + 1 - rings) / caps
            size, height = radius * math.cos(angle), radius * math.sin(angle)
            height = -height if ring < 0 else length + height
        elif rings > 1:
            height = length * ring / (rings - 1.0)
        n = max(1, int(math.ceil(2.0 * math.pi * size / edge)))
        turn, turned = math.cos(2.0 * math.pi / n), math.sin(2.0 * math.pi / n)
        u, v = size, 0.0
        for _ in range(n):
            x = rod[0] + u * frame[0, 0] + v * frame[1, 0] + height * frame[2, 0]
            y = rod[1] + u * frame[0, 1] + v * frame[1, 1] + height * frame[2, 1]
            z = rod[2] + u * frame[0, 2] + v * frame[1, 2] + height * frame[2, 2]
            be_wary(
                state,
                T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
                T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
                T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
            )
            u, v = turn * u - turned * v, turned * u + turn * v


@njit(**INNER)
def be_wary(state, px, py, pz):
    """Be wary of the cell of a place (base frame) from now on."""
    recent, cloud = view(state, "recent"), view(state, "cloud")
    shape, origin, inv = cloud.shape, cloud.origin, 1.0 / cloud.h
    x, y, z = (px - origin[0]) * inv, (py - origin[1]) * inv, (pz - origin[2]) * inv
    inside = x >= 0.0 and y >= 0.0 and z >= 0.0
    inside = inside and x < 4.0 * shape[0] and y < 4.0 * shape[1]
    if not (inside and z < 4.0 * shape[2]):
        return
    ix, iy, iz = int(x), int(y), int(z)
    b = ((ix >> 2) * shape[1] + (iy >> 2)) * shape[2] + (iz >> 2)
    bit = ((ix & 3) << 4) | ((iy & 3) << 2) | (iz & 3)
    now = recent.clock[0]
    word = np.uint64(1) << np.uint64(bit)
    stamp(recent, b, word, now, this_period(state, now))
