"""Shapes in the close test: exact distances, and never an optimistic word."""

import numpy as np
import pytest
from naive_cells import centers
from numba import njit
from scipy.spatial.transform import Rotation
from shapes_drawn import (
    KINDS,
    draw_shape,
    draw_shapes,
    exact_distance,
    smallest_solid_gap,
    solids_of,
)
from small import draw_valid
from wrappers import with_wrapper

import odm
from odm.close_test import _close as close
from odm.close_test._arm import Clearance, make_work
from odm.close_test._close import FIRST_SOLID
from odm.close_test.close_test import CloseTest
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._solids import chord_keeps, solid_distance, solid_gap
from roadmap.compiling.jit_options import LEAN
from roadmap.kinematics.forward import difference

chord_keeps = with_wrapper(chord_keeps)
chords_at_solids = with_wrapper(close.chords_at_solids)
place_clear = with_wrapper(close.place_clear)
solid_gap = with_wrapper(solid_gap)

NOTHING = np.zeros((0, 3))


@njit(**LEAN | {"cache": False})
def _fill_distances(solids, places, enough, found):
    for k in range(places.shape[0]):
        x, y, z = places[k, 0], places[k, 1], places[k, 2]
        found[k] = solid_distance(solids, 0, x, y, z, enough)


def distances(solids, places, enough=np.inf):
    """Return the signed distances of places (n, 3) from the first solid."""
    found = np.empty(len(places))
    _fill_distances(solids, np.ascontiguousarray(places), enough, found)
    return found


def cloud_of(cell_map, points):
    cloud = cell_map.grid.new_cloud(max(1, len(points)))
    occupancy.mark_points(points, cloud)
    occupancy.sort_points(points, cloud)
    return cloud


def work_of(cell_map):
    return make_work(cell_map.arm, cell_map.robot.dof)


def around(shape, rng, n=40):
    """Return places near a shape, outside, inside and on it."""
    middle = shape.T_base_shape[:3, 3]
    return middle + rng.normal(size=(n, 3)) * rng.choice([0.03, 0.1, 0.5], (n, 1))


@pytest.mark.parametrize("kind", KINDS)
def test_the_distance_is_exact(kind, rng):
    inside = outside = 0
    for _ in range(25):
        shape = draw_shape(kind, rng)
        solids, places = solids_of([shape]), around(shape, rng)
        slow = exact_distance(shape, places)
        fast = distances(solids, places), distances(solids, places, 0.02)
        for there, d, near in zip(slow, *fast, strict=True):
            assert d == pytest.approx(there, abs=2e-7) if there > 0.0 else d <= 1e-9
            # a bound is enough
            assert near <= d + 1e-12 and (near == d or near >= 0.02)
            inside, outside = inside + (d < 0.0), outside + (d > 0.0)
    assert inside > 5 and outside > 100


@pytest.mark.parametrize("kind", KINDS)
def test_the_tangent_is_below_the_distance_everywhere(kind, rng):
    for _ in range(20):
        shape = draw_shape(kind, rng)
        solids, places = solids_of([shape]), around(shape, rng)
        here = around(shape, rng, 1)[0]
        for enough in (np.inf, 0.02):
            d, *g = solid_gap(solids, 0, *here, enough)
            assert np.linalg.norm(g) <= 1.0 + 1e-9
            for place, there in zip(places, distances(solids, places), strict=True):
                assert there >= d + np.dot(g, place - here) - 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_a_chord_keeps_exactly_what_its_places_keep(kind, rng):
    kept = lost = 0
    for _ in range(150):
        shape = draw_shape(kind, rng)
        solids = solids_of([shape])
        a, b = around(shape, rng, 2)
        places = a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a)
        d = distances(solids, places)
        step = np.linalg.norm(b - a) / 399
        need = rng.choice([0.01, 0.05, 0.2, float(d.min()) + 1e-4])
        said = chord_keeps(solids, 0, tuple(a), tuple(b), need)
        if said:
            assert d.min() >= need - 1e-9
        else:
            assert d.min() - 0.5 * step < need + 1e-9
        kept, lost = kept + said, lost + (not said)
        # parallel to a face, or to an axis, is where it would take long
        side = shape.T_base_shape[:3, :3][:, rng.integers(3)]
        b = a + 0.3 * side
        places = a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a)
        d = distances(solids, places).min()
        if d > 1e-6:
            assert chord_keeps(solids, 0, tuple(a), tuple(b), d - 0.3 / 399)
            assert not chord_keeps(solids, 0, tuple(a), tuple(b), d + 1e-6)
    assert kept > 10 and lost > 20


