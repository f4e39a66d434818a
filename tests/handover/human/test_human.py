"""The person: proportions, postures, frames, capsules, input that is refused."""

import numpy as np
import pytest
from rows import each
from small import AWAY, HOME

import handover
from handover import POSTURES, Human, Part, Skeleton
from handover.human.anthropometry import ARM_RANGES, HEIGHTS, RADII
from handover.human.body import ARM_LABELS, COLUMN, BodySizes
from odm import sample_capsules
from roadmap.errors import BadInput
from roadmap.transforms import pose_of

TURNED = pose_of((0.4, -1.0, 1.1), (0.2, -0.3, 2.0))


def part(human, label):
    return human.capsules()[human.labels == label]


@pytest.mark.parametrize("height", [1.2, 1.75, 2.2])
def test_a_standing_person_has_the_proportions_of_the_reference_model(height):
    human = Human(height)
    at = dict(zip(COLUMN, human.places / height, strict=True))
    assert at["left_shoulder"] == pytest.approx([0, 0.110, 0.818])
    assert at["right_shoulder"] == pytest.approx([0, -0.110, 0.818])
    assert at["hip"] == pytest.approx([0, 0, 0.530])
    assert at["neck"] == pytest.approx([0, 0, 0.840])
    assert human.p_world_eyes[2] == pytest.approx(0.936 * height)
    head = part(human, Part.HEAD)[0]
    assert head[5] + head[6] == pytest.approx(height)  # the crown
    legs = human.capsules()[human.labels >= Part.LEFT_LEG]
    assert legs[:, [2, 5]].min() / height == pytest.approx(0.0234, abs=1e-3)
    assert human.arm("left").lengths == pytest.approx(
        np.array([0.186, 0.146, 0.051]) * height
    )


def test_the_hand_of_a_straight_arm_ends_at_the_finger_tips():
    human = Human(1.75, arms={"right": np.zeros(7)})
    hand = part(human, Part.RIGHT_HAND)[0]
    arm = (0.186 + 0.146 + 0.108) * 1.75
    assert hand[5] - hand[6] == pytest.approx(0.818 * 1.75 - arm)


@pytest.mark.parametrize("posture", POSTURES)
def test_every_posture_rests_on_its_floor_inside_the_joint_ranges(posture):
    human = Human(1.7, posture)
    rods = human.capsules()
    lowest = (rods[:, [2, 5]] - rods[:, [6]]).min() - POSTURES[posture].step
    assert -0.045 < lowest < 0.02
    for side in ("left", "right"):
        q = human.arms[side]
        assert ((q >= ARM_RANGES[:, 0]) & (q <= ARM_RANGES[:, 1])).all()
    assert set(human.labels) == set(Part) and len(rods) == len(human.labels) == 15
    assert np.isfinite(rods).all() and (rods[:, 6] > 0).all()


def test_postures_look_as_they_are_called():
    shoulder = {p: Human(1.75, p).T_world_shoulder("left")[:3, 3] for p in POSTURES}
    pelvis = {p: Human(1.75, p).T_world_pelvis[:3, 3] for p in POSTURES}
    assert shoulder["bending"][0] > 0.3 and shoulder["bending"][2] < 1.3
    assert 0.4 < pelvis["sitting"][2] < 0.62
    assert 0.95 < shoulder["kneeling"][2] < 1.1
    assert shoulder["lying"][2] < 0.3 and shoulder["lying"][0] < -0.4
    assert Human(1.75, "lying").T_world_chest[2, 0] == pytest.approx(1)  # face up
    assert pelvis["ladder"][2] == pytest.approx(pelvis["standing"][2] + 0.56, abs=0.02)
    for p in ("standing", "sitting", "ladder"):  # shanks that carry are upright
        hip, knee, ankle = part(Human(1.75, p), Part.LEFT_LEG)[:, :3]
        assert knee[0] == pytest.approx(ankle[0], abs=0.01)


