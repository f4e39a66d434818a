"""A* over the masks: an edge is looked at when it is about to be used, once a frame.

The open list holds unverified entries: several for one vertex, one for each way into
it. An entry is verified when it comes out first; so the first verified entry of a
vertex is its shortest free way, as in lazy A* (Cohen, Phillips, Likhachev 2014).
From the goal's side a flood runs along once the search takes longer than usual: a
goal (or a start) that is walled in is known when the smaller side is exhausted.
"""

import math

import numpy as np
from numba import njit

from odm._kernels.bound import free_bound, remember_way
from odm._kernels.direct import update_hits
from odm._kernels.occupancy import list_hit
from odm._kernels.signature import apart
from odm._kernels.types import (
    EDGE_BASE,
    N_COUNTED,
    N_EDGE_TESTS,
    N_FLOODED,
    N_POPPED,
)

LOOK_BACK = 10  # vertices closed before ways of the past are looked at
PATIENCE = 96  # vertices closed before the flood from the goal starts
MANY_TESTS = 600  # lists looked at before the direct map settles all items at once
FRESH = 2  # frames in which its counts change little
FRESH_TESTS = 150  # lists looked at before then


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
def pool_free(pool, words, frame_sign, item):
    """Return True if no occupied cell is in the list of a pool item."""
    if apart(pool.sign, item, frame_sign):
        return True
    return not list_hit(
        words, pool.block, pool.mask, pool.begin[item], pool.end[item]
    )


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
def a_star(graph, direct, cloud, starts, goals, only, h, search, past, frame, run):
    """Search from the start's free attachments to goal `only` (-1: any, with costs).

    starts.memo and goals.memo hold the frame's verdict of each attachment: 4 * frame
    + 1 is free; all others are left out. `run` is new for each search of a frame.
    Returns the heap entry of the goal, or -1.
    """
    n = graph.adj_ptr.shape[0] - 1
    words = cloud.words
    low = 0 if only < 0 else only
    high = goals.count[0] if only < 0 else only + 1
    free = 4 * frame + 1
    capacity = search.e_node.shape[0]
    entries = 0
    size = 0
    for k in range(starts.count[0]):
        if starts.memo[k] != free:
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
    many = MANY_TESTS if frame - direct.frame[0] > FRESH else FRESH_TESTS
    counted = search.stats[N_COUNTED] != 0
    popped = 0
    bound = math.inf  # no longer way is of interest
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
        if ref <= EDGE_BASE:
            if not item_free(graph, words, search, frame, n + EDGE_BASE - ref):
                continue
        search.done[v] = run
        popped += 1
        if v >= n:
            search.stats[N_POPPED] += popped
            if popped > LOOK_BACK and only >= 0:
                remember_way(past, search, goals, entry, only)
            return entry
        if popped == LOOK_BACK and only >= 0:
            bound = free_bound(past, graph, words, starts, goals, only, search, free)
        g_v = search.e_g[entry]
        for g in range(low, high):
            a = goals.at[g, v]
            if a >= 0 and goals.memo[g, a] == free and entries < capacity:
                length = g_v + goals.length[g, a] + goals.cost[g]
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
                if is_taken(graph, n + graph.adj_edge[k]):
                    continue
            elif search.memo[w] == 2 * frame + 1:
                continue
            hw = h[w]
            if hw == math.inf:
                continue
            length = g_v + graph.adj_length[k]
            if length + hw > bound:
                continue
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
                    if goals.memo[g, a] != free or search.flood[w] == run:
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
                tail = flood_step(
                    graph, words, search, frame, run, head, tail, counted
                )
                head += 1
                if tail == -1:
                    tail = -2
                continue
            # the goal's side is exhausted: hopeless unless a start lies in it
            inside = False
            for k in range(starts.count[0]):
                if starts.memo[k] == free and search.flood[starts.node[k]] == run:
                    inside = True
            for g in range(low, high):
                if goals.direct_memo[g] == free:
                    inside = True
            if not inside:
                size = 0
            tail = -2
    search.stats[N_POPPED] += popped
    return -1
