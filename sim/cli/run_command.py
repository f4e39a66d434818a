"""`odm run` and `odm demo`: a robot at work beside a person."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.run.folders import MAPS, check_map_folder
from sim.run.request import RunRequest
from sim.terminal.checks import PICTURES, SECONDS
from sim.terminal.flags import Threads, flag, from_request
from sim.terminal.output import show_json

if TYPE_CHECKING:
    from odm import Recipe

DEMO = "demo"  # its recipe and the folder of its map


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


@dataclass(frozen=True)
class DemoRequest:
    """What `odm demo` is asked for."""

    out: Path = flag(Path("out"), "For pictures.", metavar="DIR", writes=PICTURES)
    seconds: float = flag(30.0, "Simulated time in s.", limits=SECONDS)
    threads: Threads = 0


@from_request(DemoRequest)
def demo(request: DemoRequest) -> None:
    """Build the demo map unless it is there, then a robot works beside an arm."""
    from odm import load_map
    from roadmap.errors import BadMap
    from sim.cli.build_command import build_to
    from sim.run.demo import run_demo
    from sim.run.places import DEMO as SETTINGS

    recipe = demo_recipe()
    folder = MAPS / recipe.name
    try:
        there = load_map(folder).recipe.as_dict() == recipe.as_dict()
    except BadMap:
        there = False
    if not there:
        check_map_folder(folder, recipe, force=True)
        cell_map, took = build_to(folder, recipe, request.threads)
        counts = f"{cell_map.roadmap.n_nodes:,} nodes, {cell_map.roadmap.n_edges:,}"
        print(f"demo map: {counts} edges in {took:.0f} s, {folder}")
    run_demo(
        folder, request.out, settings=replace(SETTINGS, duration_s=request.seconds)
    )


def demo_recipe() -> "Recipe":
    """Return the demo's recipe; with a plain arm where pybullet is absent."""
    from importlib import resources, util

    from odm import load_recipe

    recipe = load_recipe(DEMO)
    if util.find_spec("pybullet_data") is not None:
        return recipe
    print(
        "pybullet, which brings the Panda, is not installed (wheels for Python 3.11 "
        "only): the demo takes an arm of plain shapes with the Panda's joints instead"
    )
    urdf = str(resources.files("maps") / "plain_arm.urdf")
    robot = replace(recipe.robot, source=urdf, tip="tool")
    return replace(recipe, name=f"{DEMO}_plain", robot=robot)
