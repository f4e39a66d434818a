"""Points of a frame into occupied cells, and into lists by block."""

import math

import numpy as np
from numba import njit

from odm.obstacles._cloud import (
    AS_GIVEN,
    CHUNK,
    LAYOUT,
    LINKED,
    N_BAD,
    N_GIVEN,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    N_OUTSIDE,
    SORTED,
    bits_of,
    cell_of,
)
from roadmap.compiling._rows import copy_row, in_line
from roadmap.compiling.jit_options import INNER, LEAN

BEYOND = float(1 << 30)  # cells from a corner: farther than any grid reaches
ROUNDING = 1e-9  # [m] by which a point may lie beside the block that it is in
_SIGN, _EXPONENT = np.int64(-(1 << 63)), np.int64(1 << 52)


@njit(**LEAN)
def place(points, T, out):
    """Write T @ p of points (n, 3) to `out` (n, 3); T (4, 4) is rigid."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for a in range(3):
            out[i, a] = T[a, 0] * x + T[a, 1] * y + T[a, 2] * z + T[a, 3]


@njit(**INNER)
def clear(cloud):
    """Forget the last frame's points, or the cells picked last."""
    for k in range(cloud.counts[N_OCCUPIED]):
        cloud.words[cloud.occupied[k]] = 0
    cloud.counts[:] = 0


@njit(**LEAN)
def mark_points(points, cloud):
    """Mark the cells of `points` (n, 3); count those outside and those not finite."""
    for k in range(cloud.counts.shape[0]):
        cloud.counts[k] = 0
    mark_more(points[:0], points, 0, points.shape[0], cloud)
    cloud.counts[N_GIVEN] = points.shape[0]
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]


@njit(**INNER)
def mark_more(given, points, begin, end, cloud):
    """Mark the cells of points[begin:end], too, for the test by cells alone.

    Where `given` (m, 3) has points they are copied to `points` first. All is done by
    chunks, each of which stays in the first cache.
    """
    source, flat = in_line(given), in_line(points)
    bad = 0
    for first in range(begin, end, CHUNK):
        last = min(first + CHUNK, end)
        chunk, where = flat[3 * first : 3 * last], cloud.where[first:last]
        if source.shape[0] > 0:
            copy_row(source[3 * first : 3 * last], chunk)
        steps = cloud.steps[: 3 * (last - first)]
        if find_steps(chunk, steps, cloud.corners, cloud.h) < 0:
            bad += count_not_finite(chunk, cloud.corners, cloud.h)
        find_cells(steps, where, cloud.shape)
    inside = mark_cells(cloud.where[begin:end], cloud)
    cloud.counts[N_INSIDE] += inside
    cloud.counts[N_OUTSIDE] += end - begin - inside - bad
    cloud.counts[N_BAD] += bad
    cloud.counts[LAYOUT] = AS_GIVEN


@njit(**INNER)
def mark_cells(where, cloud):
    """Mark cells block << 6 | bit, -1 for none; list their blocks; return how many."""
    words, occupied, slot = cloud.words, cloud.occupied, cloud.slot
    n_occupied = cloud.counts[N_OCCUPIED]
    n_inside = np.uint64(0)
    for i in range(np.uint64(where.shape[0])):
        inside, b, bit = unpacked(where[i])
        word = words[b]
        if (word == 0) & (inside != 0):
            occupied[n_occupied] = b
            slot[b] = n_occupied
            n_occupied += 1
        words[b] = word | (inside << bit)
        n_inside += inside
    cloud.counts[N_OCCUPIED] = n_occupied
    return np.int64(n_inside)


@njit(**INNER)
def unpacked(cell):
    """Return 1, block and bit of a cell block << 6 | bit; of -1 (outside) 0, 0 and 63.

    By arithmetic, since among points in any order a branch is often guessed wrong.
    """
    code = np.uint64(np.uint32(cell))
    inside = np.uint64(1) - (code >> np.uint64(31))
    return inside, (code >> np.uint64(6)) * inside, code & np.uint64(63)


