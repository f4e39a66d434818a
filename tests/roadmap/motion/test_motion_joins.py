"""A path that goes on over the same corners is joined behind them, without a stop."""

import numpy as np
import pytest
from moving import DT, check_limits, draw_path

import roadmap

BLEND = 0.01


def drawn(panda, rng, corners=6):
    path = draw_path(panda, rng, corners, size=0.5)
    return path, roadmap.time_path(panda, path, blend=BLEND)


def corners_ahead(motion, commit, path):
    """The corners of the path that are still ahead of a commit point."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return path[np.r_[0.0, lengths.cumsum()] > commit.s + 1e-9]


def sampled(motion, t=0.0, end=np.inf):
    return motion.sample(np.arange(t, min(motion.duration, end) + 2 * DT, DT))


def test_the_same_path_changes_nothing(panda, rng):
    for _ in range(8):
        path, motion = drawn(panda, rng)
        t = rng.uniform(0.0, 0.7) * motion.duration
        commit = motion.commit(t, 0.05)
        rest = np.vstack([commit.q[None], corners_ahead(motion, commit, path)])
        joined = motion.join(t, commit, rest, blend=BLEND)
        # it is timed anew from an acceleration, which takes it out first
        assert joined.duration == pytest.approx(motion.duration - t, abs=0.05)
        assert joined.path is motion.path


def test_a_change_far_ahead_slows_nothing_before_it(panda, rng):
    compared = 0
    for _ in range(8):
        path, motion = drawn(panda, rng)
        t = rng.uniform(0.0, 0.2) * motion.duration
        commit = motion.commit(t, 0.05)
        ahead = corners_ahead(motion, commit, path)
        other = 0.5 * (ahead[-1] + draw_path(panda, rng, 1)[0])
        changed = np.vstack([commit.q[None], ahead[:-1], other[None]])
        joined = motion.join(t, commit, changed, blend=BLEND)
        check_limits(panda, sampled(joined))
        assert np.allclose(joined.q_end, other)
        # up to the leg that leads to the last common corner it is as quick as before
        s = np.linalg.norm(np.diff(path[:-2], axis=0), axis=1).sum() - 0.1
        if s > commit.s:
            took = [reached(joined, 0.0, s), reached(motion, t, s)]
            assert took[0] == pytest.approx(took[1], abs=0.05)
            compared += 1
    assert compared >= 4


def reached(motion, t, s):
    """The time after t at which a motion is at arc length s."""
    times = np.arange(t, motion.duration, DT)
    return next(k - t for k in times if motion.place(k) >= s)


def test_a_commit_point_is_never_on_a_blend(panda, rng):
    rounded = 0
    for _ in range(20):
        _, motion = drawn(panda, rng)
        t = rng.uniform(0.0, 0.8) * motion.duration
        plain = motion.commit(t, 0.05)
        commit = motion.commit(t, 0.05, through_blends=True)
        assert commit.s >= plain.s
        piece = motion.path.pieces[motion.path.index(commit.s - 1e-9)]
        assert piece.d == 0.0 or commit.s == motion.length
        if commit.s == motion.length:
            continue
        # a corner of sixty degrees there is passed, not stopped at
        turn = rng.standard_normal(panda.dof)
        turn -= (turn @ piece.u) * piece.u
        w = 0.5 * piece.u + np.sqrt(0.75) * turn / np.linalg.norm(turn)
        joined = motion.join(
            t, commit, np.vstack([commit.q, commit.q + 0.3 * w]), blend=BLEND
        )
        check_limits(panda, sampled(joined))
        times = np.arange(0.0, joined.duration, DT)
        near = [k for k in times if abs(joined.place(k) - commit.s) < 0.01]
        rounded += min(joined.speed(k) for k in near) > 0.01
    assert rounded >= 8


@pytest.mark.parametrize("seed", range(6))
def test_limits_hold_through_joins_over_common_corners_and_stops(panda, seed):
    rng = np.random.default_rng(seed)
    path, motion = drawn(panda, rng, 7)
    for _ in range(12):
        t = rng.uniform(0.0, 0.15) * max(motion.duration, 0.1)
        if rng.random() < 0.3:
            motion, t = motion.stop(t), 0.01
        begin = motion.at(t)
        through = bool(rng.random() < 0.7)
        commit = motion.commit(t, 0.05, through_blends=through)
        turns = [turn.q for turn in motion.path.corners if turn.s > commit.s + 1e-7]
        keep = turns[: rng.integers(0, len(turns) + 1)]
        new = draw_path(panda, rng, int(rng.integers(0, 3)), size=0.5)
        rest = np.vstack([commit.q[None], *[q[None] for q in keep], new])
        motion = motion.join(
            t, commit, rest, blend=BLEND, speed_scale=rng.uniform(0.2, 1.0)
        )
        points = sampled(motion)
        check_limits(panda, points)
        assert np.abs(points.q[0] - begin.q).max() < 1e-6
        assert np.abs(points.dq[0] - begin.dq).max() < 1e-5
        assert np.allclose(motion.q_end, rest[-1], atol=1e-6)
        assert motion.deviation <= BLEND + 1e-12


def test_a_sharp_corner_behind_a_blend_is_not_passed(panda):
    """A join there repeated the old profile up to it, and went on at that speed."""
    joined, rng = 0, np.random.default_rng(3)
    middle = 0.5 * (panda.lower + panda.upper)
    for _ in range(12):
        first = towards(rng, panda.dof)
        second = towards(rng, panda.dof, first, 0.05)
        third = towards(rng, panda.dof, second, 0.6)
        legs = -0.8 * first, 0.0 * first, 0.3 * second, 0.3 * second + 0.5 * third
        motion = roadmap.time_path(panda, middle + np.array(legs), blend=0.004)
        for t in np.linspace(0.1, 0.9, 24) * motion.duration:
            commit = motion.commit(t, through_blends=True)
            if motion.path.pieces[motion.path.index(motion.place(t))].d == 0.0:
                continue
            off = np.vstack([commit.q, commit.q + 0.4 * towards(rng, panda.dof)])
            check_limits(panda, sampled(motion.join(t, commit, off, blend=0.004)))
            joined += 1
    assert joined >= 40


def towards(rng, dof, near=0.0, off=1.0):
    """A direction (dof,), that of another one but for a share."""
    turn = rng.standard_normal(dof)
    u = near + off * turn / np.linalg.norm(turn)
    return u / np.linalg.norm(u)


def test_of_two_corners_that_nearly_are_one_both_may_be_on_the_way(panda, rng):
    """A robot on the second's blend was to go on over a corner that it had begun."""
    on_both = 0
    for _ in range(20):
        path = draw_path(panda, rng, 3, size=0.4)
        motion = roadmap.time_path(panda, path, blend=0.05, speed_scale=0.05)
        corner = motion.path.corners[0]
        t = _when(motion, corner.begin + 0.1 * (corner.s - corner.begin))
        commit = motion.commit(t)
        beside = path[1] + 2e-5 * rng.uniform(-1.0, 1.0, panda.dof)
        ahead = beside + 0.4 * rng.uniform(-1.0, 1.0, (2, panda.dof))
        rest = np.vstack([commit.q, beside, ahead])
        motion = motion.join(t, commit, rest, blend=0.05)
        at = [k for k, c in enumerate(motion.path.corners) if near(c.q, beside, 1e-7)]
        if not at:
            continue
        corner = motion.path.corners[at[0]]
        t = _when(motion, corner.begin + 0.3 * (corner.s - corner.begin))
        commit = motion.commit(t)
        begun = [c for c in motion.path.corners if c.begin < commit.s < c.s]
        on_both += len(begun) == 2
        rest = np.vstack([commit.q, beside, ahead + 0.05])
        joined = motion.join(t, commit, rest, blend=0.05)
        check_limits(panda, sampled(joined))
        assert np.allclose(joined.q_end, rest[-1], atol=1e-6)
    assert on_both >= 5


def near(a, b, most):
    return np.abs(a - b).max() <= most


def _when(motion, s):
    """The time at which a motion is at arc length s [s]."""
    return min(motion.duration, reached(motion, 0.0, min(s, motion.length - 1e-6)))
