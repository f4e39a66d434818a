"""Where the obstacles have lately been: stamps of blocks, and their cells by period.

A block keeps when it was last occupied, and which of its cells were, in a ring of four
periods of a third of the memory each. So a cell is remembered for the memory and at
most a third longer, while its block is occupied; and no cell of a block is remembered
any longer than the memory after the block was left. A frame costs one look at each
occupied block. All cells are laid out only where a search asks: they rank paths, and
neither free nor block a motion.
"""

import math

import numpy as np
from numba import njit

from odm.cell_map._packed import ON, word_of
from odm.obstacles._cloud import N_OCCUPIED
from odm.obstacles._occupancy import list_hit
from odm.search._items import disjoint, graph_hit
from odm.search._state import EDGE_BASE, view
from roadmap.compiling.jit_options import INNER, LEAN

PERIOD_S = 0.01  # [s] between two frames where no time is given
PERIODS = 3  # of the memory; the ring has one more
TOLL = 3.0  # times its length a motion counts more that enters wary cells,
TOLLED = 160  # and so many vertices of a search, until it is content with any way
_SLACK_S = 1e-6  # clocks round
# of a word's bits ix << 4 | iy << 2 | iz, those at the high end of an axis
_HIGH_X = np.uint64(0xFFFF000000000000)
_HIGH_Y = np.uint64(0xF000F000F000F000)
_HIGH_Z = np.uint64(0x8888888888888888)
_LOW_X, _LOW_Y = np.uint64(0x000000000000FFFF), np.uint64(0x000F000F000F000F)
_LOW_Z = np.uint64(0x1111111111111111)


@njit(**LEAN)
def forget_recent(recent):
    """Forget where the obstacles have been."""
    last = recent.listed.shape[0] - 1
    for k in range(recent.listed[last]):
        drop_block(recent, recent.listed[k])
    recent.listed[last] = 0
    recent.clock[0] = 0.0
    recent.laid[0] = -1


@njit(**INNER)
def drop_block(recent, b):
    """Forget a block."""
    recent.when[b] = -math.inf
    for g in range(PERIODS + 1):
        recent.cells[(PERIODS + 1) * b + g] = 0


@njit(**INNER)
def turn_ring(recent, b, period):
    """Forget the cells of a block that are older than the ring of `period`."""
    old, size = recent.period[b], PERIODS + 1
    if old == period:
        return
    first = old + 1
    if period < old or period - old > size:
        first = period - PERIODS
    for g in range(first, period + 1):
        recent.cells[size * b + g % size] = 0
    recent.period[b] = period


@njit(**INNER)
def stamp(recent, b, word, now, period):
    """Remember that cells of a block are occupied now."""
    if recent.when[b] == -math.inf:
        last = recent.listed.shape[0] - 1
        recent.listed[recent.listed[last]] = b
        recent.listed[last] += 1
    turn_ring(recent, b, period)
    recent.when[b] = now
    recent.cells[(PERIODS + 1) * b + period % (PERIODS + 1)] |= word


@njit(**INNER)
def remember(state, now):
    """Stamp the blocks of the frame; `now` NaN: a frame of 10 ms after the last."""
    recent, cloud = view(state, "recent"), view(state, "cloud")
    if math.isnan(now):
        now = recent.clock[0] + PERIOD_S
    if now < recent.clock[0]:  # a clock that was set back: another beginning
        forget_recent(recent)
    recent.clock[0] = now
    period = this_period(state, now)
    for k in range(cloud.counts[N_OCCUPIED]):
        b = cloud.occupied[k]
        stamp(recent, b, cloud.words[b], now, period)


@njit(**INNER)
def this_period(state, now):
    """Return the number of the period that a time lies in."""
    return np.int64(math.floor(now * PERIODS / view(state, "rules").history_s[0]))


