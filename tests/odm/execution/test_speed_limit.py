"""Speed near a person: the standard's formula, and what it does to an executor."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from naive_speed import naive_share
from wrappers import with_wrapper

from odm.execution import _speed as kernels
from odm.execution.executor import Executor
from odm.execution.settings import ExecutionSettings
from odm.execution.speed_limit import SpeedLimit, SpeedSettings
from odm.execution.threat import Watcher
from roadmap.geometry.gaps import ball_gaps
from roadmap.kinematics.forward import sphere_centers
from roadmap.motion.motion import time_path

allowed_share = with_wrapper(kernels.allowed_share)
RULE = np.array([0.02, 0.15, 0.02, 0.15, 1.6, 0.25, 0.5, 0.0, 0.8])
NO_HANDS = np.zeros((0, 7))


def one(gap, toward=1.0, coming=0.0, known=True):
    """Return the share of a ball that goes at a capsule, `gap` [m] away."""
    centers, moved = np.zeros((1, 3)), np.array([[toward, 0.0, 0.0]])
    x = gap + 0.1 + 0.05
    capsule = np.array([[x, 0.0, -0.5, x, 0.0, 0.5, 0.05]])
    rate = np.tile([-coming, 0.0, 0.0], (1, 2)) if known else np.full((1, 6), np.nan)
    return share_of(centers, moved, np.array([0.1]), capsule, rate)


def share_of(centers, moved, radii, capsules, rates, hands=NO_HANDS, rule=RULE):
    """Return the share of spheres (n, 3) that move so fast (n, 3)."""
    balls = np.column_stack([centers, radii])
    ahead, all_of_them = centers + 1e-3 * moved, np.arange(len(balls))
    told = (balls, ahead, 1e3, all_of_them, capsules, rates, hands)
    return allowed_share(*told, rule)


def test_far_away_nothing_is_slowed_and_near_the_formula_holds():
    assert one(2.0) == 1.0
    assert one(0.05) == pytest.approx((0.05 - 0.02) / (0.02 + 0.075))
    assert one(0.3, coming=1.0) == 1.0
    assert one(0.22, coming=1.0) == pytest.approx((0.22 - 0.17 - 0.02) / 0.095)


def test_it_is_never_slower_than_the_least_speed_nor_for_who_goes_away():
    assert one(0.0) == pytest.approx(0.15)
    assert one(0.05, coming=-2.0) == one(0.05)
    assert one(0.01, toward=-1.0) == 1.0


def test_what_is_not_known_comes_at_walking_speed():
    assert one(0.35, known=False) == pytest.approx(one(0.35, coming=1.6))
    assert one(0.35, known=False) < one(0.35)


def test_it_is_the_twins_on_random_pairs(rng):
    for _ in range(20):
        centers, moved = rng.uniform(-0.5, 0.5, (2, 6, 3))
        capsules = np.column_stack([rng.uniform(-0.8, 0.8, (4, 6)), np.full(4, 0.05)])
        rates = rng.uniform(-1.0, 1.0, (4, 6))
        rates[0] = np.nan
        radii = rng.uniform(0.03, 0.08, 6)
        found = share_of(centers, moved, radii, capsules, rates)
        twin = naive_share(centers, moved, radii, capsules, rates, RULE[:5])
        assert found == pytest.approx(twin, abs=2e-3)
        near = ball_gaps(np.column_stack([centers, radii]), capsules[:1])[:, 0] < 0.25
        fastest = np.linalg.norm(moved, axis=1)[near].max(initial=0.5)
        found = share_of(centers, moved, radii, capsules, rates, capsules[:1])
        assert found == pytest.approx(min(twin, 0.5 / fastest), abs=2e-3)
        calm, gaps = (
            np.copy(RULE),
            ball_gaps(np.column_stack([centers, radii]), capsules),
        )
        calm[7] = 0.2  # of all of them
        near = gaps.min(axis=1) < calm[7]
        fastest = np.linalg.norm(moved, axis=1)[near].max(initial=0.8)
        found = share_of(centers, moved, radii, capsules, rates, rule=calm)
        assert found == pytest.approx(min(twin, 0.8 / fastest), abs=2e-3)


class Nobody:
    """A planner that frees everything: what slows here is the limit alone."""

    def __init__(self, cell_map):
        self.cell_map = cell_map

    def blocked_leg(self, path, extra=0.0, points=None):
        return None

    def separation(self, q):
        return 1.0


def test_an_executor_keeps_the_limit_and_gets_faster_again(small_map):
    robot = small_map.robot
    q, goal = np.zeros(3), np.array([1.5, 0.0, 0.0])
    q, goal = (np.clip(x, robot.lower, robot.upper) for x in (q, goal))
    settings = ExecutionSettings(speed_scale=0.3)
    executor = Executor(robot, Nobody(small_map), q, 0.01, settings)
    arm = np.array([[5.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.1]])
    watcher = Watcher()

    class Go:
        status, path, reason = "following", np.array([q, goal]), ""

    fastest = []
    for k in range(150):
        executor.limit_speed(0.3 if 40 <= k < 90 else 1.0)
        executor.update(Go, executor.commit(), watcher.look(arm, 0.01 * k))
        executor.advance()
        fastest.append(np.abs(executor.set_point.dq).max())
    assert max(fastest[75:90]) < 0.35 * max(fastest[:40])
    assert max(fastest[120:]) > 2.0 * max(fastest[75:90])


def test_a_motion_away_from_the_person_is_not_slowed(small_map):
    robot = small_map.robot
    limit = SpeedLimit(robot, SpeedSettings())
    there = np.clip([0.8, 0.3, 0.3], robot.lower, robot.upper)
    motion = time_path(
        robot, np.array([np.clip(np.zeros(3), robot.lower, robot.upper), there])
    )
    from roadmap.kinematics.forward import sphere_centers

    ends = [sphere_centers(robot, motion.at(t).q)[-1] for t in (0.0, motion.duration)]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    shares = []
    for side in (1.0, -1.0):
        p = ends[0] + side * 0.2 * along
        threat = Watcher().look(np.array([[*p, *(p + [0, 0, 0.01]), 0.03]]), 0.0)
        shares.append(limit.share(motion, 0.0, 1.0, threat))
    assert shares[0] < shares[1]


def test_near_a_hand_that_takes_part_no_point_is_quicker_than_is_said(small_map):
    robot = small_map.robot
    path = np.array([[0.0, 0.6, 0.0], [0.8, 0.2, 0.3]])
    motion = time_path(robot, path)
    settings = SpeedSettings(hand_speed=0.1)
    t = 0.5 * motion.duration
    centers = [sphere_centers(robot, motion.at(t + dt).q) for dt in (0.0, 1e-4)]
    speeds = np.linalg.norm(centers[1] - centers[0], axis=1) / 1e-4
    tip = centers[0][robot.moving][-1]
    side = np.array([0.0, 0.0, 0.4])
    shares = []
    for up in (0.0, 1.0):  # beside the tip; out of reach
        place = tip + [0.0, 0.0, up] + side
        hand = np.array([[*place, *place, 0.05]])
        far = np.array([[5.0, 0, 0, 5.0, 0, 0.2, 0.05]])
        watcher = Watcher()
        for k in range(4):
            threat = watcher.look(far, 0.01 * k)
        limit = SpeedLimit(robot, settings)
        assert limit.share(motion, t, 1.0, threat) == 1.0
        reach = 0.35 if up == 0.0 else 0.25
        limit = SpeedLimit(robot, replace(settings, hand_near=reach))
        shares.append(limit.share(motion, t, 1.0, threat, hand))
    gaps = np.linalg.norm(centers[0] - (tip + side), axis=1) - 0.05
    near = robot.moving & (gaps - robot.spheres[:, 3] < 0.35)
    full = robot.max_velocity / np.abs(motion.at(t).dq)
    assert shares[1] == 1.0
    assert shares[0] == pytest.approx(0.1 / (full.min() * speeds[near].max()), rel=0.02)


def gone_beside(small_map, hand, limit):
    """Return how hard the tip is jerked at most, and a stop, on a way beside a hand."""
    robot = small_map.robot
    q, goal = np.array([0.0, 0.6, 0.0]), np.array([0.8, 0.2, 0.3])
    executor = Executor(robot, Nobody(small_map), q, 0.01)
    settings = SpeedSettings(hand_near=0.5, hand_jerk=limit)
    rule = partial(SpeedLimit(robot, settings).jerk_share, hands=hand)
    executor.limit_jerk(rule)
    watcher = Watcher()

    class Go:
        status, path, reason = "following", np.array([q, goal]), ""

    tips, stops = [], []
    for k in range(400):
        threat = watcher.look(np.array([[5.0, 0, 0, 5.0, 0, 1.0, 0.1]]), 0.01 * k)
        executor.update(Go, executor.commit(), threat)
        executor.advance()
        tips.append(sphere_centers(robot, executor.set_point.q)[robot.moving][-1])
        stops.append(executor.held)
    assert np.allclose(executor.set_point.q, goal)
    jerk = np.linalg.norm(np.diff(tips, 3, axis=0), axis=1) / 0.01**3
    return jerk.max(), max(stops, key=lambda stop: stop.duration)


def test_near_a_hand_that_takes_part_it_is_gentle_and_stops_as_hard_as_ever(small_map):
    robot = small_map.robot
    tip = sphere_centers(robot, np.array([0.8, 0.2, 0.3]))[robot.moving][-1]
    near, far = ([*p, *p, 0.05] for p in (tip + [0.0, 0.0, 0.2], tip + 3.0))
    jerk = {}
    for name, hand, limit in [
        ("any", near, np.inf), ("near", near, 2.0), ("far", far, 2.0)
    ]:  # fmt: skip
        jerk[name], stop = gone_beside(small_map, np.array([hand]), limit)
        hardest = max(abs(phase.j) for phase in stop.profile.phases)
        assert stop.jerk_scale == 1.0 and hardest == pytest.approx(stop.path.j.max())
    assert jerk["far"] == jerk["any"]
    assert jerk["near"] < 1.5 * 2.0 and jerk["any"] > 3.0 * jerk["near"]


def test_the_share_of_the_jerk_follows_the_limit_and_how_far_the_hand_is(small_map):
    robot = small_map.robot
    motion = time_path(robot, np.array([[0.0, 0.6, 0.0], [0.8, 0.2, 0.3]]))
    tip = sphere_centers(robot, motion.q_end)[robot.moving][-1]
    hand = np.array([[*tip, *tip, 0.05]])
    rule = SpeedLimit(robot, SpeedSettings(hand_jerk=1.0))
    share = rule.jerk_share(motion, 0.0, hand)
    assert 0.0 < share < 0.5
    twice = SpeedLimit(robot, SpeedSettings(hand_jerk=2.0))
    assert twice.jerk_share(motion, 0.0, hand) == pytest.approx(2.0 * share)
    assert rule.jerk_share(motion, 0.0, hand + [2.0, 0, 0, 2.0, 0, 0, 0]) == 1.0
    assert rule.jerk_share(motion, motion.duration, hand) == 1.0
    assert rule.jerk_share(motion, 0.0, np.zeros((0, 7))) == 1.0


def test_who_has_just_braked_for_somebody_goes_on_with_all_of_the_jerk(small_map):
    class Once(Nobody):
        blocks = False

        def blocked_leg(self, path, extra=0.0, points=None):
            return 0 if self.blocks else None

    q, goal = np.array([0.0, 0.6, 0.0]), np.array([0.8, 0.2, 0.3])
    planner = Once(small_map)
    executor = Executor(small_map.robot, planner, q, 0.01)
    executor.limit_jerk(lambda motion, t: 0.02)
    watcher = Watcher()

    shares = []
    for k in range(120):
        planner.blocks = k == 20
        threat = watcher.look(np.array([[5.0, 0, 0, 5.0, 0, 1.0, 0.1]]), 0.01 * k)
        commit = executor.commit()
        path = np.array([commit.q, goal])
        go = SimpleNamespace(status="following", path=path, reason="")
        executor.update(go, commit, threat)
        shares.append(executor.motion.jerk_scale)
        executor.advance()
    assert set(shares[1:20]) == {0.02} and set(shares[20:31]) == {1.0}
    assert min(shares[32:]) < 0.1  # as soon as that can be
