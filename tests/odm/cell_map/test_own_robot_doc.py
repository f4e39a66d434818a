"""The recipe of docs/own_robot.md builds, with the arm of the tests as the robot."""

import re
from pathlib import Path

import pytest

from odm import build_map, load_recipe
from odm.close_test.safety import Safety

ROOT = Path(__file__).resolve().parents[3]
ARM = ROOT / "tests" / "data" / "arm3.urdf"
NAMES = {"my.urdf": str(ARM), "tool0": "tool", "joint_1": "turn", "joint_2": "bend"}


@pytest.fixture(scope="module")
def recipe(tmp_path_factory):
    page = (ROOT / "docs" / "own_robot.md").read_text(encoding="utf-8")
    text = re.search(r"```toml\n(.*?)```", page, re.S).group(1)
    for told, ours in NAMES.items():
        assert told in text
        text = text.replace(told, ours)
    path = tmp_path_factory.mktemp("doc") / "my.toml"
    path.write_text(text.replace("nodes = 10000", "nodes = 60"), encoding="utf-8")
    return load_recipe(path)


def test_it_says_what_is_taken_where_nothing_is_said(recipe):
    assert recipe.safety == Safety()
    assert recipe.name == "my" and recipe.payload is not None


def test_it_builds_with_limits_floor_table_and_payload(recipe):
    cell_map = build_map(recipe, threads=1)
    robot = cell_map.robot
    turn, bend = (robot.joint_names.index(name) for name in ("turn", "bend"))
    assert robot.max_acceleration[turn] == robot.max_acceleration[bend] == 20.0
    assert robot.max_jerk[turn] == 1000.0
    assert cell_map.payload is not None and cell_map.roadmap.n_edges > 0
