import numpy as np
import pytest
from mocap_files import STANDING

from handover.human.body import COLUMN, JOINTS, BodySizes, Part, UpperBody, joint_places
from odm import sample_capsules
from roadmap.errors import BadInput
from roadmap.transforms import rotation_rpy

SIZES = BodySizes.sized()
LEGS = {Part.LEFT_LEG, Part.RIGHT_LEG}


def standing(**moved):
    places = np.full((len(JOINTS), 3), np.nan)
    for name, place in {**STANDING, **moved}.items():
        places[COLUMN[name]] = place
    return places


def capsules_of(body, places):
    return dict(zip(map(Part, body.labels), body.capsules(places), strict=False))


def test_a_whole_body_has_every_part_and_closed_capsules():
    body = UpperBody(STANDING, SIZES)
    capsules = body.capsules(standing())
    assert set(body.labels) == set(Part) - LEGS and len(capsules) == 9
    assert np.isfinite(capsules).all() and (capsules[:, 6] > 0).all()
    assert len(sample_capsules(capsules)) > 100


def test_arm_capsules_run_from_joint_to_joint():
    capsules = capsules_of(UpperBody(STANDING, SIZES), standing())
    for side in ("left", "right"):
        shoulder, elbow, hand = (
            STANDING[f"{side}_{j}"] for j in ("shoulder", "elbow", "hand")
        )
        upper = capsules[Part[f"{side}_upper_arm".upper()]]
        fore = capsules[Part[f"{side}_forearm".upper()]]
        np.testing.assert_allclose(upper, [*shoulder, *elbow, SIZES.upper_arm])
        np.testing.assert_allclose(fore, [*elbow, *hand, SIZES.forearm])


def test_the_hand_reaches_straight_on_by_its_length():
    rod = capsules_of(UpperBody(STANDING, SIZES), standing())[Part.RIGHT_HAND]
    wrist, elbow = np.array(STANDING["right_hand"]), np.array(STANDING["right_elbow"])
    along = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    np.testing.assert_allclose(rod[:3], wrist)
    finger_tip = rod[3:6] + rod[6] * along
    np.testing.assert_allclose(finger_tip, wrist + SIZES.hand_length * along)


def test_a_known_finger_tip_bends_the_hand():
    tip = (0.1, 0.35, 1.0)
    body = UpperBody([*STANDING, "right_tip"], SIZES)
    rod = capsules_of(body, standing(right_tip=tip))[Part.RIGHT_HAND]
    np.testing.assert_allclose(rod[3:6], tip)


def test_the_head_reaches_the_crown_above_a_low_head_joint():
    heads = UpperBody(STANDING, SIZES).capsules(standing())[-1]
    top = heads[5] + heads[6]
    assert top == pytest.approx(STANDING["neck"][2] + SIZES.crown, abs=0.02)
    marker = standing(head=(0.0, 0.0, 1.80))  # on top of the head
    assert UpperBody(STANDING, SIZES).capsules(marker)[-1, 5] == pytest.approx(1.80)


@pytest.mark.parametrize(
    "absent, n_capsules",
    [
        (("head",), 9),
        (("hip",), 9),
        (("neck",), 9),
        (("neck", "hip", "head"), 9),
        (("left_elbow",), 6),
        (("left_elbow", "left_shoulder"), 5),
        (("left_elbow", "left_shoulder", "neck"), 3),
    ],
)
def test_absent_joints_leave_a_smaller_finite_body(absent, n_capsules):
    present = [name for name in STANDING if name not in absent]
    body = UpperBody(present, SIZES)
    places = standing()
    places[[COLUMN[name] for name in absent]] = np.nan
    capsules = body.capsules(places)
    assert capsules.shape == (n_capsules, 7) == (len(body.labels), 7)
    assert np.isfinite(capsules).all()


def test_frames_are_done_at_once():
    body = UpperBody(STANDING, SIZES)
    places = np.stack([standing(), standing(right_hand=(0.3, 0.3, 1.0))])
    both = body.capsules(places)
    np.testing.assert_array_equal(both, [body.capsules(p) for p in places])


