"""The close test: free means free everywhere on the motion, and cells agree."""

import numpy as np
import pytest
from naive_cells import centers, edge_cells, occupied_cells, smallest_gap
from scipy.spatial.transform import Rotation
from small import draw_arm, draw_valid
from wrappers import with_wrapper

import odm
from odm.close_test import _close as close
from odm.close_test._arm import Clearance, make_work
from odm.close_test.close_test import NO_SOLIDS, CloseTest
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._cloud import N_INSIDE, N_LISTED
from roadmap.kinematics.forward import difference

any_at_box = with_wrapper(close.any_at_box)
any_beside = with_wrapper(close.any_beside)
any_within = with_wrapper(close.any_within)
body_at = with_wrapper(close.body_at)
body_chord = with_wrapper(close.body_chord)
list_near = with_wrapper(close.list_near)
place_spheres = with_wrapper(close.place_spheres)
prepare_motion = with_wrapper(close.prepare_motion)


def cloud_of(cell_map, points):
    cloud = cell_map.grid.new_cloud(max(1, len(points)))
    occupancy.mark_points(points, cloud)
    occupancy.sort_points(points, cloud)
    return cloud


def work_of(cell_map):
    return make_work(cell_map.arm, cell_map.robot.dof)


def is_clear(cell_map, points, q, dq, escape=False, work=None):
    work = work or work_of(cell_map)
    radii, tolerance = cell_map.swept_radii(), cell_map.motion_tolerance
    test = CloseTest(cell_map.arm, radii, tolerance, work)
    return test.clear(q, dq, cloud_of(cell_map, points), escape)


def test_what_is_called_free_is_free_at_dense_samples(small_map, planner, rng):
    keep = small_map.safety.rho + small_map.safety.m
    free = 0
    for _ in range(150):
        q = draw_valid(planner, rng)
        dq = difference(small_map.robot, q, draw_valid(planner, rng))
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        points = points[occupied_mask(small_map, points)]
        if is_clear(small_map, points, q, dq):
            free += 1
            assert smallest_gap(small_map, q, dq, points, 200) >= keep - 1e-9
    assert free > 20


def occupied_mask(cell_map, points):
    return (cell_map.grid.locate(points) >= 0).all(axis=1)


def test_a_dense_cloud_is_free_where_each_of_its_parts_is(small_map, planner, rng):
    """Many points of many blocks are measured at once, few of few one by one."""
    free = blocked = most = 0
    for _ in range(60):
        q = draw_valid(planner, rng)
        dq = 0.2 * difference(small_map.robot, q, draw_valid(planner, rng))
        arms = np.concatenate([draw_arm(rng) for _ in range(rng.integers(1, 6))])
        points = rng.permutation(odm.sample_capsules(arms, 0.01))
        points = points[occupied_mask(small_map, points)]
        parts = [points[k::60].copy() for k in range(60)]
        said = is_clear(small_map, points, q, dq)
        assert said == all(is_clear(small_map, part, q, dq) for part in parts)
        free, blocked = free + said, blocked + (not said)
        most = max(most, cloud_of(small_map, points).counts[N_LISTED])
    assert free > 10 < blocked and most > close.MANY and len(points) > most * close.MANY


@pytest.mark.parametrize("n", [3, close.MANY - 1, close.MANY, 150])
def test_near_blocks_are_listed_as_one_by_one(small_map, n, rng):
    grid = small_map.grid
    points = rng.uniform(grid.origin, grid.upper, (4000, 3))
    cloud = cloud_of(small_map, points)
    assert cloud.counts[N_LISTED] > 150
    cloud.counts[N_LISTED] = n
    for _ in range(200):
        place, reach = rng.uniform(grid.origin, grid.upper), rng.uniform(0.0, 0.5)
        over = np.maximum(cloud.box[:n, :3] - place, place - cloud.box[:n, 3:])
        away = (np.maximum(over, 0.0) ** 2).sum(axis=1)
        found = list_near(cloud, *place, reach)
        assert cloud.away[:n] == pytest.approx(away, rel=1e-12)
        assert cloud.near[:found].tolist() == np.flatnonzero(away < reach**2).tolist()
    assert list_near(cloud, np.nan, np.nan, np.nan, 0.1) == n


def test_what_is_not_a_number_is_within_any_distance(rng):
    xyz = rng.uniform(-1.0, 1.0, (50, 3))
    for begin, end in ((0, 50), (7, 7), (3, 20)):
        d2 = (xyz[begin:end] ** 2).sum(axis=1)
        for far2 in (0.0, d2.min(initial=1.0) * 1.001, 0.5):
            said = any_within(xyz, begin, end, (0.0, 0.0, 0.0), far2)
            assert said == (d2 < far2).any()
    assert any_within(xyz, 0, 50, (np.nan, 0.0, 0.0), 1e-6)