def test_a_zero_length_capsule_is_a_sphere(rng):
    at = rng.normal(size=3)
    a = solids_of(odm.Obstacles(capsules=np.array([[*at, *at, 0.07]])))
    b = solids_of(odm.Obstacles(spheres=np.array([[*at, 0.07]])))
    places = rng.normal(size=(20, 3))
    assert (distances(a, places) == distances(b, places)).all()


def of_shapes(cell_map, work=None):
    """Return a close test that keeps m from shapes and rho + m from points."""
    bare = cell_map.arm.spheres[:, 3] + cell_map.safety.m
    work = work or work_of(cell_map)
    tolerance = cell_map.motion_tolerance
    return CloseTest(cell_map.arm, cell_map.swept_radii(), tolerance, work, bare)


def test_what_is_clear_of_shapes_keeps_m_at_dense_places(small_map, planner, rng):
    nothing, test, m = cloud_of(small_map, NOTHING), of_shapes(small_map), None
    m, free = small_map.safety.m, 0
    for _ in range(70):
        q = draw_valid(planner, rng)
        dq = difference(small_map.robot, q, draw_valid(planner, rng))
        dq = dq * rng.choice([0.0, 0.1, 1.0])
        shapes = draw_shapes(rng, 2)
        if test.clear(q, dq, nothing, solids=solids_of(shapes)):
            free += 1
            assert smallest_solid_gap(small_map, q, dq, shapes, 30) >= m - 1e-7
    assert free > 10


def test_chords_beside_a_shape_keep_the_sag_too(small_map, rng):
    """However far their ends are from the middle, where a body is looked at."""
    arm, work = small_map.arm, work_of(small_map)
    bare = arm.spheres[:, 3] + small_map.safety.m
    clearance = Clearance(arm, bare, bare, 0.01, work)
    b = len(arm.body_ptr) - 2
    part = slice(int(arm.body_ptr[b]), int(arm.body_ptr[b + 1]))
    mask = np.arange(len(arm.tree_i)) == b
    work.body_bare[b], work.early[b] = bare[part].max(), 0
    kept = lost = 0
    for _ in range(300):
        shape = draw_shape(rng.choice(KINDS), rng)
        solids = solids_of([shape])
        begin, end = around(shape, rng, 2)
        end = rng.choice([begin, end])
        R = Rotation.random(random_state=rng).as_matrix()
        for k, at in enumerate((0.5 * (begin + end), begin, end)):
            work.frames[k, b] = [*R.ravel(), *at]
        sag = rng.choice([0.0, 0.002, 0.3])
        work.body_speed[b] = np.linalg.norm(end - begin)
        work.bend[:] = work.body_bend[:] = 8.0 * sag
        chords_at_solids(clearance, mask, 0, solids, False)
        off = arm.spheres[part, :3] @ R.T
        said = all(
            chord_keeps(solids, 0, tuple(begin + o), tuple(end + o), r + sag)
            for o, r in zip(off, bare[part], strict=True)
        )
        assert (work.state[b] == 0) == said
        kept, lost = kept + said, lost + (not said)
    assert kept > 50 < lost


