"""A robot that has to stand times the same motion once, and gets the same answers."""

import numpy as np
import pytest

from odm.execution.timed_before import TimedBefore
from roadmap.motion.motion import time_path

START, MIDDLE, END = np.array([[0.0, 0.6, 0.0], [0.5, 0.3, 0.1], [0.9, 0.2, -0.3]])
OTHER = np.array([0.4, 0.9, 0.2])


@pytest.fixture
def stood(small_map):
    """A motion that is over, at START."""
    path = np.stack([START + 0.2, START])
    return time_path(small_map.robot, path, speed_scale=0.5)


def told(motion, t, path, scale=0.5):
    """Return what `join` is asked."""
    commit = motion.commit(t, 0.05, through_blends=True)
    return motion, t, commit, path, 0.004, scale


def bytes_of(motion):
    times = np.linspace(0.0, motion.duration, 50)
    return b"".join(rows.tobytes() for rows in motion.sample(times))


def test_what_is_over_is_left_in_the_same_way_whenever_that_is_asked(stood):
    path, timed = np.stack([START, MIDDLE, END]), TimedBefore()
    first = timed.join(*told(stood, stood.duration, path))
    for later in (0.01, 0.02, 3.0):
        t = stood.duration + later
        assert timed.join(*told(stood, t, path.copy())) is first
        fresh = stood.join(
            t, told(stood, t, path)[2], path, blend=0.004, speed_scale=0.5
        )
        assert bytes_of(fresh) == bytes_of(first) and fresh.duration == first.duration


def test_another_path_speed_or_motion_is_timed_anew(small_map, stood):
    path, timed, t = np.stack([START, MIDDLE, END]), TimedBefore(), stood.duration
    first = timed.join(*told(stood, t, path))
    other = path.copy()
    other[1] = OTHER
    changed = timed.join(*told(stood, t, other))
    assert np.abs(changed.path_from()[1:-1] - OTHER).max(axis=1).min() < 0.05
    slow = timed.join(*told(stood, t, other, 0.2))
    assert slow.duration > changed.duration
    again = time_path(small_map.robot, np.stack([START - 0.1, START]), speed_scale=0.5)
    assert timed.join(*told(again, again.duration, other)) is not changed
    assert timed.join(*told(stood, t, path[:2])).length < first.length


def test_who_moves_is_timed_in_every_frame(stood):
    path, timed = np.stack([START, MIDDLE, END]), TimedBefore()
    t = 0.5 * stood.duration
    commit = stood.commit(t, 0.0)
    path = np.stack([commit.q, MIDDLE, END])
    one = timed.join(stood, t, commit, path, 0.004, 0.5)
    assert timed.join(stood, t, commit, path, 0.004, 0.5) is not one


def test_the_same_rest_at_the_same_speed_is_timed_once(stood):
    timed, t = TimedBefore(), 0.3 * stood.duration
    one = timed.rescaled(stood, t, 0.2)
    assert timed.rescaled(stood, t, 0.2) is one
    assert bytes_of(one) == bytes_of(stood.rescaled(t, 0.2))
    assert timed.rescaled(stood, t, 0.1).duration > one.duration
    assert timed.rescaled(stood, t + 0.01, 0.1).length <= one.length + 1e-9
    assert timed.rescaled(one, t, 0.1) is not one
