"""`odm workspace`: reach maps of robots: build, print and draw them."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.run.crew import Place, crew
from sim.run.folders import REACH_MAPS, check_kind_of
from sim.terminal.checks import (
    FOLDER,
    MOST_SEED,
    MOST_WORKERS,
    PICTURE,
    ROTATIONS,
    SECONDS,
    Limits,
)
from sim.terminal.flags import (
    Json,
    Lock,
    Threads,
    argument,
    flag,
    from_request,
    optional,
    refuse_beside,
)
from sim.terminal.output import bytes_text, report
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from handover import Chain, ReachMap

Poses = Annotated[
    int,
    typer.Option(
        "--recall",
        min=0,
        max=10_000_000,
        help="Random poses to solve for the recall; 0: no recall.",
    ),
]


@dataclass(frozen=True)
class ReachRequest:
    """What `odm workspace build` is asked for."""

    source: str = argument(..., "Name of a robot, its URDF, or human.", metavar="ROBOT")
    out: Path | None = optional(
        "The folder; maps/built/reach/NAME if left.", writes=FOLDER
    )
    tip: str | None = optional("Link of the tool.", metavar="LINK")
    lock: Lock = None
    cell: float = flag(
        0.05,
        "Side of a position cell, m.",
        limits=Limits(0.01, 0.5, "m", hint="5 cm are 0.05"),
    )
    rotations: int = flag(
        576, "Cells of rotation: 72 (60 deg), 576 (30 deg)...", limits=ROTATIONS
    )
    samples: int | None = optional(
        "Configurations drawn before cells are marked.",
        limits=Limits(1000, 4_000_000_000),
    )
    seconds: float | None = optional(
        "Stop after so many s of the clock; the map depends on the machine.",
        "--stop-after",
        limits=SECONDS,
    )
    seed: int = flag(1, "Same seed, same map.", limits=Limits(0, MOST_SEED))
    threads: Threads = 0
    self_collision: bool = flag(
        True,
        "Leave out configurations in self-collision.",
        "--self-collision/--no-self-collision",
    )
    workers: int = flag(
        0, "Processes of a Dask cluster made here.", min=0, max=MOST_WORKERS
    )
    scheduler: str | None = optional(
        "Scheduler of a running Dask cluster.", metavar="tcp://HOST:8786"
    )
    shared: Path | None = optional(
        "Folder that all workers see; results go there.", writes=FOLDER
    )
    recall: Poses = 2000
    plot: Path | None = optional("Draw cuts through the map.", writes=PICTURE)
    json: Json = None


@from_request(ReachRequest)
def build_reach(request: ReachRequest) -> None:
    """Mark all 6-D cells a robot reaches, each with its dexterity and a witness.

    odm workspace build panda --plot reach.png
    """
    from handover import ReachSettings, build_reach_map, load_reach_map

    target = request.out or REACH_MAPS / Path(request.source).stem
    check_kind_of(target, "reach map")
    names = ("cell", "rotations", "samples", "seconds", "seed")
    chosen = {name: getattr(request, name) for name in names}
    settings = ReachSettings(**{k: v for k, v in chosen.items() if v is not None})
    with Bars() as tell:
        tell("robot", 0, 1)
        chain = chain_of_request(request)
        tell("robot", 1, 1)
        place = Place(request.workers, request.scheduler, request.shared)
        threads, loads = request.threads, "handover.reach.reach_chunks"
        with crew(target, threads, place, loads) as workers:
            build_reach_map(chain, settings, threads, tell, workers).save(target)
        reach = load_reach_map(target)
        facts = reach_facts(reach, target, chain, request.recall, tell)
    _report(reach, facts, request.plot, request.json)


@dataclass(frozen=True)
class ReachInfoRequest:
    """What `odm workspace info` is asked for."""

    map_dir: Path = argument(..., "Folder of a reach map.", metavar="MAP")
    recall: Poses = 0
    plot: Path | None = optional("Draw cuts through the map.", writes=PICTURE)
    json: Json = None


@from_request(ReachInfoRequest)
def reach_info(request: ReachInfoRequest) -> None:
    """Tell what a reach map holds, after comparing every byte with its SHA-256.

    What is measured here does not look at self-collision: the map holds no solids.
    """
    from handover import load_reach_map

    reach = load_reach_map(request.map_dir, verify=True)
    with Bars() as tell:
        facts = reach_facts(reach, request.map_dir, reach.chain, request.recall, tell)
    _report(reach, facts, request.plot, request.json)


def chain_of_request(request: ReachRequest) -> "Chain":
    """Return the chain of a robot by name or URDF, or of a person's arm: "human"."""
    from handover import Human, chain_of
    from roadmap import load_robot
    from sim.cli.build_command import parse_locked

    if request.source == "human":
        names = ("tip", "lock", "self_collision")
        refuse_beside(request, names, "a robot, not with a person's arm")
        return Human().arm("right").chain()

    # the sphere cover is not used here, so it may be coarse
    locked = parse_locked(request.lock)
    robot = load_robot(request.source, tip=request.tip, locked=locked, cover_excess=0.1)
    return chain_of(robot, request.self_collision)