@njit(**INNER)
def find_steps(flat, steps, corners, h):
    """Write to `steps` (3 n,) how many cells points are from the grid's corner.

    LLVM makes vector code of the loop: it has no branch, its index is unsigned, and it
    goes from one number to the next, whichever axis that is of.

    Args:
        flat: (3 n,) coordinates of the points, one point after the other.
        steps: Where they go, whole; -1 before the corner and for what is no number,
            BEYOND for all that is as far or farther.
        corners: (3 n,) or longer; the grid's corner, over and over.
        h: Size of a cell.

    Returns:
        A negative number if a coordinate is not finite, in cells.
    """
    inv = 1.0 / h
    odd = 0
    for k in range(np.uint64(flat.shape[0])):
        x = (flat[k] - corners[k]) * inv
        # the sign's bit is set where the exponent is the one of infinity
        odd |= (bits_of(x) & ~_SIGN) + _EXPONENT
        near = x if x < BEYOND else BEYOND
        steps[k] = np.int32(near) if x >= 0.0 else np.int32(-1)
    return odd


@njit(**INNER)
def count_not_finite(flat, corners, h):
    """Return how many points have a coordinate that is not finite, in cells."""
    inv, n = 1.0 / h, 0
    for k in range(0, flat.shape[0], 3):
        good = True
        for a in range(k, k + 3):
            good &= math.isfinite((flat[a] - corners[a]) * inv)
        n += not good
    return n


@njit(**INNER)
def find_cells(steps, where, shape):
    """Write to `where` (n,) the cells of points, -1 for those outside the grid.

    A cell is block << 6 | bit. In vector code as `find_steps`, whose `steps` it takes,
    by integers of 32 bits. `shape` (3,) are the blocks of the grid.
    """
    nby, nbz = np.int32(shape[1]), np.int32(shape[2])
    nx, ny, nz = np.uint32(4 * shape[0]), np.uint32(4 * nby), np.uint32(4 * nbz)
    for i in range(np.uint64(where.shape[0])):
        k = np.uint64(3) * i
        x, y, z = steps[k], steps[k + np.uint64(1)], steps[k + np.uint64(2)]
        # as an unsigned number -1 is larger than all
        inside = (np.uint32(x) < nx) & (np.uint32(y) < ny) & (np.uint32(z) < nz)
        where[i] = cell_of(x, y, z, nby, nbz) if inside else np.int32(-1)


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
    n_occupied, n_points = cloud.counts[N_LISTED], cloud.counts[N_GIVEN]
    start, slot, order = cloud.start, cloud.slot, cloud.order
    where = cloud.where[:n_points]
    for k in range(n_occupied + 1):
        start[k] = 0
    # points outside are laid out behind the last block
    for i in range(np.uint64(n_points)):
        start[place_of(where[i], slot, n_occupied)] += 1
    begin = 0
    for k in range(n_occupied + 1):
        begin, start[k] = begin + start[k], begin
    for i in range(np.uint64(n_points)):
        k = place_of(where[i], slot, n_occupied)
        order[start[k]] = i
        start[k] += 1
    for k in range(n_occupied, 0, -1):
        start[k] = start[k - 1]
    start[0] = 0
    for k in range(n_occupied):
        begin, end = np.int64(start[k]), np.int64(start[k + 1])
        put_points(points, order, begin, end, cloud.xyz, cloud.box[k])
    cloud.counts[LAYOUT] = SORTED


@njit(**INNER)
def pick_points(pick, cloud, points):
    """Collect the points of the picked cells, by block.

    Only those of the picked blocks are looked at: the cloud is sorted, or linked here.
    """
    n_picked, n_points = pick.counts[N_OCCUPIED], cloud.counts[N_GIVEN]
    pick.counts[N_INSIDE] = 0
    pick.counts[LAYOUT] = SORTED
    pick.counts[N_LISTED] = 0
    if n_picked == 0 or n_points == 0:
        return
    pick.counts[N_LISTED] = n_picked
    if cloud.counts[LAYOUT] == SORTED:
        pick.counts[N_INSIDE] = pick_sorted(pick, cloud)
        return
    if cloud.counts[LAYOUT] == AS_GIVEN:
        link_points(cloud)
    pick.counts[N_INSIDE] = pick_linked(pick, cloud, points)


