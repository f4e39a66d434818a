"""A pull that lasts is felt; noise, weight, bumps and broken sensors are not."""

import numpy as np
import pytest

from roadmap import load_robot
from roadmap.kinematics.forward import tool_pose
from roadmap.motion.motion import SetPoint, time_path
from roadmap.transforms import pose_of
from sim.story.pull import PullDetector, PullSettings, carried_force
from sim.story.wrist import PlainWrist, SimulatedWrist, person_force

DT = 0.01
WEIGHT = np.array([0.0, 0.0, -2.5])


def feel(detector, forces, noise=0.0, moving=False):
    """Feel forces (n, 3), one a frame; return in which the pull had lasted."""
    rng = np.random.default_rng(4)
    told = []
    for force in forces:
        wrench = np.concatenate([force, np.zeros(3)]) + rng.normal(0, noise or 1e-9, 6)
        detector.feel(wrench, DT, moving)
        told.append(detector.pulled)
    return np.array(told)


def still(n):
    return np.tile(WEIGHT, (n, 1))


def pulled(n, force=10.0):
    return still(n) + [force, 0.0, 0.0]


def test_a_pull_is_felt_after_it_has_lasted_and_not_before():
    told = feel(PullDetector(), np.vstack([still(100), pulled(50)]), noise=0.5)
    first = int(np.argmax(told)) - 100
    assert not told[:100].any() and 20 <= first <= 32  # 0.2 s, and half a window


def test_the_weight_of_the_object_is_no_pull():
    assert not feel(PullDetector(), still(500), noise=1.0).any()


def test_a_bump_of_40_n_is_no_pull():
    bump = still(100)
    bump[50:54] += [0.0, 28.0, -28.0]
    assert not feel(PullDetector(), bump, noise=0.5).any()


def test_two_short_tugs_do_not_add_up():
    tugs = np.vstack([still(50), pulled(12), still(20), pulled(12), still(20)])
    assert not feel(PullDetector(), tugs).any()


def test_what_shakes_the_object_to_and_fro_is_no_pull():
    """25 N at 6 Hz opened the hand in the air, before anybody had touched it."""
    t = DT * np.arange(600)
    swings = [25.0 * np.sin(40.0 * t), 10.0 * np.sin(33.0 * t), 0.0 * t]
    assert not feel(PullDetector(), still(600) + np.transpose(swings), 0.4).any()
    assert feel(PullDetector(), still(600) + np.abs(np.transpose(swings)), 0.4).any()


def test_a_slow_drift_is_followed():
    drift = still(2000) + np.linspace(0.0, 20.0, 2000)[:, None] * [0.0, 1.0, 0.0]
    assert not feel(PullDetector(), drift).any()


def test_a_robot_that_moves_feels_only_what_is_three_times_as_strong():
    forces = np.vstack([still(50), pulled(60, 9.0)])
    assert not feel(PullDetector(), forces, moving=True).any()
    assert feel(PullDetector(), np.vstack([still(50), pulled(60, 20.0)])).any()


@pytest.mark.parametrize("moving", [True, False])
def test_who_took_hold_gently_and_lets_go_again_leaves_the_hand_with_it(moving):
    """Their pull counts as at rest by then: the hand let go of it, and it fell."""
    forces = np.vstack([still(50), pulled(250, 10.0), still(150), pulled(60, 10.0)])
    forces[50:300, 0] *= np.linspace(0.0, 1.0, 250)  # which nobody feels
    for own in (None, WEIGHT):
        detector, told = PullDetector(), []
        for k, force in enumerate(forces):
            wrench = np.concatenate([force, np.zeros(3)])
            detector.feel(wrench, DT, moving and k < 300, own=own)
            told.append(detector.pulled)
        assert any(told[:450]) is (own is None)
    assert told[-1] and told.index(True) <= 482


