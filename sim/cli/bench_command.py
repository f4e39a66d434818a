"""`odm bench`: finds the bench by name in `sim/bench/` and shows what it measured."""

import importlib
import inspect
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
from sim.terminal.flags import Json, argument, flag, flags_of, from_request
from sim.terminal.interrupt import GRACE, patience
from sim.terminal.output import show_json, write_text
from sim.terminal.progress import Bars

_COUNT = Limits(1, 1_000_000)
VERDICT_S = 10.0  # simulated, of each run
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
    map_dir: Path | None = flag(
        None,
        "A map's folder; the one that the bench is meant for, built where it lacks, "
        "if left.",
        "--map",
        metavar="MAP",
    )
    seed: int | None = flag(
        None, "Same seed, same frames.", limits=Limits(0, MOST_SEED)
    )
    short: bool = flag(False, "Show that it runs; measure nothing.", "--short")
    quick: bool = flag(False, "Fewer frames, within 5 min (peers).", "--quick")
    node_counts: str | None = flag(
        None,
        "Node counts of the maps, comma-separated (scale, build).",
        "--nodes",
        metavar="N,N,...",
    )
    cells: str | None = flag(
        None, "Cell sizes in m, comma-separated (scale).", metavar="M,M,..."
    )
    out: Path | None = flag(
        None,
        "Folder where maps or draws are kept and found again (scale, handover).",
        writes=FOLDER,
    )
    execution: str | None = flag(
        None, "How the robot moves (motions, targets).", metavar="kinematic|timed"
    )
    pushed: bool = flag(False, "Push the robot meanwhile (motions).", "--pushed")
    seconds: float | None = flag(
        None, "Simulated time of each run, s (motions, targets).", limits=SECONDS
    )
    seeds: int | None = flag(None, "Runs of each motion (motions).", limits=_COUNT)
    processes: int | None = flag(
        None, "Runs at a time (motions, story).", limits=Limits(1, MOST_WORKERS)
    )
    motions: list[str] | None = flag(
        None,
        "Run this motion only; again for more (motions).",
        "--motion",
        metavar="NAME",
    )
    runs: int | None = flag(
        None, "Draws of each scene (handover, story).", limits=_COUNT
    )
    repeats: int | None = flag(
        None,
        "Times each run is played; of a frame the least counts (story).",
        limits=_COUNT,
    )
    own: bool = flag(False, "Scenes of our own (handover).", "--own")
    workers: int | None = flag(
        None,
        "Build on so many processes, too (build).",
        limits=Limits(1, MOST_WORKERS),
    )
    reach: Path | None = flag(None, "Reach map (targets, story, view).", metavar="DIR")
    pads: list[str] | None = flag(
        None,
        "A link that may touch an object; again for more (story, view).",
        metavar="LINK",
    )
    distances: list[float] | None = flag(
        None,
        "Distance of the person, in m; again for more (targets).",
        "--distance",
        limits=Limits(-5.0, 5.0, "m", hint="90 cm are 0.9"),
    )
    files: list[Path] | None = flag(
        None, "A recording to use; again for more.", "--file", metavar="F"
    )
    plot: Path | None = flag(
        None, "Draw the figures, or the page (view), if it can.", writes=PICTURE
    )
    card: bool = flag(False, "The graphics card draws the page (view).", "--card")
    against: Path | None = flag(
        None, "Another checkout to compare with (golden).", metavar="DIR"
    )
    only: list[str] | None = flag(
        None, "Run this item only; again for more (golden, handover).", metavar="ITEM"
    )
    write: Path | None = flag(
        None, "Keep what this checkout does (golden).", writes=Writes()
    )
    read: Path | None = flag(
        None, "Compare with what was kept (golden).", metavar="FILE"
    )
    latency: bool = flag(False, "Time frames of both, in turn (golden).", "--latency")
    markdown: str | None = flag(
        None,
        "Put the table between the markers in FILE.md; alone: print it.",
        "--markdown",
        metavar="FILE",
    )
    json: Json = None


@from_request(BenchRequest)
def bench(request: BenchRequest) -> None:
    """Measure: figures as tables or JSON, with processor, versions and map hash."""
    options = asdict(request)
    name, json, markdown = (options.pop(k) for k in ("name", "json", "markdown"))
    given = {k: v for k, v in options.items() if v is not False and v != []}
    if code := run_bench(name, given, json, markdown):
        raise typer.Exit(code)


