"""Finds a bench by name in this folder, runs it and shows what it measured."""

import importlib
import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from odm import load_recipe
from roadmap.errors import BadInput
from sim.cli import build_command
from sim.run.folders import MAPS
from sim.tables import table
from sim.terminal.interrupt import GRACE, patience
from sim.terminal.output import show_json, write_text
from sim.terminal.progress import Bars

HERE = Path(__file__).parent
VERDICT_S = 10.0  # simulated, of each run
_REACH = "workspace"  # its --map is the reach map of ARMAR-III
# recipes whose maps are measured without --map, and built where they lack
_RECIPES = dict.fromkeys(("story", "targets", "view"), "story") | {
    "attach": "panda_carry"
}


def run_bench(
    name: str,
    options: dict,
    json: str | None = None,
    markdown: str | None = None,
    flags: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Run a bench and print its table, or write it where it is wanted.

    Args:
        name: Of a module under `sim.bench` with `run(...)`, which returns plain data.
        options: What the user chose, by parameter of `run`.
        json: FILE.json or '-'.
        markdown: '-' or a file with the markers of this bench, see `fill_section`.
        flags: Parameter -> its flag, for messages.

    Returns:
        The exit code: 1 where a bench that compares found a difference.

    Raises:
        BadInput: There is no bench of that name, or no such option or file.
    """
    modules = bench_modules()
    if name not in modules:
        known = ", ".join(sorted(modules))
        raise BadInput(f"there is no bench {name!r}; choose one of {known}")
    module = importlib.import_module(modules[name])
    run = module.run
    given = {k: v for k, v in options.items() if v is not None}
    _check_options(name, run, given, flags)
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
            print(markdown_of(result))
        elif markdown is not None:
            fill_section(Path(markdown), name, markdown_of(result))
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


def bench_modules() -> dict[str, str]:
    """Return the module of each bench by its name.

    Those under `sim.bench` with a `run`; `sim/bench/paper/odm_paper.py` is called
    odm-paper.
    """
    found = {}
    for file in HERE.rglob("*.py"):
        if "\ndef run(" in file.read_text(encoding="utf-8"):
            inner = file.relative_to(HERE).with_suffix("").parts
            found[file.stem.replace("_", "-")] = ".".join(("sim.bench", *inner))
    return found


def _needed(name: str, option: str) -> str:
    """Return what a bench wants of an option, and where it comes from."""
    if option != "map_dir" or name != _REACH:
        return "give it"
    return "the reach map of ARMAR-III; `odm workspace build armar3` makes one"


def _standard_map(name: str) -> Path:
    """Return the map that a bench is meant for, built unless one of its name is there.

    What is there may be the user's, of another size: it is measured, never replaced.
    """
    recipe = _RECIPES.get(name, "panda")
    if (MAPS / recipe / "manifest.json").is_file():
        return MAPS / recipe
    return build_command.built_map(load_recipe(recipe))


def _check_options(
    name: str, run: Callable, given: dict, flags: Mapping[str, str]
) -> None:
    known = inspect.signature(run).parameters

    def flag_of(option: str) -> str:
        return flags.get(option, f"--{option.removesuffix('_dir')}")

    for option in given:
        if option not in known:
            raise BadInput(
                f"the bench {name!r} has no option {flag_of(option)}; leave it out"
            )
    for option, parameter in known.items():
        if option == "map_dir" and name != _REACH:
            continue
        if parameter.default is parameter.empty and option not in given:
            what = f"the bench {name!r} needs {flag_of(option)}"
            raise BadInput(f"{what}: {_needed(name, option)}")


def markdown_of(result: dict) -> str:
    """Return the table of a bench and its setting as markdown."""
    lines = _markdown_table(table.lines_of(result)) if result["rows"] else []
    for more in result.get("tables", ()):
        head, *rows = _markdown_table([more["head"], *more["rows"]])
        lines += ["", f"**{more['title']}**", "", head, *rows]
    return "\n".join([*lines, "", *table.setting_lines(result)]) + "\n"


def _markdown_table(rows: list) -> list[str]:
    head, *rest = ("| " + " | ".join(line) + " |" for line in rows)
    return [head, "|" + "---|" * (head.count("|") - 1), *rest]


def fill_section(path: Path, name: str, text: str | None) -> None:
    """Put `text` between the two markers of a bench in a Markdown file.

    They are `<!-- odm bench NAME: begin -->` and end; None only checks that they are
    there.
    """
    begin, end = (f"<!-- odm bench {name}: {side} -->" for side in ("begin", "end"))
    whole = path.read_text(encoding="utf-8") if path.is_file() else ""
    before, _, rest = whole.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise BadInput(
            f"{path} has no section between {begin} and {end}; add both lines"
        )
    if text is not None:
        write_text(path, f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}")
