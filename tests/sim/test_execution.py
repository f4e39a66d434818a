"""The timed execution: limits through every replan, a tested stop, calm for nobody."""

from dataclasses import replace

import numpy as np
import pytest

import odm
from roadmap.errors import BadInput
from sim.execution import MOVING, Executor
from sim.loop import LoopSettings, run_loop
from sim.threat import Threat, ThreatSettings, Watcher

TIMED = LoopSettings(duration_s=8.0, speed_scale=0.8, execution="timed")


def played(planner, robot, places, motion, settings=TIMED):
    frames = []
    result = run_loop(planner, robot, places, motion, settings, on_frame=frames.append)
    return result, frames


def check_limits(robot, frames, rate):
    dq = np.array([frame.dq for frame in frames])
    ddq = np.array([frame.ddq for frame in frames])
    slack = 1.0 + 1e-6
    assert (np.abs(dq) <= slack * robot.max_velocity).all()
    assert (np.abs(ddq) <= slack * robot.max_acceleration).all()
    jerk = np.abs(np.diff(ddq, axis=0)) * rate
    assert (jerk <= 1.001 * robot.max_jerk).all()
    q = np.array([frame.q for frame in frames])
    steps = np.diff(q, axis=0) * rate
    assert np.allclose(steps, 0.5 * (dq[1:] + dq[:-1]), atol=0.05)


def test_limits_hold_through_holds_and_replans(careful, crane, places, passing_by):
    result, frames = played(careful, crane, places, passing_by)
    assert len(result.holds) > 1 and result.path_changes > 0
    check_limits(crane, frames, TIMED.rate_hz)
    assert np.abs([f.dq for f in frames]).max() > 0.5  # it does move


def test_trips_are_made_and_places_reached_exactly(straight, crane, places):
    result, frames = played(straight, crane, places, None)
    assert result.trips >= 2
    check_limits(crane, frames, TIMED.rate_hz)
    for at in np.flatnonzero(np.diff(result.place)):
        assert np.abs(result.q[at + 1] - places[result.place[at]]).max() < 1e-6


class BackingOff:
    """Stands in for a planner that backs off from where it holds."""

    def __init__(self, careful, offset):
        self.careful, self.offset = careful, offset
        self.set_goals, self.separation = careful.set_goals, careful.separation

    def step(self, points, q, **frame):
        answer = self.careful.step(points, q, **frame)
        if answer.status == "holding":
            answer.retreat = np.array([q + self.offset, q + [1.0, 0.0]])
        return answer


def test_retreats_are_slow_and_within_limits(careful, crane, statue):
    places = np.array([[0.5, 0.0], [-0.9, 0.3]])
    planner = BackingOff(careful, 0.0)
    result, frames = played(planner, crane, places, statue)
    check_limits(crane, frames, TIMED.rate_hz)
    assert any(hold.retreating for hold in result.holds)
    backing = [np.abs(f.dq).max() for f in frames if f.pace == "retreating"]
    assert 0.0 < max(backing) <= 0.25 * crane.max_velocity.max() + 1e-9


def test_a_retreat_that_begins_elsewhere_is_not_taken(careful, crane, statue):
    places = np.array([[0.5, 0.0], [-0.9, 0.3]])
    result, frames = played(BackingOff(careful, 0.1), crane, places, statue)
    assert result.holds and not any(f.pace == "retreating" for f in frames)


@pytest.fixture
def at_work(small_map):
    return _at_work(small_map)


def _at_work(small_map):
    """Return a frame of a planner on its way from left to right, and its executor."""
    planner = odm.ReactivePlanner(small_map)
    a, b = np.array([1.2, 0.9, 0.0]), np.array([-1.2, -0.9, 0.5])
    planner.set_goals([b])
    executor = Executor(small_map.robot, planner, a, 0.01)

    def frame(capsule, toward):
        points = odm.sample_capsules(np.array([capsule]), 0.03)
        commit = executor.commit()
        answer = planner.step(points, q=commit.q)
        threat = Threat(np.array([toward]), 0.0, ThreatSettings())
        executor.heed(answer, commit, threat)
        stop = executor.motion.stop(executor.t)
        executor.advance()
        return answer, stop, points

    return frame, executor


def far_capsule(x):
    return [x, -0.4, 0.9, x, 0.4, 0.9, 0.05]


def test_someone_far_away_does_not_slow_it(at_work):
    frame, executor = at_work
    states = {frame(far_capsule(5.0), 2.0) and executor.state for _ in range(60)}
    assert states == {MOVING}


def test_who_comes_near_slows_it_more_than_who_stands(small_map):
    slowest = {}
    for toward in (0.0, 2.0):
        frame, executor = _at_work(small_map)
        speeds, reasons = [], set()
        for _ in range(160):
            frame(far_capsule(0.7), toward)
            speeds.append(executor.motion.speed(executor.t))
            reasons.add(executor.reason)
        slowest[toward] = min(speeds[60:])
        if toward:
            assert any("nearer" in reason for reason in reasons)
    assert slowest[2.0] < 0.7 * slowest[0.0]


def test_the_stop_it_holds_is_free_of_the_points_in_every_frame(at_work):
    frame, executor = at_work
    moved = 0
    for k in range(120):
        answer, stop, _ = frame(far_capsule(1.0 - 0.004 * k), 0.4)
        moved += executor.motion.speed(executor.t) > 0.05
        if answer.status != "holding":
            assert executor.planner.blocked_leg(stop.path_from(0.0)) is None
    assert moved > 20


def test_a_part_that_goes_away_is_less_of_a_threat_than_one_that_comes():
    centers = np.zeros((1, 3))
    reach = {}
    for name, step in (("comes", -0.01), ("rests", 0.0), ("goes", 0.01)):
        watcher = Watcher()
        for k in range(2):
            x = 0.6 + k * step
            arm = np.array([[x, 0.0, 0.0, x + 0.3, 0.0, 0.0, 0.05]])
            threat = watcher.look(arm, centers, 0.01 * k)
        reach[name] = threat.reach(0.1)
    s = ThreatSettings()
    assert reach["comes"] > reach["rests"] + 0.05
    assert reach["goes"] == pytest.approx(reach["rests"])
    assert reach["rests"] == pytest.approx(0.5 * s.acceleration * 0.01)
    assert reach["comes"] <= s.speed * 0.1


def test_nobody_near_is_no_threat_and_an_unknown_speed_is_the_worst():
    centers = np.zeros((1, 3))
    far = np.array([[3.0, 0, 0, 3.3, 0, 0, 0.05]])
    near = far - [2.5, 0, 0, 2.5, 0, 0, 0]
    assert Watcher().look(far, centers, 0.0).reach(0.2) == 0.0
    assert Watcher().look(near, centers, 0.0).reach(0.2) == pytest.approx(0.4)
    assert Watcher().look(np.zeros((0, 7)), centers, 0.0).reach(0.2) == 0.0


def test_an_unknown_execution_is_refused():
    with pytest.raises(BadInput, match="kinematic, timed"):
        replace(TIMED, execution="fast")