def reach_facts(
    reach: "ReachMap", folder: Path, chain: "Chain", poses: int, tell: Bars
) -> dict:
    """Return what a reach map holds and is worth, as plain data; see `measured`."""
    from sim.tables.reach_figures import measured

    marked, grid, packed = reach.n_marked, reach.grid, reach.packed
    facts = {
        "map": str(folder),
        "name": reach.chain.name,
        "joints": list(reach.chain.joint_names),
        "unit": reach.chain.unit,
        "frame": reach.chain.frame,
        "cell": grid.cell,
        "rotations": grid.rotations.n_cells,
        "positions": {"all": grid.n_positions, "reached": len(packed.first) - 1},
        "cells": {"all": grid.n_cells, "marked": marked},
        "stored_witnesses": len(packed.roots),
        "mean_quality": round(float(packed.quality.mean()) / 255, 4),
        "self_collision": bool(reach.chain.collision_hash),
        "folder_bytes": sum(f.stat().st_size for f in folder.iterdir()),
        "built": reach.built,
        "hash": reach.hash,
    }
    facts["figures"], recall = measured(reach, folder, chain, poses, tell)
    if recall is not None:
        facts["recall"] = recall.as_dict()
    return facts


def _report(
    reach: "ReachMap", facts: dict, plot: Path | None, json: str | None
) -> None:
    if plot is not None:
        from sim.draw.map_picture import write_reach_plot

        facts["plot"] = str(write_reach_plot(reach, plot))
    report(facts, json, _show)


def _show(facts: dict) -> None:
    from sim.tables.reach_figures import print_figures

    cells, places, built = facts["cells"], facts["positions"], facts["built"]
    unit = facts["unit"] if facts["unit"] == "m" else f"{facts['unit']}s"
    print(
        f"{facts['name']}: {len(facts['joints'])} joints, cells of {facts['cell']:g} "
        f"{unit} and {facts['rotations']} rotations"
    )
    print(
        f"{cells['marked']:,} of {cells['all']:,} cells marked, at "
        f"{places['reached']:,} of {places['all']:,} positions; mean quality "
        f"{facts['mean_quality']:.3f}; {facts['stored_witnesses']:,} witnesses stored"
    )
    collision = "left out" if facts["self_collision"] else "not looked at"
    early = "; stopped early" if built["stopped_early"] else ""
    print(f"self-collision {collision}{early}")
    if (facts.get("recall") or {"recall": 1.0})["recall"] is None:
        print(
            f"recall: none of {facts['recall']['poses']} random poses could be solved "
            "(an arm of fewer than 6 joints reaches none)"
        )
    print_figures(facts["name"], facts["figures"])
    size = bytes_text(facts["folder_bytes"])
    print(f"reach map {facts['hash'][:12]}, {size}, in {facts['map']}")
