"""Pictures of a run where pybullet, or the robot's URDF, is not there."""

import sys
from dataclasses import replace

import pytest

from odm.cell_map.build import build_map
from odm.cell_map.recipe import Recipe, RobotRecipe
from roadmap.graph.connecting import RoadmapSettings
from sim.draw.cover_world import CoverWorld, open_world
from sim.run.request import RunRequest
from sim.run.runner import run


@pytest.fixture(scope="module")
def map_dir(crane_urdf, tmp_path_factory):
    recipe = Recipe(
        name="crane",
        robot=RobotRecipe(source=str(crane_urdf), tip="jib"),
        roadmap=RoadmapSettings(nodes=150, neighbors=8),
    )
    return build_map(recipe, threads=1).save(tmp_path_factory.mktemp("map") / "crane")


def test_without_pybullet_a_film_is_drawn_all_the_same_and_says_how(
    map_dir, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    run(RunRequest(map_dir, "reach", seconds=0.6, out=tmp_path / "new"))
    for ending in (".gif", "_latency.png", ".json"):
        assert (tmp_path / "new" / f"reach{ending}").stat().st_size > 500
    assert "sphere cover" in (said := capsys.readouterr().out) and "3.11" in said


def test_the_world_is_the_plain_one_where_pybullet_is_missing(map_dir, monkeypatch):
    from odm.cell_map.cell_map import load_map

    monkeypatch.setitem(sys.modules, "pybullet", None)
    world, note = open_world(load_map(map_dir))
    assert isinstance(world, CoverWorld) and "pybullet is not installed" in note


def test_the_world_is_the_plain_one_where_the_urdf_is_gone(map_dir):
    from odm.cell_map.cell_map import load_map

    pytest.importorskip("pybullet")
    cell_map = load_map(map_dir)
    robot = replace(cell_map.recipe.robot, source="gone.urdf")
    moved = replace(cell_map, recipe=replace(cell_map.recipe, robot=robot))
    world, note = open_world(moved)
    assert isinstance(world, CoverWorld) and "'gone.urdf'" in note
