"""`odm bench targets`: to the best reachable hand-over target, at ten distances."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from handover import ReachMap
from odm import load_map
from roadmap.errors import BadInput
from sim.bench.parallel import run_jobs
from sim.cli.targets_command import (
    AUDIT_S,
    GRASPS,
    MeetOptions,
    open_table,
    person_of,
    play,
    reach_of,
)
from sim.loop.loop import LoopSettings
from sim.run.demo import DEMO
from sim.tables.header import header
from sim.tables.table import value_row

# of the person from the axis of the robot's base [m]; each has a seed of its own
DISTANCES = (0.6, 0.7, 0.75, 0.8, 0.9, 1.0, 1.05, 1.1, 1.2, 1.3)
MOTION = "reach"
P50_MS, P99_MS = 3.0, 8.0  # asked of a frame's loop
TIMES = ("distance", "CPU p50", "p99", "max", "wall p50", "p99", "max")
SHARES = (
    "distance", "there", "on the way", "blocked", "top", "near", "changes", "contacts"
)  # fmt: skip


def run(
    map_dir: str | Path,
    *,
    reach: str | Path | None = None,
    seconds: float = 60.0,
    distances: Sequence[float] | None = None,
    execution: str = "kinematic",
    seed: int = 0,
    short: bool = False,
    processes: int = 2,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Run the loop to the targets of people who stand at several distances.

    Args:
        map_dir: Folder of a built map.
        reach: Folder of the robot's reach map; None: maps/built/reach/NAME, built
            where it is missing.
        seconds: Simulated time of each run [s].
        distances: Of the people [m]; None: ten from 0.6 to 1.3 m.
        execution: "kinematic" or "timed"; see `sim.loop.loop.LoopSettings`.
        seed: Of the first person; each has the next one.
        short: Few seconds at one distance: to see that it runs, not to measure.
        processes: Runs at a time; only times depend on it.
        tell: Called with what is done.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables" and "runs".

    Raises:
        BadInput: No distances, or one that is none.
        BadMap: No map, or the reach map of another robot.
    """
    tell = tell or (lambda text: None)
    if short:
        seconds, processes = min(seconds, 2.0), 1
        distances = distances or DISTANCES[4:5]
    distances = tuple(distances or DISTANCES)
    settings = _settings(seconds, execution, seed)
    options = MeetOptions(None if reach is None else Path(reach))
    for distance in distances:  # a wrong one is refused before any work
        person_of(MOTION, seed, None, replace(options, distances=(distance,) * 2))
    cell_map = load_map(map_dir, verify=False)
    tell("reach map")
    found = reach_of(cell_map.robot, options.reach, lambda *progress: None)
    jobs = [
        (str(map_dir), options, replace(settings, seed=seed + k), distance)
        for k, distance in enumerate(distances)
    ]
    tell(f"{len(jobs)} runs of {seconds:g} s, {execution}")
    processes = min(processes, len(jobs))
    runs = run_jobs(_played, jobs, processes, tell)
    setup = _setup(settings, found, options, processes)
    return {
        "bench": "targets",
        "header": header(cell_map),
        "setup": setup,
        "rows": _rows(runs),
        "tables": _tables(runs),
        "runs": runs,
    }


def _settings(seconds: float, execution: str, seed: int) -> LoopSettings:
    if not 0 < seconds < np.inf:
        raise BadInput(f"{seconds} s of each run are none; give seconds above 0")
    given = {"duration_s": seconds, "execution": execution, "seed": seed}
    return replace(DEMO, **given, keep_paths=0)


def _setup(
    settings: LoopSettings, reach: ReachMap, options: MeetOptions, processes: int
) -> dict:
    """Return what all runs have in common, for the lines below the table."""
    return {
        "motion": MOTION,
        "seconds of each run": settings.duration_s,
        "first seed": settings.seed,
        "execution": settings.execution,
        "reach map": f"{reach.hash[:12]}, {reach.grid.cell:g} m / "
        f"{reach.grid.rotations.n_cells}",
        "object": f"{options.obj}, {GRASPS} grasps",
        "audited": f"every {AUDIT_S:g} s",
        "runs at a time": processes,
        "top, near": "at or on the way to the top-ranked reachable target, to one "
        "within the margin of its quality",
    }


