"""`odm handover plan`: the scene of the guide, planned and written without --json."""

import re
from pathlib import Path

import pytest

import handover
from handover.grasps.grasp_build import GraspSettings
from handover.scenes.load import load_scene
from handover.scenes.plan_file import read_plan
from handover.scenes.start_check import start_distances
from sim.cli import handover_command

PAGE = Path(__file__).resolve().parents[3] / "docs" / "plans.md"
FEW = GraspSettings(samples=16, rolls=6)


@pytest.fixture(scope="module")
def tea(tmp_path_factory):
    """Return the scene of docs/plans.md, byte for byte, as a file."""
    path = tmp_path_factory.mktemp("tea") / "my_scene.toml"
    path.write_bytes(re.findall(rb"```toml\n(.*?)```", PAGE.read_bytes(), re.S)[0])
    return path


def test_the_scene_of_the_guide_starts_free(tea):
    scene = load_scene(tea)
    assert scene.name == "tea" and start_distances(scene)[0][0] > 0.0


def test_the_scene_of_the_guide_is_planned_and_written_without_json(odm, tea):
    cup = handover.load_object("cup")
    for hand in ("sdh_left", "person_right"):
        made = handover.build_grasps(cup, hand, FEW)
        made.save(tea.parent / "grasps" / f"cup-{hand}")
    out = tea.parent / "plan.json"
    words = ("--grasps", tea.parent / "grasps", "--out", out)
    code, told, err = odm("handover", "plan", tea, *words)
    assert code == 0, err
    assert f"plan in {out}" in told
    assert read_plan(out)["motions"]


def test_reasons_are_counted_the_most_frequent_first(capsys):
    lines = [f"tuple {k}: the hand: touches {k % 9}" for k in range(11)]
    handover_command._show_failed([*lines, "tuple 11: no room"])
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "  2 tuples without motions: the hand: touches 0"
    assert told[2] == "  1 tuple without motions: the hand: touches 2"
    assert told[6:] == ["  4 tuples for 4 other reasons; --json lists them all"]
    handover_command._show_failed([])
    assert capsys.readouterr().out == ""
