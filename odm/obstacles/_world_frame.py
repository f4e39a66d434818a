"""Points that reach into further cells, and points in another frame."""

import math

import numpy as np
from numba import njit

from odm.obstacles._cloud import N_BAD, N_INSIDE, N_LISTED, N_OCCUPIED, N_OUTSIDE
from roadmap.jit_options import INNER, LEAN


@njit(**INNER)
def add_cell(b, bit, cloud):
    """Occupy a cell."""
    if cloud.words[b] == 0:
        count = cloud.counts[N_OCCUPIED]
        cloud.occupied[count] = b
        cloud.slot[b] = count
        cloud.counts[N_OCCUPIED] = count + 1
    cloud.words[b] |= np.uint64(1) << np.uint64(bit)


@njit(**LEAN)
def dilate_points(points, extra, cloud):
    """Occupy every cell whose cube comes within `extra` of a marked frame's points.

    A point outside the grid, but as near as that, counts as one of the nearest cell:
    it is inside from here on.
    """
    inv = 1.0 / cloud.h
    r = extra * inv + 1e-9
    ox, oy, oz = cloud.origin[0], cloud.origin[1], cloud.origin[2]
    ny, nz = cloud.shape[1], cloud.shape[2]
    tx, ty, tz = 4 * cloud.shape[0], 4 * ny, 4 * nz
    for i in range(points.shape[0]):
        x = (points[i, 0] - ox) * inv
        y = (points[i, 1] - oy) * inv
        z = (points[i, 2] - oz) * inv
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            continue
        gx = max(0.0, max(-x, x - tx))
        gy = max(0.0, max(-y, y - ty))
        gz = max(0.0, max(-z, z - tz))
        if gx * gx + gy * gy + gz * gz > r * r:
            continue
        if cloud.where[i] < 0:
            ix = min(max(int(math.floor(x)), 0), tx - 1)
            iy = min(max(int(math.floor(y)), 0), ty - 1)
            iz = min(max(int(math.floor(z)), 0), tz - 1)
            b = ((ix >> 2) * ny + (iy >> 2)) * nz + (iz >> 2)
            bit = ((ix & 3) << 4) | ((iy & 3) << 2) | (iz & 3)
            add_cell(b, bit, cloud)
            cloud.where[i] = (b << 6) | bit
            cloud.counts[N_OUTSIDE] -= 1
            cloud.counts[N_INSIDE] += 1
        x0, x1 = max(int(math.floor(x - r)), 0), min(int(math.floor(x + r)), tx - 1)
        y0, y1 = max(int(math.floor(y - r)), 0), min(int(math.floor(y + r)), ty - 1)
        for ix in range(x0, x1 + 1):
            dx = max(0.0, max(ix - x, x - ix - 1.0))
            for iy in range(y0, y1 + 1):
                dy = max(0.0, max(iy - y, y - iy - 1.0))
                rest = r * r - dx * dx - dy * dy
                if rest < 0.0:
                    continue
                w = math.sqrt(rest)
                z0 = max(int(math.floor(z - w)), 0)
                z1 = min(int(math.floor(z + w)), tz - 1)
                column = ((ix >> 2) * ny + (iy >> 2)) * nz
                row = ((ix & 3) << 4) | ((iy & 3) << 2)
                for iz in range(z0, z1 + 1):
                    add_cell(column + (iz >> 2), row | (iz & 3), cloud)
    # a point from outside is in a block that was added last
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]
    return cloud.counts[N_BAD]


@njit(**LEAN)
def place(points, T, out):
    """Write T @ p of points (n, 3) to `out` (n, 3); T (4, 4) is rigid."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for a in range(3):
            out[i, a] = T[a, 0] * x + T[a, 1] * y + T[a, 2] * z + T[a, 3]
