"""`odm workspace`: what a robot reaches, stored as a map, told and drawn."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.terminal.output import JSON_HELP, Bars, bytes_text, guarded, show_json

if TYPE_CHECKING:
    from handover import Chain, ReachMap

app = typer.Typer(
    help="Where robot and person reach: maps of 6-D reachability.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
REACH_MAPS = Path("maps/built/reach")
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help=JSON_HELP)]
Poses = Annotated[
    int,
    typer.Option(
        "--recall", min=0, help="Random poses to solve for the recall; 0: not told."
    ),
]
Plot = Annotated[
    Path | None, typer.Option(metavar="PNG", help="Draw cuts through the map.")
]


@app.command("build")
@guarded
def build(
    source: Annotated[
        str,
        typer.Argument(metavar="ROBOT", help="Name of a robot, its URDF, or human."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The folder; maps/built/reach/NAME if left."),
    ] = None,
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="Link of the tool.")
    ] = None,
    lock: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT=VALUE", help="Make a joint rigid; repeatable."),
    ] = None,
    cell: Annotated[float, typer.Option(help="Side of a position cell, m.")] = 0.05,
    rotations: Annotated[
        int, typer.Option(help="Cells of rotation: 72 (60 deg), 576 (30 deg)...")
    ] = 576,
    samples: Annotated[
        int | None, typer.Option(help="Configurations drawn before cells are marked.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(help="Stop then; the map depends on the machine."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same map.")] = 1,
    threads: Annotated[int, typer.Option(min=0, help="0: one per core.")] = 0,
    self_collision: Annotated[
        bool,
        typer.Option(
            "--self-collision/--no-self-collision",
            help="Whether configurations in self-collision count out.",
        ),
    ] = True,
    recall: Poses = 2000,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Mark all 6-D cells a robot reaches, each with its dexterity and a witness.

    odm workspace build panda --plot reach.png
    """
    from handover import ReachSettings, build_reach_map, load_reach_map

    target = out or REACH_MAPS / Path(source).stem
    check_target(target)
    chosen = {"cell": cell, "rotations": rotations, "samples": samples}
    chosen |= {"seconds": seconds, "seed": seed}
    settings = ReachSettings(**{k: v for k, v in chosen.items() if v is not None})
    with Bars() as tell:
        tell("robot", 0, 1)
        chain = chain_named(source, tip, lock, self_collision)
        tell("robot", 1, 1)
        build_reach_map(chain, settings, threads, tell).save(target)
        reach = load_reach_map(target)
        facts = reach_facts(reach, target, chain, recall, tell)
    _report(reach, facts, plot, json)


@app.command("info")
@guarded
def info(
    map_dir: Annotated[
        Path, typer.Argument(metavar="MAP", help="Folder of a reach map.")
    ],
    recall: Poses = 0,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Tell what a reach map holds, after comparing every byte with its SHA-256.

    What is measured here does not look at self-collision: the map holds no solids.
    """
    from handover import load_reach_map

    reach = load_reach_map(map_dir, verify=True)
    with Bars() as tell:
        facts = reach_facts(reach, map_dir, reach.chain, recall, tell)
    _report(reach, facts, plot, json)


def chain_named(
    source: str, tip: str | None, lock: list[str] | None, self_collision: bool
) -> "Chain":
    """Return the chain of a robot by name or URDF, or of a person's arm: "human".

    Raises:
        BadRobot: No such robot, or a description that cannot be used.
    """
    from handover import Human, chain_of
    from roadmap import load_robot
    from sim.cli.build_command import parse_locked

    if source == "human":
        from roadmap.errors import BadInput

        if tip or lock:
            raise BadInput("a person's arm has no --tip and no --lock; leave them out")
        return Human().arm("right").chain()

    # the sphere cover is not used here, so it may be coarse
    robot = load_robot(source, tip=tip, locked=parse_locked(lock), cover_excess=0.1)
    return chain_of(robot, self_collision)


def check_target(target: Path) -> None:
    """Refuse to replace what is no reach map, before any work.

    Raises:
        BuildRefused: The folder holds something else.
    """
    import json

    from roadmap.errors import BuildRefused

    if not target.exists():
        return
    try:
        kind = json.loads((target / "manifest.json").read_text())["kind"]
    except (OSError, ValueError, KeyError, TypeError):
        kind = None
    if kind != "reach map":
        raise BuildRefused(
            f"{target} exists and holds no reach map, so it is left alone; choose "
            "another --out or remove it yourself"
        )


def reach_facts(
    reach: "ReachMap", folder: Path, chain: "Chain", poses: int, tell: Bars
) -> dict:
    """Return what a reach map holds and is worth, as plain data; see `measured`."""
    from sim.cli.reach_figures import measured

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
        from sim.draw.reach_picture import write_reach_plot

        plot.parent.mkdir(parents=True, exist_ok=True)
        facts["plot"] = str(write_reach_plot(reach, plot))
    if json is not None:
        show_json(facts, json)
    if json != "-":
        _show(facts)


def _show(facts: dict) -> None:
    from sim.cli.reach_figures import print_figures

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
