"""What is said of the slowest stop is what a stop takes, and what a person covers."""

from dataclasses import replace

import numpy as np
import pytest

from odm.execution.executor import ExecutionSettings
from odm.execution.slowest_stop import slowest_stop
from odm.execution.threat import ThreatSettings, Watcher
from roadmap.motion.motion import time_path

PERIOD = 0.01


@pytest.mark.parametrize("harder", [0.2, 1.0, 20.0])
def test_the_slowest_stop_is_that_of_a_motion_at_the_slowest_speed(small_map, harder):
    robot = small_map.robot
    robot = replace(robot, max_jerk=harder * robot.max_jerk)
    settings = ExecutionSettings(0.7)
    time, _ = slowest_stop(robot, settings, PERIOD, ThreatSettings())
    taken = []
    for joint in range(robot.dof):
        path = np.zeros((2, robot.dof))
        path[:, joint] = -0.9, 0.9
        motion = time_path(robot, path, blend=0, speed_scale=settings.slowest_scale)
        taken.append(motion.stop(0.5 * motion.duration).duration)
    assert time == pytest.approx(PERIOD + max(taken), rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 0.0007, 0.003, 0.02])
@pytest.mark.parametrize("acceleration", [0.0, 4.0, 9.0])
def test_somebody_comes_as_far_as_the_braking_test_counts_with(
    small_map, noise, acceleration
):
    threat = ThreatSettings(acceleration=acceleration, noise=noise)
    told = small_map.robot, ExecutionSettings(0.7), PERIOD, threat
    time, comes = slowest_stop(*told)
    watcher, stands = Watcher(threat), np.array([[1.0, 0, 0, 1, 0, 0.5, 0.05]])
    for k in range(120):
        seen = watcher.look(stands, PERIOD * k)
    assert seen.known.all()
    assert comes == pytest.approx(seen.strays(time), rel=1e-9)


def test_a_slower_robot_of_the_same_limits_stops_sooner(small_map):
    stops = [
        slowest_stop(
            small_map.robot, ExecutionSettings(scale), PERIOD, ThreatSettings()
        )
        for scale in (0.9, 0.3)
    ]
    assert stops[0] > stops[1] > (PERIOD, 0.0)
