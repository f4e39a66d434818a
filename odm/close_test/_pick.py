"""The frame's points inside the cells of one motion: all that its close test needs.

The cells of a motion hold every point that comes within radius + rho + m of a cover
sphere along it, so points in other cells cannot be in its way.
"""

import numpy as np
from numba import njit

from odm.obstacles._cloud import IS_SORTED, N_GIVEN, N_INSIDE, N_LISTED, N_OCCUPIED
from odm.obstacles._occupancy import begin_box, put_point, unpacked
from roadmap.jit_options import INNER


@njit(**INNER)
def forget_cells(pick):
    """Begin anew: no cells are picked."""
    for k in range(pick.counts[N_OCCUPIED]):
        pick.words[pick.occupied[k]] = 0
    pick.counts[:] = 0


@njit(**INNER)
def pick_cells(pick, words, block, mask, begin, end):
    """Add the occupied cells of the list block, mask [begin:end]."""
    for k in range(begin, end):
        word = words[block[k]]
        if word != 0:
            pick_word(pick, block[k], word & mask[k])


@njit(**INNER)
def pick_word(pick, b, word):
    """Add cells of a block; none of them is left out for being there already."""
    if word == 0:
        return
    if pick.words[b] == 0:
        count = pick.counts[N_OCCUPIED]
        pick.occupied[count] = b
        pick.slot[b] = count
        pick.counts[N_OCCUPIED] = count + 1
    pick.words[b] |= word


@njit(**INNER)
def pick_points(pick, cloud, points):
    """Collect the points of the picked cells, by block; return their number.

    Where the cloud is sorted only the points of the picked blocks are looked at.
    """
    n_picked, n_points = pick.counts[N_OCCUPIED], cloud.counts[N_GIVEN]
    pick.counts[N_INSIDE] = 0
    pick.counts[IS_SORTED] = 1
    pick.counts[N_LISTED] = 0
    if n_picked == 0 or n_points == 0:
        return 0
    pick.counts[N_LISTED] = n_picked
    if cloud.counts[IS_SORTED] == 1:
        found = pick_sorted(pick, cloud)
    else:
        found = pick_unsorted(pick, cloud, points)
    pick.counts[N_INSIDE] = found
    return found


@njit(**INNER)
def pick_sorted(pick, cloud):
    """Collect the points of the picked cells from a sorted cloud, block by block."""
    n_listed, where = cloud.counts[N_LISTED], cloud.where
    found = 0
    for k in range(pick.counts[N_OCCUPIED]):
        b = pick.occupied[k]
        pick.start[k], word, s = found, pick.words[b], cloud.slot[b]
        begin_box(pick.box[k])
        if s >= n_listed:  # samples of shapes alone
            continue
        for p in range(cloud.start[s], cloud.start[s + 1]):
            i = cloud.order[p]
            if (word >> np.uint64(where[i] & 63)) & np.uint64(1) != 0:
                pick.order[found] = i
                put_point(cloud.xyz[p], pick.xyz[found], pick.box[k])
                found += 1
    pick.start[pick.counts[N_OCCUPIED]] = found
    return found


@njit(**INNER)
def pick_unsorted(pick, cloud, points):
    """Collect the points of the picked cells from a cloud that is not sorted."""
    n_picked = pick.counts[N_OCCUPIED]
    start, slot, box = pick.start, pick.slot, pick.box
    for k in range(n_picked + 1):
        start[k] = 0
    where, words, hits = cloud.where[: cloud.counts[N_GIVEN]], pick.words, pick.where
    # each point is written down, and the next one over it unless its cell is picked
    found = np.uint64(0)
    for i in range(np.uint64(where.shape[0])):
        inside, b, bit = unpacked(where[i])
        hits[found] = i
        found += (words[b] >> bit) & inside
    for j in range(found):
        start[slot[where[hits[j]] >> 6] + 1] += 1
    for k in range(n_picked):
        start[k + 1] += start[k]
        begin_box(box[k])
    for j in range(found):
        i = hits[j]
        k = slot[where[i] >> 6]
        at = start[k]
        start[k] = at + 1
        pick.order[at] = i
        put_point(points[i], pick.xyz[at], box[k])
    for k in range(n_picked, 0, -1):
        start[k] = start[k - 1]
    start[0] = 0
    return np.int64(found)
