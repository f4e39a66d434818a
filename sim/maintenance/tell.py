"""`odm demo maintenance`: plays cycles, tells what happened, writes it down."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handover import ReachMap
from odm import CellMap
from sim.draw.film import FilmSettings
from sim.draw.viewpoint import Camera
from sim.loop.run_result import percentiles
from sim.maintenance.cases import (
    WORK_PLACES,
    ToolSetup,
    WorkPlace,
    case_in_reach,
    tools_of,
)
from sim.maintenance.play import CycleResult, MaintenancePlay, play_cycle
from sim.maintenance.record import CycleRecorder
from sim.people.whole_person import BASE_HEIGHT
from sim.record import saved
from sim.story.cases import slow_to_stop
from sim.story.play import StoryMoment, StoryPlay, rehearse
from sim.story.request import PANDA, DemoRequest
from sim.story.tell import figures_of, line_of, wrist_of, written
from sim.tables.header import header
from sim.terminal.progress import Bars

FILM = "maintenance.gif"


@dataclass(frozen=True)
class LadderFilm(FilmSettings):
    """A film from so far away that a person on a ladder is on it."""

    width: int = 560
    height: int = 480
    fps: float = 8.0
    fov_deg: float = 44.0
    max_bytes: int = 8_000_000  # it lasts a minute and a half

    base_height: float = BASE_HEIGHT  # of the robot above the floor [m]

    def camera(self) -> Camera:
        """Return the camera, farther off and looking higher."""
        up = BASE_HEIGHT - self.base_height
        eye, target = (1.1, -2.6, 1.35 + up), (0.45, 0.0, 0.55 + up)
        return replace(super().camera(), eye=eye, target=target)


def tell_cycles(request: DemoRequest, cell_map: CellMap, reach: ReachMap) -> dict:
    """Play cycles, print what happened, and write what was asked for of the first.

    Returns plain data: what came of each, times, figures, files. BadInput for a robot
    without fingers, or without a ladder in its reach.
    """
    quiet = request.json == "-"
    say: Callable[[str], None] = (lambda text: None) if quiet else print
    at = WORK_PLACES[request.robot or PANDA]
    setups = tools_of(cell_map, reach, request.pads or (), at)
    if slow := slow_to_stop(cell_map.robot):
        say(slow)
    with Bars("rehearsing"):
        rehearse(setups[0])  # nothing is compiled or loaded from here on
    files: list[Path] = []
    cycles = []
    for seed in range(request.seed, request.seed + request.cycles):
        recorder, first = CycleRecorder(at), not cycles
        with saved(recorder, request.record if first else None, at_end=False):
            result = _played(setups, at, seed, recorder if first else None, say)
        say(summary_of(result))
        if first:
            record = recorder.record()
            film = request.film or request.out / FILM
            look = LadderFilm(base_height=at.base_height)
            files += written(record, cell_map, request.record, film, look)
            for file in files:
                say(str(file))
        cycles.append(figures_of_cycle(result))
    whole = sum(cycle["whole"] for cycle in cycles)
    say(f"{whole} of {len(cycles)} cycles whole")
    return {
        "cycles": cycles,
        "whole": whole,
        "contacts": sum(cycle["contacts"] for cycle in cycles),
        "files": [str(file) for file in files],
        "header": header(cell_map),
    }


def _played(
    setups: tuple[ToolSetup, ...],
    at: WorkPlace,
    seed: int,
    recorder: CycleRecorder | None,
    say: Callable[[str], None],
) -> CycleResult:
    case = case_in_reach(setups, seed, at=at)
    say(
        f"seed {seed}: the ladder stands at {case.distance:.2f} m, "
        f"{np.degrees(case.bearing):.0f} deg, the person is {case.height:.2f} m tall"
    )
    cycle = MaintenancePlay(setups, case, lambda setup: wrist_of(setup)[0])
    told = 0

    def hear(run: StoryPlay, moment: StoryMoment) -> None:
        nonlocal told
        if run.index == 1:
            told = 0
            way = "gives" if run.case.direction == "give" else "takes back"
            say(f"{cycle.now:7.2f} s  the robot {way} the {run.setup.obj.name}")
        for event in run.story.events[told:]:
            say("  " + line_of(event))
        told = len(run.story.events)
        if recorder is not None:
            recorder.add(run, moment)

    try:
        with Bars("playing the cycle"):
            return play_cycle(cycle, hear)
    finally:
        cycle.close()


def summary_of(result: CycleResult) -> str:
    """Return what came of a cycle in two lines."""
    cpu = percentiles(np.concatenate([part.cpu_s for part in result.parts]))
    times = ", ".join(f"{k} {1e3 * v:.2f}" for k, v in cpu.items())
    closest = min(part.closest for part in result.parts)
    objects = sum(part.object_contacts for part in result.parts)
    return (
        f"{'whole' if result.whole else result.reason} after {result.seconds:.1f} s; "
        f"{result.contacts} frames of contact, {objects} of a tool with another part "
        f"than the arm that takes, separation at least {100 * closest:.1f} cm\n"
        f"a frame, CPU ms: {times}"
    )


def figures_of_cycle(result: CycleResult) -> dict:
    """Return what came of a cycle as plain data."""
    case = result.case
    return {
        "seed": case.seed,
        "distance_m": case.distance,
        "bearing_deg": float(np.degrees(case.bearing)),
        "height_m": case.height,
        "whole": result.whole,
        "reason": result.reason,
        "seconds": result.seconds,
        "contacts": int(result.contacts),
        "object_contacts": int(sum(part.object_contacts for part in result.parts)),
        "closest_m": float(min(part.closest for part in result.parts)),
        "hand_overs": [figures_of(part) for part in result.parts],
    }
