"""A robot that rounds the corners of its way is on its way; one farther off is not."""

import numpy as np
import pytest
from forms import some
from small import HOME, NOBODY, on_its_way
from wrappers import with_wrapper

import odm
from odm.answer import FOLLOWING
from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.safety import Safety
from odm.frame.place import Standing, place_of
from odm.search import _off_path as off_path
from odm.search import _paths as paths
from odm.search import _step as step
from odm.search._state import ROUNDED
from roadmap import time_path
from roadmap.kinematics.forward import sphere_centers

is_off_path_known = with_wrapper(step.is_off_path_known)
locate_off_path = with_wrapper(off_path.locate_off_path)
connect_along_path = with_wrapper(step.connect_along_path)


def sum_off(planner, path, q):
    """How far q is off a path by the sum over joints [m]."""
    sway, best = planner.memory.robot_state.motion_bound, np.inf
    for a, b in zip(path, path[1:], strict=False):
        t = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = min(best, np.abs(a + t * (b - a) - q) @ sway)
    return best


def on_blends(planner, path, places=7):
    """Return the configurations on the blends of a path, as they are executed."""
    blend = planner.cell_map.safety.blending
    motion = time_path(planner.robot, path, blend=blend)
    assert motion.deviation <= blend * (1 + 1e-12)
    blends = [p for p in motion.path.pieces if p.d > 0.0]
    shares = np.linspace(0.0, 1.0, places)
    return [p.at(p.begin + x * p.length)[0] for p in blends for x in shares]


@pytest.mark.parametrize("seed", [0, 1, 2, 4])  # 3 comes to a straight motion
def test_a_robot_on_a_blend_goes_on_without_being_attached(small_map, seed):
    planner, points, answer = on_its_way(small_map, seed)
    planner.step(points, q=HOME)
    attached = []
    planner.attacher.attach_start = lambda *args, **kw: attached.append(args)
    for q in on_blends(planner, answer.path):
        assert planner.step(points, q=q).status == "following"
    assert not attached


def test_the_sum_over_joints_alone_would_not_know_it(small_map):
    """Else this file tests nothing."""
    beyond = 0
    for seed in range(4):
        planner, _, answer = on_its_way(small_map, seed)
        most = planner.memory.terms.path_tolerance[0]
        places = on_blends(planner, answer.path)
        beyond += sum(sum_off(planner, answer.path, q) > most for q in places)
    assert beyond > 3


@pytest.mark.parametrize("seed", range(4))
def test_what_is_located_may_go_on_to_both_ends_of_its_segment(small_map, seed):
    planner, _, _ = on_its_way(small_map, seed)
    robot, m = small_map.robot, planner.memory
    rng, most = np.random.default_rng(seed), planner.memory.terms.path_tolerance[0]
    located = told = 0
    for _ in range(300):
        k = rng.integers(m.path.count[0] - 1)
        on = m.path.q[k] + rng.random() * (m.path.q[k + 1] - m.path.q[k])
        off = rng.normal(size=robot.dof)
        q = on + rng.uniform(0.0, 0.05) * off / np.linalg.norm(off)
        told += paths.locate_on_path(m.table, m.path, 0, q, m.robot_state.fraction) >= 0
        at = int(locate_off_path(m.table, m.path, 0, q, m.robot_state.fraction))
        if at < 0:
            continue
        located += 1
        a, b = m.path.q[at], m.path.q[at + 1]
        foot = a + m.robot_state.fraction[0] * (b - a)
        for end in (a, b):
            for t in np.linspace(0.0, 1.0, 15):
                here = sphere_centers(robot, q + t * (end - q))
                there = sphere_centers(robot, foot + t * (end - foot))
                moved = np.linalg.norm(here - there, axis=1).max()
                assert moved <= most + 1e-9
    assert 20 < located < 280 and told >= located


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_farther_off_is_not_on_its_way(small_map, seed):
    planner, _, answer = on_its_way(small_map, seed)
    robot, m = small_map.robot, planner.memory
    rng, most = np.random.default_rng(seed), planner.memory.terms.path_tolerance[0]
    legs = zip(answer.path, answer.path[1:], strict=False)
    on = np.vstack([np.linspace(a, b, 200) for a, b in legs])
    centers = np.array([sphere_centers(robot, q) for q in on])
    refused = 0
    for _ in range(200):
        off = rng.normal(size=robot.dof)
        q = on[rng.integers(len(on))] + 0.05 * off / np.linalg.norm(off)
        moved = np.linalg.norm(centers - sphere_centers(robot, q), axis=2).max(axis=1)
        if moved.min() > most:
            assert (
                paths.locate_on_path(m.table, m.path, 0, q, m.robot_state.fraction) < 0
            )
            refused += 1
    assert refused > 20


