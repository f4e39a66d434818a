"""The demo from a map to its pictures, with and without pybullet."""

import json
import sys
from dataclasses import replace

import pytest
from rich.console import Console

from odm.cell_map.build import build_map
from odm.cell_map.recipe import Recipe, RobotRecipe
from roadmap.graph.connecting import RoadmapSettings
from sim.draw.animation import FilmSettings
from sim.draw.cover_world import CoverWorld
from sim.run.demo import open_world, run_demo
from sim.run.places import DEMO

BRIEF = replace(DEMO, duration_s=2.0)
FILM = FilmSettings(width=160, height=120, frames=6)


@pytest.fixture(scope="module")
def map_dir(crane_urdf, tmp_path_factory):
    recipe = Recipe(
        name="crane",
        robot=RobotRecipe(source=str(crane_urdf), tip="jib"),
        roadmap=RoadmapSettings(nodes=150, neighbors=8),
    )
    return build_map(recipe, threads=1).save(tmp_path_factory.mktemp("map") / "crane")


def demo(map_dir, out):
    console = Console(width=140, record=True, file=open("/dev/null", "w"))
    files = run_demo(map_dir, out, "reach", BRIEF, FILM, console)
    return files, console.export_text()


def test_the_demo_writes_film_plot_and_figures_and_says_where(map_dir, tmp_path):
    pytest.importorskip("pybullet")
    files, text = demo(map_dir, tmp_path / "new" / "folder")
    for file in files.values():
        assert file.stat().st_size > 500 and str(file) in text
    assert json.loads(files["figures"].read_text())["motion"] == "reach"
    assert "contacts while moving" in text and "p99" in text


def test_without_pybullet_the_demo_goes_on_and_says_how(map_dir, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    files, text = demo(map_dir, tmp_path)
    assert files["film"].stat().st_size > 500
    assert "sphere cover" in text and "Python 3.11" in text


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
