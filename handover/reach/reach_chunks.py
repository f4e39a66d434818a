"""A reach map in chunks, for workers that share no memory: a cluster, or a store.

A chunk of samples is its span of numbers. A chunk of positions, no two of which are
neighbours, is all that marking them reads: the cells of these positions and of those
next to them. What comes back is what marking them wrote. So the map has the bytes of
one that threads filled in place.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from handover.chain import Chain
from handover.reach import _reach_build as kernels
from handover.reach._reach_build import Build, Cells
from handover.reach._reach_mark import mark_positions, queue_of
from handover.reach.extremes import work_of
from handover.reach.reach_grid import ReachGrid, reach_grid
from handover.reach.reach_touch import touch_of
from roadmap.builds.chunks import Chunk, Job, Workers

_READ = Cells._fields  # all: what was marked before stays as it is
_WRITTEN = ("quality", "source", "predecessor", "depth", "witness")


class ReachSpec(NamedTuple):
    """What workers fill."""

    chain: Chain
    cell: float
    rotations: int


def empty_cells(n: int, dof: int) -> Cells:
    """Return the cells of a map in which nothing is marked."""
    # pages that are never touched, at places out of reach, take no memory
    return Cells(
        quality=np.zeros(n, np.uint8),
        sample=np.zeros(n, np.uint8),
        source=np.zeros(n, np.uint32),
        predecessor=np.zeros(n, np.uint8),
        depth=np.zeros(n, np.uint8),
        witness=np.zeros((n, dof), np.uint16),
    )


class Maker:
    """What one worker fills chunks with; each of its threads has cells of its own."""

    def __init__(self, spec: ReachSpec) -> None:
        self.chain = spec.chain
        self.grid = reach_grid(spec.chain, spec.cell, spec.rotations)
        self._idle: list[tuple] = []

    def take(self) -> tuple:
        """Return cells, build and queue that no other thread uses."""
        try:
            return self._idle.pop()
        except IndexError:
            cells = empty_cells(self.grid.n_cells, self.chain.dof)
            shared = self.chain.arrays, self.grid.arrays, cells
            build = Build(*shared, touch_of(self.chain), work_of(self.chain))
            return cells, build, queue_of(self.grid.rotations.n_cells)

    def give_back(self, taken: tuple) -> None:
        """Hand them to the next; their cells are empty again."""
        self._idle.append(taken)


def draw_chunk(
    maker: Maker,
    span: np.ndarray,
    rules: np.ndarray,
    cell: np.ndarray,
    sample: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Draw samples span[0, 0] to span[0, 1]; return which hit, their cells, qualities.

    `rules` (2,) are seed and reference; what is no better than the sample of its cell
    so far, `cell` and `sample` (n,), is left out.
    """
    taken = maker.take()
    taken[0].sample[cell] = sample
    start, end = (int(k) for k in span[0])
    where, value = np.empty(end - start, np.int32), np.empty(end - start, np.uint8)
    kernels.draw_samples(taken[1], int(rules[0]), start, rules[1], where, value)
    taken[0].sample[cell] = 0
    maker.give_back(taken)
    hit = np.flatnonzero(where >= 0).astype(np.int32)
    return hit, where[hit], value[hit]


def mark_chunk(
    maker: Maker,
    positions: np.ndarray,
    around: np.ndarray,
    rules: np.ndarray,
    *read: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Mark positions (k,), no two neighbours; return counts (4,), and what was written.

    `around` (m,) are these and all next to them, with their cells `read`; `rules` as in
    `mark_positions`.
    """
    taken = maker.take()
    cells, build, queue = taken
    rows = {name: _rows(maker.grid, getattr(cells, name)) for name in Cells._fields}
    for name, values in zip(_READ, read, strict=True):
        rows[name][around] = values
    counts = np.zeros(4, np.int64)
    mark_positions(build, queue, positions, rules, counts)
    written = tuple(rows[name][positions] for name in _WRITTEN)
    for name in Cells._fields:
        rows[name][around] = 0
    maker.give_back(taken)
    return (counts, *written)


def _rows(grid: ReachGrid, array: np.ndarray) -> np.ndarray:
    """Return an array of cells as (positions, rotations, ...)."""
    return array.reshape(grid.n_positions, grid.rotations.n_cells, *array.shape[1:])


class ChunkPool:
    """Fills the cells of a map chunk by chunk, by `workers`."""

    def __init__(
        self, workers: Workers, spec: ReachSpec, grid: ReachGrid, cells: Cells
    ) -> None:
        self.workers, self.spec, self.grid, self.cells = workers, spec, grid, cells
        self.rows = {n: _rows(grid, getattr(cells, n)) for n in Cells._fields}

    def draw(
        self, spans: list[tuple[int, int]], seed: int, reference: float
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Yield start, cell and quality of the samples of each span."""
        rules = np.array([seed, reference], float)
        cell = np.flatnonzero(self.cells.sample)
        there = rules, cell, self.cells.sample[cell]
        chunks = (Chunk(s[0], (np.array([s]), *there)) for s in spans)
        found = self.workers.map(self._job("draw_chunk", "sample"), chunks)
        for (start, end), (hit, cell, value) in zip(spans, found, strict=True):
            where = np.full(end - start, -1, np.int32)
            quality = np.zeros(end - start, np.uint8)
            where[hit], quality[hit] = cell, value
            yield start, where, quality

    def mark(self, groups: list[np.ndarray], rules: np.ndarray) -> Iterator[np.ndarray]:
        """Mark groups of positions, none next to another; yield the counts of each."""
        chunks = (self._chunk(group, rules) for group in groups)
        found = self.workers.map(self._job("mark_chunk", "position"), chunks)
        for group, (counts, *written) in zip(groups, found, strict=True):
            for name, values in zip(_WRITTEN, written, strict=True):
                self.rows[name][group] = values
            yield counts

    def _chunk(self, group: np.ndarray, rules: np.ndarray) -> Chunk:
        at = np.stack(np.unravel_index(group, self.grid.shape), axis=1)
        steps = np.concatenate([np.zeros((1, 3), int), np.eye(3, dtype=int)])
        near = (at[:, None] + np.concatenate([steps, -steps[1:]])).reshape(-1, 3)
        inside = ((near >= 0) & (near < self.grid.shape)).all(axis=1)
        around = np.unique(np.ravel_multi_index(near[inside].T, self.grid.shape))
        read = (self.rows[name][around] for name in _READ)
        return Chunk(int(group[0]), (group, around, rules, *read))

    def _job(self, function: str, stage: str) -> Job:
        where: Any = f"{__name__}:"
        return Job(where + function, where + "Maker", self.spec, stage, 1)
