"""ARMAR-III: the numbers that were read stand in the file, and it is of one piece."""

import numpy as np
import pytest

from roadmap import load_robot, tool_pose
from roadmap.geometry.self_collision import configuration_free
from roadmap.kinematics.forward import body_frames

DEGREES = {
    "hip_pitch": (-45, 45),
    "hip_roll": (-45, 45),
    "hip_yaw": (-45, 45),
    "shoulder_1_left": (-106.91, 80),
    "shoulder_2_left": (-94.62, 13.85),
    "upper_arm_left": (-69.65, 108.25),
    "elbow_left": (-122.96, 55),
    "forearm_left": (-108.25, 69.65),
    "wrist_1_left": (-29.36, 24.11),
    "wrist_2_left": (-38.40, 44.32),
}


@pytest.fixture(scope="module")
def robot():
    return load_robot("armar3", cover_excess=0.1)


def origins(robot, q):
    """Return where each joint is, by name; x to the front, y to the left [m]."""
    frames = body_frames(robot, q)
    joint = robot.tree_i[1:, 1]
    return {
        robot.joint_names[j]: T[:3, 3] for j, T in zip(joint, frames[1:], strict=True)
    }


def test_joints_and_limits_are_those_that_were_read(robot):
    assert robot.joint_names == tuple(DEGREES)
    degrees = np.degrees(np.stack([robot.lower, robot.upper], axis=1))
    np.testing.assert_allclose(degrees, list(DEGREES.values()), atol=1e-6)
    np.testing.assert_allclose(robot.max_velocity, 1.0)


def test_lengths_are_those_that_were_read(robot, rng=np.random.default_rng(1)):
    for q in [np.zeros(10), *rng.uniform(robot.lower, robot.upper, (5, 10))]:
        at = origins(robot, q)
        for a, b, length in (
            ("hip_pitch", "hip_yaw", 0.0),
            ("shoulder_1_left", "upper_arm_left", 0.0),
            ("upper_arm_left", "elbow_left", np.hypot(0.310, 0.020)),
            ("elbow_left", "wrist_1_left", np.hypot(0.240, 0.0075)),
            ("wrist_1_left", "wrist_2_left", 0.0),
        ):
            assert np.linalg.norm(at[a] - at[b]) == pytest.approx(length, abs=1e-6)
        tool = tool_pose(robot, q)[:3, 3]
        assert np.linalg.norm(tool - at["wrist_2_left"]) == pytest.approx(0.130)


def test_it_stands_as_the_maker_s_model_does(robot):
    at = origins(robot, np.zeros(10))
    np.testing.assert_allclose(at["hip_yaw"], [0.158, 0, 0.890], atol=1e-6)
    np.testing.assert_allclose(at["shoulder_1_left"], [0.123, 0.232, 1.375], atol=1e-6)
    # the upper arm hangs, 15 degrees off the body; the forearm points ahead
    arm = at["elbow_left"] - at["upper_arm_left"]
    assert arm[2] < -0.29 and 0.05 < arm[1] < 0.1
    fore = at["wrist_1_left"] - at["elbow_left"]
    np.testing.assert_allclose(fore / np.linalg.norm(fore), [1, 0, 0], atol=0.05)
    tool = tool_pose(robot, np.zeros(10))
    np.testing.assert_allclose(tool[:3, 2], [1, 0, 0], atol=1e-6)


def test_shoulder_and_elbow_turn_the_way_an_arm_does(robot):
    q = np.zeros(10)
    names = list(robot.joint_names)
    for joint, angle, axis, sign in (
        ("shoulder_1_left", -1.2, 0, 1),  # forward
        ("shoulder_2_left", -1.0, 1, 1),  # sideways, away from the body
        ("elbow_left", -1.2, 2, -1),  # down, stretching
    ):
        moved = q.copy()
        moved[names.index(joint)] = angle
        way = tool_pose(robot, moved)[:3, 3] - tool_pose(robot, q)[:3, 3]
        if joint == "shoulder_1_left":  # the forearm would go up; look at the elbow
            way = origins(robot, moved)["elbow_left"] - origins(robot, q)["elbow_left"]
        assert sign * way[axis] > 0.1


def test_it_is_free_where_it_stands_and_can_touch_itself(robot):
    assert configuration_free(robot, np.zeros(10))[0]
    rng = np.random.default_rng(0)
    drawn = rng.uniform(robot.lower, robot.upper, (400, 10))
    assert 0.3 < np.mean([configuration_free(robot, q)[0] for q in drawn]) < 0.9
