"""The one runner of `odm run`: scripted, recorded or live person, places or targets."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.execution.executor import Executor
from odm.execution.stop_test import OWN_LIMITS, stop_time
from odm.execution.threat import ThreatSettings
from roadmap.builds.chunks import Progress
from roadmap.robot.robot import Robot
from sim.loop.loop import Frame, Loop, LoopSettings, run_frames
from sim.loop.run_result import RunResult, stretches
from sim.people.human_motion import HumanMotion
from sim.record import recording
from sim.run.meet import MeetTask
from sim.run.places import DEMO, PlacesTask
from sim.run.planned import PlanTask
from sim.run.report import setting
from sim.run.request import RunRequest
from sim.terminal.ahead import compile_ahead
from sim.terminal.output import write_text
from sim.terminal.progress import Bars, silence

Task = PlacesTask | MeetTask | PlanTask
SPURT_S = 0.3  # a touch while it stopped is looked back from by this
HINDERED = 0.1  # share of the time: who is slowed for longer is told why
WIDE = 38.0  # opening of the camera for a scene in which the robot rises [deg]


def run(request: RunRequest, live: object | None = None) -> dict:
    """Run what was asked for; print the tables unless it is to be quiet.

    `live` moves the person of `--motion keyboard`, a `sim.keyboard.KeyboardPerson`.
    Returns the figures as plain data: "run", "alone", "targets" or "plan", "notes",
    "setting", "map_hash"; of a live run, see its `figures`.
    """
    task = task_of(request, live)
    person = task.person()
    settings = settings_of(request, person)
    if live is not None:
        silence()
        live.open()
    with Bars() as tell:
        compile_ahead("run")
        task.open(tell)
        loop = task.loop(person, settings)
    meets = isinstance(task, MeetTask)
    beside = task.columns() if meets else None  # what a recording holds beside the run
    with (
        recording(request.record, loop, task.cell_map, beside) as recorder,
        watched(request, loop, task.cell_map) as page,
    ):
        listeners = [task.hear] if meets else []
        listeners += [recorder.add] if recorder else []
        listeners += [page.hear] if page else []

        def hear(frame: Frame) -> None:
            for listener in listeners:
                listener(frame)

        result = live.play(loop, hear) if live else simulate(loop, hear)
    figures = task.figures(loop, result) if result else {}
    if live is not None:
        if live.sentence and not request.quiet:
            _show(task, result, figures, [live.sentence])
        data = live.figures(result) | {"map_hash": task.cell_map.hash} | figures
        return data | ({"exit_code": live.exit_code} if request.meets else {})
    notes = notes_of(request, loop, result)
    data = {
        "run": result.summary() | {"timing": result.timing()},
        **figures,
        "notes": notes,
        "setting": setting(),
        "map_hash": task.cell_map.hash,
    }
    if not request.quiet:
        _show(task, result, figures, notes)
    with Bars("pictures") as tell:
        written = write_files(request, loop, task.cell_map, result, data, tell)
    for path in written if not request.quiet else ():
        print(path)
    return data


def task_of(request: RunRequest, live: object | None) -> Task:
    """Return what the robot is to do: follow a plan, meet the person, or go round."""
    if request.plan is not None:
        return PlanTask(request)
    return (MeetTask if request.meets else PlacesTask)(request, live)


def watched(
    request: RunRequest, loop: Loop, cell_map: CellMap
) -> AbstractContextManager:
    """Return the page in the browser that shows each frame, in which it is open."""
    if not request.view:
        return nullcontext()
    from sim.view.running import Watched

    return Watched(loop, cell_map, request.port, request.host, request.token)


def settings_of(request: RunRequest, person: HumanMotion) -> LoopSettings:
    """Return rate, duration and speeds; by default a recording is played once."""
    seconds = request.seconds
    if seconds is None:
        seconds = getattr(person, "duration_s", DEMO.duration_s)
    return replace(
        DEMO,
        duration_s=seconds,
        seed=request.seed,
        rate_hz=request.rate,
        execution=request.execution,
        yields=not request.no_yield,
        once=request.plan is not None,
        keep_paths=0 if request.live else DEMO.keep_paths,
    )


def simulate(loop: Loop, hear: Callable[[Frame], None]) -> RunResult:
    """Run a loop for its whole duration, as fast as it goes, and say how far it is."""
    settings = loop.settings
    frames = max(1, round(settings.duration_s * settings.rate_hz))
    stage, every = f"{settings.duration_s:g} s of {loop.motion.name}", frames // 100
    with Bars() as tell:
        tell(stage, 0, 100)

        def on_frame(frame: Frame) -> None:
            hear(frame)
            if frame.index % max(1, every) == 0:
                tell(stage, min(100, 100 * frame.index // frames), 100)

        result = run_frames(loop, on_frame)
        tell(stage, 100, 100)
    return result


def notes_of(request: RunRequest, loop: Loop, result: RunResult) -> list[str]:
    """Return what a reader of the figures should know of the run."""
    person, seconds = loop.motion, loop.settings.duration_s
    notes = [*getattr(person, "notes", ())]
    if request.carry is not None:
        notes.append(f"with a ball of {100 * request.carry:g} cm radius in the hand")
    if ending := getattr(person, "ending", lambda run_s: None)(seconds):
        notes.append(ending)
    if isinstance(loop.executor, Executor):
        notes += touched_in(result, loop.executor.quick)
        slowed = (result.slowed_s or 0.0) > HINDERED * result.duration_s
        if slowed and not loop.executor.quick:
            s = loop.settings
            notes += slow_stop(loop.robot, s.speed_scale, 1.0 / s.rate_hz)
    return notes


def slow_stop(robot: Robot, scale: float, period: float) -> list[str]:
    """Return a sentence on a robot that is slow near people, as its stops take long.

    Args:
        robot: The robot.
        scale: Share of the joints' speed limits that it uses.
        period: Time between frames [s].
    """
    time = stop_time(robot, scale, period)
    comes = ThreatSettings().displacement_bound(time, period)
    return [
        f"a stop takes it {1e3 * time:.0f} ms, "
        f"in which a person may come {100 * comes:.0f} cm: near people it is slow; "
        f"{OWN_LIMITS} (odm info)"
    ]


def touched_in(result: RunResult, quick: bool) -> list[str]:
    """Return a sentence on how a robot that brakes was touched on its way, if it was.

    Args:
        result: The run.
        quick: See `Executor.quick`.
    """
    touched = result.moving & (result.separation <= 0.0)
    if not touched.any():
        return []
    before = round(SPURT_S * result.rate_hz)
    near = np.zeros(len(touched), bool)
    for a, _ in stretches(touched):
        near[max(0, a - before) : a + 1] = True
    ends = result.capsules[:, :, :6].reshape(len(near), -1, 3)
    sharp = np.zeros(len(near))
    change = np.diff(ends, 2, axis=0) * result.rate_hz**2
    sharp[2:] = np.nan_to_num(np.linalg.norm(change, axis=2).max(1, initial=0.0))
    s, n = ThreatSettings(), int(touched.sum())
    frames = f"{n} frame" + "s" * (n > 1)
    more = "" if quick else f", and {s.jerk:g} more in every second from then on"
    said = (
        f"it was touched on its way in {frames}: up to {SPURT_S:g} s before, the "
        f"person sped up by up to {sharp[near].max():.0f} m/s2; assumed are "
        f"{s.acceleration:g}{more} (ThreatSettings)"
    )
    if not quick:
        said += f". A robot that stops sooner is touched standing: {OWN_LIMITS}"
    return [said]


def write_files(
    request: RunRequest,
    loop: Loop,
    cell_map: CellMap,
    result: RunResult,
    data: dict,
    tell: Progress,
) -> list[Path | str]:
    """Write the pictures and figures that were asked for; return paths, and notes.

    The film shows the first seconds of a scene, else the liveliest ones.
    """
    plot = request.picture(request.plot, "_latency.png")
    film = request.picture(request.animation, ".gif")
    figures = request.picture(None, ".json")
    written = [path for path in (plot, film, figures) if path is not None]
    if plot is not None:
        from sim.run.latency_plot import write_latency_plot

        write_latency_plot(result, plot)
    if film is not None:
        note = _write_film(loop, cell_map, result, film, tell)
        written += [note] if note else []
    if figures is not None:
        text = json.dumps(data, indent=1) if request.meets else result.to_json()
        write_text(figures, text)
    return written


def _write_film(
    loop: Loop, cell_map: CellMap, result: RunResult, path: Path, tell: Progress
) -> str:
    """Write the film of a run; return what is to be said of it, "" for nothing."""
    from sim.draw.animation import FilmSettings, write_animation
    from sim.draw.cover_world import open_world
    from sim.draw.surroundings import all_triangles, standing_of

    film, film_s = FilmSettings(), getattr(loop.motion, "film_s", None)
    if film_s is not None:
        n = round(film_s * film.fps)
        film = replace(film, begin_s=0.0, frames=n, fov_deg=WIDE)
    still = all_triangles(standing_of(loop.planner))
    world, note = open_world(cell_map, loop.planner.attached)
    with world:
        world.stand(still)
        tools = getattr(loop, "tools", None)
        write_animation(
            result, cell_map.robot, loop.places, world, path, film, tools, still, tell
        )
    return note


def _show(
    task: Task, result: RunResult | None, figures: dict, lines: list[str]
) -> None:
    if result is not None:
        task.show(result, figures)
    for line in lines:
        print(line)