def test_the_shoulder_follows_bending_and_crouching():
    human = Human(1.75, T_world_pelvis=TURNED)
    bent = Human(1.75, T_world_pelvis=TURNED, bend=np.array([0.0, 0.6, 0.0]))
    turn = (
        human.T_world_shoulder("right")[:3, :3].T
        @ bent.T_world_shoulder("right")[:3, :3]
    )
    np.testing.assert_allclose(turn, pose_of((0, 0, 0), (0, 0.6, 0))[:3, :3], atol=1e-9)
    down = human.moved(pose_of((0, 0, -0.4)) @ TURNED)
    drop = human.T_world_shoulder("right") - down.T_world_shoulder("right")
    np.testing.assert_allclose(drop[:3, 3], [0, 0, 0.4], atol=1e-12)


@pytest.mark.parametrize("posture", POSTURES)
def test_a_person_is_placed_on_the_floor(posture):
    human = Human(1.6, posture)
    there = human.placed(1.0, -2.0, 0.8)
    T = pose_of((1.0, -2.0, 0.0), (0, 0, 0.8))
    for at in (slice(0, 3), slice(3, 6)):
        moved = human.capsules()[:, at] @ T[:3, :3].T + T[:3, 3]
        np.testing.assert_allclose(there.capsules()[:, at], moved, atol=1e-12)


def test_the_planner_heeds_the_person(planner):
    """Far away nothing is blocked, on the robot everything is."""
    q, goal = HOME, [AWAY]
    human = Human(1.75)
    planner.set_goals(goal)
    far = human.placed(5.0, 0.0, np.pi).surface_points(0.03)
    assert planner.step(far, q=q).status != "holding"
    n_far = len(planner.invalid_nodes())
    base = pose_of((0.0, 0.0, 0.9))
    near = human.placed(0.2, 0.0, np.pi).surface_points(0.03, T_world_base=base)
    planner.step(near, q=q)
    assert n_far == 0 and len(planner.invalid_nodes()) > 10


def test_the_whole_body_moves_with_the_pelvis():
    human = Human(1.75, "sitting", pose_of((0, 0, 0)))
    moved = human.moved(TURNED)
    R, p = TURNED[:3, :3], TURNED[:3, 3]
    for at in (slice(0, 3), slice(3, 6)):
        there = human.capsules()[:, at] @ R.T + p
        np.testing.assert_allclose(moved.capsules()[:, at], there, atol=1e-12)
    np.testing.assert_allclose(
        moved.T_world_hand("left"), TURNED @ human.T_world_hand("left"), atol=1e-12
    )


@pytest.mark.parametrize("side", ["left", "right"])
def test_arm_ik_finds_the_hand_in_the_world(side, rng):
    human = Human(1.83, "bending", TURNED)
    for _ in range(50):
        q = rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1])
        T = human.with_arm(side, q).T_world_hand(side)
        solutions = human.arm_ik(side, T)
        assert len(solutions)
        for found in solutions.q:
            there = human.with_arm(side, found).T_world_hand(side)
            assert np.abs(there - T).max() < 1e-10


def test_a_reach_map_sees_the_hand_alike_for_every_person_place_and_side(rng):
    q = rng.uniform(ARM_RANGES[:, 0], ARM_RANGES[:, 1])
    seen = []
    for human in (
        Human(1.3),
        Human(2.0, "bending", TURNED),
        Human(1.75, "lying", bend=np.array([0.1, 0.5, 0.2])),
    ):
        for side in ("left", "right"):
            there = human.with_arm(side, q)
            seen.append(there.reach_pose(side, there.T_world_hand(side)))
    for other in seen[1:]:
        np.testing.assert_allclose(other, seen[0], atol=1e-12)


def test_another_height_keeps_feet_and_joints():
    small, tall = Human(1.5, "ladder"), Human(1.9, "ladder")
    np.testing.assert_allclose(small.resized(1.9).places, tall.places, atol=1e-12)
    q = {"left": np.full(7, 0.2)}
    there = Human(1.6, arms=q, T_world_pelvis=TURNED).resized(1.8)
    assert there.height == 1.8 and (there.arms["left"] == 0.2).all()
    np.testing.assert_array_equal(there.T_world_pelvis[:2], TURNED[:2])
    mine, other = there.arm("left").lengths, small.arm("right").lengths
    np.testing.assert_allclose(mine / 1.8, other / 1.5, atol=1e-15)


