"""The five parts of quality by hand, their sum, and effort against pinocchio."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from naive_arm import pinocchio_arm
from rows import each
from wrappers import with_wrapper

from handover import ArmState, Human, QualitySettings, posture_quality, total_quality
from handover.human._human_arm import arm_axes
from handover.human.anthropometry import ARM_RANGES
from handover.meet import _quality as kernel
from handover.meet.quality import first_moments
from handover.meet.settings import PARTS
from roadmap.errors import BadInput
from roadmap.transforms import pose_of

square_to_axis = with_wrapper(kernel.square_to_axis)
enters = with_wrapper(kernel.enters)
effort_cost = with_wrapper(kernel.effort_cost)

SETTINGS = QualitySettings()
FORWARD = np.radians([90.0, 0, 0, 0, 0, 0, 0])  # the right arm level to the front
TURNED = pose_of((0.4, -1.0, 1.1), (0.7, -0.4, 2.0))


def person(side="right", now=None, **more):
    arms = {side: np.zeros(7) if now is None else now}
    return Human(1.75, arms=arms, **more)


def parts_of(human, q, settings=SETTINGS, side="right", obstacles=None):
    state = ArmState.of(human, side, settings, obstacles)
    return posture_quality(state, q).parts


def cost(quality, beta):
    """Return the cost behind a quality."""
    return math.atanh(1.0 - quality) / beta


def test_joint_travel_by_hand():
    """alpha 1..7; elbow moves by 0.5, wrist by -0.2: 4 0.25 + 7 0.04 = 1.28."""
    settings = replace(SETTINGS, joint_weights=(1, 2, 3, 4, 5, 6, 7), beta_joint=0.3)
    q = np.array([0, 0, 0, 0.5, 0, 0, 0.2])
    quality = parts_of(person(now=q * [1, 1, 1, 0, 1, 1, 2]), q, settings)["joint"]
    assert quality == pytest.approx(1 - math.tanh(0.3 * 1.28))


def test_workspace_travel_by_hand():
    """From hanging to level forward, the straight arm's grip goes sqrt(2) lengths."""
    quality = parts_of(person(), FORWARD)["spatial"]
    length = 0.383 * 1.75
    expected = 1 - math.tanh(SETTINGS.beta_spatial * math.sqrt(2) * length)
    assert quality == pytest.approx(expected)


def test_visibility_by_hand():
    """A grip straight ahead of the eyes is at 0, one behind at pi, beside at pi/2."""
    human = person()
    grip = human.with_arm("right", FORWARD).T_world_hand("right")[:3, 3]
    to_grip = grip - human.p_world_eyes
    beta = SETTINGS.beta_visibility
    across = np.cross(to_grip, [0, 0, 1.0])
    for gaze, angle in ((to_grip, 0.0), (-to_grip, math.pi), (across, math.pi / 2)):
        quality = parts_of(human.looking(gaze), FORWARD)["visibility"]
        assert quality == pytest.approx(1 - math.tanh(beta * angle), abs=1e-12)


def test_a_gaze_that_is_not_known_is_the_chests_or_left_out():
    human = person()
    ahead = parts_of(human.looking(human.T_world_chest[:3, 0]), FORWARD)
    torso = posture_quality(ArmState.of(human, "right", SETTINGS), FORWARD)
    assert torso.parts == ahead
    omit = replace(SETTINGS, absent_gaze="omit", weights=(0.1, 0.2, 0.3, 0.15, 0.25))
    without = posture_quality(ArmState.of(human, "right", omit), FORWARD)
    assert math.isnan(without.parts["visibility"])
    rest = [ahead[p] for p in PARTS if p != "visibility"]
    expected = np.dot([0.1, 0.2, 0.15, 0.25], rest) / 0.7
    assert without.online == pytest.approx(expected)
    known = posture_quality(
        ArmState.of(human.looking([1, 0, 0]), "right", omit), FORWARD
    )
    assert known.parts == ahead


def ball(place, radius):
    return np.array([[*place, *place, radius]])


def test_safety_by_hand():
    """Zero beyond the distance of concern, 1 at half of it, infinite in contact."""
    human = person()
    grip = human.with_arm("right", FORWARD).T_world_hand("right")[:3, 3]
    assert parts_of(human, FORWARD)["safety"] == 1.0  # nothing is near a straight arm
    for distance, wanted in ((0.25, 0.0), (0.2, 0.0), (0.1, 1.0), (0.05, 3.0)):
        near = ball(grip + [distance + 0.03, 0, 0], 0.03)
        quality = parts_of(human, FORWARD, obstacles=near)["safety"]
        assert quality == pytest.approx(1 - math.tanh(SETTINGS.beta_safety * wanted))
    inside = ball(grip + [0.02, 0, 0], 0.03)
    assert parts_of(human, FORWARD, obstacles=inside)["safety"] == 0.0


