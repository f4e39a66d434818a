"""A frame's verdicts on roadmap items, pool items and motions into a goal."""

import numpy as np
from numba import njit

from odm.obstacles._occupancy import list_hit
from odm.search._signature import apart
from odm.search._types import IS_GOAL, N_COUNTED, N_EDGE_TESTS

# A verdict is 4 * frame + one of these. BLOCKED: by its cells; MAYBE: the search is to
# ask the close test when it comes to it; REFUSED: the close test was asked
REFUSED, FREE, BLOCKED, MAYBE = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def is_taken(graph, item):
    """Return True if the direct map, brought up to the frame, counts an item."""
    return (graph.taken[item >> 6] >> np.uint64(item & 63)) & np.uint64(1) != 0


@njit(cache=True, nogil=True)
def item_free(graph, words, search, frame, item):
    """Return True if no occupied cell is in the list of a roadmap item; remembered."""
    known = search.memo[item]
    if known >> 1 == frame:
        return known & 1 == 0
    hit = 1 if graph.closed[item] else 0
    if search.stats[N_COUNTED] != 0:
        hit |= 1 if is_taken(graph, item) else 0
    elif hit == 0:
        search.stats[N_EDGE_TESTS] += 1
        if not apart(graph.sign, item, search.sign):
            begin, end = graph.ptr[item], graph.ptr[item + 1]
            if list_hit(words, graph.block, graph.mask, begin, end):
                hit = 1
    search.memo[item] = 2 * frame + hit
    return hit == 0


@njit(cache=True, nogil=True)
def edge_free(graph, words, search, frame, edge):
    """Return True if an edge and both its end nodes are free."""
    n = graph.adj_ptr.shape[0] - 1
    if not item_free(graph, words, search, frame, n + edge):
        return False
    if not item_free(graph, words, search, frame, graph.edges[edge, 0]):
        return False
    return item_free(graph, words, search, frame, graph.edges[edge, 1])


@njit(cache=True, nogil=True)
def pool_free(pool, words, frame_sign, item):
    """Return True if no occupied cell is in the list of a pool item."""
    if apart(pool.sign, item, frame_sign):
        return True
    return not list_hit(words, pool.block, pool.mask, pool.begin[item], pool.end[item])


@njit(cache=True, nogil=True)
def way_in_free(goals, pool, words, search, frame, g, a):
    """Return True if the cells of attachment a of goal g are free; remembered."""
    known = goals.memo[g, a]
    if known >> 2 == frame:
        return known & 3 == FREE
    ref = goals.ref[g, a]
    free = ref == IS_GOAL or pool_free(pool, words, search.sign, ref)
    goals.memo[g, a] = 4 * frame + (FREE if free else BLOCKED)
    return free
