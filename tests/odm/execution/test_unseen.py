"""A part that a tracker lost comes on, while what is shown of it stays and grows."""

from types import SimpleNamespace

import numpy as np
import pytest

import odm
from odm.execution.executor import Executor
from odm.execution.threat import Watcher
from roadmap.geometry.gaps import ball_gaps
from roadmap.kinematics.forward import cover_balls

START, END = np.array([-1.2, 0.6, 0.0]), np.array([1.2, 0.6, 0.0])
RADIUS, GROWING, COMES, PERIOD = 0.05, 1.6, 1.5, 0.01  # [m], [m/s], [m/s], [s]


def closest_while_moving(cell_map, far, lost):
    """Return how near the true ball comes to the moving robot, and how far that got.

    The ball is `far` [m] beside the tip's way at first, and comes to meet the tip. It
    is seen until `lost` [s].
    """
    robot = cell_map.robot
    planner = odm.ReactivePlanner(cell_map)
    executor = Executor(robot, planner, START, PERIOD)
    tip = cover_balls(robot, 0.5 * (START + END))[robot.moving][-1]
    out = tip[:3] / np.linalg.norm(tip[:3] * (1, 1, 0)) * (1, 1, 0)
    begin = tip[:3] + (far + tip[3] + RADIUS) * out
    watcher, nearest = Watcher(), np.inf
    for k in range(150):
        true = begin - COMES * k * PERIOD * out
        age = max(k * PERIOD - lost, 0.0)
        place = begin - COMES * min(k * PERIOD, lost) * out
        shown = np.array([[*place, *place, RADIUS + GROWING * age]])
        balls = cover_balls(robot, executor.set_point.q)[robot.moving]
        gap = ball_gaps(balls, np.array([[*true, *true, RADIUS]])).min()
        if np.abs(executor.set_point.dq).max() > 1e-3:
            nearest = min(nearest, float(gap))
        if gap <= 0.0:
            break
        commit = executor.commit()
        path = np.array([commit.q, END])
        answer = SimpleNamespace(status="following", path=path, reason="")
        planner.step(odm.Obstacles(capsules=shown), q=commit.q)
        executor.update(answer, commit, watcher.look(shown, k * PERIOD))
        executor.advance()
    return nearest, float(np.abs(executor.set_point.q - START).max())


@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_who_comes_unseen_touches_a_robot_only_once_it_stands(small_map, lost):
    """Its motions are tested against where they may be, not where they were."""
    for far in (0.3, 0.5, 0.7, 0.9):
        nearest, turned = closest_while_moving(small_map, far, lost)
        assert nearest > 0.0, (far, nearest, turned)


def test_it_moves_until_they_are_near(small_map):
    assert closest_while_moving(small_map, 0.9, 0.2)[1] > 0.1
