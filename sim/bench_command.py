"""`odm bench`: finds the bench by name in `sim/bench/` and shows what it measured."""

import importlib
import inspect
import pkgutil
from pathlib import Path

from roadmap.errors import BadInput
from sim.terminal import Bars, show_json


def bench_names() -> list[str]:
    """Return the benches that are there: modules of `sim.bench` with a `run`."""
    import sim.bench

    found = []
    for module in pkgutil.iter_modules(sim.bench.__path__):
        path = Path(sim.bench.__path__[0]) / f"{module.name}.py"
        if path.is_file() and "\ndef run(" in path.read_text(encoding="utf-8"):
            found.append(module.name)
    return sorted(found)


def run_bench(
    name: str, map_dir: Path | None, markdown: bool, json: str | None
) -> None:
    """Run a bench and print its report.

    A bench is a module with `run(...) -> report`; it is given what its signature
    names of `map_dir` and `progress`. A report has `as_dict()`, `tables()` (rich)
    and `markdown()`.

    Raises:
        BadInput: There is no such bench.
    """
    names = bench_names()
    if name not in names:
        raise BadInput(f"there is no bench {name!r}; choose one of {', '.join(names)}")
    run = importlib.import_module(f"sim.bench.{name}").run
    wanted = inspect.signature(run).parameters
    with Bars() as tell:
        offered = {"map_dir": map_dir, "progress": tell}
        report = run(**{k: v for k, v in offered.items() if k in wanted})
    if json is not None:
        show_json(report.as_dict(), json)
    if markdown:
        print(report.markdown())
    elif json != "-":
        from rich.console import Console

        Console().print(*report.tables())
