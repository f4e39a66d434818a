"""`odm bench targets`: to the best reachable hand-over target, at ten distances."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from handover import ReachMap
from odm import load_map
from roadmap.errors import BadInput
from sim.bench.many import play_all
from sim.loop.loop import run_frames
from sim.run.meet import GRASPS, MeetTask, reach_map_of
from sim.run.request import RunRequest
from sim.run.runner import settings_of
from sim.tables.header import header
from sim.tables.table import value_row

# of the person from the axis of the robot's base [m]; each has a seed of its own
DISTANCES = (0.6, 0.7, 0.75, 0.8, 0.9, 1.0, 1.05, 1.1, 1.2, 1.3)
MOTION = "reach"
TREMBLE = "tremble"  # the hand stays where it is, but for 2 cm at 5 Hz
P50_MS, P99_MS = 3.0, 8.0  # asked of a frame's loop
CHANGES, PATHS, ARRIVALS = 4.0, 1.0, 12.0  # asked, a minute
DWELL_S = 1.0  # at a target, where the robot hands over, goes back and comes again
TREMBLES = (
    "distance", "there", "on the way", "blocked", "arrivals", "new paths", "changes",
    "contacts",
)  # fmt: skip
TIMES = ("distance", "CPU p50", "p99", "max", "wall p50", "p99", "max")
SHARES = (
    "distance", "there", "on the way", "blocked", "top", "near", "changes", "contacts"
)  # fmt: skip
CYCLES = (
    "distance", "arrivals", "hand-overs", "there", "on the way", "withdrawn", "blocked",
    "changes", "contacts",
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

    Each person is met three times: by a robot that stays at its target, by one that
    goes back after `DWELL_S` there and comes again, and, with a hand that stays where
    it is and trembles, by one that stays.

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
    if not 0 < seconds < np.inf:
        raise BadInput(f"{seconds} s of each run are none; give seconds above 0")
    asked = RunRequest(Path(map_dir), MOTION, seconds, execution=execution)
    asked = replace(asked, targets="meet", reach=reach and Path(reach))
    jobs = _jobs(asked, seed, distances)
    cell_map = load_map(map_dir, verify=False)
    tell("reach map")
    found = reach_map_of(cell_map.robot, asked.reach, lambda *progress: None)
    tell(f"{len(jobs)} runs of {seconds:g} s, {execution}")
    runs = play_all(_played, jobs, processes, tell)
    return {
        "bench": "targets",
        "header": header(cell_map),
        "setup": _setup(asked, found, seed, min(processes, len(jobs))),
        "rows": _rows(runs),
        "tables": _tables(runs),
        "runs": runs,
    }


def _jobs(asked: RunRequest, seed: int, distances: Sequence[float]) -> list[RunRequest]:
    """Return what to run; a wrong distance or setting is refused before any work."""
    kinds = {}, {"dwell": DWELL_S, "audit_s": 0.0}, {"motion": TREMBLE, "audit_s": 0.0}
    jobs = [
        replace(asked, seed=seed + k, between=(distance, distance), **more)
        for more in kinds
        for k, distance in enumerate(distances)
    ]
    for job in jobs:
        settings_of(job, MeetTask(job).person())
    return jobs


def _setup(asked: RunRequest, found: ReachMap, seed: int, processes: int) -> dict:
    """Return what is to be known of the runs."""
    return {
        "motion": MOTION,
        "seconds of each run": asked.seconds,
        "first seed": seed,
        "execution": asked.execution,
        "reach map": f"{found.hash[:12]}, {found.grid.cell:g} m / "
        f"{found.grid.rotations.n_cells}",
        "object": f"{asked.obj}, {GRASPS} grasps",
        "staying, cycling": f"the robot stays at its target; it goes back after "
        f"{DWELL_S:g} s there without a break, and comes again",
        "trembling": f"the motion {TREMBLE}: the hand stays near the robot and "
        "trembles 2 cm at 5 Hz; the robot stays",
        "audited": f"every {asked.audit_s:g} s",
        "runs at a time": processes,
        "top, near": "at or on the way to the top-ranked reachable target, to one "
        "within the margin of its quality",
    }


def _played(job: RunRequest) -> dict:
    """Run once; a process of its own may do this."""
    task = MeetTask(job)
    person = task.person()
    task.open(lambda *progress: None)
    loop = task.loop(person, settings_of(job, person))
    result = run_frames(loop, task.hear)
    summary = result.summary()
    same = {k: summary[k] for k in ("trajectory_sha256", "path_changes", "held_s")}
    found = task.figures(loop, result)["targets"]
    told = {"distance_m": job.distances[0], "seed": job.seed, "seconds": job.seconds}
    told["motion"] = job.motion
    return told | {"changes": loop.live.counts["changes"]} | found | same


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
    staying, cycling, trembling = _by_mode(runs)
    most, least, paths = {"most": CHANGES}, {"least": ARRIVALS}, {"most": PATHS}
    rows += [
        _a_minute(staying, "changes", "target changes a minute, staying", most),
        _a_minute(cycling, "changes", "target changes a minute, cycling", most),
        _a_minute(trembling, "changes", "target changes a minute, trembling", most),
        _a_minute(trembling, "path_changes", "new paths a minute, trembling", paths),
        _a_minute(cycling, "arrivals", "arrivals a minute, cycling", least),
        _a_minute(cycling, "handovers", f"stays of {DWELL_S:g} s a minute, cycling"),
        _a_minute(staying, "arrivals", "arrivals a minute, staying"),
        value_row("time at the target, staying", _there(staying), "%"),
    ]
    return rows + _audited(staying)


def _by_mode(runs: list[dict]) -> tuple[list[dict], list[dict], list[dict]]:
    """Return runs in which the robot stays, goes back, and stays beside a tremble."""
    trembling = [r for r in runs if r["motion"] == TREMBLE]
    others = [r for r in runs if r["motion"] != TREMBLE]
    return (
        [r for r in others if r["dwell_s"] is None],
        [r for r in others if r["dwell_s"] is not None],
        trembling,
    )


def _a_minute(
    runs: list[dict], name: str, what: str, asked: dict | None = None
) -> dict:
    minutes = sum(r["seconds"] for r in runs) / 60.0
    count = sum(r[name] for r in runs)
    note = f"{count} in {minutes:.1f} minutes"
    return value_row(what, count / minutes, "", note, **(asked or {}))


def _there(runs: list[dict]) -> float:
    """Return the share of time at a target [%]."""
    there = sum(r["share_of_time"].get("there", 0.0) * r["seconds"] for r in runs)
    return round(100.0 * there / sum(r["seconds"] for r in runs), 1)


def _audited(runs: list[dict]) -> list[dict]:
    """Return what the audit says of all runs together."""
    rows = []
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
    staying, cycling, trembling = _by_mode(runs)
    return [
        {
            "title": f"A frame's loop [ms], {word}",
            "head": TIMES,
            "rows": [_times(r) for r in some],
        }
        for word, some in (
            ("staying", staying),
            ("cycling", cycling),
            ("trembling", trembling),
        )
    ] + [
        {
            "title": "Staying: share of time; of audited frames; changes a minute",
            "head": SHARES,
            "rows": [_shares(r) for r in staying],
        },
        {
            "title": "Cycling: arrivals and hand-overs a minute; share of time",
            "head": CYCLES,
            "rows": [_cycles(r) for r in cycling],
        },
        {
            "title": "Trembling: share of time; new paths and target changes a minute",
            "head": TREMBLES,
            "rows": [_trembles(r) for r in trembling],
        },
    ]


def _times(run: dict) -> list[str]:
    taken = [run[f"loop_{clock}_s"] for clock in ("cpu", "wall")]
    cells = [f"{1e3 * t[k]:.1f}" for t in taken for k in ("p50", "p99", "max")]
    return [f"{run['distance_m']:g} m", *cells]


def _shares(run: dict) -> list[str]:
    audit = run["audit"]
    seen = [_percent(audit[k]) for k in ("top", "within_margin")]
    return [
        f"{run['distance_m']:g} m",
        *_states(run, ("there",), ("on the way",), ("blocked", "no target")),
        *(seen if _some(run) else ("-", "-")),
        f"{run['target_changes_per_minute']:.0f}",
        str(run["contacts"]),
    ]


def _cycles(run: dict) -> list[str]:
    minutes = run["seconds"] / 60.0
    blocked = ("blocked", "no target")
    return [
        f"{run['distance_m']:g} m",
        *(f"{run[name] / minutes:.1f}" for name in ("arrivals", "handovers")),
        *_states(run, ("there",), ("on the way",), ("withdrawn",), blocked),
        f"{run['target_changes_per_minute']:.0f}",
        str(run["contacts"]),
    ]


def _trembles(run: dict) -> list[str]:
    minutes = run["seconds"] / 60.0
    return [
        f"{run['distance_m']:g} m",
        *_states(run, ("there",), ("on the way",), ("blocked", "no target")),
        *(f"{run[name] / minutes:.1f}" for name in ("arrivals", "path_changes")),
        f"{run['target_changes_per_minute']:.0f}",
        str(run["contacts"]),
    ]


def _states(run: dict, *groups: tuple[str, ...]) -> list[str]:
    """Return the share of time in each group of states of the pursuit."""
    time = run["share_of_time"]
    return [_percent(sum(time.get(k, 0.0) for k in group)) for group in groups]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
