"""What is said of the slowest stop is what a stop takes, and what a person covers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from odm.execution.executor import Executor
from odm.execution.settings import ExecutionSettings, PaceSettings
from odm.execution.stop_test import slowest_stop, stop_time
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
    assert comes == pytest.approx(seen.displacement_bound(time), rel=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_how_far_somebody_comes_is_told_of_any_rate(noise):
    """Below 5 frames a second nobody is followed from one to the next."""
    threat = ThreatSettings(noise=noise)
    for period in (0.002, 0.01, 1.0 / 30, 0.1, 0.2, 0.21, 0.5, 1.0):
        watcher, stands = Watcher(threat), np.array([[1.0, 0, 0, 1, 0, 0.5, 0.05]])
        for k in range(int(1.0 / period) + 5):
            seen = watcher.look(stands, period * k)
        assert seen.known.all() == (period <= 0.2)
        for time in (0.05, 0.2, 1.0):
            told = threat.displacement_bound(time, period)
            assert told == pytest.approx(seen.displacement_bound(time), rel=1e-9)


def test_who_follows_late_stops_so_much_later_and_is_quick_no_more(small_map):
    robot = replace(small_map.robot, max_jerk=100.0 * small_map.robot.max_jerk)
    times, quick = [], []
    for late in (0.0, 0.04):
        how = ExecutionSettings(0.1, latency_s=late)
        times.append(slowest_stop(robot, how, PERIOD, ThreatSettings())[0])
        planner = SimpleNamespace(cell_map=small_map, blocked_leg=lambda *_: None)
        quick.append(Executor(robot, planner, np.zeros(3), PERIOD, how).quick)
    assert times[1] - times[0] == pytest.approx(0.04) and quick == [True, False]


def test_a_slower_robot_of_the_same_limits_stops_sooner(small_map):
    stops = [
        slowest_stop(
            small_map.robot, ExecutionSettings(scale), PERIOD, ThreatSettings()
        )
        for scale in (0.9, 0.3)
    ]
    assert stops[0] > stops[1] > (PERIOD, 0.0)


@pytest.mark.parametrize("quick", [True, False])
def test_a_robot_slow_to_stop_expects_more_of_somebody_who_is_calm(small_map, quick):
    robot = small_map.robot
    times = 100.0 if quick else 0.2
    robot = replace(
        robot,
        max_acceleration=times * robot.max_acceleration,
        max_jerk=times * robot.max_jerk,
    )
    time = stop_time(robot, ExecutionSettings().slowest_scale, PERIOD)
    assert (time <= PaceSettings().quick_s) == quick
    watcher, stands = Watcher(), np.array([[1.0, 0, 0, 1, 0, 0.5, 0.05]])
    for k in range(10):
        seen = watcher.look(stands, PERIOD * k)
    calm = seen.as_so_far()
    comes = slowest_stop(robot, ExecutionSettings(), PERIOD, seen.settings)[1]
    assert comes == pytest.approx((calm if quick else seen).displacement_bound(time))

    def told(threat):
        """Return how much larger the person is told to be in a few frames [m]."""
        grown = []

        class Planner:
            cell_map = small_map

            def blocked_leg(self, path, extra=0.0, points=None):
                grown.append(points.capsules[0, 6] - 0.05)

        executor = Executor(robot, Planner(), np.zeros(robot.dof), PERIOD)
        path = np.array([np.zeros(robot.dof), np.full(robot.dof, 0.5)])
        answer = SimpleNamespace(status="replanned", path=path, retreat=None, reason="")
        for _ in range(30):
            executor.update(answer, executor.commit(), threat)
            executor.advance()
            answer.status = "following"
        return np.array(grown)

    assert (told(seen) >= told(calm)).all()
    assert (told(seen).max() > 1.3 * told(calm).max()) != quick
    assert np.array_equal(told(seen), told(calm)) == quick
