"""`odm run` and `odm demo`: the loop with its tables and pictures."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sim.cli_build import MAPS, build_to, check_target
from sim.terminal import Bars, stdout_to_stderr, write_text

if TYPE_CHECKING:
    from odm import CellMap, Recipe
    from sim.run_result import RunResult

DEMO = "demo"  # its recipe and the folder of its map


@dataclass(frozen=True)
class RunFiles:
    """Which pictures a run writes; None: not this one."""

    plot: Path | None = None
    animation: Path | None = None
    record: Path | None = None

    @classmethod
    def chosen(
        cls, out: Path | None, motion: str, plot: Path | None, animation: Path | None
    ) -> "RunFiles":
        """Return the files for a folder `out`, or those named one by one."""
        if out is None:
            return cls(plot, animation)
        return cls(
            plot or out / f"{motion}_latency.png",
            animation or out / f"{motion}.gif",
            out / f"{motion}.json",
        )


def run_motion(
    map_dir: Path,
    motion: str,
    seconds: float,
    seed: int,
    rate: float,
    files: RunFiles,
    quiet: bool = False,
) -> dict:
    """Run the loop with and without a person, print the tables unless `quiet`.

    Returns:
        The figures as plain data: "run", "alone", "setting", "map_hash".
    """
    from odm import ReactivePlanner, load_map
    from sim.demo import DEMO as SETTINGS
    from sim.demo import find_places, run_pair, warm_up
    from sim.human_motion import make_motion
    from sim.report import print_report, setting

    settings = replace(SETTINGS, duration_s=seconds, seed=seed, rate_hz=rate)
    make_motion(motion, seed)  # a wrong name is refused before any work
    cell_map = load_map(map_dir)
    planner = ReactivePlanner(cell_map)
    with Bars() as tell:
        places = find_places(planner)
        warm_up(planner, places, motion, settings)
        tell(f"{seconds:g} s of {motion}", 0, 1)
        result, alone = run_pair(planner, places, motion, settings)
        tell(f"{seconds:g} s of {motion}", 1, 1)
    if not quiet:
        print_report([result], alone, cell_map.hash)
    written = write_files(files, cell_map, result, places)
    if not quiet:
        for path in written:
            print(path)
    return {
        "run": result.summary() | {"timing": result.timing()},
        "alone": alone.summary(),
        "setting": setting(),
        "map_hash": cell_map.hash,
    }


def write_files(
    files: RunFiles, cell_map: "CellMap", result: "RunResult", places: object
) -> list[Path]:
    """Write the pictures that were asked for; return their paths."""
    written = [p for p in (files.plot, files.animation, files.record) if p is not None]
    for path in written:
        path.parent.mkdir(parents=True, exist_ok=True)
    if files.plot is not None:
        from sim.pictures import write_latency_plot

        write_latency_plot(result, files.plot)
    if files.animation is not None:
        from sim.animation import write_animation
        from sim.demo import open_world

        with stdout_to_stderr():  # pybullet greets and warns on stdout
            world, _ = open_world(cell_map)
        with world:
            write_animation(result, cell_map.robot, places, world, files.animation)
    if files.record is not None:
        write_text(files.record, result.to_json())
    return written


def run_demo_command(out: Path, seconds: float, threads: int) -> None:
    """Build the demo map unless it is there, then run the demo."""
    from odm import load_map
    from roadmap.errors import BadMap
    from sim.demo import DEMO as SETTINGS
    from sim.demo import run_demo

    recipe = demo_recipe()
    folder = MAPS / recipe.name
    try:
        fresh = load_map(folder).recipe.as_dict() == recipe.as_dict()
    except BadMap:
        fresh = False
    if not fresh:
        check_target(folder, recipe, force=True)
        cell_map, took = build_to(folder, recipe, threads)
        counts = f"{cell_map.roadmap.n_nodes:,} nodes, {cell_map.roadmap.n_edges:,}"
        print(f"demo map: {counts} edges in {took:.0f} s, {folder}")
    run_demo(folder, out, settings=replace(SETTINGS, duration_s=seconds))


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
