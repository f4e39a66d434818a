"""`odm run --carry`: the ball is planned with, audited, and refused where it must."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small import small_recipe

import odm as planner_package
from odm.cell_map.recipe import PayloadRecipe
from roadmap.kinematics.forward import tool_pose
from sim.loop.carried import ball_rows, take_ball
from sim.record import read_record, write_record
from sim.record.record_check import BadRecord
from sim.record.run_record import RunRecord


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    envelope = PayloadRecipe(radius=0.08, position=(0.0, 0.0, 0.05))
    recipe = replace(small_recipe(), payload=envelope)
    folder = tmp_path_factory.mktemp("carried") / "arm3"
    return planner_package.build_map(recipe).save(folder)


@pytest.mark.parametrize("execution", ["kinematic", "timed"])
def test_a_run_with_a_ball_has_no_contact_while_moving(
    odm, map_dir, tmp_path, execution
):
    file = tmp_path / "run.json"
    code, out, err = odm(
        "run", "--map", map_dir, "--seconds", 5, "--carry", 0.07, "--json", file,
        "--execution", execution,
    )  # fmt: skip
    assert code == 0, err
    result = json.loads(file.read_text())
    assert result["run"]["contacts"] == 0 and result["run"]["trips"] > 0
    assert "with a ball of 7 cm radius in the hand" in result["notes"]
    assert "with a ball of 7 cm" in out


def test_a_recorded_run_has_the_ball_when_it_is_run_again(odm, map_dir, tmp_path):
    file, again, bare = (tmp_path / f"{n}.npz" for n in ("run", "again", "bare"))
    words = ("run", "--map", map_dir, "--seconds", 2)
    code, _, err = odm(*words, "--carry", 0.07, "--record", file)
    assert code == 0, err
    record = read_record(file)
    assert np.array_equal(record.arrays["payload"], [[0.0, 0.0, 0.05, 0.07]])
    code, out, err = odm("replay", file, "--map", map_dir, "--record", again)
    assert code == 0 and out.startswith("same"), err
    assert again.read_bytes() == file.read_bytes()
    # the ball is what makes the difference, to the path and to the distances
    assert odm(*words, "--record", bare)[0] == 0
    empty = read_record(bare)
    assert "payload" not in empty.arrays and empty.head["format"] == 2
    assert record.head["format"] == 3  # so that older programs refuse it
    assert not np.array_equal(record.arrays["q"], empty.arrays["q"])
    found = RunRecord(record.head, {**record.arrays, "payload": np.zeros((1, 3))})
    with pytest.raises(BadRecord, match=r"must be spheres \(n, 4\) with radii above 0"):
        read_record(write_record(found, tmp_path / "bad.npz"))


def test_the_audited_robot_has_the_ball(map_dir):
    planner = planner_package.ReactivePlanner(planner_package.load_map(map_dir))
    bare = planner.robot
    robot = take_ball(planner, 0.07)
    assert np.array_equal(planner.attached, [[0.0, 0.0, 0.05, 0.07]])
    assert len(robot.solid_kind) == len(bare.solid_kind) + 1
    q = np.array([0.3, 0.2, 0.1])
    T = tool_pose(bare, q)
    (row,) = ball_rows(bare, planner.attached, q)
    assert np.allclose(row[:3], T[:3, 3] + 0.05 * T[:3, 2]) and row[6] == 0.07
    assert take_ball(planner_package.ReactivePlanner(planner.cell_map), None) is bare


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--carry", "0.09"], "a sphere of 0.08 m radius"),
        (["--carry", "-1"], "--carry is -1: give a number above 0"),
        (["--carry", "0.05", "--motion", "keyboard"], "does not go with --motion"),
    ],
)
def test_a_ball_that_cannot_be_carried_is_refused(odm, map_dir, options, words):
    code, _, err = odm("run", "--map", map_dir, "--seconds", 1, *options)
    assert code not in (0, None) and words in " ".join(err.split())