def test_a_place_is_clear_where_a_motion_that_stays_there_is(small_map, planner, rng):
    test, still, free = of_shapes(small_map), np.zeros(3), 0
    for k in range(150):
        q = draw_valid(planner, rng)
        at, way = centers(small_map.arm, small_map.robot, q), rng.normal(size=3)
        i, way = rng.integers(len(at)), way / np.linalg.norm(way)
        gap = (
            rng.uniform(0.9, 1.2) * (test.group.bare if k % 2 else test.group.radii)[i]
        )  # from a point, a ball
        points = (at[i] + gap * way)[None] if k % 2 == 0 else NOTHING
        balls = np.array([[*(at[i] + (gap + 0.03) * way), 0.03]])[: k % 2]
        cloud, solids = (
            cloud_of(small_map, points),
            solids_of(odm.Obstacles(spheres=balls)),
        )
        said = test.clear(q, still, cloud, solids=solids)
        test.group.work.speed[:] = test.group.work.body_speed[:] = -1.0  # of before
        assert place_clear(test.group, q, cloud, solids) == said
        free += said
    assert 20 < free < 130
    for bad in (np.nan, np.inf):
        nowhere = np.array([0.0, bad, 0.0])
        assert not place_clear(test.group, nowhere, cloud, solids)
    none = cloud_of(small_map, NOTHING), solids_of([])
    assert place_clear(test.group, q, *none)
    for radii in (test.group.radii, test.group.bare):
        before, radii[-1] = radii[-1], np.nan
        assert not place_clear(test.group, q, *none)
        radii[-1] = before


def test_what_is_blocked_by_a_shape_comes_within_the_tolerance(small_map, planner, rng):
    nothing, test, blocked = cloud_of(small_map, NOTHING), of_shapes(small_map), 0
    for _ in range(100):
        q = draw_valid(planner, rng)
        dq = 0.3 * difference(small_map.robot, q, draw_valid(planner, rng))
        shapes = draw_shapes(rng, 1, spread=0.25)
        if not test.clear(q, dq, nothing, solids=solids_of(shapes)):
            blocked += 1
            gap = smallest_solid_gap(small_map, q, dq, shapes, 200)
            step = 0.01  # the places that are looked at lie apart, and it gives 1 mm up
            assert gap < small_map.safety.m + step
            sphere, shape = test.blocked_by
            assert sphere >= 0 and shape == FIRST_SOLID
    assert blocked > 10


def test_shapes_free_what_their_samples_free(small_map, planner, rng):
    """At least that: the samples pay rho, the shapes nothing."""
    nothing, test = cloud_of(small_map, NOTHING), of_shapes(small_map)
    both = shapes_alone = 0
    for _ in range(150):
        q = draw_valid(planner, rng)
        dq = difference(small_map.robot, q, draw_valid(planner, rng))
        dq = dq * rng.choice([0.0, 0.1, 1.0])
        shapes = draw_shapes(rng, 1)
        points = odm.surface_of(shapes[0], small_map.safety.rho).points
        cells = small_map.grid.locate(points)
        points = points[(cells >= 0).all(axis=1)]
        by_points = test.clear(q, dq, cloud_of(small_map, points))
        by_shapes = test.clear(q, dq, nothing, solids=solids_of(shapes))
        if by_points and not by_shapes:
            # a solid that holds all of it has no sample near: shapes know better
            assert smallest_solid_gap(small_map, q, dq, shapes, 200) < 0.02
            inside = centers(small_map.arm, small_map.robot, q)
            assert exact_distance(shapes[0], inside).min() == 0.0
        both, shapes_alone = both + by_points, shapes_alone + by_shapes
    assert shapes_alone > both > 10


def test_points_and_shapes_block_each_for_themselves(small_map, planner, rng):
    test, seen = of_shapes(small_map), set()
    for _ in range(150):
        q = draw_valid(planner, rng)
        dq = 0.5 * difference(small_map.robot, q, draw_valid(planner, rng))
        shapes = draw_shapes(rng, 1, spread=0.25)
        points = rng.uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 0.9], (2, 3))
        cloud, solids = cloud_of(small_map, points), solids_of(shapes)
        nothing = cloud_of(small_map, NOTHING)
        one = test.clear(q, dq, cloud)
        other = test.clear(q, dq, nothing, solids=solids)
        assert test.clear(q, dq, cloud, solids=solids) == (one and other)
        seen.add((one, other))
    assert len(seen) == 4


