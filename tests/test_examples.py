"""The examples of docs/examples run, in a short form, and show what they say."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import odm

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "examples"


@pytest.fixture(scope="module")
def small_arm():
    """Return the map that the examples build without one of their own."""
    return odm.build_map(odm.load_recipe(FOLDER / "small_arm.toml"))


@pytest.fixture
def example(monkeypatch):
    """Return a function: number of an example -> its `main`, as its script sees it."""
    monkeypatch.syspath_prepend(str(FOLDER))

    def load(number):
        (file,) = FOLDER.glob(f"{number:02d}_*.py")
        return runpy.run_path(str(file))["main"]

    return load


def test_a_ball_in_the_way_gives_another_path(example, small_arm, capsys):
    free, around = example(1)(small_arm)
    assert len(free.path) and not np.array_equal(free.path, around.path)
    said = capsys.readouterr().out
    assert "nobody there" in said and "straight into the ball: False" in said


def test_a_motion_stops_and_turns_back(example, small_arm, capsys):
    motion = example(2)(small_arm)
    places = example(1).__globals__["two_places"](odm.ReactivePlanner(small_arm))
    assert np.abs(motion.q_end - places[0]).max() < 1e-6
    assert "a stop begun at" in capsys.readouterr().out


def test_the_loop_goes_to_and_fro_and_keeps_away(example, small_arm):
    result = example(3)(small_arm, 8.0)
    assert result["trips"] >= 1 and result["closest"] > 0.0


def test_beside_a_person_it_brakes_and_keeps_away(example, small_arm):
    result = example(4)(small_arm, 8.0)
    assert result["trips"] >= 1 and result["closest"] > 0.0


def test_a_person_who_comes_nearer_is_named(example, small_arm, capsys):
    far, _, near = example(5)(small_arm)
    assert far.status != "holding"
    assert "cm away" in capsys.readouterr().out and near is not None


def test_two_robots_work_beside_each_other(example, small_arm):
    result = example(6)(small_arm, 9.0)
    assert min(result["trips"]) >= 1 and result["closest"] > 0.0


def test_every_example_is_tested_and_short():
    files = sorted(FOLDER.glob("*.py"))
    assert [int(file.name[:2]) for file in files] == [1, 2, 3, 4, 5, 6, 7]
    assert all(len(file.read_text().splitlines()) < 60 for file in files)
