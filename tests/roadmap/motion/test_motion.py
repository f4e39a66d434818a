"""Motions keep every limit at every time, through stops, rescaling and joins."""

import threading
import time

import numpy as np
import pytest
from moving import DT, check_limits, draw_path
from rows import each
from wrappers import with_wrapper

import roadmap
from roadmap.errors import BadInput
from roadmap.kinematics.forward import sphere_centers
from roadmap.motion._timing import length_to_change
from roadmap.motion.blending import joint_motion_bounds
from roadmap.motion.motion import Motion

length_to_change = with_wrapper(length_to_change)


def sampled(motion):
    return motion.sample(np.arange(0.0, motion.duration + 2 * DT, DT))


@pytest.mark.parametrize("time", [-1.0, np.nan, "1", None, np.arange(3.0)])
def test_a_set_point_has_one_time_that_is_a_number(panda, rng, time):
    motion = roadmap.time_path(panda, draw_path(panda, rng, 2))
    with pytest.raises(BadInput, match="no set-point at .*; ask from 0 s on"):
        motion.at(time)


@pytest.mark.parametrize("blend", [0.0, 0.002, 0.02])
def test_samples_are_the_bytes_of_one_time_after_the_other(panda, rng, blend):
    for corners in (1, 2, 5, 5):
        motion = roadmap.time_path(panda, draw_path(panda, rng, corners), blend=blend)
        for one in (motion, motion.stop(0.4 * motion.duration)):
            times = np.r_[0.0, rng.uniform(0.0, 1.1 * one.duration + 0.1, 200)]
            for k, rows in enumerate(one.sample(times)):
                one_by_one = np.array([one.at(t)[k] for t in times])
                assert rows.shape == (201, panda.dof)
                assert rows.tobytes() == one_by_one.tobytes()
            for wrong in (-1.0, np.nan):
                with pytest.raises(BadInput, match="no set-point at"):
                    one.sample([0.1, wrong])


@pytest.mark.parametrize("blend", [0.0, 0.002, 0.02])
@pytest.mark.parametrize("corners", [2, 3, 6])
def test_a_timed_path_keeps_all_limits_and_ends_at_rest(panda, rng, corners, blend):
    for _ in range(4):
        path = draw_path(panda, rng, corners)
        motion = roadmap.time_path(panda, path, blend=blend)
        points = sampled(motion)
        check_limits(panda, points)
        assert np.allclose(points.q[0], path[0]) and np.allclose(points.q[-1], path[-1])
        for rows in (points.dq, points.ddq):
            assert np.abs(rows[[0, -1]]).max() < 1e-6


def test_a_gentler_motion_keeps_its_share_of_the_jerk_and_its_stops_use_all(panda, rng):
    for _ in range(3):
        path = draw_path(panda, rng, 4)
        motion = roadmap.time_path(panda, path, blend=0.01)
        gentle = motion.gentler(0.0, 0.02)
        soft = _with_limits(panda, np.array([[1.0], [1.0], [0.02]]))
        check_limits(soft, sampled(gentle))
        assert gentle.jerk_scale == 0.02 and gentle.duration > motion.duration
        assert np.allclose(gentle.q_end, path[-1])
        stop = gentle.stop(0.4 * gentle.duration)
        check_limits(panda, sampled(stop))
        jerk = np.abs(np.diff(sampled(stop).ddq, axis=0)) / DT / panda.max_jerk
        assert jerk.max() > 0.1 and stop.jerk_scale == 1.0
        late = motion.gentler(0.1 * motion.duration, 0.5)
        if late is not None:
            for a, b in zip(
                late.at(0.0), motion.at(0.1 * motion.duration), strict=True
            ):
                assert np.allclose(a, b, atol=1e-6)


def test_a_motion_that_is_about_to_stop_cannot_be_gentler(panda, rng):
    motion = roadmap.time_path(panda, draw_path(panda, rng, 2))
    t = motion.duration - 0.02
    assert motion.profile.state(t).a < 0.0 and motion.gentler(t, 0.01) is None
    with pytest.raises(BadInput, match="jerk scale of 0"):
        motion.gentler(t, 0.0)