def test_a_way_that_turns_back_or_stands_is_no_trouble(small_map):
    planner, points, answer = on_its_way(small_map, 0)
    way, m = planner.memory.path, planner.memory
    n = int(way.count[0])
    way.q[n], way.q[n + 1] = way.q[n - 2], way.q[n - 2]  # back, and on the spot
    way.count[0] = n + 2
    q = way.q[n - 1] + [0.0, 0.0, 0.002]
    for first in range(n + 1):
        at = int(locate_off_path(m.table, way, first, q, m.robot_state.fraction))
        assert -1 <= at <= n and np.isfinite(m.robot_state.fraction[0])


def there_is(static, point):
    """Let a point stand there, for the static test alone: no edge is closed."""
    static.set_place(place_of([Standing("it", point[None], point[None], NO_SOLIDS)]))


def _beside_a_blend(planner, path):
    """Return a place on a blend and a point that stands still inside its corner.

    The path keeps its clearance from the point, the blend does not: the robot is up to
    `safety.blending` off its path there.
    """
    static, safety = planner.static, planner.cell_map.safety
    robot = planner.robot
    legs = np.diff(path, axis=0)
    grown = robot.spheres[robot.moving, 3] + safety.rho + safety.m
    shares = np.linspace(0.0, 1.0, 60)[:, None]
    on_path = np.vstack([a + shares * d for a, d in zip(path, legs, strict=False)])
    there = np.array([sphere_centers(robot, q)[robot.moving] for q in on_path])
    for q in on_blends(planner, path):
        at = sphere_centers(robot, q)[robot.moving]
        for i in range(len(at)):
            k = np.linalg.norm(there[:, i] - at[i], axis=1).argmin()
            inwards = at[i] - there[k, i]
            if np.linalg.norm(inwards) < 5e-4:
                continue
            inwards /= np.linalg.norm(inwards)
            point = at[i] + (grown[i] - 3e-4) * inwards
            there_is(static, point)
            if static.motion_free(q, np.zeros_like(q)):
                continue
            if all(static.motion_free(a, d) for a, d in zip(path, legs, strict=False)):
                return q, point
    return None


def test_a_robot_that_rounds_a_corner_beside_what_stands_still_goes_on(small_map):
    """It was told that its start is not free, and stood for good."""
    seen = 0
    for seed in some(range(30), *range(3, 19)):
        planner, points, answer = on_its_way(small_map, seed)
        found = _beside_a_blend(odm.ReactivePlanner(small_map), answer.path)
        if found is None:
            continue
        q, point = found
        m = planner.memory
        planner.step(points, q=HOME)
        segment, _ = planner.path.locate(q)
        there_is(planner.static, point)
        m.numbers.where[0] = segment
        planner.path.certify_off_path(q)
        assert (m.off_path.free == ROUNDED).all()
        # no nearer to what stands still than blending may bring it
        towards = point - sphere_centers(planner.robot, q)[planner.robot.moving]
        nearest = towards[np.linalg.norm(towards, axis=1).argmin()]
        too_near = small_map.safety.rounding + 1e-3
        planner.set_static((point - too_near * nearest / np.linalg.norm(nearest))[None])
        m.numbers.where[0] = segment
        planner.path.certify_off_path(q)
        assert (m.off_path.free == 0).all()
        seen += 1
    assert seen >= 3


