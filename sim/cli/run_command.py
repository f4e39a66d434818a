"""`odm run` and `odm demo`: the loop with its tables and pictures."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadmap.errors import BadInput
from sim.cli.build_command import MAPS, build_to, check_target
from sim.terminal.output import Bars, stdout_to_stderr, write_text

if TYPE_CHECKING:
    from odm import CellMap, Recipe
    from sim.cli.targets_command import MeetOptions
    from sim.loop.run_result import RunResult
    from sim.people.human_motion import HumanMotion

WIDE = 38.0  # opening of the camera for a scene in which the robot rises [deg]
DEMO = "demo"  # its recipe and the folder of its map


@dataclass(frozen=True)
class RunFiles:
    """Which files a run writes; None: not this one.

    Attributes:
        plot, animation: Pictures.
        figures: What came of it, as JSON.
        record: The whole run, to be replayed.
    """

    plot: Path | None = None
    animation: Path | None = None
    figures: Path | None = None
    record: Path | None = None

    @classmethod
    def chosen(
        cls,
        out: Path | None,
        motion: str,
        plot: Path | None,
        animation: Path | None,
        record: Path | None = None,
    ) -> "RunFiles":
        """Return the files for a folder `out`, or those named one by one."""
        if out is None:
            return cls(plot, animation, record=record)
        return cls(
            plot or out / f"{motion}_latency.png",
            animation or out / f"{motion}.gif",
            out / f"{motion}.json",
            record,
        )


def check_options(motion: str, file: Path | None, pictures: dict) -> None:
    """Refuse options that do not go together, before any work."""
    if motion == "mocap" and file is None:
        raise BadInput("--motion mocap plays a recording; name it with --file F")
    if motion != "mocap" and file is not None:
        raise BadInput(f"--file goes with --motion mocap, not with {motion}")
    if motion == "keyboard":
        asked = [name for name, path in pictures.items() if path is not None]
        if asked:
            raise BadInput(
                f"{asked[0]} writes pictures of a run known beforehand; "
                "leave it out with --motion keyboard"
            )


def meet_options(targets: str, given: dict) -> "MeetOptions | None":
    """Return the options of `--targets meet`; None: work places.

    Args:
        targets: "places" or "meet".
        given: Attribute of `MeetOptions` -> value, None where it was not given.
    """
    named = {name: value for name, value in given.items() if value is not None}
    if targets == "meet":
        from sim.cli.targets_command import MeetOptions

        return MeetOptions(**named)
    if targets != "places":
        raise BadInput(f"no targets {targets!r}; choose places or meet")
    if named:
        flags = {"distances": "distance", "obj": "object", "side": "hand"}
        first = next(iter(named))
        raise BadInput(
            f"--{flags.get(first, first)} goes with --targets meet; add that or leave "
            "it out"
        )
    return None


def person_of(
    motion: str,
    seed: int,
    file: Path | None = None,
    mapping: Path | None = None,
    stand: tuple[float, float, float] | None = None,
    base_height: float = 0.75,
) -> "HumanMotion":
    """Return the person of a run; a wrong name or file is refused before any work."""
    from sim.people.human_motion import make_motion

    if motion != "mocap":
        return make_motion(motion, seed)
    from sim.people.mocap import MocapSettings, load_mocap

    if stand is not None:
        stand = (stand[0], stand[1], math.radians(stand[2]))
    settings = MocapSettings(stand=stand, base_height=base_height)
    return load_mocap(file, mapping=mapping, settings=settings)


def run_motion(
    map_dir: Path,
    motion: "HumanMotion",
    seconds: float | None,
    seed: int,
    rate: float,
    files: RunFiles,
    quiet: bool = False,
    execution: str = "kinematic",
    carry: float | None = None,
) -> dict:
    """Run the loop with and without a person, print the tables unless `quiet`.

    Args:
        map_dir: Folder of a built map.
        motion: The person.
        seconds: Simulated time [s]; None: that of a recorded clip, else 30 s.
        seed: Of a scripted motion, noted in the result.
        rate: Frames per second.
        files: Pictures and recording to write.
        quiet: Print nothing.
        execution: "kinematic" or "timed"; see `sim.loop.loop.LoopSettings`.
        carry: Radius of a ball in the robot's hand [m]; see `sim.loop.carried`.

    Returns:
        The figures as plain data: "run", "alone", "setting", "map_hash".
    """
    from odm import ReactivePlanner, load_map
    from sim.loop.carried import take_ball
    from sim.loop.loop import Loop, run_frames, run_loop
    from sim.people.scenes import before_work_places
    from sim.record import check_target, recording
    from sim.run.demo import DEMO as SETTINGS
    from sim.run.demo import find_places, warm_up
    from sim.run.report import print_report, setting

    if seconds is None:
        seconds = getattr(motion, "duration_s", SETTINGS.duration_s)
    settings = replace(
        SETTINGS, duration_s=seconds, seed=seed, rate_hz=rate, execution=execution
    )
    if files.record is not None:
        check_target(files.record)
    cell_map = load_map(map_dir)
    planner = ReactivePlanner(cell_map)
    take_ball(planner, carry)
    with Bars() as tell:
        places = find_places(planner)
        motion = before_work_places(motion, planner.robot, places)
        warm_up(planner, places, motion, settings)
        tell(f"{seconds:g} s of {motion.name}", 0, 1)
        planner = ReactivePlanner(cell_map)  # one that knows nothing of all that
        robot = take_ball(planner, carry)
        loop = Loop(planner, robot, places, motion, settings)
        with recording(files.record, loop, cell_map) as recorder:
            result = run_frames(loop, recorder and recorder.add)
        bare = replace(settings, keep_paths=0)
        alone = run_loop(planner, robot, places, None, bare)
        tell(f"{seconds:g} s of {motion.name}", 1, 1)
    notes = [*getattr(motion, "notes", ())]
    if carry is not None:
        notes.append(f"with a ball of {100 * carry:g} cm radius in the hand")
    if ending := getattr(motion, "ending", lambda run_s: None)(seconds):
        notes.append(ending)
    if not quiet:
        print_report([result], alone, cell_map.hash)
        for note in notes:
            print(note)
    film_s = getattr(motion, "film_s", None)
    written = write_files(files, cell_map, result, places, film_s, planner.attached)
    if not quiet:
        for path in written:
            print(path)
    return {
        "run": result.summary() | {"timing": result.timing()},
        "alone": alone.summary(),
        "notes": notes,
        "setting": setting(),
        "map_hash": cell_map.hash,
    }


def write_files(
    files: RunFiles,
    cell_map: "CellMap",
    result: "RunResult",
    places: object,
    film_s: float | None = None,
    held: np.ndarray | None = None,
) -> list[Path]:
    """Write the pictures that were asked for; return their paths.

    The film shows the first `film_s` seconds, or the liveliest ones where that is None;
    `held` (n, 4) spheres are in its hand, tool frame [m].
    """
    asked = (files.plot, files.animation, files.figures)
    written = [path for path in asked if path is not None]
    for path in written:
        path.parent.mkdir(parents=True, exist_ok=True)
    if files.plot is not None:
        from sim.draw.latency_plot import write_latency_plot

        write_latency_plot(result, files.plot)
    if files.animation is not None:
        from sim.draw.animation import write_animation
        from sim.draw.film import FilmSettings
        from sim.run.demo import open_world

        film = FilmSettings()
        if film_s is not None:
            n = round(film_s * film.fps)
            film = replace(film, begin_s=0.0, frames=n, fov_deg=WIDE)
        with stdout_to_stderr():  # pybullet greets and warns on stdout
            world, _ = open_world(cell_map, held)
        with world:
            robot = cell_map.robot
            write_animation(result, robot, places, world, files.animation, film)
    if files.figures is not None:
        write_text(files.figures, result.to_json())
    return written


def run_demo_command(out: Path, seconds: float, threads: int) -> None:
    """Build the demo map unless it is there, then run the demo."""
    from odm import load_map
    from roadmap.errors import BadMap
    from sim.run.demo import DEMO as SETTINGS
    from sim.run.demo import run_demo

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
