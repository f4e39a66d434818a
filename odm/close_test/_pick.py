"""The frame's points inside the cells of one motion: all that its close test needs.

The cells of a motion hold every point that comes within radius + rho + m of a cover
sphere along it, so points in other cells cannot be in its way.
"""

import numpy as np
from numba import njit

from odm.obstacles._cloud import IS_SORTED, N_HEEDED, N_INSIDE, N_LISTED, N_OCCUPIED
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
    """Collect the points of the picked cells, by block; return their number."""
    n_picked, n_points = pick.counts[N_OCCUPIED], cloud.counts[N_HEEDED]
    pick.counts[N_INSIDE] = 0
    pick.counts[IS_SORTED] = 1
    pick.counts[N_LISTED] = 0
    if n_picked == 0 or n_points == 0:
        return 0
    pick.counts[N_LISTED] = n_picked
    start, slot, box = pick.start, pick.slot, pick.box
    for k in range(n_picked + 1):
        start[k] = 0
    found = 0
    for i in range(n_points):
        at = cloud.where[i]
        if at < 0:
            continue
        if (pick.words[at >> 6] >> np.uint64(at & 63)) & np.uint64(1) != 0:
            pick.where[found] = i
            found += 1
            start[slot[at >> 6] + 1] += 1
    for k in range(n_picked):
        start[k + 1] += start[k]
        for a in range(3):
            box[k, a] = np.inf
            box[k, a + 3] = -np.inf
    for j in range(found):
        i = pick.where[j]
        k = slot[cloud.where[i] >> 6]
        at = start[k]
        start[k] = at + 1
        pick.order[at] = i
        for a in range(3):
            v = points[i, a]
            pick.xyz[at, a] = v
            box[k, a] = min(box[k, a], v)
            box[k, a + 3] = max(box[k, a + 3], v)
    for k in range(n_picked, 0, -1):
        start[k] = start[k - 1]
    start[0] = 0
    pick.counts[N_INSIDE] = found
    return found
