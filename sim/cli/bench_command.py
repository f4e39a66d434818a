"""`odm bench`: what a bench is asked for; `sim.bench.command` finds and runs it."""

import importlib
from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from sim.terminal.checks import (
    FOLDER,
    MOST_SEED,
    MOST_WORKERS,
    PICTURE,
    SECONDS,
    Limits,
    Writes,
)
from sim.terminal.flags import (
    JointNames,
    Json,
    argument,
    flags_of,
    from_request,
    optional,
    switch,
)

_COMMAND = "sim.bench.command"
_COUNT = Limits(1, 1_000_000)
NOT_SHIPPED = (
    "the benches are not installed with the package; run them from a checkout, where "
    "`pip install -e '.[bench]'` brings them and what they compare with"
)


@dataclass(frozen=True)
class BenchRequest:
    """What `odm bench` is asked for; None: left to the bench."""

    name: str = argument(
        ...,
        "latency, motions, memory, overhead, build, ompl, odm-paper, camera, "
        "clutter, scene, human, handover, handover-recording, approach, attach, "
        "workspace, story, "
        "targets, interrupts, peers, scale, view or golden.",
        metavar="NAME",
    )
    map_dir: Path | None = optional(
        "A map's folder; the one that the bench is meant for, built where it lacks, "
        "if left.",
        "--map",
        metavar="MAP",
    )
    seed: int | None = optional("Same seed, same frames.", limits=Limits(0, MOST_SEED))
    short: bool = switch("Show that it runs; measure nothing.")
    quick: bool = switch("Fewer frames, within 5 min (peers).")
    node_counts: str | None = optional(
        "Node counts of the maps, comma-separated (scale, build).",
        "--nodes",
        metavar="N,N,...",
    )
    cells: str | None = optional(
        "Cell sizes in m, comma-separated (scale).", metavar="M,M,..."
    )
    out: Path | None = optional(
        "Folder where maps or draws are kept and found again (scale, handover).",
        writes=FOLDER,
    )
    execution: str | None = optional(
        "How the robot moves (motions, targets).", metavar="kinematic|timed"
    )
    pushed: bool = switch("Push the robot meanwhile (motions).")
    seconds: float | None = optional(
        "Simulated time of each run, s (motions, targets).", limits=SECONDS
    )
    seeds: int | None = optional("Runs of each motion (motions).", limits=_COUNT)
    processes: int | None = optional(
        "Runs at a time (motions, story).", limits=Limits(1, MOST_WORKERS)
    )
    motions: list[str] | None = optional(
        "Run this motion only; again for more (motions).", "--motion", metavar="NAME"
    )
    runs: int | None = optional("Draws of each scene (handover, story).", limits=_COUNT)
    repeats: int | None = optional(
        "Times each run is played; of a frame the least counts (story).", limits=_COUNT
    )
    varied: bool = switch("Other scenes than the paper's, drawn by seed (handover).")
    workers: int | None = optional(
        "Build on so many processes, too (build).", limits=Limits(1, MOST_WORKERS)
    )
    reach: Path | None = optional("Reach map (targets, story, view).", metavar="DIR")
    pads: list[str] | None = optional(
        "A link that may touch an object; again for more (story, view).", metavar="LINK"
    )
    distances: list[float] | None = optional(
        "Distance of the person, in m; again for more (targets).",
        "--distance",
        limits=Limits(-5.0, 5.0, "m", hint="90 cm are 0.9"),
    )
    files: list[Path] | None = optional(
        "A recording to use; again for more.", "--file", metavar="F"
    )
    mapping: JointNames = None
    accept_defects: bool = switch(
        "Play recordings that show what no person does (motions)."
    )
    plot: Path | None = optional(
        "Draw the figures, or the page (view), if it can.", writes=PICTURE
    )
    card: bool = switch("The graphics card draws the page (view).")
    against: Path | None = optional(
        "Another checkout to compare with (golden).", metavar="DIR"
    )
    only: list[str] | None = optional(
        "Run this item only; again for more (golden, handover).", metavar="ITEM"
    )
    write: Path | None = optional(
        "Keep what this checkout does (golden).", writes=Writes()
    )
    read: Path | None = optional("Compare with what was kept (golden).", metavar="FILE")
    latency: bool = switch("Time frames of both, in turn (golden).")
    markdown: str | None = optional(
        "Put the table between the markers in FILE.md; alone: print it.",
        "--markdown",
        metavar="FILE",
    )
    json: Json = None


@from_request(BenchRequest)
def bench(request: BenchRequest) -> None:
    """Measure: figures as tables or JSON, with processor, versions and map hash."""
    try:
        import sim.bench  # noqa: F401  an installed wheel leaves it out
    except ImportError:
        from roadmap.errors import BadInput

        raise BadInput(NOT_SHIPPED) from None
    options = asdict(request)
    name, json, markdown = (options.pop(k) for k in ("name", "json", "markdown"))
    given = {k: v for k, v in options.items() if v is not False and v != []}
    command = importlib.import_module(_COMMAND)
    if code := command.run_bench(name, given, json, markdown, flags_of(BenchRequest)):
        raise typer.Exit(code)