def test_a_person_looks_where_told():
    human = Human(1.75)
    assert human.gaze is None
    there = human.looking_at(human.p_world_eyes + [0.0, 2.0, 0.0])
    np.testing.assert_allclose(there.gaze, [0, 1, 0], atol=1e-12)
    assert there.looking(None).gaze is None


def test_the_obstacles_of_a_person_are_its_capsules_with_their_names():
    human = Human(1.75, T_world_pelvis=TURNED)
    obstacles = human.obstacles()
    np.testing.assert_array_equal(obstacles.capsules, human.capsules())
    assert Part(human.labels[0]).words in obstacles.name(0)
    seen, moved = human.obstacles(TURNED).capsules, human.moved(np.eye(4))
    np.testing.assert_allclose(seen, moved.obstacles().capsules, atol=1e-12)


def test_surface_points_cover_the_capsules_in_the_robots_frame():
    human = Human(1.75, T_world_pelvis=TURNED)
    points = human.surface_points(0.03)
    np.testing.assert_array_equal(points, sample_capsules(human.capsules(), 0.03))
    seen = human.surface_points(0.03, T_world_base=TURNED)
    unmoved = human.moved(np.eye(4)).surface_points(0.03)
    assert len(seen) == len(unmoved) == len(points)
    for cloud in (seen, unmoved):  # the same up to where on a circle samples begin
        assert np.abs(cloud.mean(axis=0) - unmoved.mean(axis=0)).max() < 1e-3


def test_thickness_changes_the_capsules_only():
    thick, thin = Human(1.75), Human(1.75, thickness="mean")
    assert (thick.capsules()[:, 6] > thin.capsules()[:, 6]).all()
    np.testing.assert_array_equal(
        thick.T_world_shoulder("left"), thin.T_world_shoulder("left")
    )


def test_there_is_one_source_of_sizes():
    sizes = BodySizes.sized(1.75, "mean")
    assert tuple(vars(sizes).values())[:6] == RADII["mean"][:6]
    assert (sizes.thigh, sizes.shank, sizes.foot) == RADII["mean"][6:]
    skeleton = Skeleton.of_height(1.75)
    assert skeleton.hands[0] == sizes.hand_length


def test_nothing_of_a_person_can_be_changed_in_place():
    human = Human(1.75)
    for array in (human.T_world_pelvis, human.places, human.arms["left"]):
        with pytest.raises(ValueError):
            array[0] = 1.0


NAN = np.eye(4) * np.nan


@each(
    "call, words",
    [
        (lambda: Human(1.19), "1.19 m is outside 1.2 to 2.2"),
        (lambda: Human(2.21), "2.21 m is outside 1.2 to 2.2"),
        (lambda: Human(float("nan")), "nan m is outside"),
        (lambda: Human().resized(3.0), "3.0 m is outside"),
        (lambda: Skeleton.of_height(17.5), "17.5 m is outside"),
        (
            lambda: Human(1.75, "floating"),
            "no posture 'floating'; choose one of standing, bending, sitting, "
            "kneeling, lying, ladder",
        ),
        (lambda: Human(thickness="fat"), "no thickness 'fat' of a body; choose"),
        (lambda: Human(T_world_pelvis=NAN), "T_world_pelvis holds NaN"),
        (lambda: Human(T_world_pelvis=1.1 * np.eye(4)), "not a rigid motion"),
        (lambda: Human(T_world_pelvis=np.diag([1, -1, 1, 1])), "not a rigid motion"),
        (lambda: Human(T_world_pelvis=np.eye(3)), "shape"),
        (lambda: Human().moved(NAN), "T_world_pelvis holds NaN"),
        (lambda: Human().arm_ik("right", NAN), "T_world_hand holds NaN"),
        (lambda: Human().arm_ik("right", 0 * np.eye(4)), "not a rigid motion"),
        (lambda: Human().arm_ik("both", np.eye(4)), "no 'both' arm"),
        (lambda: Human(arms={"third": np.zeros(7)}), "no 'third' arm"),
        (lambda: Human(arms={"left": np.zeros(6)}), "give seven finite angles"),
        (lambda: Human(gaze=np.zeros(3)), "is no direction"),
        (lambda: Human(gaze=np.array([1.0, np.nan, 0])), "is no direction"),
        (lambda: Human().looking_at([]), "p_world has shape .0,.; give a place"),
        (lambda: Human().placed(np.nan, 0, 0), "nobody stands at"),
        (lambda: Human(mass=-3.0), "mass of -3.0 kg"),
        (lambda: Human(bend=np.array([0, 3.0, 0])), "bend of the trunk"),
        (lambda: Human().surface_points(T_world_base=NAN), "T_world_base holds NaN"),
    ],
)
def test_bad_input_is_refused_with_the_remedy(call, words):
    with pytest.raises(BadInput, match=words):
        call()


