"""The arm: forward kinematics, Jacobian, and that no solution is missed."""

import numpy as np
import pinocchio as pin
import pytest
from forms import size
from naive_arm import naive_fk, pinocchio_arm, swivels_that_work
from numba import njit
from rows import each

from handover import Arm, Human
from handover.human._arm_ik import AXES, MAX_SPANS, SPANS, WORK_ROWS
from handover.human._arm_solve import solve_arm
from handover.human._human_arm import arm_axes, arm_pose
from handover.human.anthropometry import ARM_RANGES
from roadmap.errors import BadInput
from roadmap.transforms import flat_pose, pose_of

LENGTHS = np.array([0.33, 0.25, 0.09])
RIGHT, LEFT = Arm("right", LENGTHS), Arm("left", LENGTHS)
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def drawn(rng, n, ranges=ARM_RANGES):
    return rng.uniform(ranges[:, 0], ranges[:, 1], (n, 7))


def test_forward_kinematics_equals_the_slow_twin_and_pinocchio(rng):
    model, data = pinocchio_arm(LENGTHS)
    for q in drawn(rng, 200):
        T = RIGHT.fk(q)
        np.testing.assert_allclose(T, naive_fk(LENGTHS, q), atol=1e-14)
        pin.framesForwardKinematics(model, data, q)
        there = data.oMf[model.getFrameId("grip")].homogeneous
        np.testing.assert_allclose(T, there, atol=1e-14)


