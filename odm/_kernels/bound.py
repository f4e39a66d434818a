"""Ways that long searches found lately bound the next one.

Where one of them is free in this frame, no way longer than it is of interest: A* need
not keep entries beyond it, and returns what it would have returned anyway.
"""

import math

from numba import njit

from odm._kernels.occupancy import list_hit
from odm._kernels.signature import apart
from odm._kernels.types import EDGE_BASE

ROUNDING = 1.0 + 1e-9


@njit(cache=True, nogil=True)
def open_item(graph, words, sign, item):
    """Return True if no occupied cell is in the list of a roadmap item."""
    if graph.closed[item]:
        return False
    if apart(graph.sign, item, sign):
        return True
    begin, end = graph.ptr[item], graph.ptr[item + 1]
    return not list_hit(words, graph.block, graph.mask, begin, end)


@njit(cache=True, nogil=True)
def free_bound(past, graph, words, starts, goals, g, search, free):
    """Return the length of the shortest past way to goal g that is free, or inf.

    A way counts from any vertex that the start is joined to.
    """
    n = graph.adj_ptr.shape[0] - 1
    best = math.inf
    for r in range(past.vertex.shape[0]):
        if past.vertex[r] != goals.vertex[g]:
            continue
        length = goals.cost[g]
        for i in range(past.count[r]):
            v, via = past.node[r, i], past.via[r, i]
            if i == 0:
                if goals.memo[g, via] != free:
                    break
            elif not open_item(graph, words, search.sign, n + via):
                break
            if not open_item(graph, words, search.sign, v):
                break
            length += past.length[r, i]
            if length >= best:
                break
            for k in range(starts.count[0]):
                if starts.node[k] == v and starts.memo[k] == free:
                    best = min(best, length + starts.length[k])
    return best * ROUNDING


@njit(cache=True, nogil=True)
def remember_way(past, search, goals, entry, g):
    """Keep the way that ends in heap entry `entry` at goal g."""
    last = past.count.shape[0] - 1
    r = past.count[last]
    via = -2 - search.e_ref[entry]
    e = search.e_from[entry]
    count = 0
    after = search.e_g[entry]
    past.vertex[r] = -1
    while e >= 0:
        if count >= past.node.shape[1]:
            return
        past.node[r, count] = search.e_node[e]
        past.via[r, count] = via
        past.length[r, count] = after - search.e_g[e]
        after = search.e_g[e]
        via = EDGE_BASE - search.e_ref[e]
        e = search.e_from[e]
        count += 1
    past.length[r, 0] -= goals.cost[g]
    past.count[r] = count
    past.vertex[r] = goals.vertex[g]
    if known_before(past, r):
        past.vertex[r] = -1
    else:
        past.count[last] = (r + 1) % past.vertex.shape[0]


@njit(cache=True, nogil=True)
def known_before(past, r):
    """Return True if another row holds the way of row r."""
    for s in range(past.vertex.shape[0]):
        if s == r or past.vertex[s] != past.vertex[r] or past.count[s] != past.count[r]:
            continue
        same = past.via[s, 0] == past.via[r, 0]
        for i in range(past.count[r]):
            same = same and past.node[s, i] == past.node[r, i]
        if same:
            return True
    return False
