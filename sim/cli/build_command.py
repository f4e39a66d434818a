"""`odm build`: from a recipe or a URDF to a map, or its cost; and `odm warmup`."""

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.run.crew import HERE, Place, begin_ahead, crew
from sim.run.folders import MAPS, check_map_folder
from sim.terminal.checks import FOLDER, MOST_WORKERS, Limits, Refused, check_choice
from sim.terminal.flags import (
    Json,
    Threads,
    argument,
    flag,
    from_request,
    optional,
    switch,
)
from sim.terminal.output import bytes_text, counted, report
from sim.terminal.progress import Bars, now_compiling

if TYPE_CHECKING:
    from odm import CellMap, Recipe
    from roadmap.robot.robot import Robot

_OWN = "With your own robot"
_CLUSTER = "On a Dask cluster"
_COST = "Size and safety"
_PAIRS = 6  # of links that are named in a line, at most
_LOADS = "odm.cell_map.chunk_code"
# sections of a recipe, and the options that go there under their own name
_SECTIONS = {"roadmap": ("nodes", "neighbors", "seed"), "safety": ("h", "rho")}

# what `odm warmup` can be asked for alone, and its name in the tables
_COMPILED = {"run": "run", "demo": "story"}


@dataclass(frozen=True)
class BuildRequest:
    """What `odm build` is asked for; None: as in the recipe."""

    recipe: str | None = argument(
        None, "Name or .toml path of a recipe; or give --robot."
    )
    out: Path | None = optional(
        "The map's folder; maps/built/NAME if left.", writes=FOLDER
    )
    threads: Threads = 0
    force: bool = switch("Replace a map of another recipe.")
    suggest: bool = switch("Table of sizes; nothing is built.")
    robot: str | None = optional("URDF file of your robot.", metavar="URDF", panel=_OWN)
    tip: str | None = optional("Link of the tool.", metavar="LINK", panel=_OWN)
    lock: list[str] | None = optional(
        "Make a joint rigid, at a value in rad or m; may be repeated.",
        metavar="JOINT=VALUE",
        panel=_OWN,
    )
    name: str | None = optional("Name of the map.", panel=_OWN)
    srdf: str | None = optional("Link pairs not to test.", metavar="SRDF", panel=_OWN)
    scenery: list[str] | None = optional(
        "What stands around: a MoveIt .scene or a URDF; may be repeated.",
        metavar="FILE",
    )
    nodes: int | None = optional(
        "Nodes of the roadmap.", panel=_COST, limits=Limits(2, 5_000_000, "nodes")
    )
    neighbors: int | None = optional(
        "Edges tried per node.", panel=_COST, limits=Limits(1, 500)
    )
    h: float | None = optional(
        "Cell size in m.",
        panel=_COST,
        limits=Limits(0.002, 1.0, "m", hint="4 cm are 0.04"),
    )
    rho: float | None = optional(
        "Covering radius of samples in m.",
        panel=_COST,
        limits=Limits(0.0005, 0.5, "m", hint="3 cm are 0.03"),
    )
    seed: int | None = optional(
        "Seed of the sampled nodes.", panel=_COST, limits=Limits(0, 2**63 - 1)
    )
    workers: int = flag(
        0, "Processes of a cluster made here.", panel=_CLUSTER, min=0, max=MOST_WORKERS
    )
    scheduler: str | None = optional(
        "Scheduler of a running Dask cluster.",
        panel=_CLUSTER,
        metavar="tcp://HOST:8786",
    )
    shared: Path | None = optional(
        "Folder that all workers see; results go there, not over the network.",
        panel=_CLUSTER,
        writes=FOLDER,
    )
    json: Json = None


@from_request(BuildRequest)
def build(request: BuildRequest) -> None:
    """Build a map from a recipe (`odm build panda`) or from your robot's URDF.

    odm build --robot my.urdf --tip tool0 --nodes 10000 --out DIR
    """
    from roadmap.errors import BuildRefused

    if (request.recipe is None) == (request.robot is None):
        raise Refused(
            "give either a recipe (`odm build panda`, `odm build my.toml`) or --robot "
            "my.urdf --tip LINK"
        )
    place = Place(request.workers, request.scheduler, request.shared)
    if not request.suggest:
        begin_ahead(place, _LOADS)
    recipe, threads, json = recipe_of(request), request.threads, request.json
    if request.suggest:
        from sim.cli.suggest import suggest_sizes

        suggest_sizes(recipe, threads, json)
        return
    target = request.out or MAPS / recipe.name
    try:
        check_map_folder(target, recipe, request.force)
    except BuildRefused:
        _check_robot(recipe)
        raise
    cell_map, seconds = build_to(
        target, recipe, threads, quiet=json == "-", place=place
    )
    facts = built_facts(cell_map, target, seconds)
    report(facts, json, _show)


