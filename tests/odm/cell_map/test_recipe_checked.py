"""A mistake anywhere in a recipe is told when it is read, before the robot is."""

import pytest
from rows import each

import odm.cell_map.build
from odm import Recipe, load_recipe
from odm.cell_map.recipe import parse_recipe, recipe_of_map
from roadmap.errors import BadRecipe


@each(
    ("text", "words"),
    [
        ('[[scenery]]\ntype = "cone"', "choose one of"),
        ('[[scenery]]\ntype = ["box"]', "choose one of"),
        ('[[scenery]]\ntype = "box"\nsizes = [1, 1, 1]', "no key 'sizes'"),
        ('[[scenery]]\ntype = "box"\nsize = [1, 1]', "size"),
        ('[[scenery]]\ntype = "plane"\nnormal = [0, 0, 0]', "no direction"),
        ('[[scenery]]\ntype = "mesh"\nfile = "gone.stl"', "gone.stl"),
        ('[[scenery]]\ntype = "mesh"\nfile = 3', "scenery 0"),
        ('[scenery]\ntype = "plane"', "scenery"),
        ('scenery = ["plane"]', "scenery 0"),
        ('robot = "panda"', "robot is 'panda'"),
        ("[robot]\nsource = 3", "robot.source is 3"),
        ("[robot]\ntip = true", "robot.tip is True"),
        ("[robot]\nlocked = 3", "robot.locked is 3"),
        ('[robot.locked]\nj = "open"', "robot.locked.j is 'open'"),
        ("[robot.velocity]\nj = nan", "robot.velocity.j is nan"),
        (f"[robot.locked]\nj = 1{400 * '0'}", "must be a finite number"),
        (f"[roadmap]\nweights = [1{400 * '0'}]", "roadmap.weights is"),
        (f"[payload]\nradius = 1{400 * '0'}", "payload.radius is"),
        ("[roadmap]\nweights = 3", "roadmap.weights is 3"),
        ("name = 3", "name is 3"),
        ('name = "arm"', "names no robot; write [robot] with source"),
        ('[robot]\ntip = "hand"', "names no robot"),
        ('[robot]\nurdf = "arm.urdf"', "did you mean 'source'"),
        ('name = ""\n[robot]\nsource = "panda"', "name is ''"),
        ('name = "../x"\n[robot]\nsource = "panda"', "without '/'"),
    ],
)
def test_a_mistake_is_told_when_the_recipe_is_read(tmp_path, text, words):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(BadRecipe) as error:
        load_recipe(path)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_robot_is_told_from_a_recipe():
    with pytest.raises(BadRecipe, match="my.urdf is a robot and no recipe; give it"):
        load_recipe("my.urdf")


def test_a_recipe_with_the_mark_of_its_encoding_is_read(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text('[robot]\nsource = "arm.urdf"\n', encoding="utf-8-sig")
    assert load_recipe(path).robot.source == "arm.urdf"


def test_a_build_reads_its_scenery_before_the_robot(monkeypatch):
    def robot_of(recipe):
        raise AssertionError("the robot came first")

    monkeypatch.setattr(odm.cell_map.build, "robot_of", robot_of)
    recipe = Recipe("bad", scenery=({"type": "box", "sizes": [1, 1, 1]},))
    with pytest.raises(BadRecipe, match="no key 'sizes'"):
        odm.build_map(recipe)


def test_the_mesh_of_a_stored_map_may_be_gone(tmp_path):
    (tmp_path / "part.stl").touch()
    table = {"name": "place", "scenery": [{"type": "mesh", "file": "part.stl"}]}
    recipe = parse_recipe(table, "place", tmp_path)
    (tmp_path / "part.stl").unlink()
    assert recipe_of_map(recipe.for_map()).scenery == recipe.scenery
