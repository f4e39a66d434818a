"""What the paper's rule for edges misses: stop when a middle adds no more cells."""

from dataclasses import dataclass

import numpy as np

from odm.cell_map import _sweep as sweep
from odm.cell_map.cell_map import ROUNDING, CellMap
from odm.cell_map.chunk_work import at_rest, swept_cells
from odm.cell_map.sweep import swept_by
from roadmap.kinematics.forward import difference

LEVEL = 7  # an edge is looked at in 2**LEVEL pieces


@dataclass(frozen=True)
class EdgeRule:
    """The paper's rule beside what is swept, on edges drawn at random.

    Cells are those of the sphere cover alone: the paper inflates nothing.

    Attributes:
        edges: Edges looked at.
        short: Edges of which the rule misses a cell that is swept.
        cells, missed: Swept cells of all of them, and those that the rule misses.
        middles: Configurations the rule looked at, per edge.
        bound_missed: Swept cells that the motion bound misses: must be 0.
        bound_cells: Cells of the motion bound.
        passed, asked: Questions "is this edge free of the arm's cells?" that are to
            be answered with no, and those that the rule answers with yes.
    """

    edges: int
    short: int
    cells: int
    missed: int
    middles: float
    bound_missed: int
    bound_cells: int
    asked: int
    passed: int


def edge_rule(cell_map: CellMap, occupied: np.ndarray, n: int, seed: int) -> EdgeRule:
    """Try the rule on `n` edges of a map.

    Args:
        cell_map: The map.
        occupied: (f, n_blocks) uint64 cells of the whole arm in some frames.
        n: Edges, drawn at random.
        seed: Of the draw.
    """
    roadmap, sweeper = cell_map.roadmap, _Sweeper(cell_map)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(roadmap.n_edges, min(n, roadmap.n_edges), replace=False)
    short = cells = missed = middles = loose = bound_cells = asked = passed = 0
    for edge in chosen:
        a, b = roadmap.nodes[roadmap.edges[edge]]
        dq = difference(cell_map.robot, a, b)
        words = sweeper.samples(a, dq)
        swept = np.bitwise_or.reduce(words)
        found, looked = by_rule(words)
        bound = sweeper.by_bound(a, dq)
        lost = swept & ~found
        n_lost = _count(lost)
        short, missed = short + (n_lost > 0), missed + n_lost
        cells, middles = cells + _count(swept), middles + looked
        loose, bound_cells = loose + _count(swept & ~bound), bound_cells + _count(bound)
        hit = (occupied & swept).any(axis=1)
        asked += int(hit.sum())
        passed += int((hit & ~(occupied & found).any(axis=1)).sum())
    return EdgeRule(
        len(chosen), short, cells, missed, middles / len(chosen), loose, bound_cells,
        asked, passed,
    )  # fmt: skip


def by_rule(words: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the cells the rule finds, and how many middles it looked at.

    Args:
        words: (2**k + 1, n_blocks) cells of the configurations along an edge.
    """
    found = words[0] | words[-1]
    stack, looked = [(0, len(words) - 1)], 0
    while stack:
        first, last = stack.pop()
        middle = (first + last) // 2
        if middle == first:
            continue
        looked += 1
        if not (words[middle] & ~found).any():
            continue
        found = found | words[middle]
        stack += [(middle, last), (first, middle)]
    return found, looked


def words_of(cells: np.ndarray, cell_map: CellMap) -> np.ndarray:
    """Return cells (n, 3) as one word of 64 bits for each block, (n_blocks,)."""
    shape = cell_map.grid.blocks
    inside = ((cells >= 0) & (cells < 4 * shape)).all(axis=1)
    x, y, z = cells[inside].T
    block = ((x >> 2) * shape[1] + (y >> 2)) * shape[2] + (z >> 2)
    bit = ((x & 3) << 4) | ((y & 3) << 2) | (z & 3)
    words = np.zeros(cell_map.grid.n_blocks, np.uint64)
    np.bitwise_or.at(words, block, np.uint64(1) << bit.astype(np.uint64))
    return words


class _Sweeper:
    def __init__(self, cell_map: CellMap) -> None:
        arm, grid = cell_map.arm, cell_map.grid
        radii = arm.spheres[:, 3] + ROUNDING
        self._swept = swept_by(arm, radii, cell_map.motion_tolerance, grid)
        self._n_blocks = grid.n_blocks
        self._shares = np.linspace(0.0, 1.0, 2**LEVEL + 1)[:, None]

    def samples(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """Return the cells of configurations along a motion, (n, n_blocks)."""
        points = q + self._shares * dq
        resting = at_rest(self._swept, points)
        counts, blocks, masks = swept_cells(self._swept, *resting)
        words = np.zeros((len(points), self._n_blocks), np.uint64)
        words[np.repeat(np.arange(len(points)), counts), blocks] = masks
        return words

    def by_bound(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """Return the cells of a motion by the motion bound, (n_blocks,)."""
        room = sweep.sweep_scratch(self._swept.arm, self._swept.grid, len(q))
        q, dq = np.ascontiguousarray(q), np.ascontiguousarray(dq)
        sweep.sweep_motion(self._swept, q, dq, room)
        return room.words


def _count(words: np.ndarray) -> int:
    return int(np.bitwise_count(words).sum())