def test_a_hand_in_the_own_chest_is_no_posture():
    folded = np.radians([-10.0, 0, 70, 95, 0, 0, 0])
    quality = parts_of(person(), folded)
    assert quality["safety"] == 0.0
    assert parts_of(person(), FORWARD)["safety"] == 1.0


def test_the_forearm_counts_unless_told_otherwise():
    human = person()
    shoulder = human.T_world_shoulder("right")
    on_forearm = shoulder[:3, 3] + [0.45, 0.0, 0.0]
    touching = ball(on_forearm, 0.02)
    grip_only = replace(SETTINGS, forearm_counts=False)
    assert parts_of(human, FORWARD, obstacles=touching)["safety"] == 0.0
    assert parts_of(human, FORWARD, grip_only, obstacles=touching)["safety"] > 0.0
    beside = ball(on_forearm + [0, 0.021, 0], 0.02)
    assert parts_of(human, FORWARD, obstacles=beside)["safety"] > 0.0


def test_distances_equal_those_of_dense_samples(rng):
    """Segment against capsule and point, by sampled axes."""
    for _ in range(60):
        rod = np.concatenate([rng.uniform(-0.5, 0.5, 6), [rng.uniform(0.02, 0.3)]])
        a, b = rng.uniform(-0.6, 0.6, (2, 3))
        share = np.linspace(0, 1, 400)[:, None]
        line = a + share * (b - a)
        axis = rod[:3] + share * (rod[3:6] - rod[:3])
        gap = np.linalg.norm(line[:, None] - axis, axis=2).min() - rod[6]
        cut = enters(rod[None], 0, tuple(a), tuple(b))
        if abs(gap) > 2e-3:
            assert cut == (gap < 0)
        off = np.sqrt(square_to_axis(rod[None], 0, tuple(a))) - rod[6]
        sampled = np.linalg.norm(axis - a, axis=1).min() - rod[6]
        assert off == pytest.approx(sampled, abs=2e-3)


def test_effort_by_hand():
    """Hanging: none. Level forward: shoulder 1, elbow and wrist their own shares."""
    human = person()
    state = ArmState.of(human, "right", SETTINGS)
    hanging = parts_of(human, np.zeros(7))["effort"]
    assert hanging == pytest.approx(1.0, abs=1e-12)
    upper, fore, hand = state.state[kernel.MOMENTS : kernel.MOMENTS + 3]
    assert upper + fore + hand == pytest.approx(1.0)
    # thumb up: the elbow, flexing about the level axis, and the deviation carry, too
    level = cost(parts_of(human, FORWARD)["effort"], SETTINGS.beta_effort)
    assert level == pytest.approx(1.0 + (fore + hand) + hand)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("T", [pose_of((0, 0, 1)), TURNED], ids=["upright", "turned"])
def test_effort_equals_pinocchios_gravity_torques(side, T, rng):
    human = Human(1.68, T_world_pelvis=T, mass=70.0)
    state = ArmState.of(human, side, SETTINGS).state
    unit = 9.81 * human.mass * float(first_moments(human, side).sum())
    lengths = human.arm(side).lengths
    model, _ = pinocchio_arm(lengths, _segments(70.0, lengths, human))
    shoulder = human.T_world_shoulder(side)[:3, :3]
    down = shoulder.T @ [0, 0, -9.81]
    if side == "left":
        down = down * [1, -1, 1]
    model.gravity.linear = down
    data = model.createData()
    for q in rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1], (50, 7)):
        torques = pin.computeGeneralizedGravity(model, data, q)
        effort = effort_cost(state, arm_axes(q)) * unit
        assert effort == pytest.approx(np.abs(torques).sum(), rel=1e-9)


def _segments(mass, lengths, human):
    """Return mass and centre of the three segments as Winter gives them."""
    hand = human.skeleton.hands[0]
    return [
        (0.028 * mass, 0.436 * lengths[0]),
        (0.016 * mass, 0.430 * lengths[1]),
        (0.006 * mass, 0.506 * hand),
    ]


def test_the_sum_is_weighted_and_in_the_unit_interval(rng):
    settings = replace(SETTINGS, weights=(0.1, 0.4, 0.2, 0.25, 0.05))
    state = ArmState.of(person().looking([1, 0, -1]), "right", settings)
    for q in rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1], (200, 7)):
        quality = posture_quality(state, q)
        values = [quality.parts[p] for p in PARTS]
        assert all(0.0 <= v <= 1.0 for v in values)
        assert quality.online == pytest.approx(np.dot(settings.weights, values))