def test_the_jacobian_equals_pinocchios(rng):
    model, data = pinocchio_arm(LENGTHS)
    frame = model.getFrameId("grip")
    for q in drawn(rng, 100):
        there = pin.computeFrameJacobian(
            model, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        np.testing.assert_allclose(RIGHT.jacobian(q), there, atol=1e-14)


def test_the_left_arm_is_the_mirror_image(rng):
    for q in drawn(rng, 50):
        np.testing.assert_allclose(
            LEFT.fk(q), MIRROR @ RIGHT.fk(q) @ MIRROR, atol=1e-15
        )
        np.testing.assert_allclose(
            LEFT.places(q), RIGHT.places(q) * [1, -1, 1], atol=1e-15
        )


@pytest.mark.parametrize("arm", [RIGHT, LEFT], ids=["right", "left"])
def test_the_jacobian_is_the_derivative(arm, rng):
    step = 1e-6
    for q in drawn(rng, 30):
        jacobian = arm.jacobian(q)
        for n in range(7):
            ahead, behind = (arm.fk(q + s * step * np.eye(7)[n]) for s in (1, -1))
            velocity = (ahead - behind)[:3, 3] / (2 * step)
            spin = (ahead - behind)[:3, :3] / (2 * step) @ arm.fk(q)[:3, :3].T
            spin = [spin[2, 1], spin[0, 2], spin[1, 0]]
            np.testing.assert_allclose(jacobian[:, n], [*velocity, *spin], atol=1e-8)


def test_zero_is_an_arm_hanging_with_the_palm_to_the_thigh():
    T = RIGHT.fk(np.zeros(7))
    np.testing.assert_allclose(T[:3, 3], [0, 0, -LENGTHS.sum()], atol=1e-15)
    np.testing.assert_allclose(T[:3, :3].T, [[0, 1, 0], [1, 0, 0], [0, 0, -1]])


@pytest.mark.parametrize(
    "joint, degrees, place, why",
    [
        (0, 90, (0.67, 0, 0), "flexion lifts the arm forward"),
        (1, 90, (0, -0.67, 0), "abduction lifts it to its own side"),
        (3, 90, (0.34, 0, -0.33), "the elbow bends to the front"),
        (5, 20, (0.09 * np.sin(np.radians(20)), 0, None), "to the thumb, forward"),
        (6, 80, (0, 0.09 * np.sin(np.radians(80)), None), "to the palm, inward"),
    ],
)
def test_joints_turn_as_they_are_called(joint, degrees, place, why):
    at = RIGHT.fk(np.radians(degrees) * np.eye(7)[joint])[:3, 3]
    for measured, wanted in zip(at, place, strict=True):
        assert wanted is None or measured == pytest.approx(wanted, abs=1e-12), why


def test_internal_rotation_and_pronation_turn_inward():
    bent = np.radians([0, 0, 30, 90, 0, 0, 0])
    assert RIGHT.fk(bent)[1, 3] > 0.1
    assert LEFT.fk(bent)[1, 3] < -0.1
    palm = RIGHT.fk(np.radians([0, 0, 0, 90, 80, 0, 0]))[:3, 0]
    assert palm[2] < -0.9  # a pronated hand before the body looks down


@njit
def followed(arm, joints, work, found, swivels):
    """Solve the pose of each row of joints.

    Returns how many rows have no solution, how many have a swivel outside of all
    intervals, and the largest residual of all solutions.
    """
    pose, there = np.empty(12), np.empty(12)
    unsolved, outside, worst = 0, 0, 0.0
    for i in range(joints.shape[0]):
        arm_pose(arm, joints[i], pose)
        n, n_spans = solve_arm(arm, pose, 0.25, work, found, swivels)
        unsolved += n == 0
        axis = arm_axes(joints[i])[1]  # the elbow's goes with the swivel
        across = along = 0.0
        for k in range(3):
            along -= axis[k] * work[AXES + 1, k]
            across -= axis[k] * work[AXES + 2, k]
        inside = False
        for k in range(n_spans):
            first, last, _ = work[SPANS + k]
            since = (np.arctan2(across, along) - first + 1e-7) % (2 * np.pi)
            inside |= since <= last - first + 2e-7
        outside += not inside
        for k in range(n):
            arm_pose(arm, found[k], there)
            worst = max(worst, np.abs(there - pose).max())
    return unsolved, outside, worst


def test_poses_of_its_own_are_all_solved(rng):
    """And the very swivel each pose came from is in one of its intervals."""
    room = np.empty((WORK_ROWS, 3)), np.empty((100, 7)), np.empty((100, 2))
    q = drawn(rng, size(200_000, 1_000_000))
    unsolved, outside, worst = followed(RIGHT.packed, q, *room)
    assert (unsolved, outside) == (0, 0)
    assert worst <= 1e-10


def test_solvable_tells_what_has_solutions(rng):
    poses = np.array([RIGHT.fk(q) for q in drawn(rng, 300)])
    poses[::2] = poses[::2] @ pose_of((0.0, 0.1, 0.0), (0.5, 0.0, 0.9))
    for arm in (RIGHT, LEFT):
        mirrored = arm.mirrored(poses)
        solvable = arm.solvable(mirrored)
        np.testing.assert_array_equal(solvable, [len(arm.ik(T)) > 0 for T in mirrored])
        assert solvable[1::2].all() and not solvable.all()


def nearest_elbow(arm, solutions, q):
    """Return how far the elbow of q is from that of the nearest representative [m]."""
    elbows = np.array([arm.places(s)[0] for s in solutions.q])
    return np.linalg.norm(elbows - arm.places(q)[0], axis=1).min()


@pytest.mark.parametrize("arm", [RIGHT, LEFT], ids=["right", "left"])
def test_solutions_reach_the_pose_and_keep_the_ranges(arm, rng):
    for q in drawn(rng, size(600, 1500)):
        T = arm.fk(q)
        solutions = arm.ik(T)
        assert len(solutions)
        for found in solutions.q:
            assert np.abs(arm.fk(found) - T).max() <= 1e-10
        assert (solutions.q >= arm.lower).all() and (solutions.q <= arm.upper).all()
        assert nearest_elbow(arm, arm.ik(T, 0.02), q) <= 0.01 * LENGTHS[0] + 1e-9


def test_a_joint_at_the_end_of_its_range_is_found(rng):
    for q in drawn(rng, 3000):
        ends = rng.random(7) < 0.3
        q = np.where(ends, np.where(rng.random(7) < 0.5, RIGHT.lower, RIGHT.upper), q)
        # nearly straight, the elbow's angle itself is known to 1e-8 only
        q[3] = max(q[3], 0.05)
        solutions = RIGHT.ik(RIGHT.fk(q))
        assert len(solutions), np.degrees(q)
        assert max(np.abs(RIGHT.fk(s) - RIGHT.fk(q)).max() for s in solutions.q) < 1e-10


WIDE = np.radians(
    [
        (-170, 170),
        (-80, 170),
        (-170, 170),
        (0, 170),
        (-170, 170),
        (-85, 85),
        (-179, 179),
    ]
)
NARROW = np.radians(
    [(-20, 60), (-10, 40), (-30, 20), (10, 90), (-20, 60), (-10, 5), (-30, 50)]
)


@pytest.mark.parametrize(
    "ranges, share", [(ARM_RANGES, 0.3), (WIDE, 0.5), (NARROW, 0.1)]
)
def test_the_intervals_are_those_of_trying_every_swivel(ranges, share, rng):
    """Against a twin that shares no algebra; also for poses that have no solution."""
    arm = Arm("right", LENGTHS, ranges)
    found = 0
    for k in range(120):
        T = arm.fk(drawn(rng, 1, ranges)[0])
        if k % 2:  # off what it can reach
            T = T @ pose_of(rng.normal(0, 0.05, 3), rng.normal(0, 0.5, 3))
        wrist = T[:3, 3] - LENGTHS[2] * T[:3, 2]
        if abs(wrist[2]) > 0.99 * np.linalg.norm(wrist):
            continue  # there phi = 0 is defined otherwise
        spans = arm.ik(T).spans
        phi, works = swivels_that_work(LENGTHS, ranges, T, 240)
        inside = np.zeros(len(phi), bool)
        edge = np.zeros(len(phi), bool)
        for first, last in spans:
            since = (phi - first) % (2 * np.pi)
            inside |= since <= last - first
            edge |= np.minimum(since, 2 * np.pi - since) < 1e-6
            edge |= np.abs(since - (last - first)) < 1e-6
        np.testing.assert_array_equal(works[~edge], inside[~edge])
        found += works.any()
    assert found >= share * 120


def test_an_elbow_that_can_go_all_round_is_one_interval():
    free = WIDE.copy()
    free[[0, 2, 4, 6]] = [-np.pi, np.pi]
    free[1], free[5] = np.radians([-90, 180]), np.radians([-90, 90])
    arm = Arm("right", LENGTHS, free)
    spans = arm.ik(pose_of((0.3, -0.1, -0.2))).spans
    widths = spans[:, 1] - spans[:, 0]
    assert widths.max() == pytest.approx(2 * np.pi)


def test_a_hand_out_of_reach_has_no_solutions_and_that_is_no_error():
    for place in ((0.0, 0.0, 2.0), (0.68, 0.0, 0.0), (0.01, 0.0, 0.0)):
        assert len(RIGHT.ik(pose_of(place))) == 0


def test_representatives_hold_both_ends_and_the_step(rng):
    for q in drawn(rng, 200):
        for step in (0.05, np.radians(15)):
            solutions = RIGHT.ik(RIGHT.fk(q), step)
            for i, (first, last) in enumerate(solutions.spans):
                swivel = solutions.swivel[solutions.span == i]
                assert swivel[0] == first and swivel[-1] == last
                assert (np.diff(swivel) <= step + 1e-9).all()
                assert len(swivel) <= np.ceil((last - first) / step) + 1


def test_an_arm_straight_to_the_side_is_solved(rng):
    """Flexion and rotation are one motion there; each alone is undefined."""
    for tilt in (0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3):
        for q in drawn(rng, 50):
            q[1] = np.pi / 2 + tilt
            T = RIGHT.fk(q)
            found = RIGHT.ik(T).q
            assert len(found)
            assert max(np.abs(RIGHT.fk(s) - T).max() for s in found) < 1e-10
            assert ((found >= RIGHT.lower) & (found <= RIGHT.upper)).all()


@pytest.mark.parametrize("elbow", [0.0, 1e-9, 1e-6, 1e-3])
def test_a_straight_arm_is_solved(elbow, rng):
    for q in drawn(rng, 100):
        q[3] = elbow
        T = RIGHT.fk(q)
        found = RIGHT.ik(T).q
        assert len(found)
        assert max(np.abs(RIGHT.fk(s) - T).max() for s in found) < 1e-10


def test_a_full_list_stops_and_does_not_overflow():
    work, pose = np.empty((WORK_ROWS, 3)), flat_pose(RIGHT.fk(np.full(7, 0.3)))
    q, swivel = np.full((4, 7), np.nan), np.empty((4, 2))
    n, k = solve_arm(RIGHT.packed, pose, 0.01, work, q, swivel)
    assert n == 4 and 1 <= k <= MAX_SPANS and np.isfinite(q[:3]).all()
    assert np.isfinite(work[SPANS : SPANS + k]).all()


def test_an_arm_grows_with_the_body_height(rng):
    tall, small = Human(1.95).arm("right"), Human(1.3).arm("right")
    assert tall.length == pytest.approx(1.95 * 0.383)
    for q in drawn(rng, 20):
        T = small.fk(q)
        T[:3, 3] *= tall.length / small.length
        np.testing.assert_allclose(T, tall.fk(q), atol=1e-12)


def test_the_arm_as_a_chain_of_hinges_is_the_same_arm(rng):
    frames = RIGHT.fixed_frames()
    assert frames.shape == (8, 12)
    for q in drawn(rng, 20):
        T = np.eye(4)
        for k in range(8):
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = frames[k, :9].reshape(3, 3), frames[k, 9:]
            T = T @ step
            T = T @ pose_of((0, 0, 0), (0, 0, q[k])) if k < 7 else T
        T[:3, 3] *= RIGHT.length
        np.testing.assert_allclose(T, RIGHT.fk(q), atol=1e-14)


@each(
    "call, words",
    [
        (lambda: Arm("middle", LENGTHS), "no 'middle' arm; choose left or right"),
        (lambda: Arm("left", [0.3, -0.2, 0.1]), "three positive numbers"),
        (lambda: Arm("left", [0.3, np.nan, 0.1]), "three positive numbers"),
        (lambda: Arm("left", LENGTHS, ARM_RANGES[:6]), r"ranges of shape \(6, 2\)"),
        (lambda: Arm("left", LENGTHS, ARM_RANGES[:, ::-1]), "must rise"),
        (lambda: RIGHT.fk(np.zeros(6)), "give seven finite angles"),
        (lambda: RIGHT.fk(np.full(7, np.nan)), "give seven finite angles"),
        (lambda: RIGHT.ik(np.full((4, 4), np.nan)), "NaN or infinity"),
        (lambda: RIGHT.ik(2 * np.eye(4)), "not a rigid motion"),
        (lambda: RIGHT.ik(np.diag([1.0, -1, 1, 1])), "not a rigid motion"),
        (lambda: RIGHT.ik(np.eye(3)), r"shape \(3, 3\)"),
        (lambda: RIGHT.ik(np.eye(4), 0.0), "swivel step of 0.0 rad"),
        (lambda: RIGHT.solvable(np.eye(4)), r"give \(n, 4, 4\)"),
        (lambda: RIGHT.solvable(np.full((1, 4, 4), np.inf)), "NaN or infinity"),
    ],
)
def test_bad_input_is_refused_with_the_remedy(call, words):
    with pytest.raises(BadInput, match=words):
        call()


def test_the_chain_for_reach_maps_puts_the_hand_where_the_arm_does(rng):
    arm = Human(height=1.6).arm("right")
    chain = arm.chain()
    assert chain.unit == "arm length"
    for q in drawn(rng, 30):
        T = arm.fk(q)
        T[:3, 3] /= arm.length
        assert np.allclose(chain.tool_pose(q), T, atol=1e-12)
