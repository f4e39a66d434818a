"""`odm bench memory`: a long run of the loop; its memory, deadlines and latency.

Frames follow each other as fast as they go. Memory is the resident memory of the
process, so that compiled code and C++ libraries count too. The bench keeps numbers
only, in arrays that are written before the first frame.
"""

import gc
import os
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm import CellMap, ReactivePlanner, load_map
from roadmap.errors import BadInput
from sim.bench.clock import time_row
from sim.loop.loop import Loop, LoopSettings
from sim.people.human_motion import HumanMotion
from sim.people.scenes import before_work_places
from sim.run.places import DEMO, find_places, person_of, warm_up
from sim.run.request import RunRequest
from sim.tables.header import header
from sim.tables.table import value_row

GROWTH_MB = 1.0  # asked of an hour
P50_US, P99_US = 300.0, 2000.0  # asked of a step with timing and braking test
LOOKS = 60  # so often memory is looked at; the first tenth of the run is not counted
_LISTED = 50  # so many late frames by wall clock are listed, or all by CPU time
_STATM = Path("/proc/self/statm")


def run(
    map_dir: str | Path,
    *,
    seconds: float = 3600.0,
    motions: Sequence[str] = ("sweep",),
    execution: str = "timed",
    seed: int = 0,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Run the loop for a long time and measure how its memory grows.

    Args:
        map_dir: Folder of a built map.
        seconds: Simulated time of each run [s].
        motions: The people, one run after another in this process.
        execution: "timed" or "kinematic"; see `sim.loop.loop.LoopSettings`.
        seed: Of the motions.
        short: Few seconds: to see that it runs, not to measure.
        tell: Called with what is about to run.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "memory" (by motion: simulated
        time [s] and memory [MB] at each look) and "late" (by motion: frames late by
        wall clock, first all that are by CPU time, then the latest).

    Raises:
        BadInput: The run is shorter than the looks at its memory, or a motion is
            unknown.
    """
    seconds = min(seconds, 6.0) if short else seconds
    settings = replace(
        DEMO, duration_s=seconds, seed=seed, execution=execution, keep_paths=0
    )
    n = round(seconds * settings.rate_hz)
    if n < LOOKS:
        raise BadInput(
            f"{seconds:g} s are {n} frames; memory is looked at {LOOKS} times, so give "
            f"at least {LOOKS / settings.rate_hz:g} s"
        )
    people = [person_of(RunRequest(Path(map_dir), name, seed=seed)) for name in motions]
    cell_map = load_map(map_dir, verify=False)
    rows, memory, late = [], {}, {}
    for person in people:
        (tell or (lambda text: None))(f"{n} frames beside {person.name}")
        times, looks = _played(_loop_beside(person, cell_map, settings), n)
        rows += _rows(person.name, times, looks, 1.0 / settings.rate_hz)
        memory[person.name] = looks.tolist()
        late[person.name] = _late(times, 1.0 / settings.rate_hz)
    setup = {"seconds of each run": seconds, "frames": n, "execution": execution}
    return {
        "bench": "memory",
        "header": header(cell_map),
        "setup": setup | {"seed": seed, "memory": _kind()},
        "rows": rows,
        "memory": memory,
        "late": late,
    }


def _loop_beside(
    person: HumanMotion, cell_map: CellMap, settings: LoopSettings
) -> Loop:
    """Return a loop beside a person whose frames are warmed up."""
    planner = ReactivePlanner(cell_map)
    places = find_places(planner)
    person = before_work_places(person, planner.robot, places)
    warm_up(planner, places, person, settings)
    return Loop(ReactivePlanner(cell_map), planner.robot, places, person, settings)


def _played(loop: Loop, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, 4) times [s], and (LOOKS, 2) looks at memory.

    Times are those of the step by wall clock and CPU, and the same with improving. A
    look is the simulated time [s] and the memory [MB].
    """
    times, looks = np.full((n, 4), -1.0), np.full((LOOKS, 2), -1.0)
    ends = np.linspace(0, n, LOOKS + 1).astype(int)[1:]
    traced = not _STATM.exists() and not tracemalloc.is_tracing()
    if traced:
        tracemalloc.start()
    k = 0
    try:
        for i in range(n):
            frame = loop.frame()
            times[i, :2] = frame.wall_s, frame.cpu_s
            times[i, 2] = frame.wall_s + frame.improve_s
            times[i, 3] = frame.cpu_s + frame.improve_cpu_s
            if i + 1 == ends[k]:
                del frame
                gc.collect()
                looks[k] = (i + 1) / loop.settings.rate_hz, 1e-6 * memory_bytes()
                k += 1
    finally:
        if traced:
            tracemalloc.stop()
    return times, looks


def memory_bytes() -> int:
    """Return the resident memory of this process; what Python knows of elsewhere."""
    if _STATM.exists():
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return tracemalloc.get_traced_memory()[0]


def growth(looks: np.ndarray) -> tuple[float, float]:
    """Return by how much memory grew, and its slope over an hour [MB].

    The first tenth is not counted: buffers find their size. The growth is that
    between the means of the first and of the last tenth of the rest, so that a page
    more or less at one look does not count.

    Args:
        looks: (k, 2) simulated time [s] and memory [MB].
    """
    rest = looks[len(looks) // 10 :]
    few = max(1, len(rest) // 10)
    grown = rest[-few:, 1].mean() - rest[:few, 1].mean()
    slope = np.polyfit(rest[:, 0], rest[:, 1], 1)[0]
    return float(grown), float(3600.0 * slope)


def _rows(name: str, times: np.ndarray, looks: np.ndarray, period: float) -> list[dict]:
    grown, slope = growth(looks)
    minutes = f"{len(times) * period / 60.0:g} min of frames"
    wall, cpu = 1e6 * times[:, :2].T
    return [
        value_row(f"{name}: memory grew", grown, "MB", minutes, most=GROWTH_MB),
        value_row(f"{name}: its slope over an hour", slope, "MB", "least squares"),
        value_row(
            f"{name}: deadlines missed by CPU time",
            float((times[:, 3] > period).sum()),
            "",
            f"{minutes}, step and improving",
            most=0.0,
        ),
        value_row(
            f"{name}: deadlines missed by wall clock",
            float((times[:, 2] > period).sum()),
            "",
            "listed in the JSON; other processes count",
        ),
        time_row(
            f"{name}: step",
            "timing and braking test in it",
            wall,
            cpu,
            p50=P50_US,
            p99=P99_US,
        ),
    ]


def _late(times: np.ndarray, period: float) -> list[dict]:
    """Return frames late by wall clock: those late by CPU time, then the latest."""
    frames = np.flatnonzero(times[:, 2] > period)
    wall, cpu = times[frames, 2], times[frames, 3]
    order = frames[np.lexsort((-wall, cpu <= period))]
    order = order[: max(_LISTED, int((cpu > period).sum()))]
    return [
        {"frame": int(i), "wall_s": float(times[i, 2]), "cpu_s": float(times[i, 3])}
        for i in order
    ]


def _kind() -> str:
    return "resident memory" if _STATM.exists() else "memory known to tracemalloc"
