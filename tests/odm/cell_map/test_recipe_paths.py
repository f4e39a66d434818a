"""A recipe's relative paths start at its own folder, and no map knows that folder."""

import shutil

import pytest
from small import DATA

import odm
from odm.cell_map.build import robot_of
from roadmap.errors import BadInput, BadRobot

RECIPE = """
[robot]
source = "robots/arm3.urdf"
tip = "tool"
srdf = "robots/arm3.srdf"
[roadmap]
nodes = 30
neighbors = 4
[safety]
h = 0.06
[[scenery]]
type = "mesh"
file = "post.obj"
position = [0.5, 0.5, 0.1]
"""
SRDF = '<robot name="arm3"><disable_collisions link1="base" link2="hand"/></robot>'


@pytest.fixture
def home(tmp_path):
    """Return a folder with a recipe, its robot, link pairs and a mesh."""
    return laid_out(tmp_path / "home")


def laid_out(folder):
    import trimesh

    (folder / "robots").mkdir(parents=True)
    shutil.copy(DATA / "arm3.urdf", folder / "robots/arm3.urdf")
    (folder / "robots/arm3.srdf").write_text(SRDF)
    trimesh.creation.box((0.1, 0.1, 0.2)).export(folder / "post.obj")
    (folder / "tiny.toml").write_text(RECIPE)
    return folder


def test_a_recipe_builds_from_any_folder(home, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    made = odm.build_map("../home/tiny.toml")
    assert made.robot.joint_names == ("turn", "bend", "twist")
    assert (made.scenery.solids[:, 0] == 4.0).any()  # the post, a hull
    dropped = [pair[:2] for pair in made.robot.dropped_pairs]
    assert ("base", "hand") in dropped  # by the SRDF only
    with pytest.raises(BadRobot, match=r"home/robots/gone.urdf"):
        text = RECIPE.replace("arm3.urdf", "gone.urdf")
        (home / "tiny.toml").write_text(text)
        odm.build_map("../home/tiny.toml")
    with pytest.raises(BadInput, match=r"home/gone.obj"):
        (home / "tiny.toml").write_text(RECIPE.replace("post.obj", "gone.obj"))
        odm.build_map("../home/tiny.toml")


def test_the_folder_chosen_when_the_recipe_was_read_stays(home, tmp_path, monkeypatch):
    monkeypatch.chdir(home)
    recipe = odm.load_recipe("tiny.toml")
    monkeypatch.chdir(tmp_path)
    assert robot_of(recipe).dof == 3


def test_the_same_recipe_in_two_folders_gives_the_same_map(home, tmp_path):
    twin = laid_out(tmp_path / "twin")
    maps = [
        odm.load_map(odm.build_map(folder / "tiny.toml").save(folder / "map"))
        for folder in (home, twin)
    ]
    assert maps[0].hash == maps[1].hash
    assert maps[0].robot.source == maps[0].recipe.robot.source == "robots/arm3.urdf"
    assert str(tmp_path) not in (home / "map/manifest.json").read_text()


def test_known_names_and_absolute_paths_are_left_alone(home, tmp_path):
    text = RECIPE.replace("robots/arm3.urdf", "plain_arm")
    (home / "tiny.toml").write_text(text.replace('srdf = "robots/arm3.srdf"\n', ""))
    assert robot_of(odm.load_recipe(home / "tiny.toml")).source == "plain_arm"
    far = str(DATA / "arm3.urdf")
    (home / "tiny.toml").write_text(RECIPE.replace("robots/arm3.urdf", far))
    assert robot_of(odm.load_recipe(home / "tiny.toml")).source == far
    (home / "tiny.toml").write_text(RECIPE.replace("robots/arm3.urdf", "plain_arn"))
    with pytest.raises(BadRobot, match="'plain_arm'"):
        robot_of(odm.load_recipe(home / "tiny.toml"))
