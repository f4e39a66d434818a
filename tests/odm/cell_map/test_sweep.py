"""Cells that nodes and edges sweep: against the definition, point by point."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_cells import cells_near_ball, centers, edge_cells, item_cells, words_to_cells
from small import small_recipe
from wrappers import with_wrapper

import odm
from odm.cell_map import _sweep as sweep
from odm.cell_map.cell_map import ROUNDING
from odm.cell_map.sweep import sweep_roadmap
from odm.obstacles.grid import grid_for
from roadmap.kinematics.forward import difference

mark_ball = with_wrapper(sweep.mark_ball)


@settings(deadline=None, max_examples=60)
@given(
    st.tuples(*[st.floats(0.3, 0.7)] * 3), st.floats(0.001, 0.28), st.floats(0.01, 0.09)
)
def test_a_ball_marks_exactly_the_cells_it_comes_near(center, radius, h):
    blocks = np.full(3, int(np.ceil(1.0 / (4 * h))))
    origin = np.zeros(3)
    words = np.zeros(blocks.prod(), np.uint64)
    grid = sweep.Grid(origin, h, blocks)
    assert mark_ball(np.array(center), radius, grid, words)
    ids = np.flatnonzero(words)
    found = words_to_cells(ids, words[ids], blocks)
    sure = cells_near_ball(center, radius - 1e-9, origin, h, blocks)
    most = cells_near_ball(center, radius + 1e-9, origin, h, blocks)
    assert sure <= found <= most


def test_a_ball_that_leaves_the_grid_is_reported():
    words = np.zeros(8, np.uint64)
    grid = sweep.Grid(np.zeros(3), 0.1, np.full(3, 2))
    for center in ([0.0, 0.4, 0.4], [0.4, 0.79, 0.4], [0.4, 0.4, 0.75]):
        assert not mark_ball(np.array(center), 0.06, grid, words)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_ball_that_is_nowhere_is_reported_and_marks_nothing(bad):
    words = np.zeros(8, np.uint64)
    grid = sweep.Grid(np.zeros(3), 0.1, np.full(3, 2))
    for axis in range(3):
        center = np.full(3, 0.4)
        center[axis] = bad
        assert not mark_ball(center, 0.06, grid, words)
    assert not mark_ball(np.full(3, 0.4), bad if bad > 0.0 else np.nan, grid, words)
    assert not words.any()


def test_a_node_sweeps_exactly_the_cells_near_its_spheres(small_map):
    radii = small_map.swept_radii() + ROUNDING
    grid = small_map.grid
    for node in (0, 17, 80):
        q = small_map.roadmap.nodes[node]
        want = set()
        for c, r in zip(centers(small_map.arm, small_map.robot, q), radii, strict=True):
            want |= cells_near_ball(c, r, grid.origin, grid.h, grid.blocks)
        assert item_cells(small_map, node) == want


def test_an_edge_sweeps_every_cell_near_its_spheres_anywhere_on_it(small_map, rng):
    radii = small_map.swept_radii()
    grid, roadmap = small_map.grid, small_map.roadmap
    for edge in rng.choice(roadmap.n_edges, 4, replace=False):
        swept = edge_cells(small_map, edge)
        a, b = roadmap.edges[edge]
        q = roadmap.nodes[a]
        dq = difference(small_map.robot, q, roadmap.nodes[b])
        for t in rng.random(6):
            placed = centers(small_map.arm, small_map.robot, q + t * dq)
            for c, r in zip(placed, radii, strict=True):
                near = cells_near_ball(c, r, grid.origin, grid.h, grid.blocks)
                assert near <= swept


def test_an_edge_is_inflated_by_no_more_than_half_of_mu(small_map, rng):
    roadmap, grid = small_map.roadmap, small_map.grid
    radii = small_map.swept_radii() + small_map.motion_tolerance + 2 * ROUNDING
    edge = int(rng.integers(roadmap.n_edges))
    a, b = roadmap.edges[edge]
    q = roadmap.nodes[a]
    dq = difference(small_map.robot, q, roadmap.nodes[b])
    reached = set()
    for t in np.linspace(0, 1, 257):  # the finest samples a sweep can take
        placed = centers(small_map.arm, small_map.robot, q + t * dq)
        for c, r in zip(placed, radii, strict=True):
            reached |= cells_near_ball(c, r, grid.origin, grid.h, grid.blocks)
    assert edge_cells(small_map, edge) <= reached


@pytest.mark.parametrize("term", ["rho", "user"])
def test_a_larger_term_never_takes_volume_away(small_map, term):
    safety = small_map.safety
    wider = replace(safety, **{term: getattr(safety, term) + 0.015})
    grid = grid_for(small_map.robot, safety.h, 0.2)
    lists = [
        sweep_roadmap(small_map.robot, small_map.arm, small_map.roadmap, grid, s)
        for s in (safety, wider)
    ]
    for edge in range(0, small_map.roadmap.n_edges, 23):
        less, more = (
            edge_cells(replace(small_map, grid=grid, arm_cells=cells), edge)
            for cells in lists
        )
        assert less <= more


@pytest.mark.parametrize("threads", [2, 3])
def test_the_same_bytes_come_out_for_any_number_of_threads(small_map, threads):
    other = odm.build_map(small_recipe(), threads=threads, robot=small_map.robot)
    for name, array in small_map.arm_cells.arrays().items():
        assert np.array_equal(array, other.arm_cells.arrays()[name]), name
    for name, array in small_map.roadmap.arrays().items():
        assert np.array_equal(array, other.roadmap.arrays()[name]), name
