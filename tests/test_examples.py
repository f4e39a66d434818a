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


def example(number):
    """Return the `main` of an example by its number."""
    (file,) = FOLDER.glob(f"{number:02d}_*.py")
    return runpy.run_path(str(file))["main"]


def test_a_ball_in_the_way_gives_another_path(small_arm, capsys):
    free, around = example(1)(small_arm)
    assert len(free.path) and not np.array_equal(free.path, around.path)
    said = capsys.readouterr().out
    assert "nobody there" in said and "straight into the ball: False" in said


def test_beside_a_person_it_works_and_keeps_away(small_arm):
    result = example(2)(small_arm, 8.0)
    assert result["trips"] >= 1 and result["closest"] > 0.0


def test_two_robots_work_beside_each_other(small_arm):
    result = example(3)(small_arm, 12.0)
    assert min(result["trips"]) >= 1 and result["closest"] > 0.0


def test_every_example_is_tested_and_short():
    files = sorted(FOLDER.glob("*.py"))
    assert [int(file.name[:2]) for file in files] == [1, 2, 3]
    assert all(len(file.read_text().splitlines()) <= 120 for file in files)
