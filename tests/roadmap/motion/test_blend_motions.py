"""Motions over blends: chords of what is left, limits, stops on them, and joins."""

from dataclasses import replace

import numpy as np
import pytest
from corners import ROBOTS, check_limits, draw_corner, legs_at

import roadmap
from roadmap.kinematics.forward import sphere_centers
from roadmap.motion.blending import BLEND_DEVIATION, blend_path


@pytest.fixture(params=ROBOTS)
def robot(request):
    """Return one robot after the other."""
    return request.getfixturevalue(request.param)


def test_chords_of_any_part_of_a_blend_are_nearer_to_it_than_the_corner_path(
    robot, rng
):
    for _ in range(15):
        q, u, w = draw_corner(robot, rng, True)
        pieces, stray = blend_path(robot, legs_at(q, u, w), 0.02)
        for piece in (p for p in pieces if p.d > 0.0):
            a, b = np.sort(rng.random(2)) if rng.random() < 0.7 else (0.0, 1.0)
            ends = piece.begin + 2.0 * piece.d * np.array([a, 0.5 * (a + b), b])
            for begin, end in zip(ends, ends[1:], strict=False):
                first, last = piece.at(begin)[0], piece.at(end)[0]
                for t in np.linspace(0.0, 1.0, 21):
                    on = piece.at(begin + t * (end - begin))[0]
                    chord = first + t * (last - first)
                    moved = sphere_centers(robot, on) - sphere_centers(robot, chord)
                    assert np.linalg.norm(moved, axis=1).max() <= stray + 1e-9


def chord_weight(a, b, x):
    """How far a chord over [a, b] is from the blend, weighed as the corner path is."""

    def curve(y):  # in w - u, beside the straight line through the first leg
        return 2.0 * y**3 * (1.0 - 0.5 * y)

    chord = curve(a) + (x - a) / max(b - a, 1e-12) * (curve(b) - curve(a))
    return np.abs(chord - curve(x)) * (1.0 + 8.0 / 3.0 * np.abs(1.0 - 2.0 * x))


def test_the_weighed_distance_of_chords_is_less_than_that_of_the_corner_path():
    # a part of a blend stands as two chords, so that none is longer than half of it
    for a in np.linspace(0.0, 1.0, 41):
        for b in np.linspace(a, min(1.0, a + 0.5), 21):
            x = np.linspace(a, b, 101)
            assert chord_weight(a, b, x).max() < 0.9 * BLEND_DEVIATION


def test_all_limits_hold_on_longer_blends_and_through_joins(robot, rng):
    middle, half = 0.5 * (robot.upper + robot.lower), 0.3 * (robot.upper - robot.lower)

    def draw(n, first=None):
        path = middle + half * rng.uniform(-1, 1, (n, robot.dof))
        return path if first is None else np.vstack([first, path])

    for _ in range(5):
        motion = roadmap.time_path(robot, draw(5), blend=0.01)
        for _ in range(3):
            check_limits(robot, motion)
            assert motion.deviation <= 0.01 + 1e-12
            t = rng.uniform(0.0, 0.8 * motion.duration)
            commit = motion.commit(t, 0.05)
            motion = motion.join(t, commit, draw(3, commit.q), blend=0.01)


@pytest.mark.parametrize("jerk", [15.0, 500.0])
def test_stops_on_blends_brake_harder_and_keep_all_limits(robot, rng, jerk):
    quick = 7.0 * robot.max_velocity
    robot = replace(robot, max_acceleration=quick, max_jerk=jerk * quick)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.3 * (robot.upper - robot.lower)
    harder = 0
    for _ in range(8):
        legs = rng.uniform(-1, 1, robot.dof) + rng.uniform(-1, 1, (5, robot.dof))
        path = middle + 0.1 * half * np.cumsum(legs, axis=0)
        scale = rng.uniform(0.1, 1.0)
        motion = roadmap.time_path(robot, path, blend=0.01, speed_scale=scale)
        for t in rng.choice(_times_on_blends(motion), 6):
            stop = motion.stop(t)
            check_limits(robot, stop)
            way = stop.path
            for phase in stop.profile.phases:
                k = way.index(phase.s)
                harder += -phase.a > 1.05 * way.a[k] and way.pieces[k].d > 0.0
            # taken back before it stands, and left for another path
            on = stop.rescaled(rng.uniform(0.0, stop.duration), scale)
            check_limits(robot, on)
            assert np.allclose(on.q_end, motion.q_end)
            t = rng.uniform(0.0, stop.duration)
            commit = stop.commit(t, 0.02)
            new = middle + half * rng.uniform(-1, 1, (2, robot.dof))
            check_limits(robot, stop.join(t, commit, np.vstack([commit.q, new])))
    assert harder > 5


def _times_on_blends(motion):
    way, times = motion.path, np.linspace(0.0, motion.duration, 200)
    return [t for t in times if way.pieces[way.index(motion.place(t))].d > 0.0]


def test_a_motion_may_be_left_behind_its_blends_and_goes_straight_on(panda, rng):
    through = 0
    for _ in range(8):
        path = rng.uniform(-1.0, 1.0, (4, 7)) + [0, 0, 0, -1.5, 0, 1.5, 0]
        motion = roadmap.time_path(panda, path, blend=0.01, speed_scale=0.5)
        for t in np.linspace(0.0, motion.duration, 40):
            stands = motion.commit(t, 0.05).s
            commit = motion.commit(t, 0.05, through_blends=True)
            piece = motion.path.pieces[motion.path.index(commit.s)]
            assert piece.d == 0.0 or commit.s >= piece.end - 1e-9
            if commit.s <= stands + 1e-6:
                continue
            through += 1
            ahead = [
                p.corner()
                for p in motion.path.pieces
                if p.d > 0.0 and p.begin >= commit.s - 1e-9
            ]
            rest = np.vstack([commit.q, *ahead, path[-1]])
            joined = motion.join(t, commit, rest, blend=0.01, speed_scale=0.5)
            assert joined.duration < 1.02 * (motion.duration - t) + 0.01
            assert not joined.path.stops[1:-1].any()  # it stops nowhere
    assert through > 5
