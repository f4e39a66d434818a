"""A frame's verdicts on roadmap items, pool items and motions into a goal.

An item's signature says which of 256 regions it sweeps, for a first look at 32 bytes. A
region is 2 x 2 x 2 blocks; regions that any item uses share the 256 bits round robin.
Where signature and frame have no bit in common, the item is free and its list need not
be fetched from memory.
"""

import numpy as np
from numba import njit

from odm.cell_map._packed import ON, packed_hit
from odm.obstacles._cloud import N_OCCUPIED
from odm.obstacles._occupancy import list_hit
from odm.search._state import IS_GOAL, view
from roadmap.compiling.jit_options import INNER, LEAN

# A verdict is 4 * frame + one of these. BLOCKED: by its cells; MAYBE: the search is to
# ask the close test when it comes to it; REFUSED: the close test was asked
REFUSED, FREE, BLOCKED, MAYBE = 0, 1, 2, 3


@njit(**LEAN)
def sign_items(start, step, region, signature):
    """Write the signatures of items to `signature` (4 per item), zero before."""
    for i in range(start.shape[0] - 1):
        after = 0
        for k in range(start[i, 0], start[i + 1, 0]):
            after += step[k]
            if step[k] == ON:
                continue
            bit = region[after - 1]
            signature[4 * i + (bit >> 6)] |= np.uint64(1) << np.uint64(bit & 63)


@njit(**INNER)
def sign_frame(cloud, region, signature):
    """Write the signature of the occupied blocks to `signature` (4,)."""
    for k in range(4):
        signature[k] = 0
    for k in range(cloud.counts[N_OCCUPIED]):
        bit = region[cloud.occupied[k]]
        signature[bit >> 6] |= np.uint64(1) << np.uint64(bit & 63)


@njit(**INNER)
def disjoint(signature, item, frame):
    """Return True if an item's signature has no bit in common with the frame's."""
    at = 4 * item
    common = (signature[at] & frame[0]) | (signature[at + 1] & frame[1])
    common |= (signature[at + 2] & frame[2]) | (signature[at + 3] & frame[3])
    return common == 0


@njit(**INNER)
def is_hit(graph, item):
    """Return True if the direct map, brought up to the frame, counts an item."""
    return (graph.hit_bits[item >> 6] >> np.uint64(item & 63)) & np.uint64(1) != 0


@njit(**INNER)
def is_hit_again(words, hit_at, item):
    """Return True if a roadmap item shares a cell with `words` where it did before.

    That reads one word, not its list.
    """
    block = hit_at[item, 0]
    return block != 0 and words[block - np.uint64(1)] & hit_at[item, 1] != 0


@njit(**INNER)
def graph_hit(words, graph, item, hit_at):
    """Return True if the cells of a roadmap item share one with `words`."""
    if is_hit_again(words, hit_at, item):
        return True
    lists = graph.start, graph.step, graph.code, graph.half, graph.full
    return packed_hit(words, *lists, item, hit_at)


@njit(**INNER)
def note_hit(search, item):
    """Note that a roadmap item is hit in this frame; more than fit are but counted."""
    if search.hits[0] < search.hit.shape[0]:
        search.hit[search.hits[0]] = item
    search.hits[0] += 1


@njit(**INNER)
def item_free(state, item):
    """Return True if no occupied cell is in the list of a roadmap item; remembered."""
    graph, search = view(state, "graph"), view(state, "search")
    stats = view(state, "stats")
    frame = view(state, "numbers").frame[0]
    known = search.memo[item]
    if known >> 1 == frame:
        return known & 1 == 0
    hit = 1 if graph.closed[item] else 0
    if stats.counted[0] != 0:
        hit |= 1 if is_hit(graph, item) else 0
    elif hit == 0:
        stats.edge_tests[0] += 1
        if not disjoint(graph.signature, item, search.signature):
            words = view(state, "cloud").words
            if graph_hit(words, graph, item, search.hit_at):
                hit = 1
    search.memo[item] = 2 * frame + hit
    if hit != 0:
        note_hit(search, item)
    return hit == 0


@njit(**INNER)
def item_free_now(state, item):
    """As `item_free`, of an item that was hit lately: that place is looked at first."""
    search, frame = view(state, "search"), view(state, "numbers").frame[0]
    if search.memo[item] >> 1 == frame:
        return search.memo[item] & 1 == 0
    if not is_hit_again(view(state, "cloud").words, search.hit_at, item):
        return item_free(state, item)
    view(state, "stats").edge_tests[0] += 1
    search.memo[item] = 2 * frame + 1
    note_hit(search, item)
    return False


@njit(**INNER)
def edge_free(state, edge):
    """Return True if an edge and both its end nodes are free."""
    graph = view(state, "graph")
    if not item_free(state, graph.adj_ptr.shape[0] - 1 + edge):
        return False
    if not item_free(state, graph.edges[edge, 0]):
        return False
    return item_free(state, graph.edges[edge, 1])


@njit(**INNER)
def pool_free(state, item):
    """Return True if no occupied cell is in the list of a pool item."""
    pool = view(state, "pool")
    if disjoint(pool.signature, item, view(state, "search").signature):
        return True
    words = view(state, "cloud").words
    return not list_hit(words, pool.block, pool.mask, pool.begin[item], pool.end[item])


@njit(**INNER)
def goal_motion_free(state, g, a):
    """Return True if the cells of attachment a of goal g are free; remembered.

    One that a frame has just joined has no cells that could tell.
    """
    goals, frame = view(state, "goals"), view(state, "numbers").frame[0]
    known = goals.memo[g, a]
    if known >> 2 == frame:
        return known & 3 == FREE
    ref = goals.ref[g, a]
    free = ref == IS_GOAL or (ref >= 0 and pool_free(state, ref))
    goals.memo[g, a] = 4 * frame + (FREE if free else BLOCKED)
    return free
