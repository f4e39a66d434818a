"""The direct map: which items (nodes, then edges) the occupied cells invalidate."""

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from odm.obstacles._cloud import N_OCCUPIED
from odm.search._state import view
from roadmap.jit_options import INNER, LEAN


@njit(**INNER)
def update_hits(direct, graph, cloud, frame):
    """Bring the counts up to the frame's words; only changed blocks are read."""
    direct.frame[0] = frame
    if direct.listed[direct.listed.shape[0] - 1] == 0:
        count_afresh(direct, graph, cloud)
        return
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


@njit(**INNER)
def count_afresh(direct, graph, cloud):
    """Count all items for the frame; nothing is counted yet."""
    n_nodes = graph.adj_ptr.shape[0] - 1
    hits, item, mask = direct.hits, direct.item, direct.mask
    n_occupied = cloud.counts[N_OCCUPIED]
    for i in range(n_occupied):
        b = cloud.occupied[i]
        word = cloud.words[b]
        # half of the items are hit: adding 0 costs less than a wrong guess
        for k in range(direct.ptr[b], direct.ptr[b + 1]):
            hits[item[k]] += np.int32(mask[k] & word != 0)
        direct.seen[b] = word
        direct.listed[i] = b
    direct.listed[direct.listed.shape[0] - 1] = n_occupied
    for v in range(n_nodes):
        if hits[v] != 0:
            for j in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
                hits[n_nodes + graph.adj_edge[j]] += 1
    for k in range(direct.bits.shape[0]):
        word = np.uint64(0)
        for i in range(64 * k, min(64 * k + 64, hits.shape[0])):
            word |= np.uint64(hits[i] != 0) << np.uint64(i & 63)
        direct.bits[k] = word


@njit(**INNER)
def change_block(direct, graph, b, word):
    """Count the items of block b for `word` instead of what was seen there."""
    n_nodes = graph.adj_ptr.shape[0] - 1
    old = direct.seen[b]
    # first collect, without a branch to guess wrong; most items do not turn
    count = 0
    for k in range(direct.ptr[b], direct.ptr[b + 1]):
        mask = direct.mask[k]
        direct.changed[count] = k
        count += np.int64((mask & old != 0) != (mask & word != 0))
    for i in range(count):
        k = direct.changed[i]
        item = direct.item[k]
        step = 1 if direct.mask[k] & word != 0 else -1
        if count_item(direct, item, step) and item < n_nodes:
            # a node that is blocked, or freed, takes its edges along
            for j in range(graph.adj_ptr[item], graph.adj_ptr[item + 1]):
                count_item(direct, n_nodes + graph.adj_edge[j], step)
    direct.seen[b] = word


@njit(**INNER)
def count_item(direct, item, step):
    """Change an item's count by `step`; return True if it was or becomes 0."""
    before = direct.hits[item]
    direct.hits[item] = before + step
    if before != 0 and before + step != 0:
        return False
    direct.bits[item >> 6] ^= np.uint64(1) << np.uint64(item & 63)
    return True


@njit(**LEAN)
def refresh(state):
    """Bring the counts up to the frame whose points were taken."""
    direct, frame = view(state, "direct"), view(state, "numbers").frame[0]
    update_hits(direct, view(state, "graph"), view(state, "cloud"), frame)


@intrinsic
def trailing_zeros(typingctx, word):  # noqa: ANN001, ANN201
    """Return the number of the lowest bit that is set in a uint64."""

    def codegen(context, builder, _signature, args):  # noqa: ANN001, ANN202
        return builder.cttz(args[0], context.get_constant(types.boolean, True))

    return types.uint64(types.uint64), codegen


@njit(**LEAN)
def list_bits(bits, first, n, out):
    """List which of the bits first..first + n - 1 are set; return their number."""
    count = 0
    last = first + n
    for k in range(first >> 6, (last + 63) >> 6):
        word = bits[k]
        if k == first >> 6:
            word &= ~np.uint64(0) << np.uint64(first & 63)
        if last - 64 * k < 64:
            word &= (np.uint64(1) << np.uint64(last - 64 * k)) - np.uint64(1)
        base = 64 * k - first
        while word != 0:
            out[count] = base + np.int64(trailing_zeros(word))
            count += 1
            word &= word - np.uint64(1)
    return count
