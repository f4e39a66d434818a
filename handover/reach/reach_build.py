"""Build a ReachMap: draw, mark, pack; any number of threads gives the same bytes."""

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace

import numpy as np

from handover.chain import Chain
from handover.reach import _reach_build as kernels
from handover.reach import _reach_lookup as lookup
from handover.reach._reach_build import Build, Cells
from handover.reach._reach_mark import Queue, mark_positions, queue_of
from handover.reach.extremes import best_dexterity, work_of
from handover.reach.reach_chunks import ChunkPool, ReachSpec, empty_cells
from handover.reach.reach_grid import ReachGrid, reach_grid
from handover.reach.reach_map import ReachMap
from handover.reach.reach_touch import touch_of
from handover.reach.rotations import rotation_grid
from roadmap.builds.chunks import Progress, Workers
from roadmap.errors import BuildRefused
from roadmap.ranges import CheckedSettings, setting, settings_of

_CHUNK = 1 << 17  # samples drawn at a time
_POSITIONS = 16  # positions marked at a time
_BYTES = 9  # of a cell, without its witness
MAX_BYTES = 6e9  # of a build


@dataclass(frozen=True)
class ReachSettings(CheckedSettings):
    """How a reach map is filled.

    Attributes:
        cell: Side of a position cell, in the chain's unit.
        rotations: Cells of the rotation grid: 72 (60 deg), 576 (30 deg), 1944...
        samples: Configurations drawn; propagation fills in between them.
        seed: Same seed, same map.
        sweeps: Most passes over all positions; it ends where one adds next to nothing.
        keep: A witness propagated from a neighbour replaces a sample where it has at
            least this part of its quality. Smaller: a smaller file; larger: qualities
            nearer to the best.
        seconds: Draw for at most a third of this, then begin no pass after it; the
            first pass is always finished. None: no limit. With one the map depends on
            the machine.
    """

    cell: float = setting(0.05, 1e-3, 1.0)
    rotations: int = setting(576, 0, 10**9)
    samples: int = setting(3_000_000, 1000, 4_000_000_000)
    seed: int = setting(1, 0, 2**31)
    sweeps: int = setting(12, 1, 50)
    keep: float = setting(0.8, 0.0, 1.0)
    seconds: float | None = setting(None, 1e-9, np.inf, "s")

    def __post_init__(self) -> None:
        super().__post_init__()
        rotation_grid(self.rotations)


def build_reach_map(
    chain: Chain,
    settings: ReachSettings | None = None,
    threads: int = 0,
    progress: Progress | None = None,
    workers: Workers | None = None,
) -> ReachMap:
    """Mark the 6-D cells a chain reaches, each with a witness and its dexterity.

    Uniform samples come first. Then the cells of every position are marked, best
    first: a cell's witness is propagated from a neighbour's by a few damped steps, or
    is its best sample. Propagation also finds the rare cells that no sample hit. A
    map writes itself to a folder by its `save`.

    Args:
        chain: What reaches; `chain_of(robot)` or a person's arm.
        settings: See ReachSettings.
        threads: 0 for one per core; the map does not depend on it.
        progress: Called with (stage, done, total).
        workers: Who does the chunks, see `odm.build_map`; None: threads in place.

    Raises:
        BuildRefused: The grid would not fit in memory.
    """
    settings = settings_of(settings, ReachSettings)
    tell = progress or (lambda stage, done, total: None)
    begun, cpu = time.perf_counter(), time.process_time()
    grid = reach_grid(chain, settings.cell, settings.rotations)
    _check_size(grid, chain)
    cells = empty_cells(grid.n_cells, chain.dof)
    reference = best_dexterity(chain, settings.seed)
    threads = threads or os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as executor:
        pool = _Pool(executor, threads, (chain, grid, cells), settings.seconds, workers)
        try:
            drawn = _draw(pool, settings, reference, tell)
            counts, gains = _sweep(pool, settings, reference, tell)
        except BaseException:
            executor.shutdown(cancel_futures=True)
            raise
    if not counts[0]:
        raise BuildRefused(
            f"no configuration of {chain.name} was found free of self-collision; "
            "check its URDF, or build without self-collision"
        )
    tell("packing", 0, 1)
    reach = _packed(chain, grid, cells, reference)
    tell("packing", 1, 1)
    built = {
        "settings": asdict(settings),
        "threads": threads,
        "samples_drawn": drawn,
        "settled_by_sweep": gains,
        "pushes": int(counts[2]),
        "refused_for_self_collision": int(counts[3]),
        "stopped_early": pool.is_late(),
        "seconds": round(time.perf_counter() - begun, 2),
        "cpu_seconds": round(time.process_time() - cpu, 2),
    }
    return replace(reach, built=built)