def test_what_rounds_a_corner_is_led_along_no_other_path(small_map):
    """That would be rounded again, and spend the share for it a second time."""
    seen = 0
    for seed in some(range(40), *range(3, 25)):
        planner, points, answer = on_its_way(small_map, seed)
        found = _beside_a_blend(odm.ReactivePlanner(small_map), answer.path)
        if found is None or planner.path.locate(found[0])[0] < 0:
            continue
        (q, point), m = found, planner.memory
        there_is(planner.static, point)
        for planner.always_replan in (False, True):
            again = planner.step(points, q=q)
            if again.status != FOLLOWING:  # the blend is nearer to the person, too
                break
            path, n = planner.memory.path, planner.memory.path.count[0]
            assert (m.off_path.free == ROUNDED).all() and m.numbers.off_path[0] == 1
            assert np.array_equal(path.q[:n], answer.path)
            connect_along_path(m.table, path, m.numbers.where.item(), q, m.path_ends)
            assert m.path_ends.count[0] == 0
        else:
            seen += 1
    assert seen >= 2


def _just_kept_off(planner, path):
    """Let a point stand that a segment of a path just keeps off.

    Returns its number, its middle, and a displacement from there by which the robot is
    1 mm nearer to the point.
    """
    static, safety = planner.static, planner.cell_map.safety
    moving, lift = planner.robot.moving, np.array([0.0, 1e-3, 0.0])
    for k in range(1, len(path) - 1):
        dq = path[k + 1] - path[k]
        on = path[k] + 0.5 * dq
        there = sphere_centers(static.robot, on)[moving]
        moved = sphere_centers(static.robot, on + lift)[moving] - there
        far = np.linalg.norm(moved, axis=1)
        i = int(far.argmax())
        for gap in np.arange(0.0, 0.0014, 2e-4):
            keep = planner.robot.spheres[moving, 3][i] + safety.rho + safety.m + gap
            there_is(static, there[i] + keep * moved[i] / far[i])
            if static.motion_free(path[k], dq):
                return k, on, 1e-3 / far[i] * lift
    raise AssertionError("no point stands so")


def test_a_tube_around_a_segment_tells_of_no_other_and_is_not_thin(small_map):
    planner, _, answer = on_its_way(small_map, 2)
    k, on, nearer = _just_kept_off(planner, answer.path)
    m, beside = planner.memory, on + 7.0 * nearer
    for segment, q, free in ((0, answer.path[:2].mean(axis=0), 1), (k, beside, 0)):
        m.numbers.where[0] = segment
        planner.path.certify_off_path(q)
        assert (m.off_path.free == free).all()


def test_a_robot_beside_its_segment_is_not_led_nearer_to_what_stands_still(small_map):
    planner, _, answer = on_its_way(small_map, 2)
    k, on, nearer = _just_kept_off(planner, answer.path)
    static, rounding, q = planner.static, small_map.safety.rounding, on + 5.5 * nearer
    assert planner.step(NOBODY, q=on).status == "following"
    assert planner.path.locate(q)[0] == k
    ahead = answer.path[k + 1] - q
    assert not static.motions_free(q[None], ahead[None], nearer=rounding).any()
    path = planner.step(NOBODY, q=q).path
    for a, b in zip(path, path[1:], strict=False):
        assert static.motions_free(a[None], (b - a)[None], nearer=rounding).all()


def test_what_is_known_beside_a_segment_is_of_this_very_motion(small_map):
    planner, _, answer = on_its_way(small_map, 2)
    known, path, q = planner.memory.off_path, planner.memory.path, answer.path[0]
    for row in range(3):  # from elsewhere, to or from another end
        known.q[:] = q, path.q[1], path.q[0]
        assert is_off_path_known(known, path, 0, q)
        known.q[row, 1] += 1e-9
        assert not is_off_path_known(known, path, 0, q)


def test_a_corner_takes_nothing_where_tracking_may_be_off_by_more_than_blending():
    """Off by more than twice the blending share, it would be spent more than once."""
    assert Safety(tracking=0.002, blending=0.004).rounding == 0.004
    assert Safety(tracking=0.004, blending=0.004).rounding == 0.004
    assert Safety(tracking=0.005, blending=0.004).rounding == 0.0
    assert Safety(tracking=0.002, blending=0.0).rounding == 0.0
