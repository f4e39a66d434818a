"""`odm run` and `odm demo`: a robot at work beside a person."""

import json
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.cli.build_command import built_map
from sim.run.request import RunRequest
from sim.story.request import MAINTENANCE, PANDA, WORK, DemoRequest
from sim.terminal.checks import is_there
from sim.terminal.flags import from_request
from sim.terminal.output import show_json
from sim.terminal.progress import Bars, now_compiling

if TYPE_CHECKING:
    from odm import Recipe

DEMO = "demo"  # recipe, and the folder of its map
PANDA_DATA = "pybullet_data"  # the package that brings the Panda
STORY = "story"  # what a hand-over compiles, in the tables of `sim.terminal`


@from_request(RunRequest)
def run(request: RunRequest) -> None:
    """Move the robot between two work places while a person moves; audit each frame.

    With `--execution timed` it keeps its limits of acceleration and jerk, and slows
    down and stops for the person. With `--targets meet` it goes where the person can
    best take what it holds; see docs/handover.md.

    The keys of `--motion keyboard` stand on its screen; q ends it.
    """
    from sim.run import runner

    live = None
    if request.live:
        from sim.keyboard import KeyboardPerson

        live = KeyboardPerson(request.seconds)
    figures = runner.run(request, live)
    if request.json is not None:
        show_json(figures, request.json)
    if live is not None and live.exit_code:
        raise typer.Exit(live.exit_code)


@from_request(DemoRequest)
def demo(request: DemoRequest) -> None:
    """Build the demo map unless it is there, then show a robot at work.

    `odm demo handover` is the story of `make demo`: the robot takes a wrench from the
    table and hands it to a person who moves (or, with --direction receive, takes it
    from them and puts it down); `odm demo maintenance` gives three tools in turn to a
    person on a ladder, and takes each back; see docs/story.md.
    """
    if request.story != WORK and (_own_robot(request) or is_there(PANDA_DATA)):
        _hand_over(request)
        return
    quiet = request.json == "-"
    with redirect_stdout(sys.stderr if quiet else sys.stdout):
        figures = _work(request)
    if request.json is not None:
        show_json(json.loads(figures.read_text(encoding="utf-8")), request.json)


def _work(request: DemoRequest) -> Path:
    """Show a robot at work: a run with film and plot; return the file of figures."""
    if request.story != WORK:
        print(
            "pybullet, which brings the Panda and its fingers, is not installed: the "
            "demo shows a robot at work instead of a hand-over; --map MAP names a map "
            "of your own"
        )
    from sim.run import runner

    folder = built_map(demo_recipe(), request.threads)
    given = {"seconds": request.lasts(), "seed": request.seed, "out": request.out}
    asked = RunRequest(folder, **given)
    runner.run(asked)
    return asked.picture(None, ".json")


def _hand_over(request: DemoRequest) -> None:
    from odm import load_map, load_recipe
    from sim.maintenance.cases import WORK_PLACES, pads_at
    from sim.run.meet import reach_map_of
    from sim.story.cases import urdf_of
    from sim.story.request import KEYBOARD, MOCAP
    from sim.story.tell import object_of, recorded_person, tell_story
    from sim.terminal.ahead import compile_ahead

    live = None
    # what cannot be handed over or played is told before a map is loaded or built
    thing = object_of(request)
    person = recorded_person(request) if request.human == MOCAP else None
    if request.human == KEYBOARD:
        from sim.keyboard.story import KeyboardStory

        live = KeyboardStory(request.lasts())
        live.open()
    now_compiling(STORY)
    if request.map_dir is None:
        with Bars():
            compile_ahead(STORY)
    at = WORK_PLACES[request.robot or PANDA]
    folder = request.map_dir or built_map(load_recipe(at.recipe), request.threads)
    cell_map = load_map(folder)
    # told before a map of reach is built
    pads_at(cell_map.robot, request.pads or (), at)
    if thing is not None:
        urdf_of(cell_map)
    with Bars() as tell:
        compile_ahead(STORY)  # nothing is left where it was done above
        reach = reach_map_of(cell_map.robot, request.reach, tell)
    if request.story == MAINTENANCE:
        from sim.maintenance.tell import tell_cycles

        found = tell_cycles(request, cell_map, reach)
    else:
        found = tell_story(request, cell_map, reach, live, person, thing)
    if request.json is not None:
        show_json(found, request.json)
    touched = found["contacts"] or found.get("object_contacts", 0)
    if touched or found.get("whole", 1) < request.cycles:
        raise typer.Exit(1)


def _own_robot(request: DemoRequest) -> bool:
    """Return whether it is played with another robot than the Panda."""
    return request.map_dir is not None or request.robot not in (None, PANDA)


def demo_recipe() -> "Recipe":
    """Return the demo's recipe; with a plain arm where pybullet is absent."""
    from importlib import resources

    from odm import load_recipe

    recipe = load_recipe(DEMO)
    if is_there(PANDA_DATA):
        return recipe
    print(
        "pybullet, which brings the Panda, is not installed (wheels for Python 3.11 "
        "only): the demo takes an arm of plain shapes with the Panda's joints instead"
    )
    urdf = str(resources.files("maps") / "plain_arm.urdf")
    robot = replace(recipe.robot, source=urdf, tip="tool")
    return replace(recipe, name=f"{DEMO}_plain", robot=robot)
