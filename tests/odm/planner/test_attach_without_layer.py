"""An object in the hand of a map without a payload layer: the close test alone."""

import numpy as np
import pytest
import trimesh
from carrying import BALLS, HIGH, OVER, exact_gap
from small import HOME, NOBODY, draw_arm, draw_valid

import odm
from odm.exact.distances import ExactRobot, obstacles_of
from odm.execution.robot_spheres import RobotSpheres
from odm.obstacles.shapes import Capsule
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, tool_pose

STICK = odm.Cylinder(0.03, 0.3)


@pytest.fixture
def holding(small_map):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    planner.set_goals([OVER])
    planner.attach(BALLS)
    return planner


def test_every_leg_keeps_m_from_arm_and_object(small_map, holding, rng):
    robot, m, found = holding.carrier.robot, small_map.safety.m, 0
    exact = ExactRobot(robot)
    for _ in range(8):
        arm = [Capsule.between(c[:3], c[3:6], c[6]) for c in draw_arm(rng)]
        q = draw_valid(holding, rng)
        answer = holding.step(odm.Obstacles.of(arm), q=q)
        assert answer.held == "close test"
        if answer.status == "holding":
            continue
        assert answer.stage in ("straight", "search")
        found += 1
        around = obstacles_of(arm)
        for a, b in zip(answer.path, answer.path[1:], strict=False):
            assert exact_gap(robot, around, a, b) >= m
            for t in np.linspace(0.0, 1.0, 9):
                place = a + t * difference(robot, a, b)
                assert exact.self_distance(place).distance > 0.0
    assert found > 3


def test_it_is_told_and_ends_with_detach(small_map):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    planner.set_goals([OVER])
    assert planner.step(NOBODY, q=HIGH).held is None and planner.held_by is None
    planner.attach(STICK)
    assert planner.held_by == "close test"
    assert planner.step(NOBODY, q=HIGH).held == "close test"
    with pytest.raises(BadInput, match="attached already"):
        planner.attach(STICK)
    planner.detach()
    after = planner.step(NOBODY, q=HIGH)
    assert after.held is None and not planner.memory.graph.closed.any()


def test_no_item_passes_for_free_while_no_cells_know_what_is_held(small_map, holding):
    near = tool_pose(small_map.robot, HIGH) @ np.array([0.16, 0.0, 0.1, 1.0])
    for points in (NOBODY, near[None, :3]):
        holding.step(points, q=HIGH)
        assert len(holding.invalid_nodes()) == small_map.roadmap.n_nodes
        assert len(holding.invalid_edges()) == small_map.roadmap.n_edges
    holding.detach()
    holding.step(NOBODY, q=HIGH)
    assert not len(holding.invalid_nodes()) and not len(holding.invalid_edges())


def test_a_mesh_is_held(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([OVER])
    mesh = trimesh.creation.icosphere(1, 0.06)
    T = np.eye(4)
    T[0, 3] = 0.1
    planner.attach(odm.Mesh(mesh.vertices, mesh.faces), T)
    held = planner.step(NOBODY, q=HIGH)
    assert held.status == "replanned" and held.held == "close test"
    assert not planner.is_free(HOME, HOME)  # there it would be in the floor


def test_what_the_grid_does_not_see_is_not_entered(small_map):
    """A long stick reaches out of the grid, where points are not looked at."""
    planner = odm.ReactivePlanner(small_map)
    T = np.eye(4)
    T[0, 3] = 0.9
    planner.attach(odm.Sphere(0.05, T))
    grid, reached, refused = small_map.grid, 0, 0
    robot = planner.carrier.robot
    rng = np.random.default_rng(3)
    from roadmap.kinematics.forward import tool_pose

    for _ in range(200):
        q = rng.uniform(robot.lower, robot.upper)
        center = (tool_pose(robot, q) @ T)[:3, 3]
        side = np.minimum(center - grid.origin, grid.upper - center).min()
        why = planner.static.why(q, np.zeros_like(q))
        if side < 0.05 + small_map.safety.m + small_map.safety.rho:
            assert why is not None
            refused += "edge of the map's grid" in why
        else:
            reached += why is None
    assert refused > 10 and reached > 5


def test_without_a_search_nothing_would_be_left(small_map):
    settings = odm.PlannerSettings(search=0)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    with pytest.raises(BadInput, match="no payload layer, and search is 0"):
        planner.attach(STICK)
    assert planner.attached is None


def test_the_scene_holds_for_what_is_held(small_map):
    planner = odm.ReactivePlanner(small_map)
    from roadmap.kinematics.forward import tool_pose

    planner.set_goals([OVER])
    planner.attach(BALLS)
    path = planner.step(NOBODY, q=HIGH).path
    T = tool_pose(planner.robot, 0.5 * (path[0] + path[1]))
    T[:3, 3] += T[:3, :3] @ [0.24, 0.0, 0.0]
    planner.scene.add("on its way", odm.Sphere(0.06), T)  # of the object, not the arm
    assert not planner.is_free(path[0], path[1])
    after = planner.step(NOBODY, q=HIGH)
    for a, b in zip(after.path, after.path[1:], strict=False):
        assert planner.is_free(a, b)
    planner.scene.remove("on its way")
    T = tool_pose(planner.robot, HIGH)
    T[:3, 3] += T[:3, :3] @ [0.24, 0.0, 0.0]
    planner.scene.add("ball", odm.Sphere(0.06), T)
    assert "would touch ball" in planner.is_free(HIGH, HIGH).reason
    planner.detach()
    assert planner.is_free(HIGH, HIGH)
    planner.scene.test_waiting()
    closed = planner.memory.graph.closed.copy()
    planner.attach(BALLS)
    planner.detach()
    assert np.array_equal(planner.memory.graph.closed, closed)


def test_as_an_obstacle_of_another_robot_it_has_what_it_holds(small_map):
    planner = odm.ReactivePlanner(small_map)
    q, bare = small_map.roadmap.nodes[0], RobotSpheres(planner.static.robot)
    planner.attach(BALLS)
    spheres = RobotSpheres(planner.static.robot)
    assert len(spheres) == len(bare) + len(BALLS)
    held = BALLS[:, :3] @ tool_pose(planner.robot, q)[:3, :3].T
    held += tool_pose(planner.robot, q)[:3, 3]
    gaps = np.linalg.norm(spheres.at(q)[:, None, :3] - held, axis=2)
    assert np.allclose(gaps.min(axis=0), 0.0, atol=1e-9)