def _check_robot(recipe: "Recipe") -> None:
    """Refuse a robot that cannot be read, told before where its map goes."""
    from odm.cell_map.build import robot_of

    robot_of(replace(recipe, robot=replace(recipe.robot, cover_excess=0.2)))


def parse_locked(pairs: list[str] | None) -> dict[str, float]:
    """Return joint -> value from words JOINT=VALUE."""
    locked = {}
    for pair in pairs or []:
        joint, _, value = pair.partition("=")
        if joint in locked:
            raise Refused(
                f"--lock names {joint!r} twice, at {locked[joint]:g} and {value}; "
                "leave one of them out"
            )
        try:
            locked[joint] = float(value)
        except ValueError:
            locked[joint] = math.nan
        if not joint or not math.isfinite(locked[joint]):
            raise Refused(
                f"--lock is {pair!r}: give JOINT=VALUE with a number in rad or m, such "
                "as --lock finger=0.04"
            )
    return locked


def recipe_of(request: BuildRequest) -> "Recipe":
    """Return the recipe that the options ask for, checked like one from a file."""
    from odm import load_recipe
    from odm.cell_map.recipe import parse_recipe

    locked, srdf, folder = parse_locked(request.lock), request.srdf, None
    if request.recipe is not None:
        written = load_recipe(request.recipe)
        table, folder = written.as_dict(), written.folder
        if srdf is not None:  # typed here, so it starts at the current folder
            srdf = str(Path(srdf).absolute())
    else:
        table = {"name": Path(request.robot).stem}
    own = {"source": request.robot, "tip": request.tip, "locked": locked, "srdf": srdf}
    asked = {"robot": own}
    for section, names in _SECTIONS.items():
        asked[section] = {name: getattr(request, name) for name in names}
    for section, values in asked.items():
        given = {k: v for k, v in values.items() if v not in (None, {})}
        table[section] = table.get(section, {}) | given
    if request.name is not None:
        name = request.name
        if not name.strip() or "/" in name or name in (".", ".."):
            raise Refused(
                f"--name is {name!r}: give a name without '/', and the folder "
                "with --out"
            )
        table["name"] = request.name
    more = [str(Path(file).absolute()) for file in request.scenery or []]
    more = [{"type": "file", "file": file} for file in more]
    table["scenery"] = [*table.get("scenery", ()), *more]
    return parse_recipe(table, table["name"], folder)


def build_to(
    target: Path,
    recipe: "Recipe",
    threads: int,
    quiet: bool = False,
    place: Place = HERE,
) -> tuple["CellMap", float]:
    """Build a map with progress bars, save it, and return it loaded, with seconds.

    A build that was ended before goes on from its finished chunks.
    """
    from odm import build_map, load_map
    from odm.cell_map.build import robot_of
    from odm.obstacles.scenery import parse_scenery

    begun = time.perf_counter()
    parse_scenery(recipe.scenery, recipe.folder)  # a mistake is told before any work
    with crew(target, threads, place, _LOADS) as workers, Bars() as tell:
        tell("robot and its cover", 0, 1)
        robot = robot_of(recipe)
        tell("robot and its cover", 1, 1)
        if not quiet:
            _tell_size(robot, recipe)
        cell_map = build_map(recipe, threads, tell, robot, workers)
        tell("saving", 0, 1)
        cell_map.save(target)
        tell("saving", 1, 1)
    return load_map(target), time.perf_counter() - begun


def _tell_size(robot: "Robot", recipe: "Recipe") -> None:
    from rich.console import Console

    from odm.cell_map.estimate import estimate
    from roadmap import robot_names
    from roadmap.geometry.self_collision import OFTEN
    from roadmap.loading.assembly import LEFT_OUT

    size = estimate(robot, recipe)
    lines = [
        f"{recipe.name}: {recipe.roadmap.nodes:,} nodes, about "
        f"{counted(size.n_edges, 'edge')} and {bytes_text(size.map_bytes)}"
    ]
    if recipe.robot.tip is None and recipe.robot.source not in robot_names():
        told = f"the tool is {robot.tip_name}, the end of the longest chain; --tip"
        lines.append(f"{told} LINK takes another")
    names = tuple(f"{name}: " for name in robot.joint_names)
    lines += [note for note in robot.notes if note.startswith(names)]
    often = "; the robot never goes there: is their collision geometry right?"
    lines += [note + often for note in robot.notes if OFTEN in note]
    lines += _untested(robot)
    bare = "; the arm may meet them: give those within its reach collision geometry"
    lines += [note + bare for note in robot.notes if note.startswith(LEFT_OUT)]
    if not recipe.scenery:
        lines.append(
            "no scenery: the map knows of no floor and no table; give --scenery FILE, "
            "a recipe with [[scenery]], or planner.scene at run time"
        )
    for line in lines:
        Console(stderr=True).print(line, highlight=False, markup=False)


