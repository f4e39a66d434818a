"""Motions that are not tested anew while no shape has come as near."""

import numpy as np
import pytest
from carrying import BALLS, HIGH
from naive_cells import centers
from scipy.spatial.transform import Rotation
from shapes_drawn import (
    draw_pose,
    draw_shape,
    exact_distance,
    smallest_solid_gap,
    solids_of,
)
from small import AWAY, HOME, draw_valid
from wrappers import with_wrapper

import odm
from odm.close_test._slack import (
    BEND,
    NEAR,
    WIDE,
    balls_from_solid,
    displaced,
    in_fours,
    line_distance,
    lines_from_rod,
)
from odm.search import _judge as judge
from odm.search._measured import RESERVE, SAG
from odm.search._state import NO_ITEM, PIECES
from roadmap.kinematics.forward import tool_pose
from roadmap.transforms import pose_of

part_free = with_wrapper(judge.part_free)
stands_free = with_wrapper(judge.stands_free)

balls_from_solid = with_wrapper(balls_from_solid)
displaced = with_wrapper(displaced)
in_fours = with_wrapper(in_fours)
line_distance = with_wrapper(line_distance)
lines_from_rod = with_wrapper(lines_from_rod)

MOVING = ("sphere", "capsule", "cylinder", "box")
STEPS = (-1e-3, 0.0, 1e-3)  # shares of a motion beside a place on it
TESTS = 2  # of work.found: close tests that were begun


def moved(shape, rng, step):
    """Return the shape a little elsewhere, turned, and now and then of another size."""
    T = shape.T_base_shape.copy()
    T[:3, 3] += step * rng.normal(size=3)
    turn = Rotation.from_rotvec(step * rng.normal(size=3)).as_matrix()
    T[:3, :3] = turn @ T[:3, :3]
    grown = 1.0 + (0.3 * step * rng.normal() if rng.random() < 0.3 else 0.0)
    if isinstance(shape, odm.Sphere):
        return odm.Sphere(grown * shape.radius, T)
    if isinstance(shape, odm.Box):
        return odm.Box(grown * np.asarray(shape.size), T)
    return type(shape)(grown * shape.radius, grown * shape.length, T)


@pytest.mark.parametrize("kind", MOVING)
def test_no_place_is_nearer_by_more_than_shapes_were_displaced(kind, rng):
    for step in (1e-3, 0.03, 0.3):
        for _ in range(6):
            old = draw_shape(kind, rng)
            new = moved(old, rng, step)
            before, after = solids_of([old]), solids_of([new])
            bound = displaced(before.rows, before.kind, 1, after)
            places = old.T_base_shape[:3, 3] + 0.4 * rng.normal(size=(60, 3))
            lost = exact_distance(old, places) - exact_distance(new, places)
            assert lost.max() <= bound + 1e-6
            assert bound < 40.0 * step


@pytest.mark.parametrize("turn, more", [(0.3, 0.0), (0.0, 0.1)])
def test_an_end_of_a_long_box_is_displaced_no_farther_than_told(turn, more):
    """Turned about its narrow side, and grown: there the bound is nearly reached."""
    old, size = odm.Box((0.8, 0.02, 0.01)), (0.8 + more, 0.02, 0.01)
    T = pose_of(np.zeros(3), np.array([0.0, 0.0, turn]))
    new, end = odm.Box(size, T), T[:3, 0] * 0.5 * size[0]
    before = solids_of([old])
    bound = displaced(before.rows, before.kind, 1, solids_of([new]))
    lost = exact_distance(old, end[None]) - exact_distance(new, end[None])
    assert 0.6 * bound < lost <= bound + 1e-9


def test_others_shapes_are_displaced_without_bound(rng):
    ball, box = odm.Sphere(0.1, draw_pose(rng)), odm.Box([0.1] * 3, draw_pose(rng))
    mesh = draw_shape("mesh", rng)
    one = solids_of([ball])
    for others in ([ball, ball], [box], [mesh]):
        assert np.isinf(displaced(one.rows, one.kind, 1, solids_of(others)))
    same = solids_of([mesh])
    assert np.isinf(displaced(same.rows, same.kind, 1, same))


