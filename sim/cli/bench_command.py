"""`odm bench`: finds the bench by name in `sim/bench/` and shows what it measured."""

import importlib
import inspect
from pathlib import Path

from roadmap.errors import BadInput
from sim.terminal.output import Bars, show_json, write_text

_FLAGS = {"map_dir": "--map", "motions": "--motion", "files": "--file"}
_FLAGS |= {"distances": "--distance"}
NOT_SHIPPED = (
    "the benches are not installed with the package; run them from a checkout, where "
    "`pip install -e '.[bench]'` brings them and what they compare with"
)


def bench_names() -> list[str]:
    """Return the benches that are there: modules under `sim.bench` with a `run`.

    `sim/bench/paper/odm_paper.py` is called odm-paper.

    Raises:
        BadInput: They are not there: an installed wheel leaves `sim.bench` out.
    """
    return sorted(_modules())


def _modules() -> dict[str, str]:
    """Return the module of each bench by its name."""
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


def run_bench(name: str, options: dict, json: str | None, markdown: str | None) -> int:
    """Run a bench and print its table, or write it where it is wanted.

    Args:
        name: Of a module under `sim.bench` with `run(...)`, which returns plain data.
        options: What the user chose, by parameter of `run`; None: left to the bench.
        json: FILE.json or '-'.
        markdown: '-' or a file with the markers of this bench, see `fill_section`.

    Returns:
        The exit code: 1 where a bench that compares found a difference.

    Raises:
        BadInput: There are no benches or none of that name, or no such option or file.
    """
    modules = _modules()
    if name not in modules:
        known = ", ".join(sorted(modules))
        raise BadInput(f"there is no bench {name!r}; choose one of {known}")
    run = importlib.import_module(modules[name]).run
    given = {k: v for k, v in options.items() if v is not None}
    _check_options(name, run, given)
    from sim.tables import table

    if markdown not in (None, "-"):
        fill_section(Path(markdown), name, None)
    with Bars() as tell:
        if "tell" in inspect.signature(run).parameters:
            given["tell"] = lambda part: tell(part, 0, 1)
        result = run(**given)
    if json is not None:
        show_json(result, json)
    if markdown == "-":
        print(table.markdown(result))
    elif markdown is not None:
        fill_section(Path(markdown), name, table.markdown(result))
    elif json != "-":
        table.print_bench(result)
    return result.get("exit_code", 0)


def _check_options(name: str, run: object, given: dict) -> None:
    known = inspect.signature(run).parameters
    for option in given:
        if option not in known:
            flag = _FLAGS.get(option, f"--{option}")
            raise BadInput(f"the bench {name!r} has no option {flag}; leave it out")
    for option, parameter in known.items():
        if parameter.default is parameter.empty and option not in given:
            flag = _FLAGS.get(option, f"--{option}")
            raise BadInput(f"the bench {name!r} needs {flag}; give it")


def fill_section(path: Path, name: str, text: str | None) -> None:
    """Put the table of a bench between its two markers in a Markdown file.

    Args:
        path: The file.
        name: Of the bench; the markers are `<!-- odm bench NAME: begin -->` and end.
        text: The table; None only checks that the markers are there.

    Raises:
        BadInput: The file or its markers are missing.
    """
    begin, end = (f"<!-- odm bench {name}: {side} -->" for side in ("begin", "end"))
    whole = path.read_text(encoding="utf-8")
    before, _, rest = whole.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise BadInput(
            f"{path} has no section between {begin} and {end}; add both lines"
        )
    if text is not None:
        write_text(path, f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}")