@njit(**INNER)
def pick_sorted(pick, cloud):
    """Collect the points of the picked cells from a sorted cloud, block by block."""
    n_listed, where, order = cloud.counts[N_LISTED], cloud.where, cloud.order
    hits, one = pick.where, np.uint64(1)
    begin = np.uint64(0)
    for k in range(pick.counts[N_OCCUPIED]):
        b, found = pick.occupied[k], begin
        pick.start[k], word, s = begin, pick.words[b], cloud.slot[b]
        if s < n_listed:  # else it has samples of shapes alone
            # each point is written down, and the next one over it unless it is picked
            for p in range(np.uint64(cloud.start[s]), np.uint64(cloud.start[s + 1])):
                i = order[p]
                hits[found] = p
                pick.order[found] = i
                found += (word >> np.uint64(where[i] & 63)) & one
        first, last = np.int64(begin), np.int64(found)
        put_points(cloud.xyz, hits, first, last, pick.xyz, pick.box[k])
        begin = found
    pick.start[pick.counts[N_OCCUPIED]] = begin
    return np.int64(begin)


@njit(**INNER)
def link_points(cloud):
    """Let each of the marked points name the next one of its block, by its index."""
    n_listed, start, order = cloud.counts[N_LISTED], cloud.start, cloud.order
    where, slot = cloud.where[: cloud.counts[N_GIVEN]], cloud.slot
    for k in range(n_listed + 1):
        start[k] = -1
    # the last one first, so that each names one that comes later
    i = np.uint64(where.shape[0])
    while i > np.uint64(0):
        i -= np.uint64(1)
        k = place_of(where[i], slot, n_listed)
        order[i] = start[k]
        start[k] = i
    box_blocks(cloud)
    cloud.counts[LAYOUT] = LINKED


@njit(**INNER)
def box_blocks(cloud):
    """Let the box of each listed block be the block itself, a little larger."""
    side, ny, nz = 4.0 * cloud.h, cloud.shape[1], cloud.shape[2]
    for k in range(cloud.counts[N_LISTED]):
        b, box = np.int64(cloud.occupied[k]), cloud.box[k]
        at = b // (ny * nz), b // nz % ny, b % nz
        for a in range(3):
            begin = cloud.origin[a] + side * at[a]
            box[a], box[3 + a] = begin - ROUNDING, begin + side + ROUNDING


@njit(**INNER)
def pick_linked(pick, cloud, points):
    """Collect the points of the picked cells from a linked cloud, block by block."""
    n_listed, where, one = cloud.counts[N_LISTED], cloud.where, np.uint64(1)
    found = np.uint64(0)
    for k in range(pick.counts[N_OCCUPIED]):
        b, begin = pick.occupied[k], found
        pick.start[k], word, s = begin, pick.words[b], cloud.slot[b]
        if s < n_listed:  # else it has samples of shapes alone
            i = cloud.start[s]
            while i >= 0:
                # each is written down, and the next one over it unless it is picked
                pick.order[found] = i
                found += (word >> np.uint64(where[i] & 63)) & one
                i = cloud.order[i]
        first, last = np.int64(begin), np.int64(found)
        put_points(points, pick.order, first, last, pick.xyz, pick.box[k])
    pick.start[pick.counts[N_OCCUPIED]] = found
    return np.int64(found)


@njit(**INNER)
def place_of(cell, slot, outside):
    """Return the slot of a cell's block; `outside` of a cell outside the grid."""
    inside, b, _ = unpacked(cell)
    return np.uint64(slot[b]) * inside + np.uint64(outside) * (np.uint64(1) - inside)


@njit(**INNER)
def put_points(points, order, begin, end, xyz, box):
    """Copy points order[begin:end] to xyz[begin:end], and let a box (6,) hold them.

    The box is kept in registers: a number that is written to memory and read for the
    next point takes longer than all else here.
    """
    given, put = in_line(points), in_line(xyz)
    x0 = y0 = z0 = math.inf
    x1 = y1 = z1 = -math.inf
    for at in range(np.uint64(begin), np.uint64(end)):
        i, k = np.uint64(3) * np.uint64(order[at]), np.uint64(3) * at
        x, y, z = given[i], given[i + np.uint64(1)], given[i + np.uint64(2)]
        put[k], put[k + np.uint64(1)], put[k + np.uint64(2)] = x, y, z
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    box[0], box[1], box[2], box[3], box[4], box[5] = x0, y0, z0, x1, y1, z1


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