def test_spheres_near_a_box_are_found_as_one_by_one(small_map, rng):
    arm, work = small_map.arm, work_of(small_map)
    n, places, found = len(arm.spheres), work.places, 0
    for k in range(200):
        first, last = sorted(rng.integers(0, n + 1, 2))
        R = Rotation.random(random_state=rng).as_matrix()
        frame = np.array([*R.ravel(), *rng.uniform(-1.0, 1.0, 3)])
        place_spheres(arm.spheres, first, last, frame, places)
        at = arm.spheres[first:last, :3] @ R.T + frame[9:]
        assert places[:3, first:last].T == pytest.approx(at, abs=1e-12)
        box = np.concatenate([frame[9:] + rng.uniform(-0.25, 0.25, 3), np.zeros(3)])
        box[3:] = box[:3] + rng.uniform(0.0, 0.16, 3)
        radii, speed = rng.uniform(0.0, 0.2, (2, n))
        share = rng.choice([0.0, 0.5])
        over = np.maximum(np.maximum(box[:3] - at, at - box[3:]), 0.0)
        d2 = (over**2).sum(axis=1)
        near = d2 < (radii + share * speed)[first:last] ** 2
        said = any_at_box(places, first, last, box, radii, speed, share)
        assert said == near.any()
        assert places[3, first:last] == pytest.approx(d2, abs=1e-12)
        found += said
        if first < last:
            radii[first + k % (last - first)] = np.nan  # no number is near
            assert any_at_box(places, first, last, box, radii, speed, share)
    assert 50 < found < 190


def last_body(small_map):
    """Return arm, radii and clearance of a map, the last body and its spheres."""
    arm, radii, work = small_map.arm, small_map.swept_radii(), work_of(small_map)
    b = len(arm.body_ptr) - 2
    part = slice(int(arm.body_ptr[b]), int(arm.body_ptr[b + 1]))
    work.body_radius[b] = radii[part].max()
    return arm, radii, Clearance(arm, radii, radii, 0.01, work), b, part


def test_a_body_at_a_place_is_judged_as_by_each_point(small_map, rng):
    """0 free, 1 open, 2 blocked; also which sphere and point are told."""
    arm, radii, clearance, b, part = last_body(small_map)
    work = clearance.work
    counted = np.zeros(3, np.int64)
    for _ in range(400):
        R = Rotation.random(random_state=rng).as_matrix()
        frame = np.array([*R.ravel(), *rng.uniform(-0.4, 0.4, 3)])
        work.speed[part] = rng.uniform(0.0, 0.3)
        work.body_speed[b] = work.speed[part].max()
        points = frame[9:] + rng.normal(size=(rng.integers(1, 12), 3)) * 0.15
        if rng.random() < 0.6:  # blocks of many points, which are measured at once
            points = np.repeat(points[:5], 40, axis=0)
            points += rng.uniform(-0.01, 0.01, points.shape)
        points = points[occupied_mask(small_map, points)]
        cloud = cloud_of(small_map, points)
        said = body_at(clearance, b, frame, 0.5, cloud, False)
        at = arm.spheres[part, :3] @ R.T + frame[9:]
        gaps = np.linalg.norm(points[None] - at[:, None], axis=2) - radii[part, None]
        near = (gaps < 0.5 * work.speed[part, None]).any()
        want = 2 if (gaps < 0.0).any() else int(near)
        assert said == want
        counted[said] += 1
        if said == 2:
            i, p = work.found[:2]
            blocked = gaps[i - part.start] < 0.0
            mine = np.flatnonzero(blocked)
            assert blocked[p] and work.value[1] < radii[i]
            block = small_map.grid.locate(points) // 4
            same = (block[mine] == block[p]).all(axis=1)
            assert p == mine[same].min()  # the first one of its block
    assert counted.min() > 40


def test_points_beside_a_chord_are_found_as_one_by_one(rng):
    xyz = rng.uniform(-1.0, 1.0, (50, 3))
    for k in range(60):
        a, b = rng.uniform(-1.0, 1.0, (2, 3))
        if k % 10 == 0:
            b = a  # a place
        begin, end = (0, 50) if k % 3 else (11, 38)
        w, d = xyz[begin:end] - a, b - a
        along = np.clip(w @ d / max(d @ d, 1e-30), 0.0, 1.0)
        d2 = ((w - along[:, None] * d) ** 2).sum(axis=1)
        for far2 in (0.0, d2.min() * 0.999, d2.min() * 1.001, 0.5):
            said = any_beside(xyz, begin, end, (tuple(a), tuple(b)), far2)
            assert said == (d2 < far2).any()
    lost = (np.nan, 0.0, 0.0)
    assert any_beside(xyz, 0, 50, (lost, lost), 1e-6)


