"""What another robot may still sweep holds all that it then does."""

import numpy as np
import pytest
from small import DATA

from odm.execution.robot_threat import Stretch, intent_threat, limits_threat
from odm.obstacles.robot_surface import RobotSurface
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.motion.motion import time_path
from roadmap.transforms import pose_of

T = pose_of((0.9, 0.1, 0.0), (0.0, 0.0, 3.0))


@pytest.fixture(scope="module")
def surface():
    return RobotSurface(load_robot(DATA / "arm3.urdf", tip="tool"), parts="moving")


def motion_of(robot, rng, scale=0.7):
    path = rng.uniform(robot.lower, robot.upper, (4, robot.dof))
    return time_path(robot, path, speed_scale=scale)


def test_an_intent_holds_the_whole_motion_at_all_times(surface, rng):
    for _ in range(6):
        motion = motion_of(surface.robot, rng)
        begin = rng.uniform(0.0, motion.duration)
        end = min(begin + rng.uniform(0.0, 0.4), motion.duration)
        threat = intent_threat(surface, (Stretch(motion, begin, end),), T)
        clouds = threat.points.reshape(-1, len(surface), 3)
        for t in rng.uniform(begin, end, 60):
            points = surface.at(motion.at(t).q, T)
            off = np.linalg.norm(clouds - points, axis=2).max(axis=1)
            assert off.min() <= threat.radius + 1e-9
        # the same at all times: nobody has to be on time
        assert threat.between(0.0, 0.01)[0] is threat.between(0.3, 0.5)[0]


def test_a_robot_at_rest_intends_to_stay(surface):
    still = time_path(surface.robot, np.zeros((1, 3)))
    threat = intent_threat(surface, (Stretch(still, 0.0, 0.0),), T)
    assert threat.radius == 0.0 and threat.fastest == 0.0
    assert np.allclose(threat.points, surface.at(np.zeros(3), T))


def test_the_limits_hold_what_a_robot_can_do(surface, rng):
    for _ in range(8):
        motion = motion_of(surface.robot, rng)
        now = rng.uniform(0.0, motion.duration)
        point = motion.at(now)
        threat = limits_threat(surface, T, point.q, point.dq, speed_scale=0.7)
        for begin, end in ((0.0, 0.0), (0.0, 0.05), (0.1, 0.13), (0.3, 0.3)):
            points, radius = threat.between(begin, end)
            for t in np.linspace(begin, end, 7):
                there = surface.at(motion.at(now + t).q, T)
                off = np.linalg.norm(there - points, axis=1)
                assert off.max() <= radius + 1e-9


def test_old_data_make_the_ball_larger(surface):
    q, dq = np.zeros(3), np.full(3, 0.2)
    fresh = limits_threat(surface, T, q, dq).between(0.0, 0.1)[1]
    stale = limits_threat(surface, T, q, dq, age=0.1).between(0.0, 0.1)[1]
    assert stale > fresh


@pytest.mark.parametrize("age", [None, np.nan, np.inf, -0.1])
def test_data_of_unknown_age_make_it_be_anywhere(surface, age):
    threat = limits_threat(surface, T, np.zeros(3), np.zeros(3), age=age)
    assert threat.between(0.0, 0.1)[1] == np.inf


def test_a_robot_whose_joints_are_not_known_is_refused(surface):
    q = np.array([0.0, np.nan, 0.0])
    for state in ((q, np.zeros(3)), (np.zeros(3), q)):
        with pytest.raises(BadInput, match="of the other robot"):
            limits_threat(surface, T, *state)


def test_a_robot_faster_than_it_says_is_refused(surface):
    dq = np.array([10.0, 0.0, 0.0])
    with pytest.raises(BadInput, match="more than"):
        limits_threat(surface, T, np.zeros(3), dq, speed_scale=0.1)
    with pytest.raises(BadInput, match="3 finite"):
        limits_threat(surface, T, np.zeros(3), np.zeros(2))