def turned(kg):
    """Return the force of a mass in a hand that turns, and stops hard, (n, 3)."""
    angle = np.concatenate([np.zeros(50), np.linspace(0.0, 1.2, 60), np.full(90, 1.2)])
    forces = 9.81 * np.column_stack([np.sin(angle), 0.0 * angle, -np.cos(angle)])
    forces[50:75] += [6.0, 0.0, 0.0]
    forces[95:110] -= [10.0, 0.0, 0.0]
    return kg * forces


@pytest.mark.parametrize("kg", [3.0, 8.0])
def test_what_a_heavy_object_adds_as_the_robot_moves_is_no_pull(kg):
    """It had opened the hand, with nobody there."""
    forces, rng = turned(kg), np.random.default_rng(5)
    for known in (False, True):
        detector, told = PullDetector(), []
        for k, force in enumerate(np.vstack([forces, forces[-1:].repeat(90, axis=0)])):
            pull = 10.0 if k >= 230 else 0.0
            wrench = np.concatenate([force + [0.0, pull, 0.0], np.zeros(3)])
            own = force if known else None
            detector.feel(wrench + rng.normal(0, 0.5, 6), DT, 50 <= k < 110, own=own)
            told.append(detector.pulled)
        assert any(told[:230]) is not known
    assert told[-1] and 250 <= told.index(True) <= 265


@pytest.mark.parametrize("kg", [0.3, 1.5, 4.0])
def test_who_holds_on_to_what_was_taken_is_felt_whatever_it_weighs(kg, rng):
    """8 N passed for the object's weight, wherever they pointed."""
    down = np.array([0.6, 0.0, -0.8])
    weight, aside = 9.81 * kg * down, np.array([0.8, 0.0, 0.6])
    ways = rng.normal(size=(20, 3))
    ways -= (ways @ down)[:, None] * down * (ways @ down > 0.0)[:, None]

    def holds_on(hangs, pull, ramp=1):
        detector, share = PullDetector(), np.linspace(0.0, 1.0, ramp)[:, None]
        for k, force in enumerate(
            [*np.zeros((60, 3)), *(hangs + share * pull)] + 40 * [hangs + pull]
        ):
            wrench = np.concatenate([force, np.zeros(3)]) + rng.normal(0, 0.4, 6)
            detector.feel(wrench, DT, taken=weight if k >= 60 else None)
        return detector.pulls

    for share in (0.0, 0.3, 1.0):
        assert not holds_on(share * weight, np.zeros(3))
        for way in (aside, -aside, np.array([0.0, 1.0, 0.0])):
            assert holds_on(share * weight, 8.0 * way)
            assert holds_on(share * weight, 8.0 * way, ramp=500)  # ever so slowly
    assert holds_on(weight, 8.0 * down) and holds_on(0.0 * weight, -8.0 * down)
    for way in ways / np.linalg.norm(ways, axis=1)[:, None]:
        assert holds_on(0.0 * weight, 8.0 * way)


@pytest.mark.parametrize("own", [None, WEIGHT])
def test_a_pull_that_is_there_before_the_robot_stands_is_told_as_too_weak(own):
    """It counted as the force at rest, and nobody was told."""
    detector, told, counts = PullDetector(), [], []
    for k, force in enumerate([*still(50), *pulled(250, 8.0), *pulled(60, 13.0)]):
        wrench = np.concatenate([force, np.zeros(3)])
        detector.feel(wrench, DT, 50 <= k < 150, own=own)
        told.append(detector.weak)
        counts.append(detector.counts_from)
        if k == 150:
            assert not detector.weak
            detector.restart()
    assert detector.pulled and not detector.weak
    if own is None:
        assert not any(told)
        return
    assert not any(told[:165])
    assert np.allclose(told[175:300], 8.0) and np.allclose(
        counts[175:300], 12.0, atol=0.1
    )