class _Pool:
    """Threads that fill the same cells, each with working memory of its own."""

    def __init__(
        self,
        executor: ThreadPoolExecutor,
        threads: int,
        filled: tuple[Chain, ReachGrid, Cells],
        seconds: float | None,
        workers: Workers | None = None,
    ):
        chain, self.grid, self.cells = filled
        self.executor, self.size, self.begun = executor, threads, time.perf_counter()
        self.seconds = np.inf if seconds is None else seconds
        self.chunks: ChunkPool | None = None  # who works elsewhere, if anybody does
        if workers is not None:
            spec = ReachSpec(chain, self.grid.cell, self.grid.rotations.n_cells)
            self.chunks = ChunkPool(workers, spec, self.grid, self.cells)
        shared = chain.arrays, self.grid.arrays, self.cells
        n = self.grid.rotations.n_cells
        self._idle = [
            (Build(*shared, touch_of(chain), work_of(chain)), queue_of(n))
            for _ in range(threads)
        ]

    def run(self, job: Callable, items: list) -> Iterator:
        """Yield job(item, build, queue) for all items, in order."""

        def one(item: object) -> object:
            memory = self._idle.pop()
            try:
                return job(item, *memory)
            finally:
                self._idle.append(memory)

        return self.executor.map(one, items)

    def is_late(self, part: float = 1.0) -> bool:
        """Return True if this share of the time limit has passed."""
        return bool(time.perf_counter() - self.begun > part * self.seconds)


def _check_size(grid: ReachGrid, chain: Chain) -> None:
    need = grid.n_cells * (_BYTES + 2 * chain.dof)
    if need > MAX_BYTES or grid.n_cells >= 2**31:
        raise BuildRefused(
            f"the reach map of {chain.name} would have {grid.n_cells:,} cells and take "
            f"{need / 1e9:.1f} GB to build (limit {MAX_BYTES / 1e9:g}); take a larger "
            "cell or fewer rotations"
        )


def _draw(
    pool: _Pool, settings: ReachSettings, reference: float, tell: Progress
) -> int:
    """Enter the best sample of every cell; returns how many were drawn."""
    total, done = settings.samples, 0
    n_rotations = pool.grid.rotations.n_cells
    tell("drawing samples", done, total)

    def draw(span: tuple[int, int], build: Build, _: object) -> tuple:
        where = np.empty(span[1] - span[0], np.int32)
        value = np.empty(len(where), np.uint8)
        kernels.draw_samples(build, settings.seed, span[0], reference, where, value)
        return span[0], where, value

    while done < total and not pool.is_late(1 / 3):
        end = min(total, done + 8 * _CHUNK)
        spans = [(k, min(k + _CHUNK, end)) for k in range(done, end, _CHUNK)]
        if pool.chunks is not None:
            drawn = list(pool.chunks.draw(spans, settings.seed, reference))
        else:
            drawn = list(pool.run(draw, spans))

        def enter(part: int, *_: object, drawn: list = drawn) -> None:
            for start, where, value in drawn:
                kernels.keep_best(
                    part, pool.size, n_rotations, start, where, value, pool.cells
                )

        list(pool.run(enter, list(range(pool.size))))
        done = end
        tell("drawing samples", done, total)
    return done


def _sweep(
    pool: _Pool, settings: ReachSettings, reference: float, tell: Progress
) -> tuple[np.ndarray, list[int]]:
    """Propagate witnesses through all positions until a pass adds next to nothing."""
    n = pool.grid.rotations.n_cells
    marked = pool.cells.quality.reshape(-1, n)
    rules = np.array([reference, settings.seed, settings.keep])
    counts, gains = np.zeros(4, np.int64), []
    changed = pool.cells.sample.reshape(-1, n).any(axis=1)

    def mark(positions: np.ndarray, build: Build, queue: Queue) -> np.ndarray:
        added = np.zeros(4, np.int64)
        mark_positions(build, queue, positions, rules, added)
        return added

    for sweep in range(settings.sweeps):
        before = np.count_nonzero(marked, axis=1)
        groups = pool.grid.colours(changed)
        chunks = [
            [g[k : k + _POSITIONS] for k in range(0, len(g), _POSITIONS)]
            for g in groups
        ]
        total, done = sum(map(len, chunks)), 0
        for group in chunks:
            if pool.chunks is not None:
                marking = pool.chunks.mark(group, rules)
            else:
                marking = pool.run(mark, group)
            for added in marking:
                counts += added
                done += 1
                tell(f"marking cells, pass {sweep + 1}", done, total)
            if sweep and pool.is_late():
                break
        after = np.count_nonzero(marked, axis=1)
        gains.append(int(after.sum() - before.sum()))
        changed = after != before
        if pool.is_late() or gains[-1] < 3e-3 * after.sum():
            break
    return counts, gains


def _packed(chain: Chain, grid: ReachGrid, cells: Cells, reference: float) -> ReachMap:
    """Pack the marked cells of a build into a ReachMap."""
    n = grid.rotations.n_cells
    quality = cells.quality.reshape(-1, n)
    count = np.count_nonzero(quality, axis=1)
    occupied = np.flatnonzero(count)
    row_of = np.full(grid.n_positions, -1, np.int32)
    row_of[occupied] = np.arange(len(occupied))
    held = np.packbits(quality[occupied] != 0, axis=1, bitorder="little")
    bits = np.pad(held, ((0, 0), (0, -held.shape[1] % 8))).view(np.uint64)
    marked = np.flatnonzero(cells.quality)
    predecessor = cells.predecessor[marked]
    rooted = predecessor == kernels.ROOT
    row = row_of[marked[rooted] // n]
    packed = lookup.Packed(
        row_of=row_of,
        bits=bits,
        first=np.concatenate([[0], np.cumsum(count[occupied])]),
        first_root=np.searchsorted(row, np.arange(len(occupied) + 1)),
        quality=cells.quality[marked],
        predecessor=predecessor,
        roots=cells.witness[marked[rooted]],
    )
    return ReachMap(chain, grid, packed, float(reference))
