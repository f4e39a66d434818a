"""`odm bench build`: seconds by stage, bytes per edge, same bytes, two workers."""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from odm import build_map, load_map
from odm.cell_map.cell_map import CellMap
from roadmap.errors import BadInput
from sim.bench.fresh_build import fresh_build
from sim.tables.header import header
from sim.tables.table import TRUTH, value_row

# seconds on two cores, by recipe
ASKED_S = {"panda": 90.0, "demo": 20.0}
MOST_BYTES = 900.0  # per edge, each view
LEAST_TIMES = 1.8  # two workers against one process with one thread


def run(
    recipes: tuple[str, ...] = ("panda", "demo"),
    *,
    threads: tuple[int, ...] = (2, 1),
    workers: int | None = None,
    node_counts: str | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Build recipes in a temporary folder, with each number of threads.

    Args:
        recipes: Names or paths of recipes.
        threads: Numbers of threads to build with; the first is the one that is timed.
        workers: Processes of a Dask cluster that build the first recipe again, against
            one process with one thread, each started anew; None or 0: none.
        node_counts: Only that comparison, with so many nodes, with commas.
        tell: Called with what is about to be built.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".

    Raises:
        BadInput: Numbers of nodes without workers, or that cannot be read.
    """
    tell, rows, cell_map = tell or (lambda text: None), [], None
    setup = {"recipes": ", ".join(recipes), "threads": list(threads)}
    counts = _counts(node_counts, workers)
    with tempfile.TemporaryDirectory() as folder:
        for recipe in recipes if not counts else ():
            hashes = []
            for n in threads:
                tell(f"{recipe}, {n} threads")
                cell_map, times = _build(recipe, n, Path(folder))
                hashes.append(cell_map.hash)
                rows += _time_rows(recipe, n, times, timed=n == threads[0])
            if workers and recipe == recipes[0]:
                found, each = _worker_rows(recipe, None, workers, folder, tell)
                rows, hashes = rows + found, hashes + each
            rows += _map_rows(recipe, cell_map, hashes)
        for nodes in counts:
            found, each = _worker_rows(recipes[0], nodes, workers, folder, tell)
            same = float(len(set(each)) == 1)
            rows += [*found, value_row("... same bytes", same, TRUTH, least=1.0)]
    return {"bench": "build", "header": header(cell_map), "setup": setup, "rows": rows}


def _counts(text: str | None, workers: int | None) -> list[int]:
    if text is None:
        return []
    try:
        counts = [int(word) for word in text.split(",")]
    except ValueError:
        counts = []
    if not workers or not counts or min(counts) < 2:
        raise BadInput(
            f"--nodes is {text!r}, and --workers {workers or 0}; give numbers of nodes "
            "with commas, and --workers 2, too"
        )
    return counts


def _build(recipe: str, threads: int, folder: Path) -> tuple[CellMap, dict[str, float]]:
    path = folder / f"{Path(recipe).stem}-{threads}"
    begun, busy = time.perf_counter(), _cpu_seconds()
    built = build_map(recipe, threads=threads)
    made = time.perf_counter()
    built.save(path)
    saved = time.perf_counter()
    times = {
        "robot and roadmap": built.built["roadmap_seconds"],
        "cells": made - begun - built.built["roadmap_seconds"],
        "save": saved - made,
        "all": saved - begun,
        "all, CPU time": _cpu_seconds() - busy,
    }
    return load_map(path, verify=False), times


def _worker_rows(
    recipe: str,
    nodes: int | None,
    workers: int,
    folder: str,
    tell: Callable[[str], None],
) -> tuple[list[dict], list[str]]:
    """Build with one thread, then on a cluster made here, each in a new process."""
    what = recipe if nodes is None else f"{recipe}, {nodes:,} nodes"
    took = []
    for n in (0, workers):
        tell(f"{what}, {n or 'no'} workers, in a new process")
        with tempfile.TemporaryDirectory(dir=folder) as place:
            took.append(fresh_build(recipe, nodes, n, Path(place)))
    alone, both = took
    name = f"{what}, {workers} workers"
    by_clock = "times of the clock: on free cores only"
    by_cpu = (
        "by CPU time: where nobody helps, or workers load meanwhile if that is more, "
        "and chunks by the number of workers"
    )
    over = "CPU time in chunks over that of one thread"
    least = LEAST_TIMES if workers == 2 else None
    free = both.on_free_cores(workers)
    rows = [
        value_row(f"{what}, a new process with one thread: all", alone.wall, "s"),
        value_row("... all, CPU time", alone.cpu, "s"),
        value_row("... of these in chunks", alone.chunks, "s"),
        value_row(f"{name}: all", both.wall, "s"),
        value_row("... all, CPU time", both.cpu, "s"),
        value_row("... of these where nobody helps", both.alone, "s"),
        value_row("... while workers load", both.ahead, "s"),
        value_row("... in chunks", both.chunks, "s"),
        value_row("... over one thread", both.chunks / alone.chunks, "times", over),
        value_row("... speed-up on free cores", alone.cpu / free, "times", by_cpu,
                  least=least),
        value_row("... speed-up here", alone.wall / both.wall, "times", by_clock),
    ]  # fmt: skip
    return rows, [alone.hash, both.hash]


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of those that it made and that ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _time_rows(recipe: str, threads: int, times: dict, timed: bool) -> list[dict]:
    """Return a row for each stage; the limit counts for the first number of threads."""
    rows = []
    for stage, seconds in times.items():
        most = ASKED_S.get(recipe) if timed and stage == "all" else None
        name = f"{recipe}, {threads} threads: {stage}"
        rows.append(value_row(name, seconds, "s", most=most))
    return rows


def _map_rows(recipe: str, cell_map: CellMap, hashes: list[str]) -> list[dict]:
    roadmap = cell_map.roadmap
    by_edges, by_blocks = cell_map.arm_cells.bytes_by_view()
    n, same = roadmap.n_edges, float(len(set(hashes)) == 1)
    return [
        value_row(f"{recipe}: nodes", roadmap.n_nodes, ""),
        value_row(f"{recipe}: edges", n, ""),
        value_row(f"{recipe}: edge-major view", by_edges / n, "bytes per edge",
                  most=MOST_BYTES),
        value_row(f"{recipe}: direct view", by_blocks / n, "bytes per edge",
                  most=MOST_BYTES),
        value_row(f"{recipe}: same bytes for all", same, TRUTH, least=1.0),
    ]  # fmt: skip
