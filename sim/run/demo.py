"""`odm demo`: a robot at work while a person moves, with tables and pictures."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from odm.cell_map.cell_map import CellMap, load_map
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadRobot
from roadmap.loading.held_link import with_payload
from sim.draw.animation import write_animation
from sim.draw.cover_world import CoverWorld
from sim.draw.film import FilmSettings
from sim.draw.world import SimulatorMissing, World
from sim.loop.loop import LoopSettings, run_loop
from sim.people.human_motion import make_motion
from sim.run.latency_plot import write_latency_plot
from sim.run.places import DEMO, find_places, warm_up
from sim.run.report import print_report


def run_demo(
    map_dir: str | Path,
    out_dir: str | Path,
    motion: str = "sweep",
    settings: LoopSettings = DEMO,
    film: FilmSettings | None = None,
    console: Console | None = None,
) -> dict[str, Path]:
    """Run the loop with and without a person, print the tables, write the pictures.

    The folder `out_dir` is made if it is not there. Returns the files: "film" (GIF),
    "latency" (PNG) and "figures" (JSON).
    """
    console = console or Console()
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    cell_map = load_map(map_dir)
    planner = ReactivePlanner(cell_map)
    places = find_places(planner)
    human = make_motion(motion, settings.seed)
    warm_up(planner, places, human, settings)
    console.print(f"[bold]{cell_map.robot.name}[/] at work, human motion: {motion}")
    result = run_loop(planner, planner.robot, places, human, settings)
    bare = replace(settings, keep_paths=0)
    alone = run_loop(planner, planner.robot, places, None, bare)
    print_report(result, alone, cell_map.hash, console)
    begun = time.perf_counter()
    world, note = open_world(cell_map)
    with world:
        path = out / f"{motion}.gif"
        write_animation(result, cell_map.robot, places, world, path, film)
    plot = write_latency_plot(result, out / f"{motion}_latency.png")
    record = out / f"{motion}.json"
    record.write_text(result.to_json(), encoding="utf-8")
    took = time.perf_counter() - begun
    console.print(note, f"Pictures took {took:.0f} s.")
    files = {"film": path, "latency": plot, "figures": record}
    for kind, file in files.items():
        console.print(f"{kind:>8}: {file}", soft_wrap=True)
    return files


def open_world(
    cell_map: CellMap, held: np.ndarray | None = None
) -> tuple[World | CoverWorld, str]:
    """Return pybullet's world, or the plain one and a sentence that says why.

    `held` (n, 4) are spheres in the robot's hand, tool frame [m].
    """
    robot, asked = cell_map.robot, cell_map.recipe.robot
    try:
        world = World(asked.source, robot, asked.locked)
        if held is not None:
            world.carry(held)
        return world, "Drawn by pybullet."
    except (SimulatorMissing, BadRobot) as error:
        whole = robot if held is None else with_payload(robot, held)
        return CoverWorld(whole), f"Drawn from the sphere cover: {error}."
