"""The oracle: what could have been evaded, and by whom; and what it is told."""

from types import SimpleNamespace

import numpy as np
import pytest

import odm
from roadmap.kinematics.forward import sphere_centers
from roadmap.motion.motion import time_path
from sim.bench.evadable import Moment, Oracle, Touch, TouchWatch
from sim.loop.loop import exact_audit

WAITS = np.array([0.0, 0.8, 0.4])
PERIOD = 0.01


class Ball:
    """A ball of 5 cm that comes to where the hand of a robot was, and stays there."""

    def __init__(self, robot, speed, radius=0.05, start=1.5):
        self.tool = sphere_centers(robot, WAITS)[robot.moving][-1]
        self.speed, self.radius, self.start = speed, radius, start

    def capsules(self, t):
        p = self.tool + [max(0.0, self.start - self.speed * t), 0.0, 0.0]
        return np.array([[*p, *p, self.radius]])


def touched_at(robot, human):
    """Return the first frame's time in which one who stands is touched [s]."""
    audit = exact_audit(robot)
    times = np.arange(0.0, 10.0, PERIOD)
    return next(float(t) for t in times if audit(WAITS, human.capsules(t)) <= 0.0)


def stands(robot, time_s):
    return Moment(time_s, time_path(robot, WAITS[None]), 0.0)


@pytest.fixture(scope="module")
def planner(small_map):
    return odm.ReactivePlanner(small_map)


def test_who_stands_long_enough_could_have_evaded_and_truly_would_have(planner):
    robot, human = planner.robot, Ball(planner.robot, 0.6)
    at = touched_at(robot, human)
    touch = Touch(at, (), stands(robot, at - 0.5))
    motion = Oracle(planner, human).evades(touch, standing=True)
    audit = exact_audit(robot)
    gaps = [
        audit(motion.at(t).q, human.capsules(at - 0.5 + t))
        for t in np.arange(0.0, 1.0, PERIOD)
    ]
    assert min(gaps) > 0.0 and np.allclose(motion.at(0.0).q, WAITS)
    points = motion.sample(np.arange(0.0, 1.0, PERIOD))
    assert (np.abs(points.dq) <= robot.max_velocity + 1e-9).all()
    assert (np.abs(points.ddq) <= robot.max_acceleration + 1e-6).all()
    assert planner.static.motion_free(WAITS, motion.at(1.0).q - WAITS)


def test_nobody_evades_too_late_or_what_fills_the_room(planner):
    robot = planner.robot
    ball = Ball(robot, 0.6)
    at = touched_at(robot, ball)
    late = Touch(at, (), stands(robot, at - 0.02))
    assert Oracle(planner, ball).evades(late, standing=True) is None
    wall = Ball(robot, 3.0, radius=3.0, start=6.0)
    at = touched_at(robot, wall)
    early = Touch(at, (stands(robot, at - 0.5),), None)
    assert Oracle(planner, wall).evades(early) is None
    assert Oracle(planner, wall).evades(early, standing=True) is None  # it never stood


def test_touches_are_those_of_a_robot_that_stood_all_along(planner):
    robot = planner.robot
    turns = time_path(robot, np.stack([WAITS, WAITS + [0.3, 0.0, 0.0]]))
    executor = SimpleNamespace(motion=turns, t=0.0)
    settings = SimpleNamespace(rate_hz=1.0 / PERIOD)
    watch = TouchWatch(SimpleNamespace(executor=executor, settings=settings))
    over = round(turns.duration / PERIOD) + 1

    def frame(k, gap, speed):
        executor.t = PERIOD * (k + 1)
        watch.hear(SimpleNamespace(index=k, separation=gap, joint_speed=speed))

    for k in range(over + 40):
        stood = over + 20 <= k < over + 25
        moved = over - 9 <= k < over - 7
        frame(k, 0.0 if stood or moved else 0.1, 0.3 if moved else 0.0)
    watch.close()
    (touch,) = watch.touches
    assert np.isclose(touch.time_s, PERIOD * (over + 20))
    befores = [touch.time_s - moment.time_s for moment in touch.moments]
    assert np.allclose(
        befores, [b for b in (0.75, 0.5, 0.25, 0.1) if b <= touch.time_s]
    )
    # it has stood since it came to its end
    assert np.abs(turns.at(touch.stood.t).dq).max() <= 0.01
    assert np.abs(turns.at(touch.stood.t - 2 * PERIOD).dq).max() > 0.01
