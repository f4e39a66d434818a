"""The direct map: which items (nodes, then edges) the occupied cells invalidate."""

from numba import njit


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
def update_hits(ptr, items, masks, occupied, n_occupied, words, seen, hits, listed):
    """Bring `hits` (occupied blocks per item) up to the frame's `words`.

    `seen` (n_blocks,) are the words that `hits` stands for; `listed` (n_blocks + 1,)
    holds the number of blocks with seen cells at its end and their ids before it.
    Only the blocks whose word changed are read.
    """
    last = listed.shape[0] - 1
    kept = 0
    for k in range(listed[last]):
        b = listed[k]
        if words[b] != seen[b]:
            change_block(ptr, items, masks, b, words[b], seen, hits)
        if seen[b] != 0:
            listed[kept] = b
            kept += 1
    for k in range(n_occupied):
        b = occupied[k]
        if words[b] != seen[b]:
            change_block(ptr, items, masks, b, words[b], seen, hits)
            listed[kept] = b
            kept += 1
    listed[last] = kept


@njit(cache=True, nogil=True)
def change_block(ptr, items, masks, b, word, seen, hits):
    """Count the items of block b for `word` instead of seen[b]."""
    old = seen[b]
    changed = old ^ word
    for k in range(ptr[b], ptr[b + 1]):
        mask = masks[k]
        if mask & changed != 0:
            hits[items[k]] += (1 if mask & word != 0 else 0) - (
                1 if mask & old != 0 else 0
            )
    seen[b] = word


@njit(cache=True, nogil=True)
def invalid_items(hits, n_nodes, edges, nodes_out, edges_out):
    """List hit nodes, and edges hit themselves or at an end; return both numbers."""
    n = 0
    for i in range(n_nodes):
        if hits[i] > 0:
            nodes_out[n] = i
            n += 1
    m = 0
    for e in range(edges.shape[0]):
        if hits[n_nodes + e] > 0 or hits[edges[e, 0]] > 0 or hits[edges[e, 1]] > 0:
            edges_out[m] = e
            m += 1
    return n, m
