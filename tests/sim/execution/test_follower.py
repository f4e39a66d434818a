"""Following a path within the joints' speed limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from odm.execution.kinematic import Follower

corner = st.tuples(st.floats(-2, 2), st.floats(-2, 2))
corners = st.lists(corner, min_size=1, max_size=6)


@settings(deadline=None, max_examples=60)
@given(corners, st.floats(0.001, 0.5), st.floats(0.1, 1.0))
def test_no_joint_is_ever_faster_than_its_limit(crane, path, dt, scale):
    follower = Follower(crane, scale)
    q = np.zeros(2)
    after = follower.advance(q, np.array(path), dt)
    assert (np.abs(after - q) <= scale * crane.max_velocity * dt * (1 + 1e-9)).all()


def test_it_stays_on_the_path_and_turns_its_corners(crane):
    path = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]])
    follower, q, seen = Follower(crane), path[0], []
    for _ in range(120):
        rest = path[1:] if q[1] == 0.0 and q[0] < 0.5 else path[2:]
        q = follower.advance(q, np.vstack([q, rest]), 0.01)
        seen.append(q)
    seen = np.array(seen)
    assert (np.minimum(np.abs(seen[:, 1]), np.abs(seen[:, 0] - 0.5)) < 1e-9).all()
    np.testing.assert_array_equal(seen[-1], path[-1])


def test_two_half_periods_go_as_far_as_a_whole_one(crane):
    path = np.array([[0.0, 0.0], [0.3, 0.1], [0.2, -0.4], [1.0, 0.0]])
    follower = Follower(crane, 0.7)
    half = follower.advance(path[0], path[:2], 0.1)
    whole = follower.advance(path[0], path[:2], 0.2)
    again = follower.advance(half, np.vstack([half, path[1:2]]), 0.1)
    np.testing.assert_allclose(again, whole, atol=1e-12)


def test_the_fastest_joint_uses_its_whole_limit(crane):
    after = Follower(crane).advance(np.zeros(2), np.array([[0.1, 1.0]]), 0.1)
    assert np.max(np.abs(after) / crane.max_velocity) == pytest.approx(0.1)


def test_at_the_end_it_stands_exactly_at_the_last_corner(crane):
    goal = np.array([0.1, -0.1])
    after = Follower(crane).advance(np.zeros(2), goal[None], 10.0)
    assert after.tobytes() == goal.tobytes()
    assert after is not goal
