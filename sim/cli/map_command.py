"""`odm info` and `odm audit`: what a map holds, and whether what it says is true."""

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.terminal import interrupt
from sim.terminal.checks import PICTURE
from sim.terminal.flags import (
    Json,
    MapArgument,
    Seed,
    Threads,
    flag,
    from_request,
    optional,
    refuse_beside,
    switch,
)
from sim.terminal.output import report
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from odm import CellMap
    from odm.audit.audit import AuditReport
    from odm.audit.sequence_audit import SequenceReport

# what some flags of an audit are about
_PAIRS = "an audit by pairs, not with --sequences or --sabotage certificate"
REPORT_S = 30.0  # after Ctrl-C an audit may take so long to tell what it found [s]


@dataclass(frozen=True)
class InfoRequest:
    """What `odm info` is asked for."""

    map_dir: MapArgument
    overhead: bool = switch(
        "Also the clearance overhead; the first time compiles for a while."
    )
    plot: Path | None = optional("Draw what the map covers.", writes=PICTURE)
    json: Json = None


@from_request(InfoRequest)
def info(request: InfoRequest) -> None:
    """Tell what a map holds: robot, counts, bytes, safety terms, cover, scenery.

    With --overhead also what the map gives away beyond its clearance m: a quick look
    from a few approaches; `odm bench overhead` measures it.
    """
    from odm import load_map
    from sim.tables import describe

    with Bars("reading the map") as tell:
        cell_map = load_map(request.map_dir)
        facts = describe.facts(cell_map, tell, request.overhead)
        if request.plot is not None:
            from sim.draw.map_picture import plot_map

            tell("picture", 0, 1)
            facts["plot"] = str(plot_map(cell_map, request.plot))
    report(facts, request.json, describe.show)


@dataclass(frozen=True)
class AuditRequest:
    """What `odm audit` is asked for."""

    map_dir: MapArgument
    pairs: int = flag(100_000, "Pairs tested.", min=1, max=10**12)
    seed: Seed = 0
    close: bool = switch("Ask the close test, not the cells.")
    payload: bool = switch("With the payload envelope in the hand.")
    sabotage: str | None = optional(
        "Take this term of the proof away: the audit must fail.",
        metavar="rho|mu|sphere|certificate",
    )
    sequences: int | None = optional(
        "Attack what a planner remembers instead: N random frames in which "
        "the robot is pushed, goals change, sensors fail; each leg is judged anew.",
        min=1,
        max=10**9,
        metavar="N",
    )
    threads: Threads = 0
    json: Json = None


@from_request(AuditRequest)
def audit(request: AuditRequest) -> None:
    """Try to falsify a map: exact geometry against what the map calls free.

    Exit code 0: nothing found; 1: something, with the nearest cases.
    """
    from odm import load_map
    from sim.tables import describe

    by_sequences = request.sequences is not None or request.sabotage == "certificate"
    if by_sequences:
        names = ("payload", "close", *(("pairs",) if request.sequences else ()))
        refuse_beside(request, names, _PAIRS, "leave one of both")
    cell_map = load_map(request.map_dir)
    # an audit by pairs that is interrupted tells what it found so far
    with nullcontext() if by_sequences else interrupt.patience(REPORT_S):
        if by_sequences:
            found, show = _audit_sequences(request), describe.show_sequences
        else:
            found, show = _audit_pairs(request, cell_map), describe.show_audit
        facts = found.as_dict() | {"map_hash": cell_map.hash}
        report(facts, request.json, lambda _: show(found, cell_map.hash))
    if not found.complete:
        raise KeyboardInterrupt
    if not found.passed:
        raise typer.Exit(1)


def _audit_pairs(request: AuditRequest, cell_map: "CellMap") -> "AuditReport":
    """Audit pairs of a motion and an obstacle."""
    from odm.audit.audit import audit as run_audit
    from odm.cell_map.payload import loaded_map

    asked = loaded_map(cell_map) if request.payload else cell_map
    with Bars() as tell:
        return run_audit(
            asked,
            pairs=request.pairs,
            progress=tell,
            seed=request.seed,
            close=request.close,
            sabotage=request.sabotage,
            threads=request.threads,
        )


def _audit_sequences(request: AuditRequest) -> "SequenceReport":
    """Audit what a planner remembers, by random sequences of frames."""
    from odm.audit.sequence_audit import audit_sequences

    with Bars() as tell:
        return audit_sequences(
            request.map_dir,
            steps=request.sequences or request.pairs,
            progress=tell,
            seed=request.seed,
            processes=request.threads,
            sabotage=request.sabotage,
        )
