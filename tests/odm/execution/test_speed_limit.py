"""Speed near a person: the standard's formula, and what it does to an executor."""

from dataclasses import replace

import numpy as np
import pytest
from naive_speed import naive_share

from odm.execution._speed import allowed_share
from odm.execution.executor import ExecutionSettings, Executor
from odm.execution.speed_limit import SpeedLimit, SpeedSettings
from odm.execution.threat import Watcher
from roadmap.kinematics.forward import sphere_centers
from roadmap.motion.motion import time_path

RULE = np.array([0.02, 0.15, 0.02, 0.15, 1.6])


def one(gap, toward=1.0, coming=0.0, known=True):
    """Return the share of a ball that goes at a capsule, `gap` [m] away."""
    centers, moved = np.zeros((1, 3)), np.array([[toward, 0.0, 0.0]])
    x = gap + 0.1 + 0.05
    capsule = np.array([[x, 0.0, -0.5, x, 0.0, 0.5, 0.05]])
    rate = np.tile([-coming, 0.0, 0.0], (1, 2)) if known else np.full((1, 6), np.nan)
    return allowed_share(centers, moved, np.array([0.1]), capsule, rate, RULE)


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
        found = allowed_share(centers, moved, radii, capsules, rates, RULE)
        twin = naive_share(centers, moved, radii, capsules, rates, RULE)
        assert found == pytest.approx(twin, abs=2e-3)


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