def test_total_quality_weighs_online_against_dexterity():
    settings = replace(SETTINGS, online_weight=0.75)
    assert total_quality(0.8, 0.4, settings) == pytest.approx(0.7)
    both = total_quality(np.array([0.8, 0.0]), np.array([0.4, 1.0]), settings)
    np.testing.assert_allclose(both, [0.7, 0.25])


def test_left_and_right_are_alike(rng):
    """A mirrored person in a mirrored world has the same quality."""
    flip = np.array([1.0, -1.0, 1.0])
    world = rng.uniform(-1, 1, (5, 7)) + [0.5, 0, 1, 0.5, 0, 1, 1.2]
    world[:, 6] = 0.05
    mirrored = world * [*flip, *flip, 1.0]
    now = np.array([0.3, 0.2, 0.1, 0.5, 0.2, 0, 0.1])
    gaze = np.array([0.9, 0.3, -0.4])
    right = ArmState.of(person("right", now, gaze=gaze), "right", SETTINGS, world)
    left = ArmState.of(
        person("left", now, gaze=gaze * flip), "left", SETTINGS, mirrored
    )
    for q in rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1], (50, 7)):
        a, b = posture_quality(right, q), posture_quality(left, q)
        assert a.online == pytest.approx(b.online, abs=1e-12)


def test_quality_does_not_depend_on_where_the_world_begins(rng):
    """Turned about the vertical and shifted, everything together."""
    T = pose_of((3.0, -2.0, 0.5), (0, 0, 1.1))
    near = rng.uniform(-0.5, 0.5, (4, 7)) + [0.4, 0, 1.2, 0.4, 0, 1.2, 0.6]
    human = person(gaze=np.array([1.0, 0.2, 0.0]))
    there = human.moved(T @ human.T_world_pelvis).looking(T[:3, :3] @ human.gaze)
    far = near.copy()
    for at in (slice(0, 3), slice(3, 6)):
        far[:, at] = near[:, at] @ T[:3, :3].T + T[:3, 3]
    for q in rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1], (20, 7)):
        a = posture_quality(ArmState.of(human, "right", SETTINGS, near), q)
        b = posture_quality(ArmState.of(there, "right", SETTINGS, far), q)
        assert a.online == pytest.approx(b.online, abs=1e-9)


def test_a_longer_person_in_the_same_posture_has_the_same_effort():
    q = np.radians([50.0, 20, 10, 40, 10, 0, 0])
    small, tall = (parts_of(Human(h), q)["effort"] for h in (1.3, 2.1))
    assert small == pytest.approx(tall, abs=1e-12)


@each(
    "change, words",
    [
        ({"weights": (0.4, 0.4, 0.4, -0.1, -0.1)}, "five that are not negative"),
        ({"weights": (0.2, 0.2, 0.2, 0.2, 0.3)}, "sum to 1.1; they must sum to 1"),
        ({"weights": (0.25,) * 4}, "give five"),
        ({"weights": (math.nan,) * 5}, "not negative"),
        ({"joint_weights": (1.0,) * 6}, "give seven"),
        ({"joint_weights": (1.0,) * 6 + (-1.0,)}, "give seven"),
        ({"beta_effort": 0.0}, "beta_effort is 0.0"),
        ({"beta_spatial": math.inf}, "beta_spatial is inf"),
        ({"safety_distance": 0.0}, r"safety_distance \[m\] is 0.0"),
        ({"absent_gaze": "guess"}, "no way 'guess'"),
        (
            {"absent_gaze": "omit", "weights": (0, 0, 1, 0, 0)},
            "weight is on visibility",
        ),
        ({"online_weight": 1.5}, "online_weight is 1.5"),
    ],
)
def test_settings_that_are_none_are_refused(change, words):
    with pytest.raises(BadInput, match=words):
        QualitySettings(**change)


@pytest.mark.parametrize(
    "obstacles, words",
    [
        (np.zeros((3, 3)), r"shape \(3, 3\); give capsules"),
        (np.full((1, 7), np.nan), "NaN, infinity or a negative radius"),
        (np.array([[0, 0, 0, 1, 0, 0, -0.1]]), "negative radius"),
    ],
)
def test_obstacles_that_are_none_are_refused(obstacles, words):
    with pytest.raises(BadInput, match=words):
        ArmState.of(Human(), "right", SETTINGS, obstacles)