@pytest.mark.parametrize("number", [0.0, np.nan])
def test_lines_beside_a_capsule_are_measured_as_one_by_one(number, rng):
    """To the last bit, in fours and what is left over; points, spheres, parallels."""
    for k in range(600):
        n = rng.integers(1, 14)
        spheres, gap = rng.normal(size=(n, 4)), np.full(n, 7.0)
        f = rng.normal(size=12)
        g = f + rng.normal(size=12) * 10.0 ** rng.integers(-9, 1) * (k % 5 > 0)
        solids = solids_of([odm.Capsule(0.05, 0.2, draw_pose(rng))])
        rod = solids.rows[0]
        rod[3:6] = 10.0 ** rng.integers(-9, 1) * rng.normal(size=3) * (k % 7 > 0)
        if k % 11 == 0:  # all lines are parallel to it
            g[:9], g[9:], rod[3:6] = f[:9], f[9:] + [0.0, 0.3, 0.0], [0.0, 0.2, 0.0]
        rod[7] = rod[3] * rod[3] + rod[4] * rod[4] + rod[5] * rod[5]
        if np.isnan(number):
            rod[rng.integers(0, 6)] = number
        lines_from_rod(spheres, (0, n), f, g, rod, gap)
        for i, p in enumerate(spheres[:, :3]):
            ends = [_place(frame, p) for frame in (f, g)]
            alone = line_distance(solids, 0, *ends, 0.0)
            np.testing.assert_array_equal(gap[i], alone)
            assert np.isnan(alone) == np.isnan(number)


@pytest.mark.parametrize("kind", (*MOVING, "mesh"))
@pytest.mark.parametrize("lanes", [8, 16])
def test_balls_have_no_more_to_spare_than_is_told(kind, lanes, rng):
    """On all of their way; and exactly that where it is a capsule's, and they stay."""
    for k in range(20):
        shape = draw_shape(kind, rng)
        begin = rng.normal(size=(3, lanes))
        end = begin + 0.3 * rng.normal(size=(3, lanes)) * (k % 4 > 0)
        bound, shares = rng.uniform(0.0, 0.2, (3, lanes)), tuple(rng.uniform(0, 1, 2))
        wide = bound[2] + shares[0] * bound[0] + shares[1] * bound[1]
        near = np.full(lanes, 7.0)
        balls_from_solid((begin, end), bound, shares, solids_of([shape]), 0, near)
        gaps = [
            exact_distance(shape, (begin + t * (end - begin)).T) - wide
            for t in np.linspace(0.0, 1.0, 9)
        ]
        assert (near <= np.min(gaps, axis=0) + 1e-6).all()
        if kind in ("capsule", "sphere") and k % 4 == 0:
            np.testing.assert_allclose(near, gaps[0], atol=1e-6)


