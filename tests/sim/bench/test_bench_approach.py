"""`odm bench approach` asks for approaches into bins; exact geometry checks them."""

from dataclasses import replace

import numpy as np

import odm
from sim.bench.core import approach


def test_a_short_run_finds_bins_with_2_cm_to_spare(tmp_path):
    recipe = odm.load_recipe("panda")
    few = replace(recipe.roadmap, nodes=300, neighbors=2)
    folder = odm.build_map(replace(recipe, roadmap=few)).save(tmp_path / "panda")
    result = approach.run(folder, short=True)
    found, fair, gap, clock = result["rows"]
    assert result["setup"]["poses"] == 3 and clock["n"] == 3
    assert found["value"] == fair["value"] == 100.0 and clock["asked"] == {"p99": 5000}
    assert 1.0 <= gap["value"] <= 2.5


def test_a_bin_keeps_its_distance_from_the_tools_links():
    planner = odm.ReactivePlanner(odm.build_map(_tiny()))
    robot = planner.robot
    q = planner.cell_map.roadmap.nodes[0]
    T = approach.tool_pose(robot, q)
    boards = approach.bin_around(robot, T, 0.03)
    own = robot.link_body[robot.solid_link] == robot.tip_body
    exact = approach.ExactRobot(robot)
    gap = exact.distance_of(own, np.array(q), approach.obstacles_of(boards)).distance
    assert len(boards) == 5 and 0.015 < gap <= 0.0301


def test_what_exact_geometry_allows_is_what_keeps_the_distance():
    planner = odm.ReactivePlanner(odm.build_map(_tiny()))
    robot, exact = planner.robot, approach.ExactRobot(planner.robot)
    T = approach.tool_pose(robot, np.array(planner.cell_map.roadmap.nodes[0]))
    boards = approach.bin_around(robot, T, 0.03)
    assert 0.0 < approach.largest_gap(planner, exact, T, boards) <= 0.0301
    inside = odm.Box(np.full(3, 0.02), T)  # in the hand: nothing can be allowed
    assert approach.largest_gap(planner, exact, T, [*boards, inside]) == 0.0


def _tiny():
    recipe = odm.load_recipe("panda")
    return replace(recipe, roadmap=replace(recipe.roadmap, nodes=20, neighbors=2))
