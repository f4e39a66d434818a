"""Cost to go over the whole roadmap, from every node to a goal.

Where the shortest edge is not tiny, nodes wait in buckets as wide as that edge (Dial,
Communications of the ACM 12(11), 1969): no node of a bucket can shorten the path of
another one in it, so their order does not matter and no heap is needed.
"""

import math

from numba import njit

from odm.search._astar import pop, push
from roadmap.jit_options import INNER, LEAN

MOST_BUCKETS = 4096
ROUNDING = 1.0 - 1e-12  # rounding must not lift the bound above the truth


@njit(**LEAN)
def exact_cost(graph, node, length, number, search, h):
    """Fill `h` (n,) with the cost to go to a goal.

    It is joined to `node` (number,) by motions of `length` (number,).
    """
    h[:] = math.inf
    if number == 0:
        return
    node, length = node[:number], length[:number]
    width = math.inf
    longest = 0.0
    for k in range(graph.adj_length.shape[0]):
        width = min(width, graph.adj_length[k])
        longest = max(longest, graph.adj_length[k])
    first, last = math.inf, 0.0
    for a in range(node.shape[0]):
        first, last = min(first, length[a]), max(last, length[a])
    span = max(longest, last - first)
    if width * MOST_BUCKETS > span:
        by_buckets(graph, node, length, search, h, width, span)
    else:
        lower_costs(graph, node, length, search, h, 1.0)
    for i in range(h.shape[0]):
        h[i] *= ROUNDING


@njit(**LEAN)
def lower_costs(graph, node, length, search, h, rounding):
    """Lower `h` (n,) where `node` (k,), joined by `length` (k,), is a shorter way.

    `h` is the cost to go by the motions that the goal had before, times `rounding`, or
    infinity. Only nodes whose cost falls, and their neighbours, are looked at
    (Dijkstra's algorithm).
    """
    entries = 0
    size = 0
    for a in range(node.shape[0]):
        if length[a] * rounding < h[node[a]]:
            h[node[a]] = length[a] * rounding
            search.e_node[entries] = node[a]
            push(search, size, length[a], entries)
            entries += 1
            size += 1
    while size > 0:
        f = search.heap_f[0]
        v = search.e_node[pop(search, size)]
        size -= 1
        if f * rounding > h[v]:
            continue
        for k in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
            w = graph.adj_node[k]
            through = f + graph.adj_length[k]
            if through * rounding < h[w] and entries < search.e_node.shape[0]:
                h[w] = through * rounding
                search.e_node[entries] = w
                push(search, size, through, entries)
                entries += 1
                size += 1


@njit(**INNER)
def by_buckets(graph, node, length, search, h, width, span):
    """Fill `h` by buckets of `width`: no edge is shorter, none over `span`."""
    head, after = search.heap_e, search.e_from
    count = min(int(span / width) + 3, head.shape[0])
    for b in range(count):
        head[b] = -1
    entries = 0
    waiting = 0
    first = math.inf
    for a in range(node.shape[0]):
        first = min(first, length[a])
        v = node[a]
        if length[a] < h[v]:
            h[v] = length[a]
            b = int(length[a] / width) % count
            search.e_node[entries], search.e_g[entries] = v, length[a]
            after[entries], head[b] = head[b], entries
            entries += 1
            waiting += 1
    at = int(first / width)
    while waiting > 0:
        b = at % count
        while head[b] >= 0:
            entry = head[b]
            head[b] = after[entry]
            waiting -= 1
            v, f = search.e_node[entry], search.e_g[entry]
            if f != h[v]:
                continue
            for k in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
                w = graph.adj_node[k]
                through = f + graph.adj_length[k]
                if through < h[w] and entries < after.shape[0]:
                    h[w] = through
                    c = int(through / width) % count
                    search.e_node[entries], search.e_g[entries] = w, through
                    after[entries], head[c] = head[c], entries
                    entries += 1
                    waiting += 1
        at += 1