def test_a_body_is_as_wide_and_as_fast_as_its_widest_and_fastest_sphere(small_map, rng):
    arm, work = small_map.arm, work_of(small_map)
    for _ in range(20):
        radii, bare = rng.uniform(0.01, 0.2, (2, len(arm.spheres)))
        clearance = Clearance(arm, radii, bare, 0.01, work)
        assert prepare_motion(clearance, rng.normal(size=small_map.robot.dof))
        for of_body, of_sphere in (
            (work.body_radius, radii),
            (work.body_bare, bare),
            (work.body_speed, work.speed),
            (work.body_bend, work.bend),
        ):
            parts = zip(arm.body_ptr[:-1], arm.body_ptr[1:], strict=True)
            most = [of_sphere[a:b].max(initial=0.0) for a, b in parts]
            assert of_body.tolist() == most


def test_a_chord_sees_the_points_near_all_of_it(small_map, rng):
    """However far its ends are from its middle, which is what blocks are listed by."""
    arm, radii, clearance, b, part = last_body(small_map)
    work = clearance.work
    free = blocked = 0
    for _ in range(300):
        R = Rotation.random(random_state=rng).as_matrix()
        begin, d = rng.uniform(-0.4, 0.4, 3), rng.uniform(0.0, 0.8) * unit(rng)
        for k, share in enumerate((0.5, 0.0, 1.0)):
            work.frames[k, b] = [*R.ravel(), *(begin + share * d)]
        work.body_speed[b], sag = np.linalg.norm(d), rng.choice([0.0, 0.01, 0.1])
        work.bend[:] = work.body_bend[:] = 8.0 * sag
        points = begin + rng.uniform(-0.3, 1.3, (rng.integers(1, 40), 1)) * d
        points += rng.normal(size=points.shape) * rng.choice([0.15, 0.4])
        if rng.random() < 0.5:  # blocks of many points, which are measured at once
            points = np.repeat(points[:4], 50, axis=0)
            points += rng.uniform(-0.005, 0.005, points.shape)
        f, g = work.frames[1, b], work.frames[2, b]
        points = points[occupied_mask(small_map, points)]
        said = body_chord(clearance, b, f, g, 1.0, cloud_of(small_map, points), False)
        at = arm.spheres[part, :3] @ R.T + begin
        w = points[None] - at[:, None]
        along = np.clip(w @ d / (d @ d), 0.0, 1.0)
        gaps = np.linalg.norm(w - along[..., None] * d, axis=2)
        assert said == (gaps >= radii[part, None] + sag).all()
        free, blocked = free + said, blocked + (not said)
    assert free > 50 < blocked


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def test_the_separation_is_that_of_the_nearest_point_and_sphere(
    small_map, planner, rng
):
    arm, work = small_map.arm, work_of(small_map)
    for spacing in (0.05, 0.008):
        for _ in range(20):
            q = draw_valid(planner, rng)
            points = odm.sample_capsules(draw_arm(rng), spacing)
            cloud = cloud_of(small_map, points[occupied_mask(small_map, points)])
            there = cloud.xyz[: cloud.counts[N_INSIDE]]
            at = centers(arm, small_map.robot, q)
            gaps = np.linalg.norm(at[:, None] - there[None], axis=2)
            gaps -= arm.spheres[:, 3:]
            for limit in (np.inf, 0.1, float(gaps.min()) - 1e-6):
                said = close.separation(arm, q, cloud, NO_SOLIDS, limit, work)
                if limit < gaps.min():
                    assert said == limit and work.found[0] == -1
                    continue
                assert said == pytest.approx(min(limit, gaps.min()), abs=1e-9)
                if said < limit:
                    i, p = work.found[:2]
                    k = np.flatnonzero(cloud.order[: len(there)] == p)[0]
                    assert gaps[i, k] == pytest.approx(gaps.min(), abs=1e-9)


def test_what_is_called_blocked_comes_within_the_tolerance(small_map, planner, rng):
    keep = small_map.safety.rho + small_map.safety.m
    blocked = 0
    for _ in range(60):
        q = draw_valid(planner, rng)
        dq = difference(small_map.robot, q, draw_valid(planner, rng))
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        points = points[occupied_mask(small_map, points)]
        work = work_of(small_map)
        if not is_clear(small_map, points, q, dq, work=work):
            blocked += 1
            sag = close.FINE_SAG + 1e-6
            assert smallest_gap(small_map, q, dq, points, 400) <= keep + 10 * sag
            assert 0 <= work.found[1] < len(points)
    assert blocked > 10


