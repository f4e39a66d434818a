"""More distance at run time: dilated cells and larger radii, never anything freed."""

import numpy as np
import pytest
from naive_cells import cells_near_ball, free_items, item_cells
from small import HOME, NOBODY, ball_at, draw_arm, draw_valid

import odm
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from odm.obstacles import _occupancy as occupancy
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference

EXTRAS = (0.0, 0.004, 0.02, 0.05, 0.12)


def marked(grid, points, extra):
    cloud = grid.new_cloud(len(points))
    occupancy.mark_points(points, cloud)
    occupancy.dilate_points(points, extra, cloud)
    occupancy.sort_points(points, cloud)
    return cloud


def cells_of(cloud, grid):
    found = set()
    for b in cloud.occupied[: cloud.counts[0]]:
        nx, ny, nz = (int(v) for v in grid.blocks)
        at = np.array([b // (ny * nz), b // nz % ny, b % nz])
        for k in range(64):
            if int(cloud.words[b]) >> k & 1:
                found.add(tuple((4 * at + [k >> 4, k >> 2 & 3, k & 3]).tolist()))
    return found


@pytest.mark.parametrize("extra", EXTRAS[1:])
def test_the_cells_are_those_near_a_point(small_map, rng, extra):
    grid = small_map.grid
    points = rng.uniform(grid.origin - 0.1, grid.upper + 0.1, (60, 3))
    cloud = marked(grid, points, extra)
    sure, most = set(), set()
    for p in points:
        sure |= cells_near_ball(p, extra - 1e-7, grid.origin, grid.h, grid.blocks)
        most |= cells_near_ball(p, extra + 1e-7, grid.origin, grid.h, grid.blocks)
    assert sure <= cells_of(cloud, grid) <= most


def test_a_point_just_outside_the_grid_counts_as_inside(small_map):
    grid = small_map.grid
    points = np.array([grid.upper + [0.01, -0.3, -0.3], grid.upper + [0.09, 0, 0]])
    cloud = marked(grid, points, 0.05)
    assert cloud.counts[1:3].tolist() == [1, 1]
    assert np.array_equal(cloud.xyz[0], points[0])


def test_a_larger_clearance_never_frees_anything(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    grown = 0
    for _ in range(12):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        q_a, q_b = draw_valid(planner, rng), draw_valid(planner, rng)
        nodes = edges = np.zeros(0, int)
        free = True
        for extra in EXTRAS:
            planner.set_extra_clearance(extra)
            planner.step(points, HOME)
            more_nodes, more_edges = planner.invalid_nodes(), planner.invalid_edges()
            assert np.isin(nodes, more_nodes).all()
            assert np.isin(edges, more_edges).all()
            grown += len(more_edges) - len(edges) if extra else 0
            nodes, edges = more_nodes.copy(), more_edges.copy()
            now = bool(planner.is_free(q_a, q_b))
            assert free or not now
            free = now
    assert grown > 100


def test_no_extra_clearance_is_the_map_itself(small_map, rng):
    planner, plain = (odm.ReactivePlanner(small_map) for _ in range(2))
    planner.set_extra_clearance(0.1)
    planner.set_extra_clearance(0.0)
    points = odm.sample_capsules(draw_arm(rng), 0.03)
    for p in (planner, plain):
        p.set_goals([-HOME])
    one, other = (p.step(points, HOME) for p in (planner, plain))
    assert one.path.tobytes() == other.path.tobytes()
    nodes, edges = free_items(small_map, points)
    assert np.array_equal(planner.invalid_nodes(), np.flatnonzero(~nodes))
    assert np.array_equal(planner.invalid_edges(), np.flatnonzero(~edges))


@pytest.mark.parametrize("extra", [0.02, 0.08])
def test_what_is_free_keeps_that_much_more(small_map, rng, extra):
    """Exact solids and python-fcl: edges by cells, motions by the close test."""
    settings = odm.PlannerSettings(extra_clearance=extra)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    robot, roadmap = small_map.robot, small_map.roadmap
    exact, fcl = ExactRobot(robot), FclRobot(robot)
    need = small_map.safety.m + extra
    ends = roadmap.nodes[roadmap.edges]
    near = tried = 0
    for _ in range(25):
        arm = draw_arm(rng)
        shapes = [odm.Capsule.between(r[:3], r[3:6], r[6]) for r in arm]
        obstacles = obstacles_of(shapes)
        grown = [odm.Capsule.between(r[:3], r[3:6], r[6] + need) for r in arm]
        fcl.set_obstacles(grown)
        planner.step(odm.sample_capsules(arm, 0.03), HOME)
        open_ = np.setdiff1d(np.arange(roadmap.n_edges), planner.invalid_edges())
        pairs = [ends[e] for e in rng.permutation(open_)[:25]]
        for _ in range(25):
            q_a = draw_valid(planner, rng)
            q_b = q_a + 0.3 * difference(robot, q_a, draw_valid(planner, rng))
            if planner.is_free(q_a, q_b):
                pairs.append((q_a, q_b))
        for q_a, q_b in pairs:
            q = q_a + rng.random() * difference(robot, q_a, q_b)
            gap = exact.distance(q, obstacles).distance
            assert gap >= need and not fcl.collides(q)
            near, tried = near + (gap < need + 0.1), tried + 1
    assert near > 20 and tried > 500


def test_paths_keep_it_too(small_map, rng):
    extra = 0.04
    need = small_map.safety.m + extra
    exact, moved = ExactRobot(small_map.robot), 0
    for seed in range(6):
        walk = np.random.default_rng(seed)
        settings = odm.PlannerSettings(extra_clearance=extra)
        planner = odm.ReactivePlanner(small_map, settings=settings)
        arm, q = draw_arm(walk), draw_valid(planner, walk)
        planner.set_goals([draw_valid(planner, walk) for _ in range(2)])
        for _ in range(25):
            arm = arm + np.array([0.006, -0.004, 0.0, 0.006, -0.004, 0.0, 0.0])
            shapes = [odm.Capsule.between(r[:3], r[3:6], r[6]) for r in arm]
            answer = planner.step(odm.sample_capsules(arm, 0.03), q)
            planner.improve()
            for a, b in list(zip(answer.path, answer.path[1:], strict=False))[:2]:
                dq = difference(small_map.robot, a, b)
                for t in (0.0, 0.4, 1.0):
                    assert exact.distance(a + t * dq, shapes).distance >= need
                moved += 1
            if len(answer.path) > 1:
                dq = difference(small_map.robot, *answer.path[:2])
                q = q + dq * min(1.0, 0.1 / max(np.abs(dq).max(), 1e-9))
    assert moved > 50


def test_braking_and_the_place_keep_it_too(small_map):
    planner = odm.ReactivePlanner(small_map)
    p = ExactRobot(small_map.robot).frames(HOME)[-1, 9:]
    points = ball_at(p + [0.0, 0.0, 0.25])
    planner.step(points, HOME)
    assert planner.blocked_leg(HOME[None]) is None and planner.is_free(HOME, HOME)
    planner.set_static(points)
    bare = planner.memory.graph.closed.sum()
    planner.set_extra_clearance(0.12)
    planner.step(points, HOME)
    assert planner.blocked_leg(HOME[None]) == 0
    assert planner.blocked_leg(HOME[None], points=points) == 0
    assert planner.memory.graph.closed.sum() > bare
    planner.step(NOBODY, HOME)
    assert "set by set_static" in planner.is_free(HOME, HOME).reason
    planner.set_extra_clearance(0.0)
    assert planner.memory.graph.closed.sum() == bare


@pytest.mark.parametrize("extra", [-0.01, 0.6, np.nan, np.inf])
def test_a_bad_clearance_is_refused(small_map, extra):
    planner = odm.ReactivePlanner(small_map)
    with pytest.raises(BadInput, match="extra clearance"):
        planner.set_extra_clearance(extra)
    with pytest.raises(BadInput, match="extra_clearance .m. is .* from 0 to 0.5"):
        odm.ReactivePlanner(
            small_map, settings=odm.PlannerSettings(extra_clearance=extra)
        )


def test_an_edge_is_blocked_from_the_cell_next_door(small_map):
    """A point in a cell that no edge sweeps blocks those that come within `extra`."""
    grid, planner = small_map.grid, odm.ReactivePlanner(small_map)
    swept = item_cells(small_map, 0)
    cell = next(c for c in sorted(swept) if (c[0] - 1, c[1], c[2]) not in swept)
    p = grid.origin + grid.h * (np.array(cell) + [-0.1, 0.5, 0.5])
    planner.step(p[None], HOME)
    before = 0 in planner.invalid_nodes()
    planner.set_extra_clearance(0.2 * grid.h)
    planner.step(p[None], HOME)
    assert not before and 0 in planner.invalid_nodes()


def test_a_shape_far_beside_the_grid_is_sampled_as_soon_as_it_may_count(planner):
    """Else one point stands for it, in no cell."""
    grid = planner.cell_map.grid
    corner = grid.upper + 0.25 / np.sqrt(3.0)  # 25 cm beyond it
    planner.step(odm.Obstacles(spheres=np.array([[*corner, 0.05]])), q=HOME)
    assert len(planner.points) == 1
    planner.set_extra_clearance(0.3)
    assert len(planner.points) > 1
