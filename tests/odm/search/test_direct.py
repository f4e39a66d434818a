"""The direct map: the same answer by changes, from scratch, and by the lazy view."""

import numpy as np
from naive_cells import free_items
from small import draw_arm

import odm


def test_the_direct_map_agrees_with_the_definition(small_map, planner, rng):
    for _ in range(12):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.step(points, q=np.zeros(small_map.robot.dof))
        nodes, edges = free_items(small_map, points)
        assert np.array_equal(planner.invalid_nodes(), np.flatnonzero(~nodes))
        assert np.array_equal(planner.invalid_edges(), np.flatnonzero(~edges))


def test_by_changes_and_from_scratch_are_equal_over_a_motion(small_map, planner, rng):
    arm, q = draw_arm(rng), np.zeros(small_map.robot.dof)
    other = odm.ReactivePlanner(small_map)
    for k in range(60):
        arm = arm.copy()
        arm[:, :6] += np.tile(rng.normal(scale=0.01, size=3), 2)
        points = odm.sample_capsules(arm, 0.03)
        planner.step(points, q=q)
        other.step(points, q=q)
        other.direct.clear()
        assert np.array_equal(planner.invalid_edges(), other.invalid_edges()), k
        assert np.array_equal(planner.invalid_nodes(), other.invalid_nodes()), k


def test_marking_then_clearing_restores_everything(small_map, planner, rng):
    q = np.zeros(small_map.robot.dof)
    planner.step(odm.sample_capsules(draw_arm(rng), 0.03), q=q)
    planner.invalid_edges()
    planner.step(np.zeros((0, 3)), q=q)
    assert len(planner.invalid_edges()) == len(planner.invalid_nodes()) == 0
    assert not planner.memory.cloud.words.any()
    counted = planner.memory.direct
    assert not counted.hits.any()
    assert not counted.seen.any()
    assert not counted.bits.any()


def test_one_more_point_never_frees_an_edge(small_map, planner, rng):
    q = np.zeros(small_map.robot.dof)
    for _ in range(20):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.step(points[::2].copy(), q=q)
        few = planner.invalid_edges()
        planner.step(points, q=q)
        assert np.isin(few, planner.invalid_edges()).all()


def test_the_order_of_the_points_changes_nothing(small_map, planner, rng):
    q, goal = np.array([1.0, 0.5, 0.0]), np.array([-1.0, -0.5, 0.5])
    planner.set_goals([goal])
    for _ in range(15):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        first = planner.step(points, q=q)
        edges = planner.invalid_edges()
        second = planner.step(rng.permutation(points), q=q)
        assert np.array_equal(edges, planner.invalid_edges())
        assert first.status.replace("replanned", "following") == second.status.replace(
            "replanned", "following"
        )
        assert np.array_equal(first.path, second.path)


def test_the_two_views_hold_the_same_entries(small_map):
    own, (t_ptr, t_item, t_mask) = (
        small_map.arm_cells.by_item,
        small_map.arm_cells.by_block,
    )
    item = np.repeat(np.arange(len(own.ptr) - 1), np.diff(own.ptr))
    block = np.repeat(np.arange(len(t_ptr) - 1), np.diff(t_ptr))
    here = sorted(zip(item, own.block, own.mask, strict=True))
    there = sorted(zip(t_item, block, t_mask, strict=True))
    assert len(here) == len(there)
    assert all(a == b for a, b in zip(here, there, strict=True))
