"""`odm build --scenery`: files of others stand in the recipe, or are refused early."""

import pytest
from small import DATA

from odm.obstacles.scenery import parse_scenery
from roadmap.errors import BadRecipe
from sim.cli.build_command import BuildRequest, recipe_of

CELL = "cell\n* post\n1\nsphere\n0.05\n0 2 0\n0 0 0 1\n0 0 0 0\n.\n"
ROBOT = str(DATA / "arm3.urdf")


def test_a_scene_file_that_is_typed_is_scenery(tmp_path, monkeypatch):
    (tmp_path / "cell.scene").write_text(CELL)
    monkeypatch.chdir(tmp_path)
    request = BuildRequest(recipe=None, robot=ROBOT, scenery=["cell.scene"])
    recipe = recipe_of(request)
    assert recipe.scenery[0]["file"] == str(tmp_path / "cell.scene")
    assert parse_scenery(recipe.scenery, recipe.folder).names == ("post",)
    both = recipe_of(BuildRequest(recipe="demo", scenery=["cell.scene"]))
    assert [table["type"] for table in both.scenery] == ["plane", "file"]


@pytest.mark.parametrize(
    ("file", "told"), [("none.scene", "there is no file"), ("arm.stl", "is no scene")]
)
def test_a_wrong_file_is_told_before_any_work(tmp_path, monkeypatch, file, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.stl").write_text("solid")
    with pytest.raises(BadRecipe, match=told):
        recipe_of(BuildRequest(recipe=None, robot=ROBOT, scenery=[file]))