def test_short_legs_and_limits_of_any_size_are_kept(panda, rng):
    for _ in range(15):
        scaled = _with_limits(panda, rng.uniform(0.05, 3.0, (3, panda.dof)))
        path = draw_path(panda, rng, 5, size=rng.choice([1e-4, 0.01, 0.3]))
        check_limits(scaled, sampled(roadmap.time_path(scaled, path, blend=0.01)))


def test_corners_beside_one_another_count_as_one(panda, rng):
    soft = _with_limits(panda, (1.0, 1.0, 0.01))
    for size in rng.uniform(3e-9, 3e-8, 20):
        a, b = draw_path(panda, rng, 2)
        along = (b - a) / np.linalg.norm(b - a) + 0.3 * rng.normal(size=(9, panda.dof))
        steps = np.cumsum(rng.uniform(0.3, 1.0, (9, 1)) * size * along, axis=0)
        for path in ([a, *(a + steps), b], [a, *(b - steps[::-1]), b]):
            motion = roadmap.time_path(soft, path)
            check_limits(soft, sampled(motion))
            assert np.allclose(motion.q_end, b, atol=1e-12)


def _with_limits(robot, factors):
    from dataclasses import replace

    names = ("max_velocity", "max_acceleration", "max_jerk")
    limits = {n: f * getattr(robot, n) for n, f in zip(names, factors, strict=True)}
    return replace(robot, **limits)


def test_blends_stay_near_the_corner_path_in_the_workspace(panda, rng):
    rounded = 0
    for _ in range(6):
        path = draw_path(panda, rng, 4, size=0.5)
        motion = roadmap.time_path(panda, path, blend=0.01)
        assert motion.deviation <= 0.01 + 1e-12
        along = np.concatenate(
            [np.linspace(a, b, 400) for a, b in zip(path, path[1:], strict=False)]
        )
        centers = np.array([sphere_centers(panda, q) for q in along])
        for q in sampled(motion).q[::25]:
            here = sphere_centers(panda, q)
            off = centers - here
            off2 = np.einsum("npi,npi->np", off, off).max(axis=1).min()
            assert np.sqrt(off2) <= motion.deviation + 2e-3  # the path is sampled
        rounded += motion.deviation > 1e-3
    assert rounded


def test_a_blended_path_is_no_slower_than_stopping_in_every_corner(panda, rng):
    for _ in range(8):
        path = draw_path(panda, rng, 5)
        stopping = roadmap.time_path(panda, path, blend=0.0).duration
        legs = [roadmap.time_path(panda, p).duration for p in _legs(path)]
        assert stopping <= 1.6 * sum(legs)  # one pair of limits for all legs
        assert roadmap.time_path(panda, path, blend=0.02).duration <= 1.2 * stopping


def _legs(path):
    return [path[k : k + 2] for k in range(len(path) - 1)]


def test_a_straight_way_takes_the_time_its_limits_allow(panda):
    path = np.array([np.zeros(7), [1.0, 0, 0, 0, 0, 0, 0]])
    path[:, 3] = -1.0
    motion = roadmap.time_path(panda, path)
    v, a, j = panda.max_velocity[0], panda.max_acceleration[0], panda.max_jerk[0]
    assert 2 * length_to_change(0.0, v, a, j) < 1.0  # it gets up to speed
    assert np.isclose(motion.duration, 1.0 / v + v / a + a / j)
    slow = roadmap.time_path(panda, path, speed_scale=0.25)
    assert np.abs(sampled(slow).dq).max() <= 0.25 * v + 1e-9


def test_a_stop_is_continuous_keeps_limits_and_stays_on_the_path(panda, rng):
    for _ in range(6):
        motion = roadmap.time_path(panda, draw_path(panda, rng, 4), blend=0.01)
        for t in rng.uniform(0.0, motion.duration, 6):
            stop = motion.stop(t)
            _same_state(motion.at(t), stop.at(0.0))
            points = sampled(stop)
            check_limits(panda, points)
            assert np.abs(points.dq[-1]).max() < 1e-6
            assert stop.duration <= motion.duration - t + 1e-6
            ways = motion.path_from(0.0)
            assert _distance_to(ways, stop.q_end) < 0.05


