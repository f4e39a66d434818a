"""`odm doctor`: what is installed, compiled and missing, and what to do about it."""

import os
import platform
import shutil
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from sim.run.folders import MAPS
from sim.terminal.checks import is_there
from sim.terminal.compiling import ROOT, Compiling, commands
from sim.terminal.flags import Json, flag, from_request
from sim.terminal.output import FINDING, report
from sim.terminal.progress import time_text

NEEDED = {
    "numpy": "numpy", "numba": "numba", "scipy": "scipy", "networkx": "networkx",
    "yourdfpy": "yourdfpy", "trimesh": "trimesh", "lxml": "lxml",
    "collada": "pycollada", "fcl": "python-fcl", "ruckig": "ruckig",
    "typer": "typer", "rich": "rich",
}  # fmt: skip
MORE = {  # module: (package, extra, what it is for)
    "matplotlib": ("matplotlib", "sim", "pictures (--plot)"),
    "PIL": ("pillow", "sim", "films (--animation) and depth images"),
    "pybullet": ("pybullet", "sim", "films of the robot's own meshes, and the Panda"),
    "example_robot_data": ("example-robot-data", "robots", "UR5, Baxter, Jaco by name"),
    "viser": ("viser", "view", "odm view, odm run --view"),
    "ompl": ("ompl", "bench", "odm bench ompl"),
    "sphinx": ("sphinx", "docs", "make docs"),
}
DATA = {"example_robot_data"}  # packages that bring files and no module
FREE_GB, MEMORY_GB = 1.0, 2.0


@dataclass(frozen=True)
class Row:
    """One thing that was looked at."""

    what: str  # its name
    state: str  # "ok", "missing" (of use, but not needed) or "wrong"
    found: str  # what was found
    remedy: str = ""  # what to do; empty: nothing


@dataclass(frozen=True)
class DoctorRequest:
    """What `odm doctor` is asked for."""

    maps: Path = flag(MAPS, "Where the built maps lie.", "--maps", metavar="DIR")
    json: Json = None


@from_request(DoctorRequest)
def doctor(request: DoctorRequest) -> None:
    """Tell what is installed, compiled and missing, and what to do about it.

    Exit code 0: all that is needed is there; 1: something is wrong.
    """
    rows = examine(request.maps)
    wrong = [row for row in rows if row.state == "wrong"]
    facts = {"sound": not wrong, "rows": [asdict(row) for row in rows]}
    report(facts, request.json, _show)
    if wrong:
        raise typer.Exit(FINDING)


def examine(maps: Path) -> list[Row]:
    """Return everything that was looked at; nothing is compiled or loaded for it."""
    rows = [_python(), *(_package(*pair) for pair in NEEDED.items())]
    rows += [_package(module, *row) for module, row in MORE.items()]
    rows += [_writable(), _compiled(), *_machine(), _maps(maps)]
    return rows


def _python() -> Row:
    version = platform.python_version()
    if sys.version_info < (3, 11):  # noqa: UP036  a checkout may be run by any
        return Row("python", "wrong", version, "use Python 3.11 or newer")
    if sys.version_info >= (3, 12) and not is_there("pybullet"):
        remedy = "for films of meshes use Python 3.11: pybullet has wheels for no other"
        return Row("python", "ok", version, remedy)
    return Row("python", "ok", version)


def _package(module: str, package: str, extra: str = "", use: str = "") -> Row:
    """Look for a package: one that is needed, or of an extra and of use for more."""
    from sim.tables.versions import version

    found = version(package)
    if found if module in DATA else is_there(module):
        return Row(package, "ok", found or "installed")
    if not extra:
        return Row(package, "wrong", "not installed", f"pip install {package}")
    remedy = f"for {use}: pip install 'odm-planner[{extra}]'"
    return Row(package, "missing", "not installed", remedy)


def _writable() -> Row:
    """Whether what is compiled can be kept."""
    folder = os.environ.get("NUMBA_CACHE_DIR") or str(ROOT / "odm" / "search")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        remedy = "set NUMBA_CACHE_DIR to a folder of your own that stays"
        found = f"{folder}: {error.strerror}"
        return Row("cache of compiled loops", "missing", found, remedy)
    return Row("cache of compiled loops", "ok", folder)


def _compiled() -> Row:
    missing, wanted = {}, {}
    for command in commands():
        one = Compiling(command)
        wanted |= one.wanted
        try:
            missing |= one.missing()
        except Exception as error:  # nothing of ours can be imported
            return Row("compiled", "wrong", "nothing", str(error))
    found = f"{len(wanted) - len(missing)} of {len(wanted)} loops"
    if not missing:
        return Row("compiled", "ok", found)
    left = time_text(sum(missing.values()))
    remedy = f"odm warmup compiles the rest ahead, about {left} on one free core"
    return Row("compiled", "missing", found, remedy)


def _machine() -> list[Row]:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    state, remedy = "ok", ""
    if free < FREE_GB:
        state, remedy = "wrong", "make room: a map takes 0.05 to 0.5 GB"
    rows = [Row("disk, here", state, f"{free:.1f} GB free", remedy)]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    state, remedy = "ok", ""
    if memory < MEMORY_GB:
        state, remedy = "wrong", "build on another machine; a built map needs 0.5 GB"
    rows.append(Row("memory", state, f"{memory:.1f} GB", remedy))
    rows.append(Row("processor", "ok", f"{os.cpu_count()} cores"))
    return rows


def _maps(folder: Path) -> Row:
    found = sorted(file.parent.name for file in folder.glob("*/manifest.json"))
    if not found:
        remedy = "odm demo, or odm build RECIPE"
        return Row("maps", "missing", f"none in {folder}", remedy)
    return Row("maps", "ok", ", ".join(found))


def _show(facts: dict) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from sim.tables.fitted import Fitted

    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    for _ in range(3):
        table.add_column(overflow="fold")
    colours = {"ok": "green", "missing": "yellow", "wrong": "red"}
    for row in facts["rows"]:
        state = Text(row["state"], style=colours[row["state"]])
        table.add_row(state, row["what"], Text(row["found"]))
        if row["remedy"]:
            table.add_row("", "", Text(f"-> {row['remedy']}"))
    console = Console(highlight=False)
    console.print(Fitted(table))
    well = "nothing that is needed is missing or wrong"
    console.print(well if facts["sound"] else "something is wrong; see the arrows")
