"""Robots by name: found with their tool and locks, or refused with what would help."""

import importlib.util
import tomllib
from fnmatch import fnmatch
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from rows import each

from roadmap import load_robot, robot_names
from roadmap.errors import BadRobot
from roadmap.geometry.self_collision import configuration_free
from roadmap.geometry.spheres import robot_solids
from roadmap.kinematics.forward import body_frames, tool_pose
from roadmap.robot.known import KnownRobot, known_robot, own_file, robot_file

COARSE = {"cover_excess": 0.1}
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def rail_arm():
    """Return our arm on a rail."""
    return load_robot("rail_arm", **COARSE)


@pytest.fixture(scope="module")
def example():
    """Return a function: a name of example-robot-data -> its robot, or skip."""

    def load(name):
        try:
            return load_robot(name, **COARSE)
        except BadRobot as error:
            pytest.skip(str(error))

    return load


def test_the_names_that_are_promised_are_known():
    assert {"kawasaki_fs003n", "kuka_iiwa", "xarm6", "ur5", "baxter_left"} <= set(
        robot_names()
    )
    assert robot_names() == sorted(robot_names())


@each("name", robot_names())
def test_a_robot_of_ours_is_there_and_goes_into_the_wheel(name):
    known = known_robot(name)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["maps"]
    own = [known.file] if known.origin == "maps" else []
    for file in own + [known.srdf] * bool(known.srdf):
        assert own_file(file).is_file()
        assert any(fnmatch(file, pattern) for pattern in patterns)


def test_an_unknown_name_gets_the_list_and_the_nearest_one():
    with pytest.raises(BadRobot, match="did you mean 'kawasaki_fs003n'") as caught:
        load_robot("kawasaki")
    assert all(name in str(caught.value) for name in robot_names())


def test_a_name_like_no_other_gets_the_list():
    with pytest.raises(BadRobot, match=r"'q9'.*give the path of a .urdf file or one"):
        robot_file("q9")


def test_without_example_robot_data_the_extra_is_named(monkeypatch):
    def absent(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", absent)
    with pytest.raises(BadRobot, match=r"'ur5'.*pip install 'odm-planner\[robots\]'"):
        load_robot("ur5")


def test_without_pybullet_its_extra_is_named(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(BadRobot, match=r"'xarm6'.*pip install 'odm-planner\[sim\]'"):
        load_robot("xarm6")


def test_a_version_that_lacks_the_file_is_told_apart(monkeypatch):
    gone = KnownRobot("maps", "gone.urdf", "tool")
    monkeypatch.setattr("roadmap.robot.known._ROBOTS", {"gone": gone})
    with pytest.raises(BadRobot, match="gone.urdf of maps.*has no such file"):
        robot_file("gone")


def test_the_extras_that_errors_name_are_there():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    robots = extras["optional-dependencies"]["robots"]
    assert any(line.startswith("example-robot-data") for line in robots)
    sim = extras["optional-dependencies"]["sim"]
    assert any(line.startswith("pybullet") for line in sim)


@pytest.mark.parametrize(
    "name, dof, endless", [("ur5", 6, 0), ("kinova", 6, 3), ("baxter_left", 7, 0)]
)
def test_robots_of_example_robot_data_load(name, dof, endless, example):
    robot = example(name)
    assert robot.dof == dof and robot.continuous.sum() == endless
    assert robot.tip_name == known_robot(name).tip


def test_baxter_s_right_arm_hangs_and_only_the_left_one_moves(example, rng):
    robot = example("baxter_left")
    assert all(name.startswith("left_") for name in robot.joint_names)
    frames = body_frames(robot, np.zeros(robot.dof))
    lowest = {}
    for solid in robot_solids(robot):
        T = frames[robot.link_body[solid.link]]
        points = solid.T_body_solid[:3, 3] @ T[:3, :3].T + T[:3, 3]
        lowest[robot.link_names[solid.link]] = points[2]
    assert robot.link_body[robot.link_names.index("right_wrist")] == 0
    assert lowest["right_wrist"] < lowest["right_upper_shoulder"] - 0.4
    # its coarse shapes overlap at the joints; our SRDF leaves those pairs out
    draws = rng.uniform(robot.lower, robot.upper, (200, robot.dof))
    assert np.mean([configuration_free(robot, q)[0] for q in draws]) > 0.4
    reasons = [reason for _, _, reason in robot.dropped_pairs]
    assert sum("SRDF: overlap" in reason for reason in reasons) == 5


def test_one_s_own_srdf_and_locks_come_before_the_known_ones(tmp_path):
    path = tmp_path / "pairs.srdf"
    line = '<disable_collisions link1="rail" link2="column" reason="why not"/>'
    path.write_text(f"<robot>{line}</robot>")
    robot = load_robot("rail_arm", locked={"slide": 0.1}, srdf=path, **COARSE)
    assert "slide" not in robot.joint_names
    assert ("rail", "column", "SRDF: why not") in robot.dropped_pairs
    assert any("slide = 0.1" in note for note in robot.notes)
    assert "held over the whole travel of left_finger" in robot.notes
    robot = load_robot("rail_arm", travel=(), **COARSE)
    assert any("left_finger = 0.02" in note for note in robot.notes)


def test_the_rail_arm_has_a_joint_of_every_kind(rail_arm, rng):
    assert rail_arm.joint_names == ("slide", "turn", "shoulder", "elbow", "wrist")
    assert rail_arm.continuous.tolist() == [False, True, False, False, False]
    # a slide moves all of it along y, by as much
    q = rng.uniform(rail_arm.lower, rail_arm.upper)
    moved = q.copy()
    moved[0] += 0.1
    step = tool_pose(rail_arm, moved) - tool_pose(rail_arm, q)
    np.testing.assert_allclose(step[:3, 3], [0, 0.1, 0], atol=1e-12)
    slide = int(np.flatnonzero(rail_arm.tree_i[:, 2] == 2)[0])
    assert (rail_arm.sphere_reach[rail_arm.moving, slide] == 1).all()


@pytest.mark.parametrize("opening", [0.0, 0.02, 0.04])
def test_a_locked_finger_takes_its_mimic_along(opening):
    robot = load_robot("rail_arm", locked={"left_finger": opening}, **COARSE)
    y = {
        robot.link_names[solid.link]: solid.T_body_solid[1, 3]
        for solid in robot_solids(robot)
    }
    assert y["left_pad"] == pytest.approx(opening + 0.01)
    assert y["right_pad"] == pytest.approx(-opening - 0.01)
