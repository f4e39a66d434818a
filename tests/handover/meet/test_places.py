"""What a hand can do at a place is the best of everything one could try there."""

import math

import numpy as np
import pytest

from handover import ArmState, Human, QualitySettings, posture_quality, rotation_grid
from handover.chain import Chain
from handover.meet.places import NAMES, qualities_at
from handover.meet.quality import total_quality
from handover.meet.settings import PARTS, MeetSettings
from handover.reach.extremes import best_dexterity, work_of
from roadmap.errors import BadInput
from roadmap.kinematics._chain import dexterity, forward, jacobian

ROTATIONS = 72


@pytest.fixture(scope="module")
def person():
    return Human(1.7).placed(0.4, -0.2, 2.0).looking((-1.0, 0.2, -0.3))


def tried_one_by_one(human: Human, side: str, point: np.ndarray) -> tuple:
    """Return the maxima over rotations and elbows, by the slow public functions."""
    settings, arm = QualitySettings(), human.arm(side)
    state, chain = ArmState.of(human, side, settings), arm.chain()
    T = np.eye(4)
    best, reached = dict.fromkeys(NAMES, 0.0), 0
    for R in rotation_grid(ROTATIONS).centers:
        T[:3, :3] = R
        T[:3, 3] = np.linalg.inv(human.T_world_shoulder(side))[:3] @ [*point, 1.0]
        pose = T.copy()
        pose[1, 3] *= -1.0 if side == "left" else 1.0  # rotations are canonical
        found = arm.ik(arm.mirrored(pose), MeetSettings.swivel_step)
        reached += len(found) > 0
        for q in found.q:
            quality = posture_quality(state, q)
            easy = min(dexterity_of(chain, q) / best_dexterity_once(chain), 1.0)
            values = quality.parts | {
                "dexterity": easy,
                "combined": 0.5 * (easy + quality.parts["effort"]),
                "online": quality.online,
                "total": total_quality(quality.online, easy, settings),
            }
            best = {name: max(best[name], values[name]) for name in NAMES}
    return best, reached / ROTATIONS


def dexterity_of(chain: Chain, q: np.ndarray) -> float:
    work = work_of(chain)
    forward(chain.arrays, q, work.frames)
    jacobian(chain.arrays, work.frames, work.jac)
    return dexterity(chain.arrays, q, work.jac, work.weighted, work.gram)


_KEPT: list[float] = []


def best_dexterity_once(chain: Chain) -> float:
    if not _KEPT:
        _KEPT.append(best_dexterity(chain, 1))
    return _KEPT[0]


@pytest.mark.parametrize("side", ["right", "left"])
def test_it_is_the_best_of_all_rotations_and_elbows(person, side, rng):
    shoulder = person.T_world_shoulder(side)[:3, 3]
    points = shoulder + rng.uniform(-0.35, 0.35, (3, 3))
    found = qualities_at(person, side, points, rotations=ROTATIONS)
    assert (found.reached > 0).any()
    for i, point in enumerate(points):
        best, reached = tried_one_by_one(person, side, point)
        assert found.reached[i] == pytest.approx(reached)
        for name in NAMES:
            if reached:
                assert found.best[name][i] == pytest.approx(best[name], abs=1e-9)


def test_the_joints_it_tells_put_the_grip_there_and_are_worth_that(person, rng):
    shoulder = person.T_world_shoulder("left")[:3, 3]
    points = shoulder + rng.uniform(-0.3, 0.3, (20, 3))
    found = qualities_at(person, "left", points, rotations=ROTATIONS)
    state = ArmState.of(person, "left", QualitySettings())
    inside = np.flatnonzero(found.reached > 0)
    assert len(inside) > 5
    for i in inside:
        grip = person.with_arm("left", found.q[i]).T_world_hand("left")[:3, 3]
        assert np.abs(grip - points[i]).max() < 1e-9
        assert posture_quality(state, found.q[i]).online <= found.best["online"][i]
        online, dexterity = (found.best[name][i] for name in ("online", "dexterity"))
        assert found.best["total"][i] <= (5 * online + dexterity) / 6 + 1e-12


def test_the_left_hand_does_what_the_right_one_does_in_the_mirror(rng):
    human, mirror = Human(1.8), np.array([1.0, -1.0, 1.0])
    points = human.T_world_shoulder("right")[:3, 3] + rng.uniform(-0.4, 0.4, (8, 3))
    right = qualities_at(human, "right", points, rotations=ROTATIONS)
    left = qualities_at(human, "left", points * mirror, rotations=ROTATIONS)
    for name in NAMES:
        np.testing.assert_allclose(left.best[name], right.best[name], atol=1e-9)


def test_a_hand_at_arms_length_before_the_shoulder_is_about_half_as_easy():
    """The shoulder's torque alone costs 1 there, whose quality is one half."""
    human = Human(1.75)
    at = human.T_world_shoulder("right")[:3, 3].copy()
    at[0] += 0.998 * human.arm("right").length
    found = qualities_at(human, "right", at[None], rotations=1944)
    assert 0.45 < found.best["effort"][0] < 0.505
    assert found.best["dexterity"][0] < 0.1  # a straight arm cannot go further


def test_nothing_is_told_of_places_out_of_reach():
    human = Human(1.75)
    far = human.T_world_shoulder("right")[:3, 3] + [[2.0, 0.0, 0.0]]
    found = qualities_at(human, "right", far, rotations=ROTATIONS)
    assert found.reached[0] == 0 and np.isnan(found.q).all()
    assert all(np.isnan(values).all() for values in found.best.values())


def test_visibility_is_left_out_where_the_settings_say_so(person):
    T = person.T_world_shoulder("right")
    at = (T @ [0.3, 0.0, -0.3, 1.0])[None, :3]
    settings = QualitySettings(absent_gaze="omit")
    blind = qualities_at(
        person.looking(None), "right", at, settings, rotations=ROTATIONS
    )
    assert np.isnan(blind.best["visibility"]).all()
    assert np.isfinite(blind.best["online"]).all() and PARTS[2] == "visibility"


def test_what_is_no_place_is_refused(person):
    for points in (np.zeros(3), np.zeros((2, 2)), np.full((1, 3), math.nan)):
        with pytest.raises(BadInput, match="places have shape"):
            qualities_at(person, "right", points)
    with pytest.raises(BadInput, match="choose left or right"):
        qualities_at(person, "up", np.zeros((1, 3)))
    with pytest.raises(BadInput, match="no grid has 5 rotations"):
        qualities_at(person, "right", np.zeros((1, 3)), rotations=5)


def test_no_places_are_no_error(person):
    assert qualities_at(person, "right", np.zeros((0, 3))).q.shape == (0, 7)
