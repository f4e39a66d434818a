"""The wheel holds what runs and leaves out what measures."""

import ast
import sys
import tomllib
from pathlib import Path

import pytest
from setuptools import PEP420PackageFinder
from sources import nodes

from roadmap.errors import BadInput
from sim.cli import bench_command

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def shipped():
    """Return the packages that pip puts into the wheel.

    A folder that holds no file, only what was compiled in it once, ships nothing.
    """
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    find = tomllib.loads(text)["tool"]["setuptools"]["packages"]["find"]
    found = PEP420PackageFinder.find(
        str(ROOT), include=find["include"], exclude=find["exclude"]
    )
    return {name for name in found if any((ROOT / Path(*name.split("."))).glob("*.py"))}


def folders(*packages):
    """Return the dotted names of all folders that hold Python files."""
    files = (f for package in packages for f in (ROOT / package).rglob("*.py"))
    return {".".join(file.relative_to(ROOT).parts[:-1]) for file in files}


def test_the_wheel_holds_every_package_and_no_bench(shipped):
    benches = {name for name in folders("sim") if name.startswith("sim.bench")}
    assert benches
    assert shipped == folders("roadmap", "odm", "handover", "sim", "maps") - benches


def test_what_is_shipped_imports_no_bench_but_to_run_it(shipped):
    bad = []
    for package in shipped:
        for file in (ROOT / package.replace(".", "/")).glob("*.py"):
            for node in nodes(file):
                if isinstance(node, ast.Import | ast.ImportFrom):
                    source = getattr(node, "module", None)
                    names = [
                        ".".join(filter(None, (source, a.name))) for a in node.names
                    ]
                    bad += [file.name for name in names if "sim.bench" in name]
    assert bad == ["bench_command.py"]


def test_without_the_benches_one_sentence_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "sim.bench", None)
    with pytest.raises(BadInput, match=r"not installed.*pip install -e '\.\[bench\]'"):
        bench_command.bench(name="latency")
