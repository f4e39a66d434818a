"""Small maps that many tests share; built once a session."""

import gc
import importlib.util
import os
import sys
from collections.abc import Generator
from pathlib import Path

from sim.__main__ import COLLECT, compute_alike

compute_alike()  # as the command does, before numpy is there

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from small import small_recipe  # noqa: E402

import odm  # noqa: E402

gc.set_threshold(*COLLECT)  # as the command does: to rewrite asserts makes many objects


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Import from the other end in every second worker, where all tests are run.

    Asserts that one worker has rewritten the other reads; in a fresh clone each of two
    that go side by side would rewrite them all.
    """
    number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    folder, config = Path(__file__).parent, session.config
    if number % 2 == 0 or config.args != config.getini("testpaths"):
        return
    for file in sorted(folder.rglob("test_*.py"), reverse=True):
        try:
            _ = pytest.Module.from_parent(session, path=file).obj
        except (Exception, pytest.skip.Exception):  # is told where it is collected
            inside = file.relative_to(folder.parent).with_suffix("")
            sys.modules.pop(".".join(inside.parts), None)


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Leave out what was collected where tests look for garbage: 0.3 s each time."""
    gc.freeze()


ABSENT = "comes with pybullet"  # told wherever a robot of pybullet_data is asked for

if importlib.util.find_spec("pybullet_data") is None:  # such as with Python 3.12

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup() -> Generator:
        """Skip what needs a robot that is not here."""
        return (yield from _unless_absent())

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call() -> Generator:
        """Skip what needs a robot that is not here."""
        return (yield from _unless_absent())


def _unless_absent() -> Generator:
    try:
        return (yield)
    except Exception as error:
        if ABSENT not in str(error):
            raise
        pytest.skip("the Panda comes with pybullet, which is not installed")


@pytest.fixture(scope="session")
def small_map() -> odm.CellMap:
    """A map of the three-joint arm: 150 nodes on a floor."""
    return odm.build_map(small_recipe())


@pytest.fixture
def planner(small_map: odm.CellMap) -> odm.ReactivePlanner:
    """A fresh planner on the small map."""
    return odm.ReactivePlanner(small_map, always_replan=True)


@pytest.fixture
def rng() -> np.random.Generator:
    """A seeded generator."""
    return np.random.default_rng(20)
