"""The tree: imports point down, doors are true, and a planner needs little."""

import ast
import importlib
import pkgutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from sources import nodes, tree

ROOT = Path(__file__).resolve().parent.parent
ORDER = ["roadmap", "odm", "handover", "sim"]
PLANNER = ["roadmap", "odm"]
ONLY_IN_SIM = {"pybullet", "pybullet_data", "matplotlib", "PIL", "typer", "rich"}
ONLY_IN_SIM |= {"viser"}
ONLY_IN_SIM |= {"ompl", "pinocchio"}
# to load a map and to plan takes numpy and numba only; numba itself imports scipy's
# own __init__, which is small
SCIPY = {f"scipy.{name}" for name in ("spatial", "sparse", "stats", "optimize")}
HEAVY = {"trimesh", "yourdfpy", "fcl", "networkx", "lxml", "matplotlib", *SCIPY}


@cache
def imported(path):
    """Return the top-level names of all modules that a file imports."""
    names = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module)
    return {name.split(".")[0] for name in names}


def files(package):
    return sorted((ROOT / package).rglob("*.py"))


def modules(package):
    door = importlib.import_module(package)
    found = pkgutil.walk_packages(door.__path__, f"{package}.")
    return [package, *(module.name for module in found)]


@pytest.mark.parametrize("package", ORDER)
def test_imports_point_down(package):
    above = set(ORDER[ORDER.index(package) + 1 :])
    for path in files(package):
        assert not above & imported(path), f"{path} imports {above & imported(path)}"


@pytest.mark.parametrize("package", PLANNER)
def test_the_planner_knows_no_simulator_and_no_terminal(package):
    for path in files(package):
        assert not ONLY_IN_SIM & imported(path), path


@pytest.mark.parametrize("package", PLANNER)
def test_the_planner_never_prints(package):
    for path in files(package):
        names = {n.id for n in nodes(path) if isinstance(n, ast.Name)}
        assert "print" not in names, path


@pytest.mark.parametrize("package", PLANNER)
def test_every_name_of_a_door_exists(package):
    for name in modules(package):
        module = importlib.import_module(name)
        for public in getattr(module, "__all__", ()):
            assert hasattr(module, public), f"{name} promises {public}"


@pytest.mark.parametrize("package", ORDER)
def test_every_package_opens_with_one_sentence(package):
    for path in (p for p in files(package) if p.name == "__init__.py"):
        text = ast.get_docstring(tree(path))
        assert text, path
        first = text.strip().split("\n\n")[0].replace("\n", " ")
        assert first.endswith(".") and ". " not in first, path


def test_nothing_is_called_utils():
    assert not [p for package in ORDER for p in files(package) if "util" in p.name]


def loaded_after(statements):
    code = f"import sys\n{statements}\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_importing_the_planner_loads_no_heavy_package():
    loaded = loaded_after("import roadmap, odm")
    assert not loaded & (HEAVY | ONLY_IN_SIM)


def test_the_command_line_starts_without_the_planner():
    loaded = loaded_after("import sim.cli.main")
    assert not loaded & (HEAVY | {"numba", "numpy", "roadmap", "odm"})
