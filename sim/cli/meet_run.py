"""From the options of `odm run --targets meet` to the run that was asked for."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handover import Human
from roadmap.errors import BadInput
from sim.cli.run_command import person_of as motion_of
from sim.cli.targets_command import MeetOptions, open_table, run_meet, warm_up
from sim.loop.meet_loop import MeetLoop
from sim.people.arm import HumanArm
from sim.people.arm_path import Person
from sim.people.whole_person import BASE_HEIGHT, WholePerson, scripted_person
from sim.run.demo import DEMO
from sim.terminal.output import Bars

if TYPE_CHECKING:
    from sim.loop.loop import Loop, LoopSettings

_REFUSED = {
    "record": "--record writes runs between work places, which can be replayed",
    "animation": "--animation draws work places",
}


def run_targets(
    map_dir: Path,
    motion: str,
    seconds: float | None,
    seed: int,
    rate: float,
    options: MeetOptions,
    given: dict,
    quiet: bool = False,
    execution: str = "kinematic",
    base_height: float = BASE_HEIGHT,
) -> dict:
    """Run the motion that was asked for; return the figures as plain data.

    Args:
        map_dir: Folder of a built map.
        motion: Name of a scripted motion, "mocap" or "keyboard".
        seconds: As of `odm run`.
        seed: As of `odm run`.
        rate: As of `odm run`.
        options: Of the targets.
        given: Further options of `odm run`, None where they were not given.
        quiet: Print nothing.
        execution: As of `sim.loop.loop.LoopSettings`.
        base_height: Of the robot's base above a recording's floor [m].

    Raises:
        BadInput: Options that do not go together.
    """
    for name, why in _REFUSED.items():
        if given[name] is not None:
            raise BadInput(f"{why}; leave it out with --targets meet")
    if motion == "keyboard":
        return _keyboard(map_dir, seconds, rate, options, quiet, execution)
    recorded = None
    if motion == "mocap":
        placed = (given["file"], given["mapping"], given["stand"], base_height)
        recorded = motion_of(motion, seed, *placed)
    out, plot, figures = given["out"], given["plot"], None
    if out is not None:
        plot, figures = plot or out / f"{motion}_latency.png", out / f"{motion}.json"
    files = {"plot": plot, "figures": figures, "quiet": quiet}
    return run_meet(
        map_dir,
        motion,
        recorded,
        seconds,
        seed,
        rate,
        options,
        execution=execution,
        **files,
    )


def _keyboard(
    map_dir: Path,
    seconds: float | None,
    rate: float,
    options: MeetOptions,
    quiet: bool,
    execution: str,
) -> dict:
    """Let keys move the person's right arm; the body stands behind it."""
    from sim.keyboard import run_keyboard
    from sim.loop.meet_audit import shares
    from sim.run.meet_report import print_targets, target_figures

    if options.side == "left":
        raise BadInput("the keys move the right arm; leave --hand out")
    side = "right"
    with Bars() as tell:
        table = open_table(map_dir, options, tell)
        brief = replace(DEMO, rate_hz=rate, execution=execution, keep_paths=0)
        anybody = scripted_person("reach", 0, options.distances)
        warm_up(table, anybody, side, brief)
    near = float(np.mean(options.distances))
    shoulder = Human().placed(near, 0.0, np.pi).T_world_shoulder("right")[:3, 3]
    arm = Person(HumanArm.sized(), tuple(shoulder - [0.0, 0.0, BASE_HEIGHT]))
    loops: list[MeetLoop] = []

    def make_loop(
        planner: object,
        robot: object,
        places: object,
        motion: object,
        settings: "LoopSettings",
    ) -> "Loop":
        person = WholePerson(motion)
        live = table.live(person.human(0.0), side)
        loops.append(MeetLoop(live, table.rest, person, settings))
        return loops[0]

    ended = run_keyboard(
        map_dir, seconds, rate, arm, quiet, make_loop, execution=execution
    )
    data = ended.as_dict()
    if ended.result is not None:
        margin = loops[0].live.settings.choice.margin
        told = {"margin": margin, "audit": shares([], margin)}
        data["targets"] = told = target_figures(loops[0], ended.result) | told
        if not quiet:
            print_targets(told)
    return data | {"exit_code": ended.exit_code}