def test_separation_is_that_of_the_nearest(small_map, planner, rng):
    test = of_shapes(small_map)
    radii = small_map.arm.spheres[:, 3]
    for _ in range(30):
        q, shapes = draw_valid(planner, rng), draw_shapes(rng, 3)
        points = rng.uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 0.9], (3, 3))
        c = centers(small_map.arm, small_map.robot, q)
        by_point = (np.linalg.norm(c[:, None] - points, axis=2) - radii[:, None]).min()
        by_shape = min((exact_distance(s, c) - radii).min() for s in shapes)
        cloud, solids = cloud_of(small_map, points), solids_of(shapes)
        found = test.separation(q, cloud, solids=solids)
        if by_shape > -radii.min():  # no centre is inside: there depth counts
            assert found == pytest.approx(min(by_point, by_shape), abs=1e-6)
        assert (test.blocked_by[1] < 0) == (by_shape < by_point)
        assert test.separation(q, cloud, 0.01, solids) == min(0.01, found)


def test_an_escape_never_brings_a_sphere_nearer_to_a_near_shape(
    small_map, planner, rng
):
    nothing, work = cloud_of(small_map, NOTHING), work_of(small_map)
    test, free = of_shapes(small_map, work), 0
    for _ in range(200):
        q = draw_valid(planner, rng)
        dq = 0.2 * difference(small_map.robot, q, draw_valid(planner, rng))
        shapes = draw_shapes(rng, 1)
        solids = solids_of(shapes)
        if test.clear(q, 0.0 * dq, nothing, solids=solids):
            continue
        close.place_anchor(small_map.arm, q, work)
        now = centers(small_map.arm, small_map.robot, q)
        if not test.clear(q, dq, nothing, True, solids):
            continue
        free += 1
        keep = small_map.arm.spheres[:, 3] + small_map.safety.m
        begin = distances(solids, now)
        least = np.minimum(keep, np.array(begin) - close.ESCAPE_SLACK)
        for t in np.linspace(0.0, 1.0, 60):
            there = centers(small_map.arm, small_map.robot, q + t * dq)
            d = distances(solids, there)
            assert (d >= least - 1e-9).all()
    assert free > 4


def test_one_more_shape_never_frees_a_motion(small_map, planner, rng):
    nothing, test = cloud_of(small_map, NOTHING), of_shapes(small_map)
    for _ in range(60):
        q = draw_valid(planner, rng)
        dq = difference(small_map.robot, q, draw_valid(planner, rng))
        shapes = draw_shapes(rng, 3)
        all_of_them = test.clear(q, dq, nothing, solids=solids_of(shapes))
        some = [test.clear(q, dq, nothing, solids=solids_of([s])) for s in shapes]
        assert all_of_them == all(some)


def test_what_is_no_number_is_blocked_beside_shapes_too(small_map):
    nothing, test = cloud_of(small_map, NOTHING), of_shapes(small_map)
    far = solids_of(odm.Obstacles(spheres=np.array([[5.0, 5.0, 5.0, 0.1]])))
    q = np.zeros(small_map.robot.dof)
    assert test.clear(q, q, nothing, solids=far)
    for j in range(len(q)):
        for bad in (np.nan, np.inf, -np.inf):
            lost = np.where(np.arange(len(q)) == j, bad, q)
            assert not test.clear(lost, q, nothing, solids=far)
            assert not test.clear(q, lost, nothing, solids=far)
            assert not test.clear(q, lost, nothing)
    arm, radii, _, tolerance, work = test.group
    for bad in (np.nan, np.inf):
        for kept in ((radii + bad, radii), (radii, radii + bad)):
            endless = CloseTest(arm, kept[0], tolerance, work, kept[1])
            assert not endless.clear(q, q, nothing, solids=far)