def test_the_door_is_true():
    assert HEIGHTS == (1.2, 2.2)
    assert all(hasattr(handover, name) for name in handover.__all__)


@pytest.mark.parametrize("posture", POSTURES)
def test_the_joints_are_where_the_arms_and_the_trunk_have_them(posture, rng):
    arms = {side: rng.uniform(-1.0, 1.0, 7) for side in ("left", "right")}
    human = Human(1.63, posture, TURNED, arms, bend=rng.uniform(-0.5, 0.5, 3))
    R = human.T_world_chest[:3, :3]
    for side, arm in arms.items():
        shoulder = human.T_world_shoulder(side)[:3, 3]
        at = {j: human.places[COLUMN[f"{side}_{j}"]] for j in ("elbow", "hand", "tip")}
        elbow, wrist, grip = shoulder + human.arm(side).places(arm) @ R.T
        np.testing.assert_allclose(human.places[COLUMN[f"{side}_shoulder"]], shoulder)
        np.testing.assert_allclose((at["elbow"], at["hand"]), (elbow, wrist))
        along = (grip - wrist) / np.linalg.norm(grip - wrist)
        beyond = human.skeleton.hands[0] - human.sizes.hand
        np.testing.assert_allclose(at["tip"], wrist + beyond * along)
    neck = human.T_world_chest[:3, 3] + R @ human.skeleton.neck
    np.testing.assert_allclose(human.places[COLUMN["neck"]], neck)
    head = neck + R @ human.skeleton.skull
    np.testing.assert_allclose(human.places[COLUMN["head"]], head)
    hip = TURNED[:3, 3] + TURNED[:3, :3] @ human.skeleton.hip
    np.testing.assert_allclose(human.places[COLUMN["hip"]], hip)


@pytest.mark.parametrize("side", ["left", "right"])
def test_capsules_of_an_arm_that_is_bent_otherwise_are_those_of_the_whole_person(side):
    human = Human(1.62, "bending").placed(0.3, -0.2, 0.7)
    arm, rng = human.arm(side), np.random.default_rng(3)
    joints = rng.uniform(arm.lower, arm.upper, (4, 7))
    rods = human.arm_capsules(side, joints)
    for q, rows in zip(joints, rods, strict=True):
        bent = human.with_arm(side, q)
        whole = bent.capsules()[np.isin(bent.labels, ARM_LABELS[side])]
        assert np.array_equal(rows, whole)
    assert human.arm_capsules(side, joints[:0]).shape == (0, 3, 7)


def test_what_is_of_another_kind_is_refused_in_one_sentence():
    human = Human()
    for words, call in (
        ("arms is None", lambda: Human(arms=None)),
        ("skeleton is 1.0", lambda: Human(skeleton=1.0)),
        ("mass of x kg", lambda: Human(mass="x")),
        ("swivel step of None", lambda: human.arm_ik("left", np.eye(4), None)),
        ("joints must be", lambda: human.arm_capsules("left", None)),
        ("joints of an arm", lambda: human.arm_capsules("left", [1.0, 2.0])),
    ):
        with pytest.raises(BadInput, match=words):
            call()
