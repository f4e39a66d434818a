"""Retreats are tested against the person's motion, as everything else that moves."""

from types import SimpleNamespace

import numpy as np
import pytest
from forms import size

import odm
from odm.exact.distances import ExactRobot
from odm.execution.executor import RETREATING, STANDING, Executor
from odm.execution.kinematic import KinematicMover
from odm.execution.threat import Threat, ThreatSettings
from odm.obstacles.shapes import Capsule
from roadmap.geometry.gaps import ball_gaps
from roadmap.kinematics.forward import cover_balls, sphere_centers
from roadmap.transforms import pose_of

START = np.array([0.0, 0.6, 0.0])
AWAY = np.array([0.8, 0.2, 0.0])


class Scene:
    """A small arm that holds, with a way out, and a ball beside its tip."""

    def __init__(self, small_map):
        self.planner = odm.ReactivePlanner(small_map)
        self.planner.set_goals([[-1.2, 0.6, 0.0]])
        robot = small_map.robot
        self.robot = robot
        self.executor = Executor(robot, self.planner, START, 0.01)
        tip = sphere_centers(robot, START)[robot.moving][-1]
        ahead = sphere_centers(robot, AWAY)[robot.moving][-1]
        self.tip, self.out = tip, (ahead - tip) / np.linalg.norm(ahead - tip)
        self.path = np.stack([START, AWAY])

    def frame(self, place, velocity):
        """Hold for a frame beside a ball of 5 cm."""
        ball = np.array([[*place, *place, 0.05]])
        commit = self.executor.commit()
        self.planner.step(odm.Obstacles(capsules=ball), q=commit.q)
        rates = np.tile(np.asarray(velocity, float), (1, 2, 1))
        threat = Threat(ball, rates, np.zeros(1), 0.0, ThreatSettings())
        answer = SimpleNamespace(status="holding", retreat=self.path, reason="")
        self.executor.update(answer, commit, threat)


@pytest.fixture
def scene(small_map):
    return Scene(small_map)


def test_it_backs_off_from_who_stands_behind_it(scene):
    place = scene.tip - 0.25 * scene.out
    for _ in range(10):
        scene.frame(place, np.zeros(3))
        scene.executor.advance()
    assert scene.executor.state == RETREATING
    assert np.abs(scene.executor.set_point.dq).max() > 0.01


def test_it_does_not_back_off_towards_who_comes_from_there(scene):
    place = scene.tip + 0.14 * scene.out
    for _ in range(30):
        scene.frame(place, -2.0 * scene.out)
        assert scene.executor.state == STANDING
        scene.executor.advance()


def test_a_retreat_ends_before_who_comes_touches_it(scene):
    place = scene.tip - 0.25 * scene.out
    for _ in range(25):
        scene.frame(place, np.zeros(3))
        scene.executor.advance()
    assert scene.executor.state == RETREATING
    here = sphere_centers(scene.robot, scene.executor.set_point.q)[scene.robot.moving]
    side = np.cross(scene.out, [0.0, 0.0, 1.0])
    place, velocity = here[-1] + 0.5 * scene.out + 0.1 * side, -1.5 * scene.out
    moving = []
    for _ in range(60):  # one comes from where the retreat leads to
        scene.frame(place, velocity)
        speed = np.abs(scene.executor.set_point.dq).max()
        gap = scene.planner.separation(scene.executor.set_point.q)
        moving.append((speed, gap))
        scene.executor.advance()
        place = place + 0.01 * velocity
    assert min(gap for speed, gap in moving) < 0.1  # it would have been touched
    assert all(gap > 0.0 for speed, gap in moving if speed > 0.01)
    assert scene.executor.state == STANDING