def test_capsules_give_their_joints_back():
    places = standing(right_tip=(0.1, 0.35, 1.0))
    body = UpperBody([*STANDING, "right_tip"], SIZES)
    capsules = body.capsules(places)
    found = joint_places(capsules, body.labels)
    known = [n for n in (*STANDING, "right_tip") if n != "head"]
    at = [COLUMN[name] for name in known]
    np.testing.assert_array_equal(found[at], places[at])
    again = UpperBody(JOINTS, SIZES).capsules(found)
    np.testing.assert_allclose(again, capsules, atol=1e-15)


def test_what_no_capsule_tells_has_no_place():
    arm = ("right_shoulder", "right_elbow", "right_hand")
    body = UpperBody(arm, SIZES)
    found = joint_places(body.capsules(standing()), body.labels)
    known = np.isfinite(found).all(axis=1)
    assert {n for n, k in zip(JOINTS, known, strict=True) if k} == {*arm, "right_tip"}


def test_the_body_turns_and_moves_with_its_joints():
    body = UpperBody(STANDING, SIZES)
    R, shift = rotation_rpy(0, 0, 0.7), np.array([0.4, -1.0, 0.2])
    turned = body.capsules(standing() @ R.T + shift)
    capsules = body.capsules(standing())
    np.testing.assert_allclose(turned[:, :3], capsules[:, :3] @ R.T + shift)
    np.testing.assert_allclose(turned[:, 3:6], capsules[:, 3:6] @ R.T + shift)


def test_needs_lists_exactly_the_joints_that_place_a_capsule():
    body = UpperBody(STANDING, SIZES)
    before = body.capsules(standing())
    for name in STANDING:
        moved = standing()
        moved[COLUMN[name]] += [0.03, 0.05, -0.02]
        changed = (body.capsules(moved) != before).any(axis=1)
        np.testing.assert_array_equal(changed, body.needs[:, COLUMN[name]], name)


def test_joints_on_one_spot_give_a_sphere_and_no_nan():
    places = standing(right_hand=STANDING["right_elbow"], head=STANDING["neck"])
    assert np.isfinite(UpperBody(STANDING, SIZES).capsules(places)).all()


def test_labels_read_as_words():
    assert Part.LEFT_UPPER_ARM.words == "left upper arm" and Part.HEAD.words == "head"


@pytest.mark.parametrize(
    "present, words",
    [
        (["hip", "neck"], "no arm is complete among hip, neck; give shoulder"),
        (["right_shoulder", "right_hand"], "no arm is complete"),
        ([], "among none"),
        (["right_knee"], "no joint right_knee; choose from hip"),
    ],
)
def test_a_body_without_arms_or_of_unknown_joints_is_refused(present, words):
    with pytest.raises(BadInput, match=words):
        UpperBody(present, SIZES)


def test_thin_people_are_inside_thick_ones():
    mean, thick = (vars(BodySizes.sized(1.75, t)) for t in ("mean", "conservative"))
    assert all(mean[name] <= thick[name] for name in mean)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: BodySizes.sized(2.6), "2.6 m is outside 1.2 to 2.2"),
        (lambda: BodySizes.sized(1.7, "fat"), "no thickness 'fat'"),
        (lambda: BodySizes(0, *[0.1] * 8), "hand of a body is 0 m"),
    ],
)
def test_impossible_sizes_are_refused(call, words):
    with pytest.raises(BadInput, match=words):
        call()


def test_one_body_has_the_bytes_that_it_has_among_several():
    body = UpperBody(JOINTS, BodySizes.sized(1.75))
    places = np.random.default_rng(5).normal(0.0, 0.5, (200, len(JOINTS), 3))
    places[0, COLUMN["head"]] = places[0, COLUMN["neck"]]  # no direction
    places[1, COLUMN["hip"]] = np.nan
    both = body.capsules(places)
    for one, rows in zip(places, both, strict=True):
        assert body.capsules(one).tobytes() == rows.tobytes()
