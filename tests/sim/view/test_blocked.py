"""What the page paints red is what the planner calls blocked."""

import numpy as np
from recorded import NEAR

from odm import ReactivePlanner, sample_capsules
from sim.people.human_motion import make_motion
from sim.view.blocked import (
    SPACING,
    RoadmapPicture,
    cell_centers,
    occupied_cells,
    seen_points,
)


def test_blocked_edges_are_the_planners(view_map):
    picture, planner = RoadmapPicture(view_map), ReactivePlanner(view_map)
    planner.set_goals([view_map.roadmap.nodes[0]])
    motion, some = make_motion("sweep", 0, NEAR), 0
    for t in np.linspace(0.0, 4.0, 9):
        capsules = motion.capsules(t)
        points = sample_capsules(capsules, SPACING)
        planner.step(points, q=view_map.roadmap.nodes[1], covering_radius=0.03)
        cells = occupied_cells(view_map.grid, seen_points(capsules, None))
        found = np.flatnonzero(picture.blocked(cells))
        np.testing.assert_array_equal(found, planner.invalid_edges())
        some += len(found)
    assert some > 0


def test_nobody_blocks_nothing_and_points_outside_the_grid_are_no_cells(view_map):
    grid = view_map.grid
    far = np.array([[1e3, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    with np.errstate(invalid="ignore"):
        cells = occupied_cells(grid, seen_points(np.zeros((0, 7)), far))
    assert len(cells) == 0
    assert not RoadmapPicture(view_map).blocked(cells).any()


def test_a_cells_centre_lies_in_it(view_map):
    grid = view_map.grid
    points = np.random.default_rng(0).uniform(grid.origin, grid.upper, (200, 3))
    cells = occupied_cells(grid, points)
    np.testing.assert_array_equal(grid.locate(cell_centers(grid, cells)), cells)
