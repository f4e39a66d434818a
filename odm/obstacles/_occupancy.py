"""Points of a frame into occupied cells, and into lists by block."""

import math

import numpy as np
from numba import njit

from odm.obstacles._cloud import (
    IS_SORTED,
    N_BAD,
    N_HEEDED,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    N_OUTSIDE,
)
from roadmap.jit_options import INNER, LEAN


@njit(**INNER)
def clear(cloud):
    """Forget the last frame's points."""
    for k in range(cloud.counts[N_OCCUPIED]):
        cloud.words[cloud.occupied[k]] = 0
    cloud.counts[:] = 0


@njit(**LEAN)
def mark_points(points, cloud):
    """Mark the cells of `points` (n, 3); count those outside and those not finite."""
    for k in range(cloud.counts.shape[0]):
        cloud.counts[k] = 0
    mark_more(points, 0, points.shape[0], cloud)
    cloud.counts[N_HEEDED] = points.shape[0]
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]


@njit(**INNER)
def mark_more(points, begin, end, cloud):
    """Mark the cells of points[begin:end], too; the close test does not heed them."""
    ox, oy, oz = cloud.origin[0], cloud.origin[1], cloud.origin[2]
    inv = 1.0 / cloud.h
    nbx, nby, nbz = cloud.shape[0], cloud.shape[1], cloud.shape[2]
    top_x, top_y, top_z = 4.0 * nbx, 4.0 * nby, 4.0 * nbz
    words, occupied, where = cloud.words, cloud.occupied, cloud.where
    n_occupied = cloud.counts[N_OCCUPIED]
    outside = 0
    bad = 0
    for i in range(begin, end):
        x = (points[i, 0] - ox) * inv
        y = (points[i, 1] - oy) * inv
        z = (points[i, 2] - oz) * inv
        inside = x >= 0.0 and y >= 0.0 and z >= 0.0
        if inside and x < top_x and y < top_y and z < top_z:
            ix, iy, iz = int(x), int(y), int(z)
            b = ((ix >> 2) * nby + (iy >> 2)) * nbz + (iz >> 2)
            bit = ((ix & 3) << 4) | ((iy & 3) << 2) | (iz & 3)
            word = words[b]
            if word == 0:
                occupied[n_occupied] = b
                cloud.slot[b] = n_occupied
                n_occupied += 1
            words[b] = word | (np.uint64(1) << np.uint64(bit))
            where[i] = (b << 6) | bit
        else:
            where[i] = -1
            if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
                outside += 1
            else:
                bad += 1
    cloud.counts[N_OCCUPIED] = n_occupied
    cloud.counts[N_INSIDE] += end - begin - outside - bad
    cloud.counts[N_OUTSIDE] += outside
    cloud.counts[N_BAD] += bad
    cloud.counts[IS_SORTED] = 0


@njit(**LEAN)
def count_beyond(points, limit):
    """Return how many of points (n, 3) have a coordinate larger than `limit`."""
    n = 0
    for i in range(points.shape[0]):
        far = max(abs(points[i, 0]), max(abs(points[i, 1]), abs(points[i, 2])))
        n += not far <= limit
    return n


@njit(**LEAN)
def deepest(points, cloud):
    """Return how far the innermost of points (n, 3) is inside the grid [m]."""
    best = -math.inf
    for i in range(points.shape[0]):
        depth = math.inf
        for a in range(3):
            x = points[i, a] - cloud.origin[a]
            depth = min(depth, min(x, 4.0 * cloud.h * cloud.shape[a] - x))
        best = max(best, depth)
    return best


@njit(**LEAN)
def sort_points(points, cloud):
    """Lay the marked points out by block, once a frame and only when asked for."""
    n_occupied, n_points = cloud.counts[N_LISTED], cloud.counts[N_HEEDED]
    start, slot, box = cloud.start, cloud.slot, cloud.box
    for k in range(n_occupied + 1):
        start[k] = 0
    for i in range(n_points):
        if cloud.where[i] >= 0:
            start[slot[cloud.where[i] >> 6] + 1] += 1
    for k in range(n_occupied):
        start[k + 1] += start[k]
        for a in range(3):
            box[k, a] = math.inf
            box[k, a + 3] = -math.inf
    for i in range(n_points):
        if cloud.where[i] < 0:
            continue
        k = slot[cloud.where[i] >> 6]
        at = start[k]
        start[k] = at + 1
        cloud.order[at] = i
        for a in range(3):
            v = points[i, a]
            cloud.xyz[at, a] = v
            box[k, a] = min(box[k, a], v)
            box[k, a + 3] = max(box[k, a + 3], v)
    for k in range(n_occupied, 0, -1):
        start[k] = start[k - 1]
    start[0] = 0
    cloud.counts[IS_SORTED] = 1


@njit(**INNER)
def list_hit(words, block, mask, begin, end):
    """Return True if the cells of a list [begin:end] share one with `words`."""
    for k in range(begin, end):
        # few blocks are occupied: most masks need not be fetched
        word = words[block[k]]
        if word != 0 and word & mask[k] != 0:
            return True
    return False


@njit(**INNER)
def item_hit(ptr, blocks, masks, item, words):
    """Return the first entry of an item that shares a cell with `words`, or -1."""
    for k in range(ptr[item], ptr[item + 1]):
        if words[blocks[k]] & masks[k] != 0:
            return k
    return -1
