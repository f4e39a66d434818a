"""`odm bench motions`: contacts, trips and calm beside every scripted motion.

With `pushed` the robot is pushed in every run (`sim.bench.pushed`), the one with nobody
included, and no trips are asked. A contact counts, judged at the true robot by exact
geometry, if the robot moves by itself meanwhile: if its set-point does. That somebody
presses a robot that stands against a person is no contact of the planner's.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from odm import ReactivePlanner, load_map
from roadmap.errors import BadInput
from sim.bench.evadable import Oracle, TouchWatch
from sim.bench.lost_time import PaceWatch, lost_time, lost_time_table
from sim.bench.many import play_all
from sim.bench.pushed import KINDS, PushedLoop, PushSettings, run_pushed
from sim.loop.loop import Frame, Loop, LoopSettings, exact_audit, run_frames
from sim.loop.run_result import RunResult
from sim.people.human_motion import HumanMotion, make_motion, motion_names
from sim.people.scenes import SCENES, before_work_places
from sim.run.places import DEMO, find_places, person_of
from sim.run.request import RunRequest
from sim.tables.header import header
from sim.tables.table import value_row

TRIPS = 60.0  # asked of the trips made without a person [%]
EVADABLE = 15.0  # of the contacts with a robot that stood, at most [%]
FAST = ("intrusion", "crowding")  # no trips are asked, and no contacts only if timed
MINUTE = 60.0
_LOOKS_HZ = 10.0


def run(
    map_dir: str | Path,
    *,
    seconds: float = 60.0,
    seeds: int = 2,
    motions: Sequence[str] | None = None,
    files: Sequence[str | Path] = (),
    mapping: str | Path | None = None,
    accept_defects: bool = False,
    execution: str = "kinematic",
    pushed: bool = False,
    seed: int = 0,
    short: bool = False,
    processes: int = 2,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Run the loop beside every motion and seed, and once without a person.

    Args:
        map_dir: Folder of a built map.
        seconds: Simulated time of each run [s].
        seeds: Runs of each motion, from `seed` on.
        motions: Names of motions; None: all scripted ones but the scenes, which are
            staged so that the robot has to hold.
        files: Recorded motions (CSV, BVH), each played once for its length at most.
        mapping: TOML file that names the joints of the files; None: known ones.
        accept_defects: Play files that show what no person does, too.
        execution: "kinematic" or "timed"; see `sim.loop.loop.LoopSettings`.
        pushed: Push the robot, several times a minute; see `sim.bench.pushed`.
        seed: The first seed.
        short: Few seconds: to see that it runs, not to measure.
        processes: Runs at a time; the figures do not depend on it.
        tell: Called with what is about to run.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables" and "runs"; a table
        of timed runs says where the time goes, see `sim.bench.lost_time`.
    """
    names = tuple(motions or (n for n in motion_names() if n not in SCENES))
    files = tuple(str(file) for file in files)
    if (mapping or accept_defects) and not files:
        raise BadInput(
            "--mapping and --accept-defects are about recordings, and none was given; "
            "name one with --file FILE, or leave them out"
        )
    how = {"mapping": mapping, "accept_defects": accept_defects}
    people = {f: RunRequest(Path(map_dir), "mocap", file=Path(f), **how) for f in files}
    _check_people(names, people.values(), seed)
    if short:
        seconds, seeds = min(seconds, 2.0), 1
    jobs = [(None, seed), *((m, s + seed) for m in names for s in range(seeds))]
    jobs += [(request, seed) for request in people.values()]
    shared = (str(map_dir), seconds, execution, pushed)
    tell = tell or (lambda text: None)
    tell(f"{len(jobs)} runs of {seconds:g} s")
    alone = _played((*shared, *jobs[0], None))
    jobs = [(*shared, *job, alone["trip_s"]) for job in jobs[1:]]
    runs = play_all(_played, jobs, processes, tell)
    every = *names, *(Path(file).stem for file in files)
    rows = _all_rows(every, alone, runs, execution, pushed)
    split = [run for run in runs if "lost" in run]
    setup = {"seconds of each run": seconds, "seeds": seeds, "first seed": seed}
    setup["execution"] = execution
    if pushed:
        setup["pushed"] = asdict(PushSettings())
        rows += _pushed_rows([alone, *runs], execution)
    return {
        "bench": "motions",
        "header": header(load_map(map_dir, verify=False)),
        "setup": setup,
        "rows": rows,
        "tables": [lost_time_table(split)] if split else [],
        "runs": [alone, *runs],
    }


