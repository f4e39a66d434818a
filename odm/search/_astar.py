"""A* over the masks: an edge is looked at when it is about to be used, once a frame.

The open list holds unverified entries: several for one vertex, one for each way into
it. An entry is verified when it comes out first; so the first verified entry of a
vertex is its shortest free way, as in lazy A* (Cohen, Phillips, Likhachev 2014).
From the goal's side a flood runs along once the search takes longer than usual: a
goal (or a start) that is walled in is known when the smaller side is exhausted.
"""

import math

from numba import njit

from odm.search._bound import free_bound, recent_bound, remember_way
from odm.search._invalidation import update_hits
from odm.search._items import FREE, MAYBE, is_taken, item_free, way_in_free
from odm.search._judge import start_clear, way_in_clear
from odm.search._state import (
    cloud_of,
    direct_of,
    goals_of,
    graph_of,
    own_of,
    past_of,
    pool_of,
    search_of,
)
from odm.search._types import EDGE_BASE, N_COUNTED, N_EDGE_TESTS, N_FLOODED, N_POPPED

LOOK_BACK = 8  # vertices closed before the last way is looked at,
LOOK_FARTHER = 12  # and all ways of the past where it is blocked
PATIENCE = 96  # vertices closed before the flood from the goal starts
MANY_TESTS = 1000  # lists looked at before the direct map settles all items at once
RECENT = 2  # frames in which its counts change little
RECENT_TESTS = 700  # lists looked at before then


@njit(cache=True, nogil=True)
def push(search, size, f, entry):
    """Add an entry to the heap of `size`; smaller f first, then older entries."""
    k = size
    while k > 0:
        up = (k - 1) >> 1
        if search.heap_f[up] <= f:
            break
        search.heap_f[k] = search.heap_f[up]
        search.heap_e[k] = search.heap_e[up]
        k = up
    search.heap_f[k] = f
    search.heap_e[k] = entry


@njit(cache=True, nogil=True)
def pop(search, size):
    """Take the first entry off the heap of `size`."""
    first = search.heap_e[0]
    size -= 1
    f, e = search.heap_f[size], search.heap_e[size]
    k = 0
    while True:
        low = 2 * k + 1
        if low >= size:
            break
        other = low + 1
        if other < size:
            fl, fo = search.heap_f[low], search.heap_f[other]
            if fo < fl or (fo == fl and search.heap_e[other] < search.heap_e[low]):
                low = other
        fl = search.heap_f[low]
        if f < fl or (f == fl and e < search.heap_e[low]):
            break
        search.heap_f[k] = fl
        search.heap_e[k] = search.heap_e[low]
        k = low
    search.heap_f[k] = f
    search.heap_e[k] = e
    return first


@njit(cache=True, nogil=True)
def flood_step(graph, words, search, frame, run, head, tail, counted):
    """Take one node off the goal side's queue; return the new tail, -1 if it met."""
    n = graph.adj_ptr.shape[0] - 1
    u = search.queue[head]
    search.stats[N_FLOODED] += 1
    for k in range(graph.adj_ptr[u], graph.adj_ptr[u + 1]):
        w = graph.adj_node[k]
        if search.flood[w] == run:
            continue
        if counted:
            item = n + graph.adj_edge[k]
            if is_taken(graph, item) or graph.closed[item]:
                continue
        elif not item_free(graph, words, search, frame, w):
            continue
        elif not item_free(graph, words, search, frame, n + graph.adj_edge[k]):
            continue
        if search.done[w] == run:
            return -1
        search.flood[w] = run
        search.queue[tail] = w
        tail += 1
    return tail


@njit(cache=True, nogil=True)
def can_enter(goals, pool, words, search, frame, g):
    """Return True if a motion into goal g is free, or may be by the close test."""
    for a in range(goals.number[g]):
        if way_in_free(goals, pool, words, search, frame, g, a):
            return True
        if goals.memo[g, a] == 4 * frame + MAYBE:
            return True
    return False


