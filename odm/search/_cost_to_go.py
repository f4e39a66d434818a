"""Cost to go over the whole roadmap, from every node to a goal.

Where the shortest edge is not tiny, nodes wait in buckets as wide as that edge (Dial,
Communications of the ACM 12(11), 1969): no node of a bucket can shorten the path of
another one in it, so their order does not matter and no heap is needed.
"""

import numpy as np
from numba import njit

from odm.search._astar import pop, push
from roadmap.compiling.jit_options import BARE, BARE_INNER

MOST_BUCKETS = 4096
NARROWER = 1.0 + 1e-9  # than the shortest edge buckets are: sums are rounded
ROUNDING = 1.0 - 1e-12  # rounding must not lift the bound above the truth


@njit(**BARE)
def lower_costs(graph, node, length, search, h, shortest, longest):
    """Lower `h` (n,) where `node` (k,), joined by `length` (k,), is a shorter way.

    `h` is the cost to go by the motions that the goal had before, or infinity. Only
    nodes whose cost falls, and their neighbours, are looked at (Dijkstra's algorithm).
    No edge is shorter than `shortest` or longer than `longest`.
    """
    span = longest
    for a in range(length.shape[0]):
        for b in range(a):
            span = max(span, abs(length[a] - length[b]))
    count, least = 1, NARROWER * span / shortest + 3.0
    while count < least and count < MOST_BUCKETS:
        count *= 2
    if count >= least and count <= search.heap_e.shape[0]:
        by_buckets(graph, node, length, search, h, NARROWER / shortest, count)
    else:
        by_heap(graph, node, length, search, h)


@njit(**BARE_INNER)
def by_buckets(graph, node, length, search, h, per_length, count):
    """Lower `h` by `count` buckets, a power of two; `per_length` of them are 1 long."""
    head, after, mask = search.heap_e, search.e_from, np.uint64(count - 1)
    for b in range(count):
        head[b] = -1
    entries, waiting, first = np.int64(0), 0, np.inf
    for a in range(node.shape[0]):
        if length[a] * ROUNDING < h[node[a]]:
            h[node[a]] = length[a] * ROUNDING
            first = min(first, length[a])
            c = np.uint64(length[a] * per_length) & mask
            search.e_node[entries], search.e_g[entries] = node[a], length[a]
            after[entries], head[c] = head[c], entries
            entries += 1
            waiting += 1
    at = np.uint64(first * per_length) if waiting > 0 else np.uint64(0)
    while waiting > 0:
        b = at & mask
        while head[b] >= 0:
            entry = np.uint64(head[b])
            head[b] = after[entry]
            waiting -= 1
            v, f = np.uint64(search.e_node[entry]), search.e_g[entry]
            if f * ROUNDING > h[v]:
                continue
            begin, end = graph.adj_ptr[v], graph.adj_ptr[v + np.uint64(1)]
            for k in range(np.uint64(begin), np.uint64(end)):
                w = np.uint64(graph.adj_node[k])
                through = f + graph.adj_length[k]
                if through * ROUNDING < h[w]:
                    h[w] = through * ROUNDING
                    c = np.uint64(through * per_length) & mask
                    search.e_node[entries], search.e_g[entries] = w, through
                    after[entries], head[c] = head[c], entries
                    entries += 1
                    waiting += 1
        at += np.uint64(1)


@njit(**BARE_INNER)
def by_heap(graph, node, length, search, h):
    """Lower `h` by a heap, which takes edges of any length."""
    entries = 0
    size = 0
    for a in range(node.shape[0]):
        if length[a] * ROUNDING < h[node[a]]:
            h[node[a]] = length[a] * ROUNDING
            search.e_node[entries] = node[a]
            push(search, size, length[a], entries)
            entries += 1
            size += 1
    while size > 0:
        f = search.heap_f[0]
        v = search.e_node[pop(search, size)]
        size -= 1
        if f * ROUNDING > h[v]:
            continue
        for k in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
            w = graph.adj_node[k]
            through = f + graph.adj_length[k]
            if through * ROUNDING < h[w]:
                h[w] = through * ROUNDING
                search.e_node[entries] = w
                push(search, size, through, entries)
                entries += 1
                size += 1