@pytest.mark.parametrize(("force", "told"), [(1.5, False), (2.5, True), (3.8, True)])
def test_a_faint_pull_is_told_as_too_weak(force, told):
    """Below 4 N nobody was told anything."""
    detector, rng = PullDetector(), np.random.default_rng(6)
    for felt in [*still(100), *pulled(200, force)]:
        wrench = np.concatenate([felt, np.zeros(3)]) + rng.normal(0, 0.4, 6)
        detector.feel(wrench, DT, own=WEIGHT)
    assert not detector.lasted and bool(detector.weak) == told
    if told:
        assert detector.weak > 2.0 and detector.counts_from == pytest.approx(4.0)
    detector.restart()
    assert not detector.weak


def test_neither_noise_nor_a_bump_nor_a_failing_sensor_is_a_weak_pull():
    detector, rng = PullDetector(), np.random.default_rng(6)
    forces = still(300)
    forces[100:104] += [0.0, 28.0, -28.0]
    for k, force in enumerate(forces):
        wrench = np.concatenate([force, np.zeros(3)]) + rng.normal(0, 1.0, 6)
        detector.feel(np.full(6, np.nan) if k == 200 else wrench, DT, own=WEIGHT)
    assert not detector.weak


def test_the_weight_of_what_is_held_follows_the_pose_of_the_base():
    robot, T = load_robot("plain_arm"), np.eye(4)
    q = 0.5 * (robot.lower + robot.upper)
    hangs = pose_of((0.0, 0.0, 2.0), (np.pi, 0.0, 0.3))
    force = carried_force(robot, SetPoint(q, 0 * q, 0 * q), T, 2.0, hangs)
    in_world = (hangs @ tool_pose(robot, q))[:3, :3] @ force
    assert np.allclose(in_world, [0.0, 0.0, -2.0 * 9.81])


def test_the_force_of_what_is_held_is_its_weight_and_what_moving_it_takes():
    robot = load_robot("plain_arm")
    T = np.array([[0, 0, 1, 0.1], [0, 1, 0, 0], [-1, 0, 0, 0.2], [0, 0, 0, 1.0]])
    middle, half = 0.5 * (robot.lower + robot.upper), robot.upper - robot.lower
    motion = time_path(robot, np.array([middle - 0.1 * half, middle + 0.1 * half]))
    for t in (0.1, 0.3 * motion.duration, motion.duration + 1.0):
        point = motion.at(t)
        q = [motion.at(t + d).q for d in (-2e-3, 0.0, 2e-3)]
        p = [(tool_pose(robot, row) @ T)[:3, 3] for row in q]
        gone = (p[0] + p[2] - 2.0 * p[1]) / 4e-6
        R = tool_pose(robot, point.q)[:3, :3]
        force = -1.5 * R.T @ (gone + [0.0, 0.0, 9.81])
        assert np.abs(carried_force(robot, point, T, 1.5) - force).max() < 0.3


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_sensor_that_fails_never_opens_the_hand(broken):
    detector = PullDetector()
    feel(detector, np.vstack([still(50), pulled(60)]))
    assert detector.pulled
    detector.feel(np.full(6, broken), DT)
    assert not detector.pulled and not detector.pulls


def test_a_new_pull_must_last_as_long_as_the_first():
    detector = PullDetector(PullSettings(hold_s=0.1))
    feel(detector, np.vstack([still(50), pulled(40)]))
    detector.restart()
    assert not detector.pulled
    assert not feel(detector, pulled(9)).any() and feel(detector, pulled(5)).any()


def test_pybullets_reaction_forces_are_those_that_add_up():
    pytest.importorskip("pybullet")
    from sim.story.cases import story_wrench

    obj = story_wrench()
    plain, bullet = PlainWrist(obj), SimulatedWrist(obj)
    for k, rpy in enumerate(np.random.default_rng(2).uniform(-3, 3, (4, 3))):
        T = pose_of((0.3, 0.1 * k, 0.5), tuple(rpy))
        force = person_force(T, 10.0, 0.02, 20.0)
        ours = plain.wrench(T, obj.mass_kg, force)
        for _ in range(3):
            theirs = bullet.wrench(T, obj.mass_kg, force)
        assert np.abs(ours[:3] - theirs[:3]).max() < 0.5
    bullet.close()
