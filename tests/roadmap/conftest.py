"""Robots for the tests: the Panda, others where installed, and hand-written ones."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from urdf_parts import BALL

from roadmap import load_robot


def _folder(package: str, inside: str = "") -> Path | None:
    try:
        spec = importlib.util.find_spec(package)
    except ModuleNotFoundError:  # nor is the package that it lies in
        spec = None
    places = list(spec.submodule_search_locations or []) if spec else []
    return Path(places[0]) / inside if places else None


@pytest.fixture(scope="session")
def panda():
    """Return pybullet_data's Panda with its default cover."""
    if _folder("pybullet_data") is None:
        pytest.skip("the Panda comes with pybullet, which is not installed")
    return load_robot("panda")


@pytest.fixture(scope="session")
def pybullet_file():
    """Return a function: path inside pybullet_data -> Path, or skip."""

    def find(inside: str) -> Path:
        folder = _folder("pybullet_data")
        if folder is None or not (folder / inside).is_file():
            pytest.skip(f"pybullet_data/{inside} is not installed")
        return folder / inside

    return find


@pytest.fixture(scope="session")
def example_file():
    """Return a function: path inside example-robot-data -> Path, or skip."""

    def find(inside: str) -> Path:
        prefix = _folder("cmeel.prefix") or _folder("numpy").parent / "cmeel.prefix"
        path = prefix / "share/example-robot-data/robots" / inside
        if not path.is_file():
            pytest.skip(f"example-robot-data with {inside} is not installed")
        return path

    return find


@pytest.fixture
def urdf(tmp_path):
    """Return a function: body of a <robot> -> path of a URDF file in tmp_path."""

    def write(body: str, name: str = "robot.urdf") -> Path:
        path = tmp_path / name
        path.write_text(f'<robot name="handmade">{body}</robot>')
        return path

    return write


@pytest.fixture(scope="session")
def link():
    """Return a function that writes a <link> with one collision shape."""

    def write(name: str, shape: str = "", xyz: str = "0 0 0", rpy: str = "0 0 0"):
        if not shape:
            return f'<link name="{name}"/>'
        return (
            f'<link name="{name}"><collision><origin xyz="{xyz}" rpy="{rpy}"/>'
            f"<geometry>{shape}</geometry></collision></link>"
        )

    return write


@pytest.fixture(scope="session")
def joint():
    """Return a function that writes a <joint>."""

    def write(name, kind, parent, child, xyz="0 0 0", axis="0 0 1", inside=""):
        limit = '<limit lower="-2" upper="1.5" velocity="1" effort="1"/>'
        if kind in ("fixed", "continuous") or "<limit" in inside:
            limit = ""
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            f"{limit}{inside}</joint>"
        )

    return write


@pytest.fixture
def arm(urdf, link, joint):
    """Return a function: shape of the moving link -> path of its URDF."""

    def write(shape="", kind="revolute", inside="", name="robot.urdf"):
        body = link("base", BALL) + link("arm", shape)
        return urdf(body + joint("turn", kind, "base", "arm", inside=inside), name)

    return write


@pytest.fixture
def gantry(urdf, link, joint):
    """Return a robot with prismatic, continuous and mimic joints on its chain."""
    box = '<box size="0.3 0.1 0.1"/>'
    rail = '<limit lower="-0.2" upper="0.7" velocity="0.5" effort="1"/>'
    follow = '<mimic joint="turn" multiplier="-2" offset="0.3"/>'
    body = link("base", '<box size="0.1 0.1 0.5"/>') + link("slide", box)
    body += link("arm", '<cylinder radius="0.05" length="0.4"/>', "0 0 0.2")
    body += link("hand", '<sphere radius="0.06"/>', "0.1 0 0") + link("tool")
    body += joint("rail", "prismatic", "base", "slide", "0 0 0.6", "1 0 0", rail)
    body += joint("turn", "continuous", "slide", "arm", "0.2 0 0", "0 1 0")
    body += joint("wrist", "continuous", "arm", "hand", "0 0 0.5", "0 1 0", follow)
    body += joint("mount", "fixed", "hand", "tool", "0.2 0 0")
    return load_robot(urdf(body), cover_excess=0.03)


@pytest.fixture
def crane(urdf, link, joint):
    """Return a robot whose slides come before, between and behind turning joints."""
    slow = '<limit lower="-3" upper="3" velocity="0.7" effort="1"/>'
    rail = '<limit lower="0" upper="1.2" velocity="0.5" effort="1"/>'
    rod = '<limit lower="-0.1" upper="0.5" velocity="0.3" effort="1"/>'
    box = '<box size="0.6 0.08 0.08"/>'
    body = link("base", '<box size="0.2 0.2 0.2"/>') + link("cart", box)
    body += link("boom", box, "0.3 0 0") + link("mast", box, "0 0.2 0")
    body += link("rod", '<cylinder radius="0.04" length="0.5"/>', "0 0 -0.25")
    body += link("hook", '<sphere radius="0.07"/>', "0.1 0 0") + link("tool")
    body += joint("rail", "prismatic", "base", "cart", "0 0 0.5", "0 1 0", rail)
    body += joint("slew", "continuous", "cart", "boom", "0 0 0.1")
    body += joint("luff", "revolute", "boom", "mast", "0.6 0 0", "0 0.6 0.8", slow)
    body += joint("lift", "prismatic", "mast", "rod", "0 0.4 0", "0 0 1", rod)
    body += joint("spin", "continuous", "rod", "hook", "0 0 -0.5", "0.6 0 0.8")
    body += joint("mount", "fixed", "hook", "tool", "0.2 0 0")
    return load_robot(urdf(body, "crane.urdf"), cover_excess=0.05)


@pytest.fixture
def rng():
    """Return a generator with a fixed seed."""
    return np.random.default_rng(7)