def _check_people(
    names: Sequence[str], people: Iterable[RunRequest], seed: int
) -> None:
    """Refuse a wrong name or file before any work."""
    for name in names:
        make_motion(name, seed)
    for request in people:
        person_of(request)


def _all_rows(
    names: Sequence[str], alone: dict, runs: list[dict], execution: str, pushed: bool
) -> list[dict]:
    """Return the figures of the run alone, of each motion, and of all contacts."""
    trips = alone["trips_per_minute"]
    rows = [value_row("nobody: trips a minute", trips, "")]
    for name in names:
        beside = [r for r in runs if r["motion"] == name]
        rows += _rows(name, beside, trips, execution, pushed)
    if runs and all("evadable" in r for r in runs):
        rows += _standing_rows(runs)
    return rows


def _played(
    job: tuple[str, float, str, bool, str | RunRequest | None, int, float | None],
) -> dict:
    """Run once beside a motion or, by request, a recording; in any process."""
    map_dir, seconds, execution, pushed, motion, seed, trip_s = job
    planner = ReactivePlanner(load_map(map_dir, verify=False))
    settings = LoopSettings(
        rate_hz=DEMO.rate_hz, duration_s=seconds, seed=seed, execution=execution
    )
    recorded = isinstance(motion, RunRequest)
    if recorded:
        human = person_of(motion)
    else:
        human = None if motion is None else make_motion(motion, seed)
    places = find_places(planner)
    if human is not None:
        human = before_work_places(human, planner.robot, places)
    given = planner, planner.robot, places, human, settings
    loop = PushedLoop(*given, PushSettings()) if pushed else Loop(*given)
    asks = human is not None and execution == "timed" and not pushed
    watch, paces = TouchWatch(loop) if asks else None, PaceWatch()

    def hear(frame: Frame) -> None:
        paces.hear(frame)
        if watch is not None:
            watch.hear(frame)

    result = run_pushed(loop, hear) if pushed else run_frames(loop, hear)
    lost = {}
    if asks and trip_s is not None:
        how = (paces.paces, settings.speed_scale, trip_s)
        lost["lost"] = lost_time(planner, places, human, result, *how)
    name = {"motion": motion.file.stem} if recorded else {}
    return {
        **result.summary(),
        **name,
        "trips_per_minute": result.trips * MINUTE / seconds,
        "moving_s": float(result.moving.sum()) / result.rate_hz,
        "trip_s": _trip_s(result),
        "occupied": _occupied(planner, places, result),
        **({} if watch is None else _evadable(planner, human, watch)),
        **lost,
    }


def _trip_s(result: RunResult) -> float | None:
    """Return the time of a trip, on the average [s]; None where none was made."""
    arrived = np.flatnonzero(np.diff(result.place))
    if not len(arrived):
        return None
    return float(arrived[-1] + 1) / result.rate_hz / len(arrived)


def _evadable(
    planner: ReactivePlanner, human: HumanMotion, watch: TouchWatch
) -> dict[str, int]:
    """Return how many touches of a robot that stood could have been evaded."""
    watch.close()
    oracle, touches = Oracle(planner, human), watch.touches
    return {
        "evadable": sum(oracle.evades(t, standing=True) is not None for t in touches),
        "evadable_before": sum(oracle.evades(t) is not None for t in touches),
    }


def _changes(runs: list[dict]) -> float:
    """Return path changes a minute of the time in which the robot moves, of all runs.

    A run whose goal is blocked all along has next to no such time, and counts so.
    """
    moving = sum(run["moving_s"] for run in runs) / MINUTE
    return sum(run["path_changes"] for run in runs) / moving if moving else 0.0


