"""`odm bench`: finds the bench by name in `sim/bench/` and shows what it measured."""

import importlib
import inspect
import pkgutil
from pathlib import Path

from roadmap.errors import BadInput
from sim.terminal import Bars, show_json, write_text

_FLAGS = {"map_dir": "--map", "motions": "--motion", "files": "--file"}
_FLAGS |= {"distances": "--distance"}


def bench_names() -> list[str]:
    """Return the benches that are there: modules of `sim.bench` with a `run`.

    `sim/bench/odm_paper.py` is called odm-paper.
    """
    import sim.bench

    folder = Path(sim.bench.__path__[0])
    modules = [m.name for m in pkgutil.iter_modules([str(folder)])]
    texts = {m: (folder / f"{m}.py").read_text(encoding="utf-8") for m in modules}
    runs = [name for name, text in texts.items() if "\ndef run(" in text]
    return sorted(name.replace("_", "-") for name in runs)


def run_bench(name: str, options: dict, json: str | None, markdown: str | None) -> int:
    """Run a bench and print its table, or write it where it is wanted.

    Args:
        name: Of a module of `sim.bench` with `run(...)`, which returns plain data.
        options: What the user chose, by parameter of `run`; None: left to the bench.
        json: FILE.json or '-'.
        markdown: '-' or a file with the markers of this bench, see `fill_section`.

    Returns:
        The exit code: 1 where a bench that compares found a difference.

    Raises:
        BadInput: There is no such bench, or it has no such option or file.
    """
    if name not in bench_names():
        known = ", ".join(bench_names())
        raise BadInput(f"there is no bench {name!r}; choose one of {known}")
    run = importlib.import_module(f"sim.bench.{name.replace('-', '_')}").run
    given = {k: v for k, v in options.items() if v is not None}
    _check_options(name, run, given)
    from sim.bench import table

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