@pytest.mark.parametrize("kind", [Executor, KinematicMover])
def test_a_retreat_ends_before_what_is_put_in_its_way(scene, kind):
    scene.executor = kind(scene.robot, scene.planner, START, 0.01)
    exact, ball = ExactRobot(scene.robot), odm.Sphere(0.02)
    tip = sphere_centers(scene.robot, AWAY)[scene.robot.moving][-1]
    there = pose_of(tip, np.zeros(3))
    for k in range(150):
        scene.frame(scene.tip - 0.25 * scene.out, np.zeros(3))
        scene.executor.advance()
        if k == 10:
            assert scene.executor.state == RETREATING
            scene.planner.scene.add("ball", ball, there)
            scene.path = None  # as of a planner that knows of no way out
    gap = exact.distance(scene.executor.set_point.q, [ball.moved(there)]).distance
    assert gap > scene.planner.cell_map.safety.m
    assert scene.executor.state == STANDING


def test_a_slow_retreat_is_taken_where_a_quick_one_could_not_stop(scene):
    speeds = {}
    for gap in (0.35, 0.14):
        scene.executor = Executor(scene.robot, scene.planner, START, 0.01)
        for _ in range(12):
            scene.frame(scene.tip - gap * scene.out, np.zeros(3))
            scene.executor.advance()
        if scene.executor.state == RETREATING:
            speeds[gap] = scene.executor.motion.speed_scale
    assert speeds[0.35] == 0.25
    assert speeds.get(0.14, 0.0) < 0.25


def played_beside(small_map, rng, within):
    """Stand beside a ball within the cover; return gaps [m], speeds, executor, q."""
    planner, robot = odm.ReactivePlanner(small_map), small_map.robot
    exact, place = ExactRobot(robot), None
    while place is None:
        q = START + rng.uniform(-0.4, 0.4, 3)
        balls = cover_balls(robot, q)[robot.moving]
        out = rng.normal(size=3)
        out *= (balls[-1, 3] + rng.uniform(-0.03, 0.05)) / np.linalg.norm(out)
        ball = np.tile(balls[-1, :3] + out, 2)
        ball = np.append(ball, 0.02)[None]
        cover, solid = (
            ball_gaps(balls, ball).min(),
            Capsule.between(*ball[0, :6].reshape(2, 3), 0.02),
        )
        if within[0] < exact.distance(q, [solid]).distance < within[1] and cover < 0.0:
            place = ball
    planner.set_goals([[-1.2, 0.6, 0.0]])
    executor, gaps, speeds = Executor(robot, planner, q, 0.01), [], []
    threat = Threat(place, np.zeros((1, 2, 3)), np.zeros(1), 0.0, ThreatSettings())
    for _ in range(120):
        commit = executor.commit()
        answer = planner.step(odm.Obstacles(capsules=place), q=commit.q)
        executor.update(answer, commit, threat)
        executor.advance()
        point = executor.set_point
        gaps.append(exact.distance(point.q, [solid]).distance)
        speeds.append(np.abs(point.dq).max())
    return np.array(gaps), np.array(speeds), executor, q


def test_it_leaves_who_stands_within_its_cover_but_not_at_its_links(small_map, rng):
    left, plays = 0, size(3, 5)
    for _ in range(plays):
        gaps, speeds, executor, q = played_beside(small_map, rng, (0.012, 0.02))
        assert gaps.min() > executor.settings.yield_gap - 1e-6
        left += gaps[-1] > gaps[0] + 0.01
    assert left > plays / 2


def test_who_touches_its_links_is_not_left_and_is_told_why(small_map, rng):
    gaps, speeds, executor, q = played_beside(small_map, rng, (-0.02, -0.004))
    assert (speeds == 0.0).all() and np.allclose(executor.set_point.q, q, atol=1e-12)
    assert "stands until they are farther" in executor.reason


def test_beside_somebody_too_near_a_retreat_is_looked_for_now_and_then(scene):
    """To tell why it stands: the search takes a while, and frames come on."""
    path, looked = scene.path, []

    class Answer:
        status, reason = "holding", ""

        @property
        def retreat(self):
            looked.append(frame)
            return path

    scene.executor._separation.stays_above = lambda least, q: False  # it may not move
    for frame in range(20):
        scene.executor.update(Answer(), scene.executor.commit(), None)
        assert "stands until they are farther" in scene.executor.reason
        scene.executor.advance()
    every = scene.executor.pace.retreat_every
    assert looked == list(range(0, 20, every)) and every > 1
