"""The direct map: which items (nodes, then edges) the occupied cells invalidate."""

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from odm.obstacles._cloud import N_OCCUPIED
from odm.search._state import view
from roadmap.compiling.jit_options import INNER, LEAN

# cell lists compared before the direct map decides all items: as long as that takes,
MANY_TESTS = 1000  # in maps of up to ITEMS nodes and edges, and more in larger ones
RECENT = 2  # frames in which its counts change little
RECENT_TESTS = 700  # cell lists compared before it does so then
ITEMS = 50_000
# an entry of a block that has changed takes so many times as long as one counted afresh
CHANGE_COSTS = 2


@njit(**INNER)
def update_hits(direct, graph, cloud, frame):
    """Bring the counts up to the frame's words; only changed blocks are read.

    Where most have changed, all are counted afresh: that takes less.
    """
    direct.frame[0] = frame
    listed = direct.listed
    last = listed.shape[0] - 1
    if is_other(direct, cloud):
        for k in range(listed[last]):
            direct.seen[listed[k]] = 0
        for i in range(direct.hits.shape[0]):
            direct.hits[i] = 0
        listed[last] = 0
    if listed[last] == 0:
        count_afresh(direct, graph, cloud)
        return
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
def is_other(direct, cloud):
    """Return True where counting afresh takes less than counting what has changed."""
    ptr, listed = direct.ptr, direct.listed
    changed = whole = 0
    for k in range(listed[listed.shape[0] - 1]):
        b = listed[k]
        if cloud.words[b] != direct.seen[b]:
            changed += ptr[b + 1] - ptr[b]
    for k in range(cloud.counts[N_OCCUPIED]):
        b = cloud.occupied[k]
        whole += ptr[b + 1] - ptr[b]
        if direct.seen[b] == 0:
            changed += ptr[b + 1] - ptr[b]
    return CHANGE_COSTS * changed > whole + direct.hits.shape[0]


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


@njit(**INNER)
def tests_worth_refreshing(state):
    """Return how many cell lists are compared in the time that `refresh` takes."""
    ago = view(state, "numbers").frame[0] - view(state, "direct").frame[0]
    many = RECENT_TESTS if ago <= RECENT else MANY_TESTS
    return max(many, many * view(state, "search").memo.shape[0] // ITEMS)


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
