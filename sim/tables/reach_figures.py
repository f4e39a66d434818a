"""What a reach map is worth: the table of `odm workspace build` and `info`."""

import time
from collections.abc import Callable
from pathlib import Path

from handover import Chain, ReachMap, load_reach_map
from handover.reach.reach_recall import (
    Recall,
    center_rate,
    measure_recall,
    witness_precision,
)
from sim.tables.header import header
from sim.tables.table import print_bench, value_row

CELL_M, ROTATIONS = 0.05, 576  # the grid that limits are asked of
SECONDS, SECONDS_LONG = 30.0, 45.0  # up to 7 joints, and above; wall clock, 2 cores
SHARE, PRECISION = 97.0, 99.0  # [%]
SIZE_MB, LOAD_MS = 40.0, 10.0
_LOADS = 5
_CENTERS = 500


def measured(
    reach: ReachMap,
    folder: Path,
    chain: Chain,
    poses: int,
    tell: Callable[[str, int, int], None],
) -> tuple[list[dict], Recall | None]:
    """Return what a stored map is worth: rows as of a bench, and the recall.

    Rows have limits where the grid is the one they are asked of. `poses` are solved for
    the recall; 0: neither that nor centres. A chain with a robot is looked at for
    self-collision.
    """
    grid, built = reach.grid, reach.built
    fine = (grid.cell, grid.rotations.n_cells) == (CELL_M, ROTATIONS)
    asked = fine and reach.chain.unit == "m"
    seconds = SECONDS if chain.dof <= 7 else SECONDS_LONG
    threads = f"{built['threads']} thread{'s' if built['threads'] != 1 else ''}"
    rows = [
        value_row(
            "built in, wall clock",
            built["seconds"],
            "s",
            f"{threads}; of a machine that others use, too",
            most=seconds if asked else None,
        ),
        value_row(
            "processor time by thread",
            round(built["cpu_seconds"] / built["threads"], 2),
            "s",
            "what the wall clock would tell if nothing else ran, about",
        ),
    ]
    found = measure_recall(reach, chain, poses, progress=tell) if poses else None
    if found is not None and found.recall is not None:
        note = (
            f"+- {100 * found.margin:.1f} %: {found.marked} of {found.solvable} poses "
            f"that could be solved, of {found.poses} drawn"
        )
        limit = SHARE if asked else None
        rows.append(value_row("recall", _percent(found.recall), "%", note, least=limit))
    rows += _cell_rows(reach, chain, poses > 0, asked, tell)
    size = 1e-6 * sum(f.stat().st_size for f in folder.iterdir())
    limit = SIZE_MB if asked else None
    rows.append(value_row("size of the files", round(size, 2), "MB", most=limit))
    limit = LOAD_MS if asked else None
    note = f"by memory-map, the middle one of {_LOADS}"
    rows.append(value_row("load", _load_ms(folder), "ms", note, most=limit))
    return rows, found


def _cell_rows(
    reach: ReachMap, chain: Chain, centers: bool, asked: bool, tell: Callable
) -> list[dict]:
    if not reach.n_marked:
        return []
    precision = _percent(witness_precision(reach, chain, progress=tell))
    note = "marked cells whose witness, made again, is inside"
    note += ", within limits and free" if chain.robot else " and within limits"
    limit = PRECISION if asked else None
    rows = [value_row("precision in the cell", precision, "%", note, least=limit)]
    if centers and chain.dof >= 6:
        rate = center_rate(reach, chain, _CENTERS, progress=tell)
        note = "marked cells whose exact centre inverse kinematics reaches"
        rows.append(value_row("centres reached", _percent(rate), "%", note))
    return rows


def print_figures(name: str, rows: list[dict]) -> None:
    """Print the rows as a table, with machine and notes below."""
    result = {"title": f"reach map of {name}", "header": header(), "rows": rows}
    print_bench(result)


def _load_ms(folder: Path) -> float:
    took = []
    for _ in range(_LOADS):
        begun = time.perf_counter()
        load_reach_map(folder, verify=False)
        took.append(1e3 * (time.perf_counter() - begun))
    return round(sorted(took)[_LOADS // 2], 2)


def _percent(share: float) -> float:
    return round(100.0 * share, 2)
