"""A robot that moves away from who is near is not braked for them as one that comes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import odm
from odm.execution.executor import BRAKED, Executor
from odm.execution.threat import Threat, ThreatSettings
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.transforms import pose_of

START = np.array([0.0, 0.6, 0.0])
AWAY, NEARER = np.array([0.8, 0.6, 0.0]), np.array([-0.8, 0.6, 0.0])


class Beside:
    """A small arm that stands, a ball beside its tip, and a path it is to follow."""

    def __init__(self, small_map, gap, end, settings=None):
        self.planner = odm.ReactivePlanner(small_map)
        robot = self.robot = small_map.robot
        self.executor = Executor(robot, self.planner, START, 0.01, settings)
        here, there = (cover_balls(robot, q)[robot.moving] for q in (START, AWAY))
        tip = here[-1]
        out = there[-1, :3] - tip[:3]
        self.out = out / np.linalg.norm(out)
        # the ball is behind the tip, seen from where AWAY leads to
        self.radius = 0.05
        self.place = tip[:3] - (tip[3] + self.radius + gap) * self.out
        self.velocity = np.zeros(3)
        self.path = np.array([START, end])

    def gap(self):
        robot = self.robot
        balls = cover_balls(robot, self.executor.set_point.q)[robot.moving]
        return float(ball_gaps(balls, self.ball()).min())

    def to_robot(self):
        """Return the direction from the ball to the nearest sphere."""
        robot = self.robot
        balls = cover_balls(robot, self.executor.set_point.q)[robot.moving]
        nearest = balls[ball_gaps(balls, self.ball())[:, 0].argmin(), :3]
        return (nearest - self.place) / np.linalg.norm(nearest - self.place)

    def ball(self):
        return np.array([[*self.place, *self.place, self.radius]])

    def threat(self):
        rates = np.tile(self.velocity, (1, 2, 1))
        return Threat(self.ball(), rates, np.zeros(1), 0.0, ThreatSettings())

    def frame(self):
        """Go on along the path for a frame, whatever the planner would say."""
        commit = self.executor.commit()
        path = np.vstack([commit.q[None], self.path[1:]])
        answer = SimpleNamespace(status="following", path=path, reason="")
        self.executor.update(answer, commit, self.threat())
        self.executor.advance()


def far_after(scene, frames):
    for _ in range(frames):
        scene.frame()
    return float(np.abs(scene.executor.set_point.q - START).max())


def test_it_gets_away_from_who_stands_just_beyond_its_clearance(small_map):
    m = small_map.safety.m
    scene = Beside(small_map, m + 0.002, AWAY)
    assert scene.gap() == pytest.approx(m + 0.002)
    assert far_after(scene, 150) > 0.3
    assert scene.gap() > 0.1


def test_it_comes_no_nearer_to_who_stands_just_beyond_its_clearance(small_map):
    scene = Beside(small_map, small_map.safety.m + 0.002, NEARER)
    assert far_after(scene, 150) < 0.01
    assert scene.executor.state == BRAKED


def test_who_may_be_anywhere_is_told_without_a_number(small_map):
    scene = Beside(small_map, 0.2, AWAY)
    known, executor = scene.threat(), scene.executor
    for age, told in ((0.0, ""), (None, "and anywhere")):
        scene.threat = lambda age=age: replace(known, age=age)
        for _ in range(8):
            scene.frame()
        assert told in executor.reason and "inf" not in executor.reason


def left_by(scene, threat):
    """Return which parts are near and left by a way, None: it leads to one."""
    executor = scene.executor
    answer = SimpleNamespace(status="following", path=scene.path, reason="")
    executor.update(answer, executor.commit(), None)
    begin, stop = executor._stop_behind(executor.motion, 0.05)
    left = executor._test.left_behind(executor.motion, 0.05, begin, stop, threat)
    return None if left is None else left.tolist()


def test_which_way_leads_away_is_told_by_every_sphere_that_is_near(small_map):
    leads = {}
    for gap in (0.012, 0.4):
        for name, end in (("away", AWAY), ("nearer", NEARER)):
            scene = Beside(small_map, gap, end)
            leads[gap, name] = left_by(scene, scene.threat())
    assert leads == {
        (0.012, "away"): [True],
        (0.012, "nearer"): None,
        (0.4, "away"): [False],
        (0.4, "nearer"): [False],  # nobody is near
    }


def test_what_it_holds_leads_to_somebody_as_its_own_links_do(small_map):
    """It went on with 5 mm for `m`, the object ahead: only links were looked at."""
    leads = {}
    for end in (AWAY, NEARER):
        scene = Beside(small_map, 0.3, end)
        at = scene.place + (scene.radius + 0.012 + 0.04) * scene.out
        T = np.linalg.inv(tool_pose(scene.robot, START))
        scene.planner.attach(np.array([[*(T[:3, :3] @ at + T[:3, 3]), 0.04]]))
        leads[bool(end is AWAY)] = left_by(scene, scene.threat())
    assert leads == {True: [True], False: None}


def test_a_robot_that_was_placed_leaves_the_same_people(small_map):
    T = pose_of(np.array([3.0, -2.0, 0.5]), np.array([0.3, -0.2, 2.0]))
    for gap in (0.012, 0.4):
        for end in (AWAY, NEARER):
            scene = Beside(small_map, gap, end)
            threat = scene.threat()
            told = left_by(scene, threat)
            scene.planner.set_base(T)
            seen = moved_rods(threat.capsules, T)
            assert left_by(scene, replace(threat, capsules=seen)) == told


def test_a_way_on_which_what_is_carried_comes_nearer_does_not_lead_away(small_map):
    scene = Beside(small_map, 0.012, AWAY)
    robot, beyond = small_map.robot, scene.place - (scene.radius + 0.04) * scene.out
    assert left_by(scene, scene.threat()) == [True]
    inverse = np.linalg.inv(tool_pose(robot, START))
    ball = inverse[:3, :3] @ beyond + inverse[:3, 3]
    scene.planner.attach(np.array([[*ball, 0.02]]))
    assert left_by(scene, scene.threat()) is None


def test_who_stands_in_its_way_may_thrust_and_touch_it_only_once_it_stands(small_map):
    """They begin as hard as they may, and harder from then on as fast as they may."""
    s, worst, touched = ThreatSettings(), np.inf, 0
    for gap in (0.04, 0.08, 0.16):
        for begins in range(4, 60, 8):
            scene = Beside(small_map, gap, NEARER)
            assert not scene.executor.quick  # a quick robot goes without the jerk
            for k in range(110):
                scene.frame()
                if k >= begins:
                    harder = s.acceleration + s.jerk * 0.01 * (k - begins)
                    speed = np.linalg.norm(scene.velocity) + 0.01 * harder
                    scene.velocity = min(speed, s.speed) * scene.to_robot()
                    scene.place = scene.place + 0.01 * scene.velocity
                if np.abs(scene.executor.set_point.dq).max() > 1e-3:
                    worst = min(worst, scene.gap())
                if scene.gap() <= 0.0:
                    touched += 1
                    break
    assert touched and worst > 0.0


def test_who_comes_after_it_as_hard_as_they_may_touches_it_only_once_it_stands(
    small_map,
):
    """Their acceleration is what is assumed of them; the robot stops before."""
    most, worst = ThreatSettings().acceleration, np.inf
    for begins in (0, 5, 10, 15, 20, 30):
        scene = Beside(small_map, small_map.safety.m + 0.002, AWAY)
        for k in range(120):
            scene.frame()
            if k >= begins:
                scene.velocity = scene.velocity + 0.01 * most * scene.out
                scene.place = scene.place + 0.01 * scene.velocity
            moves = np.abs(scene.executor.set_point.dq).max() > 1e-3
            if moves:
                worst = min(worst, scene.gap())
            if scene.gap() <= 0.0:
                break
        assert scene.gap() <= 0.0  # they did catch up with it
    assert 0.0 < worst < small_map.safety.m