@njit(**INNER)
def lay_out_recent(state):
    """Lay out the cells that were occupied lately, and those to be wary of; once.

    Wary of: those occupied lately, and those of the frame grown by `rings` of cells.
    """
    recent, frame = view(state, "recent"), view(state, "numbers").frame[0]
    if recent.laid[0] == frame:
        return
    recent.laid[0] = frame
    last = recent.marked.shape[0] - 1
    for k in range(recent.marked[last]):
        b = recent.marked[k]
        recent.occupied[b] = 0
        recent.avoided[b] = 0
    recent.marked[last] = 0
    rules, now, kept = view(state, "rules"), recent.clock[0], 0
    period = this_period(state, now)
    for k in range(recent.listed[last]):
        b = recent.listed[k]
        if recent.when[b] < now - rules.history_s[0] - _SLACK_S:
            drop_block(recent, b)
            continue
        recent.listed[kept] = b
        kept += 1
        turn_ring(recent, b, period)
        word = np.uint64(0)
        for g in range(PERIODS + 1):
            word |= recent.cells[(PERIODS + 1) * b + g]
        recent.occupied[b] = word
        add_cells(recent, b, word)
    recent.listed[last] = kept
    cloud = view(state, "cloud")
    for k in range(cloud.counts[N_OCCUPIED]):
        b = cloud.occupied[k]
        recent.occupied[b] |= cloud.words[b]
        add_cells(recent, b, cloud.words[b])
    grow(recent, cloud, rules.rings[0])
    region = view(state, "graph").region
    for k in range(4):
        recent.sign[k] = 0
    for k in range(recent.marked[last]):
        bit = region[recent.marked[k]]
        recent.sign[bit >> 6] |= np.uint64(1) << np.uint64(bit & 63)


@njit(**INNER)
def add_cells(recent, b, word):
    """Be wary of some cells of a block."""
    if word == 0:
        return
    if recent.avoided[b] == 0:
        last = recent.marked.shape[0] - 1
        recent.marked[recent.marked[last]] = b
        recent.marked[last] += 1
    recent.avoided[b] |= word


@njit(**INNER)
def grow(recent, cloud, rings):
    """Be wary of the cells beside the frame's, along the axes, `rings` cells far."""
    if rings <= 0:
        return
    for k in range(cloud.counts[N_OCCUPIED]):
        b = cloud.occupied[k]
        grow_block(recent, cloud.shape, b, cloud.words[b])
    last = recent.marked.shape[0] - 1
    for _ in range(rings - 1):
        n = recent.marked[last]
        for k in range(n):
            recent.grown[k] = recent.avoided[recent.marked[k]]
        for k in range(n):
            grow_block(recent, cloud.shape, recent.marked[k], recent.grown[k])


@njit(**INNER)
def grow_block(recent, shape, b, word):
    """Be wary of the six neighbours of each cell of a block's `word`."""
    ny, nz = shape[1], shape[2]
    x, y, z = b // (ny * nz), b // nz % ny, b % nz
    inside = ((word & ~_HIGH_X) << np.uint64(16)) | (word >> np.uint64(16))
    inside |= ((word & ~_HIGH_Y) << np.uint64(4)) | ((word & ~_LOW_Y) >> np.uint64(4))
    inside |= ((word & ~_HIGH_Z) << np.uint64(1)) | ((word & ~_LOW_Z) >> np.uint64(1))
    add_cells(recent, b, inside)
    if x + 1 < shape[0]:
        add_cells(recent, b + ny * nz, (word & _HIGH_X) >> np.uint64(48))
    if x > 0:
        add_cells(recent, b - ny * nz, (word & _LOW_X) << np.uint64(48))
    if y + 1 < ny:
        add_cells(recent, b + nz, (word & _HIGH_Y) >> np.uint64(12))
    if y > 0:
        add_cells(recent, b - nz, (word & _LOW_Y) << np.uint64(12))
    if z + 1 < nz:
        add_cells(recent, b + 1, (word & _HIGH_Z) >> np.uint64(3))
    if z > 0:
        add_cells(recent, b - 1, (word & _LOW_Z) << np.uint64(3))


