"""A person from measured joints: they come back, and so does what they tell."""

import numpy as np
import pytest
from mocap_files import STANDING

from handover import Human, human_from_joints
from handover.human.anthropometry import ARM_RANGES
from handover.human.body import COLUMN, JOINTS, joint_places
from roadmap.errors import BadInput
from roadmap.transforms import pose_of

TURNED = pose_of((0.4, -1.0, 1.1), (0.1, 0.2, 2.0))


def somebody(rng, height=1.8):
    q = rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1], (2, 7))
    return Human(height, T_world_pelvis=TURNED, arms={"left": q[0], "right": q[1]})


def hands_of(human):
    return {side: human.T_world_hand(side)[:3, :3] for side in ("left", "right")}


def test_joints_of_an_upright_model_person_come_back(rng):
    for _ in range(200):
        human = somebody(rng)
        fitted = human_from_joints(human.places, 1.8, hands=hands_of(human))
        np.testing.assert_allclose(fitted.places, human.places, atol=1e-9)
        for side in ("left", "right"):
            np.testing.assert_allclose(
                fitted.arms[side], human.arms[side], atol=1e-6, err_msg=side
            )
            np.testing.assert_allclose(
                fitted.T_world_hand(side), human.T_world_hand(side), atol=1e-9
            )
            np.testing.assert_allclose(
                fitted.T_world_shoulder(side), human.T_world_shoulder(side), atol=1e-9
            )


def test_measured_places_come_back_whatever_the_person_is_like(rng):
    """Also in poses no joint range allows: the capsules are where they were seen."""
    for _ in range(200):
        places = np.array([STANDING.get(n, [np.nan] * 3) for n in JOINTS], float)
        places += rng.normal(0, 0.06, places.shape)
        known = np.isfinite(places).all(axis=1)
        fitted = human_from_joints(places)
        np.testing.assert_allclose(fitted.places[known], places[known], atol=1e-9)
        assert np.isfinite(fitted.capsules()).all()


def test_the_capsules_are_those_of_the_recording(rng):
    human = somebody(rng)
    fitted = human_from_joints(joint_places(human.capsules(), human.labels), 1.8)
    np.testing.assert_allclose(fitted.capsules()[:9], human.capsules()[:9], atol=1e-9)


def test_without_the_hand_the_forearm_is_in_the_middle(rng):
    human = somebody(rng)
    fitted = human_from_joints(human.places, 1.8)
    for side in ("left", "right"):
        assert fitted.arms[side][4] == 0.0
        np.testing.assert_allclose(
            fitted.arms[side][:4], human.arms[side][:4], atol=1e-6
        )
        tips = [COLUMN[f"{side}_tip"]]
        np.testing.assert_allclose(fitted.places[tips], human.places[tips], atol=1e-9)


def test_a_height_is_estimated_from_arms_and_trunk():
    for height in (1.4, 1.75, 2.0):
        assert human_from_joints(Human(height).places).height == pytest.approx(height)


def test_one_arm_and_the_neck_are_enough():
    human = Human(1.75, T_world_pelvis=TURNED)
    some = ("neck", "right_shoulder", "right_elbow", "right_hand")
    at = {name: human.places[COLUMN[name]] for name in some}
    fitted = human_from_joints(at, 1.75)
    where = [COLUMN[name] for name in some]
    np.testing.assert_allclose(fitted.places[where], human.places[where], atol=1e-9)
    front = fitted.T_world_pelvis[:3, 0] @ human.T_world_pelvis[:3, 0]
    assert front > 0.8  # the hip is not known: the trunk is taken as upright


def test_an_elbow_bent_back_is_kept_and_not_turned_round():
    back = np.radians([30, 10, 20, -4, 0, 0, 0])
    human = Human(1.75, arms={"right": back, "left": back})
    fitted = human_from_joints(human.places, 1.75)
    np.testing.assert_allclose(fitted.arms["right"][:4], back[:4], atol=1e-9)


@pytest.mark.parametrize(
    "places, words",
    [
        (np.zeros((10, 3)), r"shape \(10, 3\); give \(11, 3\)"),
        (np.full((11, 3), np.nan), "known joints are none"),
        ({"left_knee": np.zeros(3)}, "no joint left_knee; choose from hip"),
        ({"neck": np.zeros(2)}, r"neck is no \(3,\) point"),
        ({"neck": np.zeros(3)}, "known joints are neck; a person needs"),
    ],
)
def test_too_little_is_refused(places, words):
    with pytest.raises(BadInput, match=words):
        human_from_joints(places)


def test_nonsense_is_refused():
    good = Human(1.75).places
    with pytest.raises(BadInput, match="within 2 cm"):
        bad = good.copy()
        bad[COLUMN["left_hand"]] = bad[COLUMN["left_elbow"]]
        human_from_joints(bad, 1.75)
    with pytest.raises(BadInput, match="on one line"):
        bad = good.copy()
        bad[[COLUMN["left_shoulder"], COLUMN["right_shoulder"]]] = bad[COLUMN["neck"]]
        human_from_joints(bad, 1.75)
    with pytest.raises(BadInput, match="check the unit of the places, metres"):
        human_from_joints(1000.0 * good)
    with pytest.raises(BadInput, match="no 'lefft' arm"):
        human_from_joints(good, 1.75, hands={"lefft": np.eye(3)})
    with pytest.raises(BadInput, match="give side -> "):
        human_from_joints(Human().places, hands="left")
    with pytest.raises(BadInput, match=r"rotation has shape \(2, 2\); give \(3, 3\)"):
        human_from_joints(Human().places, hands={"left": np.eye(2)})
    with pytest.raises(BadInput, match="left hand's rotation is not a rigid"):
        human_from_joints(good, 1.75, hands={"left": 2 * np.eye(3)})


def test_an_arm_raised_a_little_too_far_does_not_jump_by_a_turn():
    high = np.radians([188, 10, -20, 30, 0, 0, 0])
    human = Human(1.75, arms={"right": high, "left": high})
    fitted = human_from_joints(human.places, 1.75)
    for side in ("left", "right"):
        np.testing.assert_allclose(fitted.arms[side][:4], high[:4], atol=1e-9)