def _place(f, p):
    """Return where a body with frame f has p, summed in the order of the loops."""
    return tuple(
        f[r] * p[0] + f[r + 1] * p[1] + f[r + 2] * p[2] + f[9 + r // 3]
        for r in (0, 3, 6)
    )


def test_spheres_are_taken_in_fours_where_there_are_so_many(small_map):
    arm = small_map.arm
    n = len(arm.spheres)
    for b in range(len(arm.body_ptr) - 1):
        begin, end = in_fours(arm, b)
        assert 0 <= begin <= arm.body_ptr[b] and arm.body_ptr[b + 1] <= end <= n
        assert (end - begin) % 4 == 0 or n < 4 or begin == 0
        if n >= 24:
            assert (end - begin) % 4 == 0


def test_a_motion_from_or_to_beside_another_is_another_one(planner):
    """Of which nothing is known; a rest of the very motion is a part of it."""
    planner.step(odm.Obstacles.of([ball_at(np.array([0.0, 0.0, 5.0]))]), q=HOME)
    table, slacks = planner.memory.table, planner.memory.slacks
    dq, beside = planner.frame.difference(HOME, AWAY), np.array([0.0, 0.0, 1e-4])
    for q, d, kept in (
        (HOME, dq, 1),
        (HOME + 0.5 * dq, 0.5 * dq, 1),
        (HOME, dq + beside, 2),
        (HOME + beside, dq - beside, 3),
    ):
        assert part_free(table, NO_ITEM, q, d)
        assert (slacks.chords > 0).sum() == kept


def test_what_was_measured_so_long_ago_that_its_shapes_are_forgotten_is_measured(
    planner,
):
    """A ball comes to where nobody asked meanwhile; another motion is asked often."""
    tool, far = (tool_pose(planner.robot, q)[:3, 3] for q in (HOME, AWAY))
    still, table = np.zeros_like(HOME), planner.memory.table
    frames = len(planner.memory.slacks.frame) + 8
    for k in range(frames + 1):
        at = tool + [0.0, 0.0, 0.3 * (1.0 - k / frames)]
        planner.step(odm.Obstacles.of([ball_at(at), ball_at(far)]), q=HOME)
        if k in (0, frames):
            assert part_free(table, NO_ITEM, HOME, still) == (k == 0)
        else:
            assert not part_free(table, NO_ITEM, AWAY, still)


def test_what_is_not_tested_anew_is_free_as_by_a_test(small_map, planner, rng):
    """Shapes drift; each frame the motion, or the rest of it, is asked for."""
    spared, m, checked = 0, small_map.safety.m, 0
    blocked = 0
    for _ in range(30):
        shapes = [draw_shape(str(rng.choice(MOVING)), rng) for _ in range(2)]
        q = draw_valid(planner, rng)
        dq = planner.frame.difference(q, draw_valid(planner, rng))
        share, step = 0.0, rng.choice([0.002, 0.01])
        for k in range(12):
            planner.step(odm.Obstacles.of(shapes), q=q)
            table = planner.memory.table
            begin, rest = q + share * dq, (1.0 - share) * dq
            tests = planner.memory.work.found[TESTS]
            free = part_free(table, NO_ITEM, begin, rest)
            by_slack = planner.memory.work.found[TESTS] == tests
            assert free == judge.close_free(table, begin, rest)
            assert free or not by_slack
            spared, blocked = spared + by_slack, blocked + (not free)
            if by_slack and checked < 25:
                checked += 1
                gap = smallest_solid_gap(small_map, begin, rest, shapes, 15)
                assert gap >= m - 1e-7
            shapes = [moved(shape, rng, step) for shape in shapes]
            share += 0.05 * (k % 2)
    assert spared > 60 and blocked > 30 and checked == 25


def test_a_motion_that_takes_the_place_of_another_begins_with_nothing(planner, rng):
    shapes = [draw_shape(str(rng.choice(MOVING)), rng) for _ in range(2)]
    q, told = draw_valid(planner, rng), 0
    planner.step(odm.Obstacles.of(shapes), q=q)
    table, rows = planner.memory.table, len(planner.memory.slacks.chords)
    for _ in range(4 * rows):
        dq = planner.frame.difference(q, draw_valid(planner, rng))
        free = part_free(table, NO_ITEM, q, dq)
        assert free == judge.close_free(table, q, dq)
        told, q = told + free, q if rng.random() < 0.5 else draw_valid(planner, rng)
    assert rows < told < 3 * rows


def asked(planner, shapes, q, dq):
    """Return what the chords of a motion have to spare from shapes [m], and nearest."""
    planner.step(odm.Obstacles.of(shapes), q=q)
    part_free(planner.memory.table, NO_ITEM, q, dq)
    slacks = planner.memory.slacks
    k = int(slacks.asked.argmax())
    n = slacks.chords[k] if slacks.asked[k] == planner.memory.numbers.frame[0] else 0
    return slacks.spare[k, :n].copy(), slacks.nearest[k, :n].copy()


def test_no_chord_has_more_to_spare_than_its_spheres(small_map, planner, rng):
    m, checked, tight, whole = small_map.safety.m, 0, 0, 0
    while checked < 50:
        shapes = [draw_shape(str(rng.choice(MOVING)), rng) for _ in range(2)]
        q = draw_valid(planner, rng)
        dq = planner.frame.difference(q, draw_valid(planner, rng))
        spare, nearest = asked(planner, shapes, q, dq)
        for c in rng.permutation(np.flatnonzero(spare > RESERVE))[:3]:
            begin, part = q + c / len(spare) * dq, dq / len(spare)
            gap = smallest_solid_gap(small_map, begin, part, shapes, 9) - m
            assert spare[c] <= gap + 1e-9
            tight += nearest[c] >= 0 and gap - spare[c] < 2.0 * SAG
            whole += nearest[c] < 0
            checked += 1
    assert tight > 3 and whole > 20


def test_what_was_measured_or_put_together_again_has_no_more_to_spare(
    small_map, planner, rng
):
    """Shapes drift: chords are measured anew, two at once, and pieces renewed."""
    m, pairs, pieces = small_map.safety.m, 0, 0
    slacks, frame = planner.memory.slacks, planner.memory.numbers.frame
    while pairs < 20 or pieces < 40:
        shapes = [draw_shape(str(rng.choice(MOVING)), rng) for _ in range(2)]
        q = draw_valid(planner, rng)
        dq = planner.frame.difference(q, draw_valid(planner, rng))
        for _ in range(6):
            n = len(asked(planner, shapes, q, dq)[0])
            k, most = int(slacks.asked.argmax()), slacks.nearest.shape[1]
            spare, now = slacks.spare[k], slacks.since[k] == frame[0]
            told = np.flatnonzero(now & (spare > RESERVE))
            parts = [(c, c, 1) for c in told if c < n and slacks.nearest[k, c] >= 0]
            parts += [
                (c, (c - most) * (n // PIECES), n // PIECES)
                for c in told
                if c >= most and n >= 2 * PIECES
            ]
            for at, first, size in [parts[i] for i in rng.permutation(len(parts))[:3]]:
                begin, part = q + first / n * dq, size / n * dq
                gap = smallest_solid_gap(small_map, begin, part, shapes, 9) - m
                assert spare[at] <= gap + 1e-9
                pieces += size > 1
                pairs += size == 1 and first + 1 < n and spare[at] == spare[first + 1]
            shapes = [moved(shape, rng, 0.02) for shape in shapes]


def outermost(small_map, q, dq, t):
    """Return the sphere that turns most at a share of a motion: place, radius, ways.

    The ways (2, 3) are the unit vectors outwards and ahead.
    """
    near = [centers(small_map.arm, small_map.robot, q + (t + h) * dq) for h in STEPS]
    ahead, bend = near[2] - near[0], near[0] + near[2] - 2.0 * near[1]
    i = int(np.linalg.norm(bend, axis=1).argmax())
    ways = np.array([-bend[i], ahead[i]])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return near[1][i], small_map.arm.spheres[i, 3], ways


def ball_at(place):
    """Return a small ball there."""
    return odm.Sphere(0.02, pose_of(place, np.zeros(3)))


def cube_at(place):
    """Return a cube there, hardly larger than a point."""
    return odm.Box((1e-4, 1e-4, 1e-4), pose_of(place, np.zeros(3)))


def by_balls(slacks, c, place):
    """Return what balls around bodies have to spare where chord c begins, and ends.

    Of the motion that was asked for last, from a small ball, less the sag; NaN where
    these balls were not looked at.
    """
    k = int(slacks.asked.argmax())
    row, n = k * (slacks.nearest.shape[1] + 1) + c, slacks.chords[k]
    if not slacks.placed[row : row + 2].all():
        return np.nan
    wide, bend = slacks.bound[k, WIDE], slacks.bound[k, BEND]
    far = np.linalg.norm(slacks.balls[row : row + 2] - place[:, None], axis=1)
    return (far - 0.02 - wide - bend / (8.0 * n * n))[:, wide >= 0.0].min()


def test_the_sag_comes_off_what_balls_around_bodies_have_to_spare(planner, rng):
    """A ball ahead of the end of a motion, where a chord's end is nearest to it."""
    told = 0
    for _ in range(12):
        q, dq = draw_valid(planner, rng), np.array([1.2, 0.0, 0.0])
        place, radius, ways = outermost(planner.cell_map, q, dq, 1.0)
        for far in (0.08, 0.12):
            at = place + (radius + 0.02 + far) * ways[1]
            spare, nearest = asked(planner, [ball_at(at)], q, dq)
            for c in np.flatnonzero((nearest < 0) & (spare > NEAR)):
                least = by_balls(planner.memory.slacks, c, at)
                assert not spare[c] > least + 1e-9
                told += spare[c] > least - 1e-3
    assert told > 10


def test_the_sag_and_the_speed_come_off(small_map, planner, rng):
    """A ball outside the bend, where chords cut the corner; and one ahead of the end.

    Of a motion of one joint, whose bounds are nearly what it does.
    """
    m, by_sphere, by_body = small_map.safety.m, 0, 0
    for _ in range(8):
        q, dq = draw_valid(planner, rng), np.array([2.5, 0.0, 0.0])
        q[0] = -1.25
        for t, way, far in ((0.5 + 1.0 / 64.0, 0, 0.006), (1.0, 1, 0.05)):
            place, radius, ways = outermost(small_map, q, dq, t)
            away = (radius + m + 0.02 + far) * ways[way]
            shapes = [ball_at(place + away)]
            spare, nearest = asked(planner, shapes, q, dq)
            free = np.flatnonzero(spare > RESERVE)
            for c in free[np.argsort(spare[free])[:4]]:
                begin, part = q + c / len(spare) * dq, dq / len(spare)
                gap = smallest_solid_gap(small_map, begin, part, shapes, 5) - m
                assert spare[c] <= gap + 1e-9
                by_sphere += nearest[c] >= 0
                by_body += nearest[c] < 0
    assert by_sphere > 8 and by_body > 4


@pytest.mark.parametrize("thing_at, size", [(ball_at, 0.02), (cube_at, 1e-4)])
def test_what_is_too_near_by_half_a_millimetre_is_not_free(
    small_map, planner, rng, thing_at, size
):
    """Of a short motion, whose chords are hardly bent; and what has as much is."""
    for _ in range(8):
        q, dq = draw_valid(planner, rng), np.array([0.1, 0.0, 0.0])
        place, radius, ways = outermost(small_map, q, dq, 0.5)
        for far in (-5e-4, 2e-3):
            away = (radius + small_map.safety.m + size + far) * ways[0]
            planner.step(odm.Obstacles.of([thing_at(place + away)]), q=q)
            assert part_free(planner.memory.table, NO_ITEM, q, dq) == (far > 0.0)


def test_the_sag_of_two_chords_measured_as_one_comes_off(small_map, planner, rng):
    """A ball outside the bend that was far, and is now a little farther than NEAR."""
    m, pairs = small_map.safety.m, 0
    for _ in range(12):
        q, dq = draw_valid(planner, rng), np.array([2.5, 0.0, 0.0])
        q[0] = -1.25
        place, radius, ways = outermost(small_map, q, dq, 0.5)
        for far in (0.2, NEAR + 0.008):
            shapes = [ball_at(place + (radius + m + 0.02 + far) * ways[0])]
            spare, nearest = asked(planner, shapes, q, dq)
        for c in np.flatnonzero((nearest >= 0) & (spare >= NEAR)):
            begin, part = q + c / len(spare) * dq, dq / len(spare)
            gap = smallest_solid_gap(small_map, begin, part, shapes, 9) - m
            assert spare[c] <= gap + 1e-9
            pairs += spare[c] == spare[c ^ 1]
    assert pairs > 8


def test_a_place_is_free_as_a_motion_that_does_not_move(planner, rng):
    told = 0
    for k in range(60):
        shapes = [draw_shape(str(rng.choice(MOVING)), rng) for _ in range(2)]
        points = draw_shape("sphere", rng).T_base_shape[:3, 3:].T if k % 2 else None
        frame = odm.Obstacles.of(shapes, points=points)
        q = draw_valid(planner, rng)
        planner.step(frame, q=q)
        table = planner.memory.table
        rests = judge.close_free(table, q, np.zeros_like(q))
        assert stands_free(table, q) == rests
        told += rests
    assert 5 < told < 55


def spares(planner):
    return planner.memory.slacks.chords.max()


def test_another_distance_or_another_hand_forgets(carrying_map):
    planner = odm.ReactivePlanner(carrying_map)
    q = HIGH
    ball = odm.Obstacles(spheres=np.array([[0.0, 0.0, 5.0, 0.05]]))

    def ask():
        planner.step(ball, q=q)
        table = planner.memory.table
        assert part_free(table, NO_ITEM, q, 0.01 * np.ones_like(q))
        assert spares(planner) > 0
        places.q[:], hit_at[:] = q, 1

    places, hit_at = planner.memory.blocked_places, planner.memory.search.hit_at
    ask()
    planner.set_extra_clearance(0.01)
    assert spares(planner) == 0 and np.isnan(places.q).all()
    ask()
    planner.attach(BALLS)
    assert spares(planner) == 0 and np.isnan(places.q).all() and not hit_at.any()
    ask()
    planner.detach()
    assert spares(planner) == 0 and np.isnan(places.q).all() and not hit_at.any()


def test_a_point_beside_the_shapes_is_not_passed_over(planner):
    far = odm.Obstacles(spheres=np.array([[0.0, 0.0, 5.0, 0.05]]))
    dq = planner.frame.difference(HOME, AWAY)
    for k in range(2):
        planner.step(far, q=HOME)
        table = planner.memory.table
        assert part_free(table, NO_ITEM, HOME, dq)
    at = tool_pose(planner.robot, HOME)[:3, 3]
    planner.step(odm.Obstacles(spheres=far.spheres, points=at[None]), q=HOME)
    assert not part_free(table, NO_ITEM, HOME, dq)
