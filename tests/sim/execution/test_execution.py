"""The timed execution: limits through every replan, a tested stop, calm for nobody."""

from dataclasses import replace

import numpy as np
import pytest

import odm
from odm.execution.executor import BRAKED, MOVING, Executor
from odm.execution.threat import Threat, ThreatSettings, Watcher
from roadmap.errors import BadInput
from sim.loop.loop import LoopSettings, run_loop

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

    def frame(capsule, velocity):
        capsule = np.array([capsule])
        person = odm.Obstacles(capsules=capsule)
        commit = executor.commit()
        answer = planner.step(person, q=commit.q)
        rates = np.tile(np.array(velocity, float), (1, 2, 1))
        threat = Threat(capsule, rates, np.zeros(1), 0.0, ThreatSettings())
        executor.update(answer, commit, threat)
        stop = executor.motion.stop(executor.t)
        executor.advance()
        return answer, stop, person

    return frame, executor


def far_capsule(x):
    return [x, -0.4, 0.9, x, 0.4, 0.9, 0.05]


AT_REST, COMES, GOES = (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)


def test_someone_far_away_does_not_slow_it(at_work):
    frame, executor = at_work
    states = {frame(far_capsule(5.0), COMES) and executor.state for _ in range(60)}
    assert states == {MOVING}


def slowest_beside(small_map, velocity):
    frame, executor = _at_work(small_map)
    speeds, reasons = [], set()
    for _ in range(160):
        frame(far_capsule(0.72), velocity)
        speeds.append(executor.motion.speed(executor.t))
        reasons.add(executor.reason)
    return min(speeds[60:]), reasons


def test_who_comes_near_slows_it_and_who_goes_away_does_not(small_map):
    comes, reasons = slowest_beside(small_map, COMES)
    rests, _ = slowest_beside(small_map, AT_REST)
    goes, _ = slowest_beside(small_map, GOES)
    assert any("the person can be in its way" in reason for reason in reasons)
    assert comes < 0.7 * rests
    assert goes >= rests


def test_the_stop_it_holds_is_free_of_the_points_in_every_frame(at_work):
    frame, executor = at_work
    moved = 0
    for k in range(120):
        answer, stop, _ = frame(far_capsule(1.0 - 0.004 * k), (-0.4, 0.0, 0.0))
        moved += executor.motion.speed(executor.t) > 0.05
        if answer.status != "holding":
            assert executor.planner.blocked_leg(stop.path_from(0.0)) is None
    assert moved > 20


def test_a_frame_that_does_not_come_makes_it_stop_and_the_next_one_go_on(at_work):
    frame, executor = at_work
    for _ in range(30):
        frame(far_capsule(5.0), AT_REST)
    assert executor.motion.speed(executor.t) > 0.3
    points = []
    for _ in range(60):  # the planner is late
        points.append(executor.set_point)
        executor.advance()
    assert executor.state == BRAKED and "in time" in executor.reason
    assert np.abs(executor.set_point.dq).max() < 1e-9
    jerk = np.abs(np.diff([p.ddq for p in points], axis=0)) / 0.01
    assert (jerk <= 1.001 * executor.robot.max_jerk).all()
    for _ in range(40):
        frame(far_capsule(5.0), AT_REST)
    assert executor.state == MOVING and executor.motion.speed(executor.t) > 0.3


def seen_thrice(velocity, spin=0.0):
    """Return an arm that moves on, and the threat of the third frame, 10 ms each."""
    arm = np.array([[0.6, 0.0, 0.0, 0.9, 0.0, 0.0, 0.05]])
    step = 0.01 * np.array([[*velocity, *velocity, 0.0]])
    step[0, 4] += 0.01 * spin
    moved = arm + 2 * step
    watcher = Watcher()
    for k, capsule in enumerate((arm, arm + step, moved)):
        threat = watcher.look(capsule, 0.01 * k)
    return moved, threat


@pytest.mark.parametrize("velocity", [(0.7, 0.0, 0.2), (-1.0, 0.5, 0.0)])
def test_a_part_is_expected_where_its_velocity_brings_it(velocity):
    moved, threat = seen_thrice(velocity)
    step = np.array([*velocity, *velocity, 0.0])
    rows = threat.between(0.1, 0.1)[0].capsules.copy()
    assert np.allclose(rows[:, :6], (moved + 0.1 * step)[:, :6])
    a, jerk = ThreatSettings().acceleration, ThreatSettings().jerk
    late = 0.5 * a * 0.01 * 0.1  # the velocity is the mean of the last 10 ms
    assert rows[0, 6] - 0.05 == pytest.approx(
        0.5 * a * 0.1**2 + jerk * 0.1**3 / 6.0 + late
    )
    middle = threat.between(0.0, 0.1)[0].capsules
    assert np.allclose(middle[:, :6], (moved + 0.05 * step)[:, :6])
    speed = np.linalg.norm(velocity)
    assert middle[0, 6] == pytest.approx(rows[0, 6] + 0.05 * speed)


def test_an_unknown_speed_is_the_worst():
    near = np.array([[0.5, 0, 0, 0.8, 0, 0, 0.05]])
    there, more = Watcher().look(near, 0.0).between(0.1, 0.2)
    assert more == 0.0 and there.capsules[0, 6] == pytest.approx(0.45)
    assert np.array_equal(there.capsules[:, :6], near[:, :6])


def test_an_unknown_execution_is_refused():
    with pytest.raises(BadInput, match="kinematic, timed"):
        replace(TIMED, execution="fast")