@njit(cache=True, nogil=True)
def a_star(state, points, starts, q, only, frame, run):
    """Search from q by its start motions to goal `only` (-1: any, with costs).

    starts.memo holds the frame's verdict of each start motion: free, or maybe, then
    the close test is asked when the motion comes out first; others are left out. So it
    is with the motions into a goal. `run` is new for each search of a frame.
    Returns the heap entry of the goal, or -1.
    """
    graph, direct, cloud = graph_of(state), direct_of(state), cloud_of(state)
    pool, goals, search = pool_of(state), goals_of(state), search_of(state)
    past = past_of(state)
    h = own_of(state).h_any if only < 0 else goals.h[only]
    n = graph.adj_ptr.shape[0] - 1
    words = cloud.words
    low = 0 if only < 0 else only
    high = goals.count[0] if only < 0 else only + 1
    free, maybe = 4 * frame + FREE, 4 * frame + MAYBE
    capacity = search.e_node.shape[0]
    entries = 0
    size = 0
    bound = math.inf  # no longer way is of interest
    for k in range(starts.count[0]):
        if starts.memo[k] != free and starts.memo[k] != maybe:
            continue
        v = starts.node[k]
        search.e_node[entries] = v
        search.e_ref[entries] = -2 - k
        search.e_from[entries] = -1
        search.e_g[entries] = starts.length[k]
        push(search, size, starts.length[k] + h[v], entries)
        entries += 1
        size += 1
    for g in range(low, high):
        if goals.direct_memo[g] == free:
            length = goals.direct_length[g] + goals.cost[g]
            search.e_node[entries] = n + g
            search.e_ref[entries] = -2
            search.e_from[entries] = -1
            search.e_g[entries] = length
            push(search, size, length, entries)
            entries += 1
            size += 1
    many = MANY_TESTS if frame - direct.frame[0] > RECENT else RECENT_TESTS
    counted = search.stats[N_COUNTED] != 0
    popped = 0
    head = 0
    tail = -1  # -1: the flood has not begun, -2: it is over
    while size > 0:
        if search.stats[N_EDGE_TESTS] > many and search.stats[N_COUNTED] == 0:
            # a long search pays for settling all items at once
            update_hits(direct, graph, cloud, frame)
            search.stats[N_COUNTED] = 1
            counted = True
        entry = pop(search, size)
        size -= 1
        v = search.e_node[entry]
        if search.done[v] == run:
            continue
        # the node first: its verdict settles all the entries that lead into it
        if v < n and not item_free(graph, words, search, frame, v):
            search.done[v] = run
            continue
        ref = search.e_ref[entry]
        if v >= n:
            g = v - n
            a = -2 - ref
            if search.e_from[entry] >= 0 and goals.memo[g, a] == maybe:
                if not way_in_clear(state, points, frame, g, a):
                    if can_enter(goals, pool, words, search, frame, g) or only < 0:
                        continue
                    break
        elif ref <= EDGE_BASE:
            if not item_free(graph, words, search, frame, n + EDGE_BASE - ref):
                continue
        else:
            k = -2 - ref
            if starts.memo[k] == maybe:
                start_clear(state, points, starts, q, frame, k)
            if starts.memo[k] != free:
                continue
        search.done[v] = run
        popped += 1
        if v >= n:
            search.stats[N_POPPED] += popped
            if popped > LOOK_BACK and only >= 0:
                remember_way(past, search, goals, entry, only)
            return entry
        if popped == LOOK_BACK and only >= 0:
            bound = recent_bound(
                past, graph, pool, words, starts, goals, only, search, frame
            )
        elif popped == LOOK_FARTHER and only >= 0 and bound == math.inf:
            bound = free_bound(
                past, graph, pool, words, starts, goals, only, search, frame
            )
        g_v = search.e_g[entry]
        for g in range(low, high):
            a = goals.at[g, v]
            if a < 0 or entries >= capacity:
                continue
            length = g_v + goals.length[g, a] + goals.cost[g]
            if length > bound:
                continue
            open_ = way_in_free(goals, pool, words, search, frame, g, a)
            if open_ or goals.memo[g, a] == maybe:
                search.e_node[entries] = n + g
                search.e_ref[entries] = -2 - a
                search.e_from[entries] = entry
                search.e_g[entries] = length
                push(search, size, length, entries)
                entries += 1
                size += 1
        if entries + graph.adj_ptr[v + 1] - graph.adj_ptr[v] > capacity:
            break
        for k in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
            w = graph.adj_node[k]
            if search.done[w] == run:
                continue
            if counted:
                # an edge's count has its end nodes in it
                item = n + graph.adj_edge[k]
                if is_taken(graph, item) or graph.closed[item]:
                    continue
            elif search.memo[w] == 2 * frame + 1:
                continue
            hw = h[w]
            if hw == math.inf:
                continue
            length = g_v + graph.adj_length[k]
            if length + hw > bound:
                continue
            if counted:
                # all that is left can be used: only a shorter way in is of interest
                if search.near_run[w] == run and search.near_g[w] <= length:
                    continue
                search.near_run[w] = run
                search.near_g[w] = length
            search.e_node[entries] = w
            search.e_ref[entries] = EDGE_BASE - graph.adj_edge[k]
            search.e_from[entries] = entry
            search.e_g[entries] = length
            push(search, size, length + hw, entries)
            entries += 1
            size += 1
        if popped < PATIENCE or tail == -2 or bound < math.inf:
            continue
        if tail == -1:
            tail = 0
            for g in range(low, high):
                for a in range(goals.number[g]):
                    w = goals.node[g, a]
                    if search.flood[w] == run:
                        continue
                    open_ = way_in_free(goals, pool, words, search, frame, g, a)
                    if not open_ and goals.memo[g, a] != maybe:
                        continue
                    if search.done[w] == run:
                        tail = -2
                        break
                    if item_free(graph, words, search, frame, w):
                        search.flood[w] = run
                        search.queue[tail] = w
                        tail += 1
                if tail == -2:
                    break
        for _ in range(8 if counted else 2):
            if tail < 0:
                break
            if head < tail:
                tail = flood_step(graph, words, search, frame, run, head, tail, counted)
                head += 1
                if tail == -1:
                    tail = -2
                continue
            # the goal's side is exhausted: hopeless unless a start lies in it
            inside = False
            for k in range(starts.count[0]):
                can = starts.memo[k] == free or starts.memo[k] == maybe
                if can and search.flood[starts.node[k]] == run:
                    inside = True
            for g in range(low, high):
                if goals.direct_memo[g] == free:
                    inside = True
            if not inside:
                size = 0
            tail = -2
    search.stats[N_POPPED] += popped
    return -1