@njit(**INNER)
def item_in_avoided(state, item):
    """Return True if a roadmap item's own cells are to be wary of; remembered."""
    recent, graph = view(state, "recent"), view(state, "graph")
    frame = recent.laid[0]
    known = recent.memo[item]
    if known >> 1 == frame:
        return known & 1 == 1
    hit = 0
    if not disjoint(graph.signature, item, recent.sign):
        if graph_hit(recent.avoided, graph, item, view(state, "search").hit_at):
            hit = 1
    recent.memo[item] = 2 * frame + hit
    return hit == 1


@njit(**INNER)
def pool_wary(state, item):
    """Return True if cells of a pool item are to be wary of."""
    pool, recent = view(state, "pool"), view(state, "recent")
    if disjoint(pool.signature, item, recent.sign):
        return False
    begin, end = pool.begin[item], pool.end[item]
    return list_hit(recent.avoided, pool.block, pool.mask, begin, end)


@njit(**INNER)
def ref_in_avoided(state, ref):
    """Return True if the cells of a path's segment are wary; unknown ones are not."""
    if ref >= 0:
        return pool_wary(state, ref)
    if ref > EDGE_BASE:
        return False
    graph, edge = view(state, "graph"), EDGE_BASE - ref
    if item_in_avoided(state, graph.adj_ptr.shape[0] - 1 + edge):
        return True
    if item_in_avoided(state, np.int64(graph.edges[edge, 0])):
        return True
    return item_in_avoided(state, np.int64(graph.edges[edge, 1]))


@njit(**INNER)
def path_in_avoided(state, path):
    """Return True if cells of a path are to be wary of."""
    for k in range(path.count[0] - 1):
        if ref_in_avoided(state, path.ref[k]):
            return True
    return False


@njit(**INNER)
def list_was_hit(state, block, mask, begin, end):
    """Return True if cells of a list [begin:end] were occupied lately, but not now.

    What is occupied now is asked by the close test.
    """
    lately, words = view(state, "recent").occupied, view(state, "cloud").words
    for k in range(begin, end):
        word = lately[block[k]]
        if word != 0 and word & ~words[block[k]] & mask[k] != 0:
            return True
    return False


@njit(**INNER)
def graph_was_hit(state, graph, item):
    """As `list_was_hit`, of a roadmap item."""
    lately, words = view(state, "recent").occupied, view(state, "cloud").words
    after, at = np.uint64(0), np.uint64(graph.start[item, 1])
    for k in range(graph.start[item, 0], graph.start[item + 1, 0]):
        after += np.uint64(graph.step[k])
        if graph.step[k] == ON:
            continue
        b, own, at = after - np.uint64(1), graph.code[at], at + np.uint64(1)
        left = lately[b] & ~words[b]
        if left != 0 and left & word_of(own, graph.half, graph.full) != 0:
            return True
    return False


@njit(**INNER)
def path_crosses_history(state, path):
    """Return True if a path is free only now: through cells left lately."""
    pool, graph = view(state, "pool"), view(state, "graph")
    n = graph.adj_ptr.shape[0] - 1
    for k in range(path.count[0] - 1):
        ref = path.ref[k]
        if not ref_in_avoided(state, ref):
            continue
        if ref >= 0:
            begin, end = pool.begin[ref], pool.end[ref]
            if list_was_hit(state, pool.block, pool.mask, begin, end):
                return True
            continue
        edge = EDGE_BASE - ref
        a, b = np.int64(graph.edges[edge, 0]), np.int64(graph.edges[edge, 1])
        for item in (n + edge, a, b):
            if graph_was_hit(state, graph, item):
                return True
    return False


@njit(**LEAN)
def is_history_left(state):
    """Return True if there are cells that were occupied lately, not now."""
    lay_out_recent(state)
    recent, words = view(state, "recent"), view(state, "cloud").words
    for k in range(recent.listed[recent.listed.shape[0] - 1]):
        b = recent.listed[k]
        if recent.occupied[b] & ~words[b] != 0:
            return True
    return False


@njit(**LEAN)
def was_hit(state, item):
    """Return True if a pool item has cells that were occupied lately, not now."""
    lay_out_recent(state)
    pool = view(state, "pool")
    begin, end = pool.begin[item], pool.end[item]
    return list_was_hit(state, pool.block, pool.mask, begin, end)
