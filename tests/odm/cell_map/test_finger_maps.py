"""Fingers travel in maps unless told not to; old maps mean what they meant."""

import json
from dataclasses import replace

import numpy as np
import pytest

import odm
from odm.audit.audit import audit
from odm.cell_map.recipe import Recipe, RobotRecipe, load_recipe
from odm.close_test.safety import Safety
from odm.exact.distances import ExactRobot, obstacles_of
from roadmap import load_robot
from roadmap.builds.store import read_folder
from roadmap.errors import BuildRefused
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import difference
from sim.run.folders import check_map_folder

URDF = """<robot name="pincer">
<link name="base"><collision><geometry><sphere radius="0.04"/></geometry></collision>
</link>
<link name="arm"><collision><origin xyz="0.15 0 0"/><geometry>
<box size="0.24 0.05 0.05"/></geometry></collision></link>
<link name="upper"><collision><origin xyz="0.03 0 0"/><geometry>
<box size="0.06 0.02 0.02"/></geometry></collision></link>
<link name="lower"><collision><origin xyz="0.03 0 0"/><geometry>
<cylinder radius="0.01" length="0.06"/></geometry></collision></link>
<link name="tool"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="bend" type="revolute"><parent link="arm"/><child link="upper"/>
<origin xyz="0.27 0.02 0"/><axis xyz="0 0 1"/>
<limit lower="-0.4" upper="1" velocity="1" effort="1"/></joint>
<joint name="curl" type="revolute"><parent link="upper"/><child link="lower"/>
<origin xyz="0.06 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/>
<mimic joint="bend" multiplier="-0.8" offset="0.1"/></joint>
<joint name="t" type="fixed"><parent link="arm"/><child link="tool"/>
<origin xyz="0.32 0 0"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def recipe(tmp_path_factory):
    path = tmp_path_factory.mktemp("pincer") / "pincer.urdf"
    path.write_text(URDF)
    robot = RobotRecipe(str(path), tip="tool")
    settings = RoadmapSettings(nodes=30, neighbors=4)
    return Recipe("pincer", robot, settings, Safety(h=0.04))


@pytest.fixture(scope="module")
def whole(recipe):
    return odm.build_map(recipe)


def still(recipe: Recipe) -> Recipe:
    return replace(recipe, robot=replace(recipe.robot, travel=()))


def test_a_free_edge_is_free_for_every_opening(recipe, whole, rng):
    assert "held over the whole travel of bend" in whole.robot.notes
    planner, roadmap = odm.ReactivePlanner(whole), whole.roadmap
    opened = [
        ExactRobot(
            load_robot(recipe.robot.source, tip="tool", locked={"bend": float(v)})
        )
        for v in (-0.4, 1.0, *rng.uniform(-0.4, 1.0, 2))
    ]
    ends, near = roadmap.nodes[roadmap.edges], 0
    for _ in range(60):
        angle, T = rng.uniform(-2, 2), np.eye(4)
        T[:2, 3] = rng.uniform(0.28, 0.45) * np.array([np.cos(angle), np.sin(angle)])
        ball = odm.Sphere(0.02, T)
        planner.step(odm.surface_of(ball, 0.03).points, np.zeros(1))
        free = np.setdiff1d(np.arange(roadmap.n_edges), planner.invalid_edges())
        for edge in rng.permutation(free)[:10]:
            q = ends[edge, 0] + rng.random() * difference(whole.robot, *ends[edge])
            for exact in opened:
                gap = exact.distance(q, obstacles_of([ball])).distance
                assert gap >= whole.safety.m
                near += gap < 0.15
    assert near > 30


def test_the_audit_finds_no_false_free(whole):
    assert audit(whole, pairs=3000, seed=2, threads=1).violations == 0


def test_a_new_map_says_that_fingers_travel(recipe, whole, tmp_path):
    folder = whole.save(tmp_path / "map")
    assert read_folder(folder)[0]["recipe"]["robot"]["travel"] == "auto"
    loaded = odm.load_map(folder)
    assert loaded.recipe == recipe and loaded.recipe.robot.travel is None
    check_map_folder(folder, recipe, force=False)


def test_an_old_map_has_fingers_that_stand_still(recipe, tmp_path):
    """What a map says that was built before fingers could travel: nothing."""
    folder = odm.build_map(still(recipe)).save(tmp_path / "map")
    assert (
        "travel"
        not in json.loads((folder / "manifest.json").read_text())["recipe"]["robot"]
    )
    loaded = odm.load_map(folder)
    assert loaded.recipe.robot.travel == ()
    assert loaded.recipe == still(recipe) and loaded.recipe != recipe
    assert any("bend = 0" in note for note in loaded.robot.notes)
    # stored again, or built again from what it says, it is the same map
    assert odm.load_map(loaded.save(tmp_path / "copy")).hash == loaded.hash
    again = odm.build_map(loaded.recipe).save(tmp_path / "again")
    assert odm.load_map(again).hash == loaded.hash
    check_map_folder(folder, still(recipe), force=False)
    with pytest.raises(BuildRefused, match="holds the map of another recipe"):
        check_map_folder(folder, recipe, force=False)


def test_recipes_of_the_package_leave_it_to_the_gripper():
    for name in ("panda", "demo", "panda_carry", "rail_arm"):
        assert load_recipe(name).robot.travel is None
