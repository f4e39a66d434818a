"""Mark the cells of one position: which witness each keeps, and how it is stored."""

from typing import NamedTuple

import numpy as np
from numba import njit

from handover.reach._reach_build import (
    MAX_DEPTH,
    ROOT,
    position_neighbor,
    propagate,
    quality_byte,
)
from handover.reach._reach_lookup import ones
from handover.reach._reach_touch import touches_itself
from roadmap.compiling.jit_options import BARE, WITHIN_INNER
from roadmap.kinematics._chain import dexterity, draw_code, jacobian

_SURE = 3  # marked neighbours before a cell that no sample hit is tried
_TRIES = 5  # propagations to such a cell before it is given up
_QUEUE = 24  # entries per cell of a position


class Queue(NamedTuple):
    """Priority queue of one position's unfilled cells, by the quality they may get."""

    head: np.ndarray  # (256,) first entry of each quality, -1 for none
    entries: np.ndarray  # (2, m) rotation, and the next entry
    # (6,) first cell of the adjacent positions, -1 outside of the grid
    near: np.ndarray


def queue_of(n_rotations: int) -> Queue:
    """Return an empty queue."""
    return Queue(
        np.full(256, -1, np.int32),
        np.zeros((2, n_rotations * _QUEUE), np.int32),
        np.zeros(6, np.int64),
    )


@njit(**BARE)
def mark_positions(build, queue, positions, rules, counts):
    """Mark what can be marked at positions no two of which are neighbours.

    Best first: a cell's turn comes with the quality of its sample or of the best
    witness next to it, which is propagated into it; a sample that is much better
    becomes a root. Marked cells stay as they are, so that what was propagated from
    them can be replayed.

    Args:
        build: See `Build`.
        queue: Working memory.
        positions: (n,) position cells.
        rules: (3,) reference of the dexterity, seed, and the part of a sample's
            quality below which a propagated witness does not replace it.
        counts: (4,) is added to: cells marked, roots, propagations, witnesses refused
            for self-collision.
    """
    grid, cells = build.grid, build.cells
    n, n_neighbors = grid.size[3], grid.neighbors.shape[1]
    head, entries = queue.head, queue.entries
    for i in range(positions.shape[0]):
        first = positions[i] * n
        used, top = _begin(build, queue, positions[i])
        while top > 0:
            e = head[top]
            if e < 0:
                top -= 1
                continue
            head[top] = entries[1, e]
            r = entries[0, e]
            if cells.quality[first + r] != 0:
                continue
            key, predecessor = priority(grid.neighbors, queue.near, cells, first, r)
            if key == top:
                parent = -1
                if predecessor < n_neighbors:
                    parent = first + grid.neighbors[r, predecessor]
                elif predecessor != ROOT:
                    parent = queue.near[predecessor - n_neighbors] + r
                _mark(build, first + r, predecessor, parent, rules, counts)
                value = int(cells.quality[first + r])
                if value > 0:
                    for k in range(n_neighbors):
                        near = grid.neighbors[r, k]
                        if near < 0 or used >= entries.shape[1]:
                            break
                        if (
                            cells.quality[first + near] == 0
                            and cells.sample[first + near] < value
                        ):
                            used = _enter(head, entries, used, value, near)
                            top = max(top, value)
                    continue
                key, predecessor = priority(grid.neighbors, queue.near, cells, first, r)
            if key > 0 and used < entries.shape[1]:
                used = _enter(head, entries, used, key, r)
                top = max(top, key)


@njit(**WITHIN_INNER)
def _begin(build, queue, position):
    """Enter the cells of a position that are not marked; return entries and best key.

    Nothing is left of the position before: what a position does must not depend on
    which ones came before it.
    """
    grid, cells = build.grid, build.cells
    n = grid.size[3]
    first = position * n
    for axis in range(6):
        near = position_neighbor(grid, position, axis)
        queue.near[axis] = near * n if near >= 0 else -1
    build.touch.axes[:] = 0.0
    used, top = 0, 0
    for r in range(n):
        if cells.quality[first + r] == 0:
            key, _ = priority(grid.neighbors, queue.near, cells, first, r)
            if key > 0:
                used = _enter(queue.head, queue.entries, used, key, r)
                top = max(top, key)
    return used, top


@njit(**WITHIN_INNER)
def _enter(head, entries, used, key, r):
    entries[0, used] = r
    entries[1, used] = head[key]
    head[key] = used
    return used + 1


@njit(**WITHIN_INNER)
def priority(neighbors, near_positions, cells, first, r):
    """Return the best quality a cell may get, 0 for none, and from which neighbour.

    A step in position is shorter than one in rotation and arrives more often, so it
    counts eight times.
    """
    own = int(cells.sample[first + r])
    failed = np.uint32(0)
    if own == 0:
        failed = cells.source[first + r]
    marked, top, score, predecessor = 0, 0, 0, ROOT
    n = neighbors.shape[1]
    for k in range(6):
        if near_positions[k] >= 0:
            q = int(cells.quality[near_positions[k] + r])
            if q > 0:
                marked += 1
                if 8 * q > score and not (failed >> np.uint32(n + k)) & np.uint32(1):
                    top, score, predecessor = q, 8 * q, n + k
    for k in range(n):
        near = neighbors[r, k]
        if near < 0:
            break
        q = int(cells.quality[first + near])
        if q > 0:
            marked += 1
            if q > score and not (failed >> np.uint32(k)) & np.uint32(1):
                top, score, predecessor = q, q, k
    if own == 0:
        least = _SURE if predecessor >= n else _SURE + 2
        if marked < least or ones(np.uint64(failed)) >= min(_TRIES, marked // 2):
            return 0, ROOT
    return max(own, top), predecessor


@njit(**WITHIN_INNER)
def _mark(build, cell, predecessor, parent, rules, counts):
    """Propagate from `parent`, else take the sample; keep what gives a witness."""
    chain, grid, cells, touch, work = build
    least = rules[2] * cells.sample[cell]
    tried = False
    if parent >= 0 and cells.quality[parent] >= least:
        tried = True
        counts[2] += 1
        if propagate(chain, grid, cells.witness[parent], parent, cell, work):
            jacobian(chain, work.frames, work.jac)
            measure = dexterity(chain, work.q, work.jac, work.weighted, work.gram)
            value = quality_byte(measure, rules[0])
            if value >= least:
                if not touches_itself(touch, work.q, work.frames):
                    depth = cells.depth[parent] + 1
                    if depth > MAX_DEPTH:
                        depth, predecessor = 0, ROOT
                    _keep(cells, cell, value, predecessor, depth, work.code, counts)
                    return
                counts[3] += 1
    if cells.sample[cell] > 0:
        draw_code(int(rules[1]), cells.source[cell], work.code)
        _keep(cells, cell, cells.sample[cell], ROOT, 0, work.code, counts)
        return
    if tried:
        cells.source[cell] |= np.uint32(1) << np.uint32(predecessor)


@njit(**WITHIN_INNER)
def _keep(cells, cell, value, predecessor, depth, code, counts):
    cells.quality[cell] = value
    cells.predecessor[cell] = predecessor
    cells.depth[cell] = depth
    for j in range(code.shape[0]):
        cells.witness[cell, j] = code[j]
    counts[0] += 1
    if predecessor == ROOT:
        counts[1] += 1