def run_bench(
    name: str, options: dict, json: str | None = None, markdown: str | None = None
) -> int:
    """Run a bench and print its table, or write it where it is wanted.

    Args:
        name: Of a module under `sim.bench` with `run(...)`, which returns plain data.
        options: What the user chose, by parameter of `run`.
        json: FILE.json or '-'.
        markdown: '-' or a file with the markers of this bench, see `fill_section`.

    Returns:
        The exit code: 1 where a bench that compares found a difference.

    Raises:
        BadInput: There are no benches or none of that name, or no such option or file.
    """
    from roadmap.errors import BadInput

    modules = _modules()
    if name not in modules:
        known = ", ".join(sorted(modules))
        raise BadInput(f"there is no bench {name!r}; choose one of {known}")
    module = importlib.import_module(modules[name])
    run = module.run
    given = {k: v for k, v in options.items() if v is not None}
    _check_options(name, run, given)
    from sim.tables import table

    if markdown not in (None, "-"):
        fill_section(Path(markdown), name, None)
    wanted = inspect.signature(run).parameters.get("map_dir")
    if wanted and wanted.default is wanted.empty and "map_dir" not in given:
        given["map_dir"] = _standard_map(name)
    # a bench that tells what it has after Ctrl-C says how long that may take
    with patience(getattr(module, "PATIENCE_S", GRACE)):
        with Bars() as tell:
            if "tell" in inspect.signature(run).parameters:
                given["tell"] = lambda part: tell(part, 0, 1)
            result = run(**given)
        if why := too_short(given):
            result = without_verdicts(result, why)
        if json is not None:
            show_json(result, json)
        if markdown == "-":
            print(table.markdown(result))
        elif markdown is not None:
            fill_section(Path(markdown), name, table.markdown(result))
        elif json != "-":
            table.print_bench(result)
    return result.get("exit_code", 0)


def too_short(given: dict) -> str:
    """Return why what was measured is too little for a verdict; empty: it is not."""
    if given.get("short"):
        return "--short shows that it runs and measures nothing"
    seconds = given.get("seconds")
    if seconds is not None and seconds < VERDICT_S:
        return f"runs of {seconds:g} s say little; verdicts need {VERDICT_S:g} s"
    return ""


def without_verdicts(result: dict, why: str) -> dict:
    """Return the figures of a bench without "met", and why there is none."""
    bare = {"met": None, "met_cpu": None}
    rows = [row | {k: v for k, v in bare.items() if k in row} for row in result["rows"]]
    setup = result.get("setup", {}) | {"verdicts": f"none: {why}"}
    return result | {"rows": rows, "setup": setup}


def _modules() -> dict[str, str]:
    """Return the module of each bench by its name.

    Those under `sim.bench` with a `run`; `sim/bench/paper/odm_paper.py` is called
    odm-paper.

    Raises:
        BadInput: They are not there: an installed wheel leaves `sim.bench` out.
    """
    from roadmap.errors import BadInput

    try:
        import sim.bench
    except ImportError:
        raise BadInput(NOT_SHIPPED) from None

    found = {}
    for folder in map(Path, sim.bench.__path__):
        for file in folder.rglob("*.py"):
            if "\ndef run(" in file.read_text(encoding="utf-8"):
                inner = file.relative_to(folder).with_suffix("").parts
                found[file.stem.replace("_", "-")] = ".".join(("sim.bench", *inner))
    return found


_REACH = "workspace"  # its --map is the reach map of ARMAR-III
# recipes whose maps are measured without --map, and built where they lack
_RECIPES = dict.fromkeys(("story", "targets", "view"), "story") | {
    "attach": "panda_carry"
}


def _needed(name: str, option: str) -> str:
    """Return what a bench wants of an option, and where it comes from."""
    if option != "map_dir" or name != _REACH:
        return "give it"
    return "the reach map of ARMAR-III; `odm workspace build armar3` makes one"


def _standard_map(name: str) -> Path:
    """Return the map that a bench is meant for, built unless one of its name is there.

    What is there may be the user's, of another size: it is measured, never replaced.
    """
    from odm import load_recipe
    from sim.cli.build_command import built_map
    from sim.run.folders import MAPS

    recipe = _RECIPES.get(name, "panda")
    if (MAPS / recipe / "manifest.json").is_file():
        return MAPS / recipe
    return built_map(load_recipe(recipe))


def _check_options(name: str, run: object, given: dict) -> None:
    from roadmap.errors import BadInput

    known, flags = inspect.signature(run).parameters, flags_of(BenchRequest)
    for option in given:
        if option not in known:
            flag = flags[option]
            raise BadInput(f"the bench {name!r} has no option {flag}; leave it out")
    for option, parameter in known.items():
        if option == "map_dir" and name != _REACH:
            continue
        if parameter.default is parameter.empty and option not in given:
            flag = flags.get(option, f"--{option}")
            raise BadInput(f"the bench {name!r} needs {flag}: {_needed(name, option)}")


def fill_section(path: Path, name: str, text: str | None) -> None:
    """Put `text` between the two markers of a bench in a Markdown file.

    They are `<!-- odm bench NAME: begin -->` and end; None only checks that they are
    there.
    """
    begin, end = (f"<!-- odm bench {name}: {side} -->" for side in ("begin", "end"))
    from roadmap.errors import BadInput

    whole = path.read_text(encoding="utf-8") if path.is_file() else ""
    before, _, rest = whole.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise BadInput(
            f"{path} has no section between {begin} and {end}; add both lines"
        )
    if text is not None:
        write_text(path, f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}")