def _untested(robot: "Robot") -> list[str]:
    """Return a line on the links that are not tested since their solids always touch.

    Their meshes, of which the hulls count, may well stand apart, and meet.
    """
    from roadmap.geometry.self_collision import always_touching_pairs

    pairs = sorted(map(sorted, always_touching_pairs(robot)))
    if not pairs:
        return []
    named = ", ".join(f"{a} and {b}" for a, b in pairs[:_PAIRS])
    more = f" and {len(pairs) - _PAIRS} more pairs" if len(pairs) > _PAIRS else ""
    return [
        f"not tested against each other, since their collision geometry, hulls of "
        f"meshes, touches in all poses: {named}{more}; give those that can stand apart "
        "collision geometry in smaller parts"
    ]


def built_map(recipe: "Recipe", threads: int = 0) -> Path:
    """Return the usual folder of a recipe's map, built unless it is there."""
    from odm import load_map
    from roadmap.errors import BadMap

    folder = MAPS / recipe.name
    try:
        there = load_map(folder).recipe.as_dict() == recipe.as_dict()
    except BadMap:
        there = False
    if not there:
        check_map_folder(folder, recipe, force=True)
        cell_map, took = build_to(folder, recipe, threads)
        roadmap = cell_map.roadmap
        edges = counted(roadmap.n_edges, "edge")
        counts = f"{roadmap.n_nodes:,} nodes, {edges}"
        line = f"{recipe.name} map: {counts} in {took:.0f} s, {folder}"
        typer.echo(line, err=True)
    return folder


def built_facts(cell_map: "CellMap", target: Path, seconds: float) -> dict:
    """Return what a build made, as plain data."""
    n_edges = max(1, cell_map.roadmap.n_edges)
    edge_major, block_major = cell_map.arm_cells.bytes_by_view()
    return {
        "map": str(target),
        "nodes": cell_map.roadmap.n_nodes,
        "nodes_asked": cell_map.recipe.roadmap.nodes,
        "edges": cell_map.roadmap.n_edges,
        "bytes_per_edge": {
            "edge_major": round(edge_major / n_edges, 1),
            "block_major": round(block_major / n_edges, 1),
        },
        "folder_bytes": sum(f.stat().st_size for f in target.iterdir()),
        "components": cell_map.built.get("components", []),
        "n_components": cell_map.built.get("n_components", 1),
        "seconds": round(seconds, 2),
        "hash": cell_map.hash,
    }


def _show(facts: dict) -> None:
    per_edge = facts["bytes_per_edge"]
    parts = facts["n_components"]
    print(
        f"{counted(facts['nodes'], 'node')} and {counted(facts['edges'], 'edge')} in "
        f"{facts['seconds']:.1f} s; {bytes_text(facts['folder_bytes'])} on disk, "
        f"{bytes_text(sum(per_edge.values()) * facts['edges'])} in memory"
    )
    if parts > 1:
        print(
            f"the largest of {parts} components was kept: {facts['nodes']:,} of "
            f"{facts['nodes_asked']:,} nodes; between the others and these no way is "
            "known, and they are left out"
        )
    print(f"map {facts['hash'][:12]} in {facts['map']}")


def warmup(
    part: Annotated[
        str | None,
        typer.Argument(
            metavar="run|demo",
            help="run: what the planner and `odm run` need. demo: what the hand-overs "
            "of `odm demo` need. All where it is left.",
            show_default=False,
        ),
    ] = None,
    fine: Annotated[
        bool, typer.Option("--fine", help="Also for grids of more than 65535 blocks.")
    ] = False,
) -> None:
    """Compile all kernels ahead, so that no frame ever pays for it."""
    if part is not None:
        check_choice("PART", part, list(_COMPILED))
    if part is not None and fine:
        raise Refused(
            f"--fine was given with {part}; leave one of both: for grids of more than "
            "65535 blocks all is compiled at once"
        )
    if part is not None:
        from sim.terminal.ahead import compile_for

        now_compiling(_COMPILED[part])
        begun = time.perf_counter()
        with Bars("loading the compiler"):
            compiled = compile_for(_COMPILED[part])
        seconds = time.perf_counter() - begun
    else:
        from sim.loop.warmup import run_warmup

        with Bars("loading the compiler") as tell:
            seconds, compiled = run_warmup(tell, fine)
    what = f"{compiled} kernels compiled" if compiled else "everything was compiled"
    print(f"{what}, {seconds:.1f} s")
