"""A recording drives the one model of a person."""

import numpy as np
import pytest
from mocap_files import person, write_csv

from handover import human_from_joints
from handover.human.body import Part, joint_places
from sim.people.mocap import load_mocap


@pytest.fixture
def motion(tmp_path):
    return load_mocap(write_csv(tmp_path / "clip.csv", person()))


def test_the_model_is_where_the_recording_is(motion):
    for t in (0.0, 0.733, 2.5):
        recorded = motion.guess(t)
        human = human_from_joints(joint_places(recorded, motion.labels), 1.75)
        capsules = human.capsules()[: len(recorded)]
        arms = motion.labels < Part.TORSO
        np.testing.assert_array_equal(human.labels[: len(recorded)], motion.labels)
        np.testing.assert_allclose(capsules[arms], recorded[arms], atol=1e-9)
        # between two frames a trunk is interpolated capsule by capsule
        np.testing.assert_allclose(capsules, recorded, atol=1e-4)


def test_the_joints_move_as_smoothly_as_the_person(motion):
    times = np.arange(0.0, 2.9, 0.02)
    joints = []
    for t in times:
        places = joint_places(motion.guess(t), motion.labels)
        joints.append(human_from_joints(places, 1.75).arms["right"])
    speed = np.abs(np.diff(joints, axis=0)).max() / 0.02
    assert 0.1 < speed < 6.0  # [rad/s] no jump to another reading of the shoulder


def test_the_hand_is_found_again_by_inverse_kinematics(motion):
    places = joint_places(motion.guess(1.0), motion.labels)
    human = human_from_joints(places, 1.75)
    solutions = human.arm_ik("right", human.T_world_hand("right"))
    assert np.abs(solutions.q - human.arms["right"]).max(axis=1).min() < 0.2