def _occupied(planner: ReactivePlanner, places: np.ndarray, result: RunResult) -> float:
    """Return the share of time in which the person is within m of the next place.

    By exact geometry, ten times a second: no planner could go there then.
    """
    audit, m = exact_audit(planner.robot), planner.cell_map.safety.m
    step = max(1, round(result.rate_hz / _LOOKS_HZ))
    frames = range(0, len(result.place), step)
    near = [
        len(result.capsules[k]) > 0
        and audit(places[result.place[k]], result.capsules[k]) < m
        for k in frames
    ]
    return float(np.mean(near))


def _rows(
    name: str, runs: list[dict], alone: float, execution: str, pushed: bool = False
) -> list[dict]:
    contacts = sum(r["contacts"] for r in runs)
    asked = execution == "timed" or name not in FAST
    near = [r["closest_while_moving"] for r in runs if r["closest_while_moving"]]
    trips = sum(r["trips_per_minute"] for r in runs) / len(runs)
    share = 100.0 * trips / alone if alone else 0.0
    held = 100.0 * sum(r["held_s"] for r in runs) / sum(r["duration_s"] for r in runs)
    least = {} if name in FAST or pushed else {"least": TRIPS}
    rows = [
        value_row(
            f"{name}: contacts while moving",
            float(contacts),
            "",
            **({"most": 0.0} if asked else {}),
        ),
        value_row(f"{name}: trips, of those with nobody", share, "%", **least),
        value_row(f"{name}: path changes a minute while moving", _changes(runs), ""),
        value_row(f"{name}: holding", held, "%"),
        value_row(
            f"{name}: contacts while it stood",
            float(sum(r["standing_contacts"] for r in runs)),
            "",
        ),
        value_row(
            f"{name}: the place to go to is within m of the person",
            100.0 * sum(r["occupied"] for r in runs) / len(runs),
            "%",
        ),
    ]
    if near:
        least_one = min(near, key=lambda moment: moment["separation_m"])
        gap, speed = 100 * least_one["separation_m"], least_one["point_speed_m_s"]
        rows.insert(
            1, value_row(f"{name}: smallest separation while moving", gap, "cm")
        )
        rows.insert(2, value_row(f"{name}: speed at it", speed, "m/s"))
    return rows


def _standing_rows(runs: list[dict]) -> list[dict]:
    """Return what came at a robot that stood, of all runs together."""
    stood = sum(r["standing_contacts"] for r in runs)
    minutes = sum(r["duration_s"] for r in runs) / MINUTE
    rows = [
        value_row("all: contacts while it stood", float(stood), ""),
        value_row("all: the same, a minute", stood / minutes, ""),
    ]
    for name, what, asked in (
        ("evadable", "from where it stood", {"most": EVADABLE}),
        ("evadable_before", "by one who knew it before it stood", {}),
    ):
        share = 100.0 * sum(r[name] for r in runs) / stood if stood else 0.0
        rows.append(value_row(f"all: of those evadable {what}", share, "%", **asked))
    return rows


def _pushed_rows(runs: list[dict], execution: str) -> list[dict]:
    """Return the figures of all runs together, with and without a person."""
    minutes = sum(r["duration_s"] for r in runs) / MINUTE
    contacts = sum(r["contacts"] for r in runs)
    pushes = sum(r["pushed"][kind] for r in runs for kind in KINDS)
    seats = sum(r["pushed"]["seats"] for r in runs)
    far = 100.0 * max(r["pushed"]["farthest_m"] for r in runs)
    asked = {"most": 0.0} if execution == "timed" else {}
    near = [r["closest_while_moving"] for r in runs if r["closest_while_moving"]]
    rows = [
        value_row("all, pushed: simulated time", minutes, "min"),
        value_row("all, pushed: pushes, bumps and slips", float(pushes), ""),
        value_row("all, pushed: farthest from the set-point", far, "cm"),
        value_row("all, pushed: contacts while moving", float(contacts), "", **asked),
    ]
    if near:
        gap = 100.0 * min(moment["separation_m"] for moment in near)
        rows.append(
            value_row("all, pushed: smallest separation while moving", gap, "cm")
        )
    if execution == "timed":
        rows.append(value_row("all, pushed: set-points set anew", float(seats), ""))
    return rows
