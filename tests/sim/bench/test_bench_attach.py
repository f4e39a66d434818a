"""`odm bench attach` runs and says true things; how fast it is is not tested."""

import json
from dataclasses import replace

import pytest
from small import small_recipe

import odm as planner
from odm.cell_map.recipe import PayloadRecipe


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("attach")
    envelope = PayloadRecipe(radius=0.08, position=(0.05, 0.0, 0.0))
    recipe = replace(small_recipe(), payload=envelope)
    return planner.build_map(recipe).save(folder / "arm3")


def test_the_table_shows_the_hand_and_the_frames_with_it(odm, map_dir, tmp_path):
    file = tmp_path / "attach.json"
    code, out, _ = odm("bench", "attach", "--map", map_dir, "--short", "--json", file)
    result = json.loads(file.read_text())
    assert code == 0 and result["bench"] == "attach"
    rows = {row["name"]: row for row in result["rows"]}
    assert rows["attach 1 sphere"]["asked"] == {"max": 5000.0}
    ratio = rows["... p50 with over p50 without, CPU"]
    assert ratio["value"] > 0.3 and ratio["asked"] == {"most": 1.5}
    for name in ("searched from scratch", "a robot on its way"):
        with_, without = (
            rows[f"frame, {name}, {hand}"] for hand in ("with payload", "empty hand")
        )
        assert with_["n"] == without["n"] > 10
    assert rows["payload layer on disk"]["value"] > 0
    assert 0 <= rows["edges that the envelope closes"]["value"] < 100
    assert "attach" in out


def test_a_map_without_a_payload_layer_is_refused(odm, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bare") / "arm3"
    planner.build_map(small_recipe()).save(folder)
    code, _, err = odm("bench", "attach", "--map", folder, "--short")
    assert code != 0 and "[payload] table" in err
