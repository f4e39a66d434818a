"""The recipes that ship: each names a known robot, and the odd ones build and hold."""

from dataclasses import replace

import numpy as np
import pytest
from robot_asked import motion_free

import odm
from odm.audit.audit import audit
from odm.cell_map.recipe import load_recipe, recipe_names
from roadmap import load_robot, robot_names
from roadmap.kinematics.forward import body_frames, difference
from roadmap.robot.known import known_robot


@pytest.fixture(scope="module")
def rail_map():
    """Return a little map of the arm on a rail."""
    recipe = load_recipe("rail_arm")
    settings = replace(recipe.roadmap, nodes=250, neighbors=6)
    robot = replace(recipe.robot, cover_excess=0.05)
    safety = replace(recipe.safety, h=0.06, mu=0.02)
    small = replace(recipe, robot=robot, roadmap=settings, safety=safety)
    return odm.build_map(small)


@pytest.mark.parametrize("name", recipe_names())
def test_a_recipe_names_a_known_robot_and_is_of_moderate_size(name):
    recipe = load_recipe(name)
    assert recipe.robot.source in robot_names()
    assert recipe.name == name
    assert recipe.roadmap.nodes <= (10_500 if recipe.robot.source == "panda" else 6_000)
    assert any(table["type"] == "plane" for table in recipe.scenery)


def test_every_robot_but_the_demo_s_stand_in_has_a_recipe():
    sources = {load_recipe(name).robot.source for name in recipe_names()}
    # agents of hand-over planning are told apart by posture and grasp, not by a recipe
    agents = {"crichton_left", "crichton_right", "drchubo_left", "drchubo_right"}
    agents |= {"person_left", "person_right"}
    assert sources == set(robot_names()) - {"plain_arm"} - agents


def test_the_weights_of_a_recipe_are_as_many_as_the_joints():
    for name in recipe_names():
        recipe = load_recipe(name)
        source = recipe.robot.source
        if recipe.roadmap.weights is None or known_robot(source).origin != "maps":
            continue
        robot = load_robot(source, locked=recipe.robot.locked, cover_excess=0.1)
        assert len(recipe.roadmap.weights) == robot.dof


def test_gross_motion_locks_the_wrist_onto_the_forearm():
    asked = load_recipe("kawasaki_fs003n_gross").robot
    robot = load_robot(asked.source, locked=asked.locked, cover_excess=0.1)
    assert robot.joint_names == ("joint1", "joint2", "joint3")
    bodies = dict(zip(robot.link_names, robot.link_body.tolist(), strict=True))
    wrist = {bodies[name] for name in ("elbow", "forearm", "wrist", "flange")}
    assert wrist == {3} and robot.tip_body == 3
    whole = load_robot("kawasaki_fs003n", cover_excess=0.1)
    q = np.array([0.4, 0.8, -0.5])
    frame = body_frames(whole, np.r_[q, 0, 0, 0])[-1] @ whole.T_body_tip
    own = body_frames(robot, q)[3] @ robot.T_body_tip
    np.testing.assert_allclose(own, frame, atol=1e-9)


def test_the_map_of_the_rail_arm_passes_a_short_audit(rail_map):
    report = audit(rail_map, pairs=6000, seed=3, threads=1)
    assert report.passed and report.violations == 0
    assert report.free_share > 0.3


def test_the_audit_of_the_rail_arm_would_see_a_wrong_cover(rail_map):
    report = audit(rail_map, pairs=6000, seed=3, threads=1, sabotage="rho")
    assert not report.passed


def test_edges_of_an_endless_joint_take_the_short_way_round(rail_map):
    robot, roadmap = rail_map.robot, rail_map.roadmap
    turn = int(np.flatnonzero(robot.continuous)[0])
    a, b = (roadmap.nodes[roadmap.edges[:, k]] for k in (0, 1))
    dq = difference(robot, a, b)
    over = np.abs(b - a)[:, turn] > np.pi
    assert over.any() and np.abs(dq[:, turn]).max() <= np.pi + 1e-12
    # what was proved free is the short way: halfway there the arm is near the seam
    for k in np.flatnonzero(over)[:5]:
        half = a[k] + dq[k] / 2
        assert abs(abs(half[turn]) - np.pi) < abs(dq[k, turn])
        assert motion_free(robot, a[k], b[k])[0]


def test_a_path_goes_over_the_seam_of_an_endless_joint(rail_map):
    planner = odm.ReactivePlanner(rail_map)
    start, goal = np.zeros(5), np.zeros(5)
    start[[1, 2, 3]], goal[[1, 2, 3]] = [3.0, 0.5, 0.8], [-3.0, 0.5, 0.8]
    planner.set_goals([goal])
    answer = planner.step(np.zeros((0, 3)), q=start)
    assert answer.status != "holding"
    steps = difference(rail_map.robot, answer.path[:-1], answer.path[1:])
    assert np.abs(steps[:, 1]).sum() < 1.0
