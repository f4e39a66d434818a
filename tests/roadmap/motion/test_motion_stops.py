"""Motions that are changed every few milliseconds: never back, and quick to stop."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import roadmap
from roadmap.motion import stopping
from roadmap.motion.retiming import timed
from roadmap.motion.timing import NoProfile, ProfileBuilder, State, after

PERIOD = 0.01
DATA = Path(__file__).resolve().parents[2] / "data"


def without_stops(robot):
    """The robot with position limits that no path here meets."""
    return replace(robot, lower=robot.lower - 9.0, upper=robot.upper + 9.0)


def crooked_path(robot, rng, corners):
    """A path of many short legs, as a planner's is while it is being smoothed."""
    start = 0.6 * rng.uniform(robot.lower, robot.upper)
    legs = rng.uniform(-0.3, 0.3, (corners - 1, robot.dof))
    legs *= rng.choice([0.02, 0.3, 1.0], (corners - 1, 1))
    return start + np.vstack([np.zeros(robot.dof), np.cumsum(legs, axis=0)])


def changed_each_frame(robot, rng, frames=60):
    """Yield motions, each made of the one before a frame later."""
    path = crooked_path(robot, rng, 12)
    motion = roadmap.time_path(without_stops(robot), path, blend=0.004)
    level = 1.0
    for _ in range(frames):
        yield motion
        t = min(PERIOD, motion.duration)
        if rng.random() < 0.5:
            commit = motion.commit(t, 0.05)
            path = crooked_path(robot, rng, 9)
            path += commit.q - path[0]
            motion = motion.join(t, commit, path, blend=0.004, speed_scale=level)
        else:
            level = float(rng.choice([1.0, 0.6, 0.36]))
            motion = motion.rescaled(t, level)


@pytest.mark.parametrize("seed", range(6))
def test_no_motion_ever_goes_back(panda, seed):
    rng = np.random.default_rng(seed)
    for motion in changed_each_frame(panda, rng):
        stop = motion.stop(min(PERIOD, motion.duration))
        for one in (motion, stop):
            phases = one.profile.phases
            ends = [*(phase.t for phase in phases[1:]), one.duration]
            for phase, end in zip(phases, ends, strict=True):
                times = np.linspace(0.0, end - phase.t, 5)
                speeds = [after(phase, dt).v for dt in times]
                assert min(speeds) > -1e-6
            assert phases == () or phases[-1].s <= one.length + 1e-6


def test_a_stop_leads_no_farther_than_to_the_next_rest_on_the_way():
    """A motion that could only be slowed down by a stop goes on from there."""
    arm = without_stops(roadmap.load_robot(str(DATA / "arm3.urdf"), tip="tool"))
    rng, looked = np.random.default_rng(0), 0
    for _ in range(60):
        motion = roadmap.time_path(arm, crooked_path(arm, rng, 9), blend=0.004)
        path, profile = motion.path, motion.profile
        for t in rng.uniform(0.0, motion.duration, 6):
            begin = min(t + 0.05, profile.duration)
            rest = stopping.stop_later(path, profile, t, begin)
            if rest.end > motion.length - 1e-6:
                continue
            on = rest.then(timed(path, State(rest.end, 0.0, 0.0), 0.5))
            for later in (0.0, 0.01, 0.03):
                stop = stopping.quickest_stop(path, on, later)
                assert later + stop.duration < rest.duration + 1e-5
                assert stop.state(stop.duration) == (stop.end, 0.0, 0.0)
                looked += 1
    assert looked > 500


def bent_path(robot, rng, corners):
    """A long way with small bends, through which it goes at full speed."""
    along = rng.uniform(-0.2, 0.2, robot.dof)
    legs = along + rng.uniform(-0.01, 0.01, (corners - 1, robot.dof))
    return np.vstack([np.zeros(robot.dof), np.cumsum(legs, axis=0)])


def test_a_stop_is_within_limits_where_it_leads_over_blends(panda, rng, monkeypatch):
    shorter = 0
    quick = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
    panda = replace(panda, max_acceleration=quick, max_jerk=500.0 * quick)
    panda = without_stops(panda)
    for _ in range(12):
        motion = roadmap.time_path(panda, bent_path(panda, rng, 8), blend=0.004)
        for t in rng.uniform(0.0, motion.duration, 5):
            stop = motion.stop(t)
            with monkeypatch.context() as patch:
                patch.setattr(stopping, "_OVER", 0)
                late = motion.stop(t)
            assert stop.duration <= late.duration + 1e-9
            shorter += stop.duration < 0.8 * late.duration
            points = stop.sample(np.arange(0.0, stop.duration, 1e-3))
            assert (np.abs(points.dq) <= 1.000001 * panda.max_velocity).all()
            assert (np.abs(points.ddq) <= 1.000001 * panda.max_acceleration).all()
            jerk = np.abs(np.diff(points.ddq, axis=0)) / 1e-3
            assert (jerk <= 1.001 * panda.max_jerk + 1e-6).all()
    assert shorter > 5


def test_pieces_of_a_way_leave_no_gap(panda, rng):
    for motion in changed_each_frame(panda, rng, 30):
        pieces = motion.path.pieces
        for piece, later in zip(pieces, pieces[1:], strict=False):
            assert piece.end == later.begin


def test_a_stop_in_closed_form_is_the_one_that_ruckig_finds(rng):
    closed = 0
    for _ in range(2000):
        v, a_most, j = rng.uniform(0, 3), rng.uniform(0.2, 8), rng.uniform(2, 400)
        state = State(rng.uniform(-5, 5), v, rng.uniform(-1.1, 1.1) * a_most)
        mine, ruckigs = ProfileBuilder(state), ProfileBuilder(state)
        try:
            ruckigs.to_speed(0.0, a_most, j)
        except NoProfile:
            with pytest.raises(NoProfile):
                mine.to_rest(a_most, j)
            continue
        mine.to_rest(a_most, j)
        closed += mine._otg is None
        assert mine.t == pytest.approx(ruckigs.t, abs=1e-9)
        assert mine.state.s == pytest.approx(ruckigs.state.s, abs=1e-8)
        assert mine.state[1:] == (0.0, 0.0)
        ends = [p.t for p in mine.phases[1:]] + [mine.t]
        for k, (phase, end) in enumerate(zip(mine.phases, ends, strict=True)):
            there = after(phase, end - phase.t)
            if k + 1 < len(mine.phases):
                later = mine.phases[k + 1]
                assert there == pytest.approx(later[1:4], abs=1e-12)
            else:
                assert there == pytest.approx(mine.state, abs=1e-9)
            assert abs(phase.j) <= j and there.a >= -a_most - 1e-9
    assert closed > 800


def test_there_is_a_profile_as_far_as_the_limits_just_so_lead(rng):
    """Between two kinds of profiles ruckig knows none, and raises its own error."""
    for _ in range(500):
        a, share = rng.uniform(0.5, 20.0), rng.uniform(2.0, 20.0)
        j, s = share * a, 2.0 * a / share**2
        builder = ProfileBuilder(State(0.0, 0.0, 0.0))
        builder.to_place(s, 0.0, 10.0, a, j)
        assert builder.state == State(s, 0.0, 0.0)
        quickest = 4.0 * a / j  # up, down, down, up: each as long as a needs
        assert builder.t == pytest.approx(quickest, rel=1e-5)