def test_what_cells_call_free_the_close_test_calls_free(small_map, rng):
    roadmap, agreed = small_map.roadmap, 0
    for _ in range(60):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        occupied = occupied_cells(small_map, points)
        for edge in rng.choice(roadmap.n_edges, 6, replace=False):
            if edge_cells(small_map, edge) & occupied:
                continue
            agreed += 1
            a, b = roadmap.edges[edge]
            q = roadmap.nodes[a]
            dq = difference(small_map.robot, q, roadmap.nodes[b])
            assert is_clear(small_map, points, q, dq)
    assert agreed > 60


def test_points_that_graze_the_boundary_of_the_cells_pass_the_close_test(
    small_map, rng
):
    # one point in the middle of a free cell right next to a swept one
    roadmap, grid = small_map.roadmap, small_map.grid
    for edge in rng.choice(roadmap.n_edges, 20, replace=False):
        swept = edge_cells(small_map, edge)
        cell = next(iter(sorted(swept)))
        while cell in swept:
            cell = (cell[0] - 1, cell[1], cell[2])
        corner = grid.origin + grid.h * (np.array(cell) + [0.999999, 0.5, 0.5])
        a, b = roadmap.edges[edge]
        q = roadmap.nodes[a]
        dq = difference(small_map.robot, q, roadmap.nodes[b])
        assert is_clear(small_map, corner[None], q, dq)


def test_one_more_point_never_frees_a_motion(small_map, planner, rng):
    for _ in range(40):
        q = draw_valid(planner, rng)
        dq = difference(small_map.robot, q, draw_valid(planner, rng))
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        few = points[rng.random(len(points)) < 0.5]
        assert is_clear(small_map, few, q, dq) or not is_clear(small_map, points, q, dq)


def test_an_escape_never_brings_a_sphere_nearer_to_a_near_point(
    small_map, planner, rng
):
    arm, robot = small_map.arm, small_map.robot
    keep = small_map.swept_radii()
    escaped = 0
    for _ in range(200):
        q = draw_valid(planner, rng)
        work = work_of(small_map)
        close.place_anchor(arm, q, work)
        now = work.anchor.copy()
        # a point that leans on a sphere of the arm
        i = int(rng.integers(len(now)))
        side = rng.normal(size=3)
        point = now[i] + side / np.linalg.norm(side) * (arm.spheres[i, 3] + 0.005)
        dq = rng.uniform(-0.4, 0.4, robot.dof)
        if not is_clear(small_map, point[None], q, dq, True, work):
            continue
        escaped += 1
        before = np.linalg.norm(now - point, axis=1)
        for t in np.linspace(0, 1, 80):
            close.place_anchor(arm, q + t * dq, work)
            gap = np.linalg.norm(work.anchor - point, axis=1)
            least = np.minimum(keep, before - close.ESCAPE_SLACK)
            assert (gap >= least - 1e-9).all()
    assert escaped > 5


def test_separation_is_the_smallest_distance_of_cover_and_points(
    small_map, planner, rng
):
    for _ in range(20):
        q = draw_valid(planner, rng)
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.step(points, q=q)
        want = smallest_gap(small_map, q, np.zeros_like(q), points, 1)
        got = planner.separation(q)
        assert got == want or abs(got - want) < 1e-9


def test_what_is_outside_the_grid_is_kept_off_as_well(small_map, planner, rng):
    grid, kept = small_map.grid, small_map.safety.rho + small_map.safety.m
    for k in range(60):
        points = rng.uniform(grid.origin - 0.2, grid.upper + 0.2, (6, 3))
        points = points[~occupied_mask(small_map, points)]
        q, still = draw_valid(planner, rng), np.zeros(3)
        planner.step(odm.Obstacles(points=points), q=q)  # no point of it has a cell
        gap = smallest_gap(small_map, q, still, points, 1)
        assert planner.separation(q) == pytest.approx(gap, abs=1e-9)
        planner.set_extra_clearance((0.0, 0.05)[k % 2])  # those near it have one now
        assert planner.separation(q) == pytest.approx(gap, abs=1e-9)
        left = gap - kept - planner.extra
        for extra in (0.0, 0.99 * left, 1.01 * left):
            assert planner.stands_clear(q, max(0.0, extra)) == (extra <= left)
        planner.set_extra_clearance(0.0)
