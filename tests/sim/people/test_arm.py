"""The human arm: sizes, poses, and what it refuses."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadmap.errors import BadInput
from sim.people.arm import HumanArm, facing_robot

angles = st.tuples(*[st.floats(-3.0, 3.0)] * 4)
SHOULDER = facing_robot((0.85, 0.1, 0.5))


@settings(deadline=None, max_examples=50)
@given(angles)
def test_lengths_and_radii_do_not_depend_on_the_pose(angles):
    arm = HumanArm.sized()
    capsules = arm.capsules(SHOULDER, angles)
    lengths = np.linalg.norm(capsules[:, 3:6] - capsules[:, :3], axis=1)
    axes = arm.lengths - [0.0, arm.radii[1]]
    np.testing.assert_allclose(lengths, axes, atol=1e-10)
    np.testing.assert_array_equal(capsules[:, 6], arm.radii)


@settings(deadline=None, max_examples=50)
@given(angles)
def test_the_forearm_starts_where_the_upper_arm_ends(angles):
    upper, fore = HumanArm.sized().capsules(SHOULDER, angles)
    np.testing.assert_array_equal(upper[3:6], fore[:3])
    np.testing.assert_allclose(upper[:3], SHOULDER[:3, 3])


@settings(deadline=None, max_examples=50)
@given(angles)
def test_moving_the_shoulder_moves_the_arm_with_it(angles):
    arm = HumanArm.sized()
    moved = SHOULDER.copy()
    moved[:3, 3] += (0.1, -0.2, 0.3)
    there = arm.capsules(moved, angles)
    here = arm.capsules(SHOULDER, angles) + [*(0.1, -0.2, 0.3) * 2, 0.0]
    np.testing.assert_allclose(there, here, atol=1e-12)


def test_at_zero_the_arm_hangs_straight_down():
    arm = HumanArm.sized()
    capsules = arm.capsules(np.eye(4), np.zeros(4))
    np.testing.assert_allclose(capsules[:, [0, 1, 3, 4]], 0.0, atol=1e-12)
    assert capsules[1, 5] - arm.radii[1] == pytest.approx(-arm.lengths.sum())


@pytest.mark.parametrize(
    ("angles", "direction"),
    [((np.pi / 2, 0, 0, 0), (1, 0, 0)), ((0, np.pi / 2, 0, 0), (0, 1, 0))],
)
def test_flexion_lifts_it_forward_and_abduction_to_the_left(angles, direction):
    arm = HumanArm.sized()
    hand = arm.capsules(np.eye(4), angles)[1, 3:6]
    np.testing.assert_allclose(hand, arm.reach * np.array(direction), atol=1e-12)


def test_the_elbow_bends_the_forearm_forward():
    arm = HumanArm.sized()
    fore = arm.capsules(np.eye(4), (0, 0, 0, np.pi / 2))[1]
    assert fore[3] > 0.3 and fore[5] == pytest.approx(fore[2])


def test_the_second_capsule_ends_at_the_finger_tips_of_a_person_of_that_height():
    arm = HumanArm.sized(1.75)
    np.testing.assert_allclose(arm.lengths, [0.3255, 0.4445])
    np.testing.assert_array_equal(arm.radii, [0.075, 0.065])
    assert HumanArm.sized(1.75, "mean").radii[0] < arm.radii[0]


def test_the_arm_is_frozen():
    arm = HumanArm.sized()
    with pytest.raises(dataclasses.FrozenInstanceError):
        arm.radii = np.ones(2)
    with pytest.raises(ValueError, match="read-only"):
        arm.radii[0] = 1.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: HumanArm.sized(17.5), "17.5 m is outside"),
        (lambda: HumanArm.sized(1.7, "tiny"), "conservative, mean"),
        (lambda: HumanArm([0.3, 0.4], [0.07, 0.0]), "positive"),
        (lambda: HumanArm([0.3, 0.4, 0.1], [0.07, 0.05]), "two positive"),
        (lambda: HumanArm([0.3, 0.05], [0.07, 0.06]), "shorter than its radius"),
    ],
)
def test_an_impossible_arm_is_refused_in_one_sentence(make, words):
    with pytest.raises(BadInput, match=words):
        make()
