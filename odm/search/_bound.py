"""Paths that long searches found lately bound the next one.

Where one of them is free in this frame, no path longer than it is of interest: A* need
not keep entries beyond it, and returns what it would have returned anyway.
"""

import math

import numpy as np
from numba import njit

from odm.search._items import FREE, item_free, way_in_free
from odm.search._recent import TOLL, item_wary, ref_wary
from odm.search._state import EDGE_BASE, view

ROUNDING = 1.0 + 1e-9


@njit(cache=True, nogil=True)
def way_bound(state, starts, r, g, best):
    """Return the length of past path r to goal g where it is free and below `best`.

    A path counts from any vertex that the start is joined to. Tolls may be counted
    twice: a bound that is too large cuts off too little, nothing else.
    """
    past, goals = view(state, "past"), view(state, "goals")
    if past.vertex[r] != goals.vertex[g]:
        return best
    n = view(state, "graph").adj_ptr.shape[0] - 1
    free = 4 * view(state, "numbers").frame[0] + FREE
    heed = view(state, "numbers").heed[0] == 1
    length = goals.cost[g]
    for i in range(past.count[r]):
        v, via = np.int64(past.node[r, i]), np.int64(past.via[r, i])
        length += past.length[r, i]
        if heed:
            ref = goals.ref[g, via] if i == 0 else EDGE_BASE - via
            if item_wary(state, v) or ref_wary(state, ref):
                length += TOLL * past.length[r, i]
        if length >= best:
            break
        if i == 0:
            if not way_in_free(state, g, via):
                break
        elif not item_free(state, n + via):
            break
        if not item_free(state, v):
            break
        for k in range(starts.count[0]):
            if starts.node[k] == v and starts.memo[k] == free:
                first = starts.length[k]
                if heed and (item_wary(state, v) or ref_wary(state, starts.ref[k])):
                    first += TOLL * first
                best = min(best, length + first)
    return best


@njit(cache=True, nogil=True)
def recent_bound(state, starts, g):
    """Return the length of the path found last if it leads to g and is free, or inf."""
    past = view(state, "past")
    r = past.count[past.vertex.shape[0] + 1]
    return ROUNDING * way_bound(state, starts, r, g, math.inf)


@njit(cache=True, nogil=True)
def free_bound(state, starts, g):
    """Return the length of the shortest past path to goal g that is free, or inf."""
    best = math.inf
    for r in range(view(state, "past").vertex.shape[0]):
        best = way_bound(state, starts, r, g, best)
    return best * ROUNDING


@njit(cache=True, nogil=True)
def remember_way(state, entry, g):
    """Keep the path that ends in heap entry `entry` at goal g."""
    past, search, goals = (
        view(state, "past"),
        view(state, "search"),
        view(state, "goals"),
    )
    rows = past.vertex.shape[0]
    r = past.count[rows]
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
    if count == 0:
        return
    past.length[r, 0] -= goals.cost[g]
    past.count[r] = count
    past.vertex[r] = goals.vertex[g]
    same = row_with(past, r)
    if same >= 0:
        past.vertex[r] = -1
        past.count[rows + 1] = same
    else:
        past.count[rows] = (r + 1) % rows
        past.count[rows + 1] = r


@njit(cache=True, nogil=True)
def row_with(past, r):
    """Return another row that ends as row r does, all its path; -1: there is none."""
    count = past.count[r]
    for s in range(past.vertex.shape[0]):
        if s == r or past.vertex[s] != past.vertex[r] or past.count[s] < count:
            continue
        same = past.via[s, 0] == past.via[r, 0]
        for i in range(count):
            same = same and past.node[s, i] == past.node[r, i]
        if same:
            return s
    return -1