def _same_state(a, b):
    for x, y in zip(a, b, strict=True):
        assert np.allclose(x, y, atol=1e-6)


def _distance_to(corners, q):
    best = np.inf
    for a, b in zip(corners, corners[1:], strict=False):
        t = np.clip((q - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        best = min(best, np.linalg.norm(a + t * (b - a) - q))
    return best


def test_chains_of_changes_are_continuous_and_keep_all_limits(panda, rng):
    joins = 0
    for _ in range(16):
        motion = roadmap.time_path(panda, draw_path(panda, rng, 4), blend=0.01)
        for _ in range(8):
            t = rng.uniform(0.0, motion.duration)
            what = rng.integers(3)
            if what == 0:
                after = motion.stop(t)
            elif what == 1:
                after = motion.rescaled(t, rng.uniform(0.05, 1.0))
            else:
                commit = motion.commit(t, rng.uniform(0.0, 0.2))
                path = draw_path(panda, rng, 3)
                path[0] = commit.q
                after = motion.join(t, commit, path)
                assert np.allclose(after.q_end, path[-1])
                joins += motion.speed(t) > 0.1
            _same_state(motion.at(t), after.at(0.0))
            check_limits(panda, sampled(after))
            motion = after
    assert joins > 3


def test_another_speed_behind_a_sharp_corner_brings_no_stop(panda, rng):
    for _ in range(4):
        path = draw_path(panda, rng, 3)
        motion = roadmap.time_path(panda, path, blend=0.0)
        corner = motion.path.pieces[0].end
        times = np.arange(0.0, motion.duration, DT)
        speeds = np.array([motion.speed(t) for t in times])
        behind = np.array([motion.place(t) > corner for t in times])
        t = times[np.flatnonzero(behind)[speeds[behind].argmax()]]
        for scale in (0.5, 1.0):
            after = motion.rescaled(t, scale)
            least = min(after.speed(s) for s in np.arange(0.0, 0.1, DT))
            assert least > 0.4 * min(speeds[behind].max(), motion.speed(t))


def test_a_stopped_motion_can_go_on(panda, rng):
    motion = roadmap.time_path(panda, draw_path(panda, rng, 3))
    stop = motion.stop(0.4 * motion.duration)
    on = stop.rescaled(stop.duration, 1.0)
    assert np.allclose(on.q_end, motion.q_end)
    check_limits(panda, sampled(on))


def test_what_is_left_covers_the_way(panda, rng):
    motion = roadmap.time_path(panda, draw_path(panda, rng, 4), blend=0.02)
    for t in np.linspace(0.0, motion.duration, 12):
        corners = motion.path_from(t)
        sway = joint_motion_bounds(panda)
        for u in np.linspace(t, motion.duration, 60):
            q = motion.at(u).q
            off = (
                min(
                    (np.abs(q - p) @ sway)
                    for a, b in zip(corners, corners[1:], strict=False)
                    for p in np.linspace(a, b, 60)
                )
                if len(corners) > 1
                else np.abs(q - corners[0]) @ sway
            )
            assert off < motion.deviation + 0.1  # the corners are sampled coarsely


def test_the_same_input_gives_the_same_bytes(panda, rng):
    path = draw_path(panda, rng, 5)
    a, b = (sampled(roadmap.time_path(panda, path)) for _ in range(2))
    assert all(x.tobytes() == y.tobytes() for x, y in zip(a, b, strict=True))


def test_a_control_thread_reads_while_another_replaces_the_motion(panda, rng):
    path = draw_path(panda, rng, 3)
    box = [(0.0, roadmap.time_path(panda, path, speed_scale=0.3))]
    total, seen, done = box[0][1].duration, [], threading.Event()

    def control():
        while not done.is_set():
            begun, motion = box[0]
            seen.append((begun, motion, motion.at(0.05)))

    thread = threading.Thread(target=control)
    thread.start()
    for k in range(60):
        begun, motion = box[0]
        t = 0.01 * total
        box[0] = (begun + t, motion.rescaled(t, 0.2 + 0.1 * (k % 3)))
        while not seen or seen[-1][1] is not box[0][1]:
            time.sleep(1e-5)  # the other thread has a turn with each motion
    done.set()
    thread.join()
    assert len({id(m) for _, m, _ in seen}) > 50
    for _, motion, point in seen[:: max(1, len(seen) // 200)]:
        _same_state(point, motion.at(0.05))


def test_a_single_corner_stands(panda):
    q = 0.5 * (panda.lower + panda.upper)
    motion = roadmap.time_path(panda, q[None])
    assert motion.duration == 0.0
    assert np.array_equal(motion.at(3.0).q, q) and not motion.at(0.0).dq.any()
    assert isinstance(motion.stop(0.0), Motion)


@each(
    ("change", "word"),
    [
        ({"path": np.zeros((2, 3))}, "shape"),
        ({"path": np.zeros((0, 7))}, "shape"),
        ({"path": np.full((2, 7), np.nan)}, "finite"),
        ({"speed_scale": 0.0}, "share"),
        ({"speed_scale": 1.5}, "share"),
        ({"speed_scale": "half"}, "a speed scale of half is no share"),
        ({"blend": -0.1}, "blend"),
        ({"blend": np.inf}, "blend"),
        ({"blend": "5 mm"}, "a blend of 5 mm m is no bound"),
    ],
)
def test_bad_input_is_named(panda, change, word):
    path = change.pop("path", np.zeros((2, 7)))
    with pytest.raises(BadInput, match=word):
        roadmap.time_path(panda, path, **change)


@pytest.mark.parametrize("t", [-0.1, np.nan])
def test_a_time_before_the_start_is_refused_and_one_beyond_the_end_stands(panda, t):
    motion = roadmap.time_path(panda, np.array([np.zeros(7), np.full(7, -0.05)]))
    with pytest.raises(BadInput, match="0 s"):
        motion.at(t)
    assert np.array_equal(motion.at(1e9).q, motion.q_end)


def test_a_path_that_begins_elsewhere_is_refused(panda):
    motion = roadmap.time_path(panda, np.array([np.zeros(7), np.full(7, -0.05)]))
    with pytest.raises(BadInput, match="commit"):
        motion.join(0.0, motion.commit(0.0), -np.ones((2, 7)) * 0.08)


@pytest.mark.parametrize("row", [0, 2])
def test_a_corner_outside_the_limits_is_named_with_joint_value_and_limits(panda, row):
    path = np.tile(0.5 * (panda.lower + panda.upper), (3, 1))
    path[row, 2] += 9.0
    with pytest.raises(BadInput, match=f"corner {row}.*panda_joint3 = 9 rad.*2.96"):
        roadmap.time_path(panda, path)
    inside = np.delete(path, row, axis=0)
    motion = roadmap.time_path(panda, inside)
    with pytest.raises(BadInput, match="corner 1.*panda_joint3"):
        motion.join(0.0, motion.commit(0.0), np.array([motion.at(0.0).q, path[row]]))


def test_a_start_an_encoder_s_error_outside_is_tolerated_and_nan_is_not(panda):
    path = np.tile(0.5 * (panda.lower + panda.upper), (2, 1))
    path[0, 5] = panda.lower[5] - 9e-4
    assert roadmap.time_path(panda, path).duration > 0
    path[0, 5] = panda.lower[5] - 2e-3
    with pytest.raises(BadInput, match="panda_joint6"):
        roadmap.time_path(panda, path)
    path[0, 5] = np.nan
    with pytest.raises(BadInput, match="panda_joint6 = nan"):
        roadmap.time_path(panda, path)


def test_degrees_are_guessed(panda):
    path = np.tile(0.5 * (panda.lower + panda.upper), (2, 1))
    path[1, 0] = 45.0
    with pytest.raises(BadInput, match="degrees; give radians"):
        roadmap.time_path(panda, path)


def test_a_joint_without_end_may_be_anywhere(crane):
    free = np.flatnonzero(crane.continuous)[0]
    path = np.tile(0.5 * (crane.lower + crane.upper), (2, 1))
    path[:, free] += [50.0, 50.5]
    assert roadmap.time_path(crane, path).duration > 0
