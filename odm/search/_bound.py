"""Paths that earlier long searches found give an upper bound for the next search.

Where one of them is free in this frame, no path longer than it is of interest: A* need
not keep entries beyond it, and returns what it would have returned anyway.
"""

import math

import numpy as np
from numba import njit

from odm.search._items import FREE, goal_motion_free, item_free
from odm.search._recent import TOLL, item_in_avoided, ref_in_avoided
from odm.search._state import EDGE_BASE, view
from roadmap.jit_options import INNER

ROUNDING = 1.0 + 1e-9


@njit(**INNER)
def path_bound(state, starts, r, g, best):
    """Return the length of earlier path r to goal g if free and below `best`, or that.

    A path counts from any vertex that the start is joined to. Tolls may be counted
    twice: a bound that is too large cuts off too little, nothing else.
    """
    earlier, goals = view(state, "earlier_paths"), view(state, "goals")
    if earlier.vertex[r] != goals.vertex[g]:
        return best
    n = view(state, "graph").adj_ptr.shape[0] - 1
    free = 4 * view(state, "numbers").frame[0] + FREE
    avoid_history = view(state, "numbers").avoid_history[0] == 1
    length = goals.cost[g]
    for i in range(earlier.count[r]):
        v, via = np.int64(earlier.node[r, i]), np.int64(earlier.via[r, i])
        length += earlier.length[r, i]
        if avoid_history:
            ref = goals.ref[g, via] if i == 0 else EDGE_BASE - via
            if item_in_avoided(state, v) or ref_in_avoided(state, ref):
                length += TOLL * earlier.length[r, i]
        if length >= best:
            break
        if i == 0:
            if not goal_motion_free(state, g, via):
                break
        elif not item_free(state, n + via):
            break
        if not item_free(state, v):
            break
        for k in range(starts.count[0]):
            if starts.node[k] == v and starts.memo[k] == free:
                first = starts.length[k]
                if avoid_history and (
                    item_in_avoided(state, v) or ref_in_avoided(state, starts.ref[k])
                ):
                    first += TOLL * first
                best = min(best, length + first)
    return best


@njit(**INNER)
def recent_bound(state, starts, g):
    """Return the length of the path found last if it leads to g and is free, or inf."""
    earlier = view(state, "earlier_paths")
    r = earlier.count[earlier.vertex.shape[0] + 1]
    return ROUNDING * path_bound(state, starts, r, g, math.inf)


@njit(**INNER)
def free_bound(state, starts, g):
    """Return the length of the shortest earlier path to g that is free, or inf."""
    best = math.inf
    for r in range(view(state, "earlier_paths").vertex.shape[0]):
        best = path_bound(state, starts, r, g, best)
    return best * ROUNDING


@njit(**INNER)
def remember_path(state, entry, g):
    """Keep the path that ends in heap entry `entry` at goal g."""
    earlier, search, goals = (
        view(state, "earlier_paths"),
        view(state, "search"),
        view(state, "goals"),
    )
    rows = earlier.vertex.shape[0]
    r = earlier.count[rows]
    via = -2 - search.e_ref[entry]
    e = search.e_from[entry]
    count = 0
    after = search.e_g[entry]
    earlier.vertex[r] = -1
    while e >= 0:
        if count >= earlier.node.shape[1]:
            return
        earlier.node[r, count] = search.e_node[e]
        earlier.via[r, count] = via
        earlier.length[r, count] = after - search.e_g[e]
        after = search.e_g[e]
        via = EDGE_BASE - search.e_ref[e]
        e = search.e_from[e]
        count += 1
    if count == 0:
        return
    earlier.length[r, 0] -= goals.cost[g]
    earlier.count[r] = count
    earlier.vertex[r] = goals.vertex[g]
    same = row_with(earlier, r)
    if same >= 0:
        earlier.vertex[r] = -1
        earlier.count[rows + 1] = same
    else:
        earlier.count[rows] = (r + 1) % rows
        earlier.count[rows + 1] = r


@njit(**INNER)
def row_with(earlier, r):
    """Return another row whose path ends with all of path r; -1: there is none."""
    count = earlier.count[r]
    for s in range(earlier.vertex.shape[0]):
        if s == r or earlier.vertex[s] != earlier.vertex[r] or earlier.count[s] < count:
            continue
        same = earlier.via[s, 0] == earlier.via[r, 0]
        for i in range(count):
            same = same and earlier.node[s, i] == earlier.node[r, i]
        if same:
            return s
    return -1