def _played(job: tuple) -> dict:
    """Run once; a process of its own may do this."""
    map_dir, options, settings, distance = job
    options = replace(options, distances=(distance, distance))
    person, side = person_of(MOTION, settings.seed, None, options)
    table = open_table(Path(map_dir), options, lambda *progress: None)
    result, told = play(table, person, side, settings, AUDIT_S, lambda done: None)
    summary = result.summary()
    same = {k: summary[k] for k in ("trajectory_sha256", "path_changes", "held_s")}
    return {"distance_m": distance, "seed": settings.seed} | told | same


def _rows(runs: list[dict]) -> list[dict]:
    """Return what is asked of all runs together."""

    def worst(clock: str, share: str) -> float:
        return max(1e3 * r[f"loop_{clock}_s"][share] for r in runs)

    n = f"largest of {len(runs)} runs"
    rows = [
        value_row(f"loop, CPU: p50, {n}", worst("cpu", "p50"), "ms", most=P50_MS),
        value_row(f"loop, CPU: p99, {n}", worst("cpu", "p99"), "ms", most=P99_MS),
        value_row(f"loop, CPU: single frame, {n}", worst("cpu", "max"), "ms"),
        value_row(f"loop, wall: p50, {n}", worst("wall", "p50"), "ms", most=P50_MS),
        value_row(f"loop, wall: p99, {n}", worst("wall", "p99"), "ms", most=P99_MS),
        value_row("contacts", float(sum(r["contacts"] for r in runs)), "", most=0.0),
    ]
    judged = sum(r["audit"]["judged"] for r in runs)
    none = sum(r["audit"]["out_of_reach"] for r in runs)
    note = f"{judged} frames audited; in {none} no target could be reached"
    some = judged - none
    for name, what in (
        ("top", "at or on the way to the top-ranked reachable target"),
        ("within_margin", "to it or one within the margin of its quality"),
        ("worse", "to a worse one"),
        ("none", "to none, though one could be reached"),
    ):
        share = sum(r["audit"][name] * _some(r) for r in runs)
        value = 100.0 * share / some if some else np.nan
        rows.append(value_row(what, round(value, 1), "%", note))
        note = ""
    return rows


def _some(run: dict) -> int:
    return run["audit"]["judged"] - run["audit"]["out_of_reach"]


def _tables(runs: list[dict]) -> list[dict]:
    times = {"title": "A frame's loop [ms]", "head": TIMES}
    shares = {"title": "Share of time; of audited frames; changes a minute"}
    shares |= {"head": SHARES, "rows": [_shares(r) for r in runs]}
    return [times | {"rows": [_times(r) for r in runs]}, shares]


def _times(run: dict) -> list[str]:
    taken = [run[f"loop_{clock}_s"] for clock in ("cpu", "wall")]
    cells = [f"{1e3 * t[k]:.1f}" for t in taken for k in ("p50", "p99", "max")]
    return [f"{run['distance_m']:g} m", *cells]


def _shares(run: dict) -> list[str]:
    def percent(share: float) -> str:
        return f"{100 * share:.0f} %"

    time, audit = run["share_of_time"], run["audit"]
    seen = [percent(audit[k]) for k in ("top", "within_margin")]
    return [
        f"{run['distance_m']:g} m",
        percent(time.get("there", 0.0)),
        percent(time.get("on the way", 0.0)),
        percent(time.get("blocked", 0.0) + time.get("no target", 0.0)),
        *(seen if _some(run) else ("-", "-")),
        f"{run['target_changes_per_minute']:.0f}",
        str(run["contacts"]),
    ]
