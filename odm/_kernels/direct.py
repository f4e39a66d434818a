"""The direct map: which items (nodes, then edges) the occupied cells invalidate."""

import numpy as np
from numba import njit

from odm._kernels.state import cloud_of, direct_of, graph_of
from odm._kernels.types import N_OCCUPIED


@njit(cache=True, nogil=True)
def transpose_lists(ptr, blocks, masks, t_ptr, t_items, t_masks):
    """Turn item -> (block, mask) lists into block -> (item, mask) lists."""
    n_blocks = t_ptr.shape[0] - 1
    for b in range(n_blocks + 1):
        t_ptr[b] = 0
    for k in range(blocks.shape[0]):
        t_ptr[blocks[k] + 1] += 1
    for b in range(n_blocks):
        t_ptr[b + 1] += t_ptr[b]
    for item in range(ptr.shape[0] - 1):
        for k in range(ptr[item], ptr[item + 1]):
            at = t_ptr[blocks[k]]
            t_items[at] = item
            t_masks[at] = masks[k]
            t_ptr[blocks[k]] = at + 1
    for b in range(n_blocks, 0, -1):
        t_ptr[b] = t_ptr[b - 1]
    t_ptr[0] = 0


@njit(cache=True, nogil=True)
def update_hits(direct, graph, cloud):
    """Bring direct.hits up to the frame's words; only changed blocks are read."""
    listed = direct.listed
    last = listed.shape[0] - 1
    kept = 0
    for k in range(listed[last]):
        b = listed[k]
        if cloud.words[b] != direct.seen[b]:
            change_block(direct, graph, b, cloud.words[b])
        if direct.seen[b] != 0:
            listed[kept] = b
            kept += 1
    for k in range(cloud.counts[N_OCCUPIED]):
        b = cloud.occupied[k]
        if cloud.words[b] != direct.seen[b]:
            change_block(direct, graph, b, cloud.words[b])
            listed[kept] = b
            kept += 1
    listed[last] = kept


@njit(cache=True, nogil=True)
def change_block(direct, graph, b, word):
    """Count the items of block b for `word` instead of what was seen there."""
    n_nodes = graph.adj_ptr.shape[0] - 1
    hits = direct.hits
    old = direct.seen[b]
    changed = old ^ word
    for k in range(direct.ptr[b], direct.ptr[b + 1]):
        mask = direct.mask[k]
        if mask & changed == 0:
            continue
        step = (1 if mask & word != 0 else 0) - (1 if mask & old != 0 else 0)
        if step == 0:
            continue
        item = direct.item[k]
        before = hits[item]
        hits[item] = before + step
        if item < n_nodes and (before == 0 or before + step == 0):
            # a node that is blocked, or freed, takes its edges along
            for j in range(graph.adj_ptr[item], graph.adj_ptr[item + 1]):
                hits[n_nodes + graph.adj_edge[j]] += step
    direct.seen[b] = word


@njit(cache=True, nogil=True)
def refresh(state):
    """Bring the counts up to the frame whose points were taken."""
    update_hits(direct_of(state), graph_of(state), cloud_of(state))


@njit(cache=True, nogil=True)
def list_hits(pairs, first, n, out):
    """List which of the counts first..first + n - 1 are not 0; return their number.

    `pairs` views the counts two by two, so that free stretches pass quickly.
    """
    count = 0
    k = first
    while k < first + n:
        if k % 2 == 0 and k + 1 < first + n:
            word = pairs[k >> 1]
            if word == 0:
                k += 2
                continue
        word = pairs[k >> 1]
        half = (word >> np.uint64(32)) if k % 2 else (word & np.uint64(0xFFFFFFFF))
        if half != 0:
            out[count] = k - first
            count += 1
        k += 1
    return count
