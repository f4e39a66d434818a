"""`odm info` and `odm audit`: what a map holds, and whether what it says is true."""

from pathlib import Path
from typing import Annotated

import typer

from sim.terminal import interrupt
from sim.terminal.flags import Json, MapArgument, Seed, Threads
from sim.terminal.output import Bars, show_json

REPORT_S = 30.0  # after Ctrl-C an audit may take so long to tell what it found [s]


def info(
    map_dir: MapArgument,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw what the map covers.")
    ] = None,
    json: Json = None,
) -> None:
    """Tell what a map holds: robot, counts, bytes, safety terms, cover, scenery.

    The clearance tax (what the map gives away beyond its clearance m) is a quick look
    from a few approaches; `odm bench tax` measures it.
    """
    from odm import load_map
    from sim.cli import describe

    cell_map = load_map(map_dir)
    with Bars() as tell:
        facts = describe.facts(cell_map, tell)
    if plot is not None:
        from sim.draw.coverage import plot_map

        plot.parent.mkdir(parents=True, exist_ok=True)
        facts["plot"] = str(plot_map(cell_map, plot))
    if json is not None:
        show_json(facts, json)
    else:
        describe.show(facts)


def audit(
    map_dir: MapArgument,
    pairs: Annotated[int, typer.Option(min=1, help="Pairs tested.")] = 100_000,
    seed: Seed = 0,
    close: Annotated[
        bool, typer.Option("--close", help="Ask the close test, not the cells.")
    ] = False,
    payload: Annotated[
        bool, typer.Option("--payload", help="With the payload envelope in the hand.")
    ] = False,
    sabotage: Annotated[
        str | None,
        typer.Option(
            metavar="rho|mu|sphere|certificate",
            help="Take this away: the audit must fail.",
        ),
    ] = None,
    sequences: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Attack what a planner remembers instead: N random frames in which "
            "the robot is pushed, goals change, sensors fail; each leg is judged anew.",
        ),
    ] = None,
    threads: Threads = 0,
    json: Json = None,
) -> None:
    """Try to falsify a map: exact geometry against what the map calls free.

    Exit code 0: nothing found; 1: something, with the nearest cases.
    """
    from odm import load_map
    from odm.audit.audit import audit as run_audit
    from odm.cell_map.payload import loaded_map
    from sim.cli import describe

    if sequences is not None or sabotage == "certificate":
        _audit_sequences(map_dir, sequences or pairs, seed, threads, sabotage, json)
        return
    cell_map = load_map(map_dir)
    asked = loaded_map(cell_map) if payload else cell_map
    options = {"seed": seed, "close": close, "sabotage": sabotage, "threads": threads}
    with interrupt.patience(REPORT_S):
        with Bars() as tell:
            report = run_audit(asked, pairs=pairs, progress=tell, **options)
        if json is not None:
            show_json(report.as_dict() | {"map_hash": cell_map.hash}, json)
        else:
            describe.show_audit(report, cell_map.hash)
    if not report.complete:
        raise KeyboardInterrupt
    if not report.passed:
        raise typer.Exit(1)


def _audit_sequences(
    map_dir: Path,
    steps: int,
    seed: int,
    threads: int,
    sabotage: str | None,
    json: str | None,
) -> None:
    """Run the audit by sequences and show it."""
    from odm import load_map
    from odm.audit.sequence_audit import audit_sequences
    from sim.cli import describe

    map_hash = load_map(map_dir).hash
    options = {"seed": seed, "processes": threads, "sabotage": sabotage}
    with Bars() as tell:
        report = audit_sequences(map_dir, steps=steps, progress=tell, **options)
    if json is not None:
        show_json(report.as_dict() | {"map_hash": map_hash}, json)
    else:
        describe.show_sequences(report, map_hash)
    if not report.complete:
        raise KeyboardInterrupt
    if not report.passed:
        raise typer.Exit(1)
