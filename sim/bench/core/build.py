"""`odm bench build`: seconds by stage, bytes per edge, same bytes, two workers."""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from odm import build_map, load_map
from odm.cell_map.cell_map import CellMap
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
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Build recipes in a temporary folder, with each number of threads.

    Args:
        recipes: Names or paths of recipes.
        threads: Numbers of threads to build with; the first is the one that is timed.
        workers: Processes of a Dask cluster that build the first recipe again, against
            one process with the last number of threads; None or 0: none.
        tell: Called with what is about to be built.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".
    """
    tell, rows, cell_map = tell or (lambda text: None), [], None
    with tempfile.TemporaryDirectory() as folder:
        for recipe in recipes:
            hashes = []
            for n in threads:
                tell(f"{recipe}, {n} threads")
                cell_map, times = _build(recipe, n, Path(folder))
                hashes.append(cell_map.hash)
                rows += _time_rows(recipe, n, times, timed=n == threads[0])
            if workers and recipe == recipes[0]:
                tell(f"{recipe}, {workers} workers")
                rows += _worker_rows(recipe, workers, times, Path(folder), hashes)
            rows += _map_rows(recipe, cell_map, hashes)
    setup = {"recipes": ", ".join(recipes), "threads": list(threads)}
    return {"bench": "build", "header": header(cell_map), "setup": setup, "rows": rows}


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
    recipe: str, workers: int, alone: dict, folder: Path, hashes: list[str]
) -> list[dict]:
    """Build on a cluster made here; `alone` is what one process took."""
    from sim.run.crew import Place, crew

    path = folder / f"{Path(recipe).stem}-workers"
    begun, busy = time.perf_counter(), _cpu_seconds()
    place = Place(workers=workers)
    with crew(path, 0, place, "odm.cell_map.chunk_work") as cluster:
        build_map(recipe, workers=cluster).save(path)
    took, used = time.perf_counter() - begun, _cpu_seconds() - busy
    hashes.append(load_map(path, verify=False).hash)
    name = f"{recipe}, {workers} workers"
    note = "what all processes took, over one process; the rest is where one waits"
    least = LEAST_TIMES if workers == 2 else None
    return [
        value_row(f"{name}: all", took, "s"),
        value_row(f"{name}: all, CPU time", used, "s"),
        value_row(f"{name}: CPU overhead", used / alone["all, CPU time"], "times",
                  note),
        value_row(f"{name}: speed-up against one thread", alone["all"] / took, "times",
                  "times of the clock: on free cores only", least=least),
    ]  # fmt: skip


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
