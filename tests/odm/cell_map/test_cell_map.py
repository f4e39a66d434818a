"""Map folders: whole, verified, refused with one sentence where they are not."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from forms import size
from naive_cells import edge_cells, occupied_cells
from small import small_recipe

import odm
from roadmap.builds.store import write_folder
from roadmap.errors import BadMap, BadRecipe, BuildRefused


@pytest.fixture
def folder(small_map, tmp_path):
    return small_map.save(tmp_path / "map")


def test_a_map_comes_back_as_it_was(small_map, folder):
    loaded = odm.load_map(folder)
    for ours, theirs in (
        (small_map.arm_cells, loaded.arm_cells),
        (small_map.roadmap, loaded.roadmap),
        (small_map.robot, loaded.robot),
        (small_map.scenery, loaded.scenery),
    ):
        for name, array in ours.arrays().items():
            assert np.array_equal(array, theirs.arrays()[name]), name
    assert loaded.recipe == small_map.recipe
    assert loaded.robot.fingerprint() == small_map.robot.fingerprint()
    assert len(loaded.hash) == 64


def test_two_builds_of_a_recipe_have_the_same_hash(small_map, folder, tmp_path):
    again = odm.build_map(small_recipe()).save(tmp_path / "again")
    assert odm.load_map(again).hash == odm.load_map(folder).hash


def test_a_flipped_byte_is_found_by_verification(folder):
    file = folder / "arm.code.npy"
    data = bytearray(file.read_bytes())
    data[-20] ^= 1
    file.write_bytes(data)
    with pytest.raises(BadMap, match="altered"):
        odm.load_map(folder)
    odm.load_map(folder, verify=False)


def test_a_truncated_array_is_refused_without_verification(folder):
    file = folder / "arm.code.npy"
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(BadMap, match="truncated"):
        odm.load_map(folder, verify=False)


def test_another_format_version_is_refused(folder):
    file = folder / "manifest.json"
    manifest = json.loads(file.read_text())
    manifest["format"] = 99
    file.write_text(json.dumps(manifest))
    with pytest.raises(BadMap, match="format version 99"):
        odm.load_map(folder)


def test_an_altered_manifest_is_refused(folder):
    file = folder / "manifest.json"
    file.write_text(file.read_text().replace('"rho": 0.03', '"rho": 0.01'))
    with pytest.raises(BadMap, match="manifest"):
        odm.load_map(folder, verify=False)


def test_no_map_and_half_a_manifest_are_refused(folder, tmp_path):
    with pytest.raises(BadMap, match="odm build"):
        odm.load_map(tmp_path / "nothing")
    (folder / "manifest.json").write_text("{")
    with pytest.raises(BadMap, match="cannot be read"):
        odm.load_map(folder)


def test_a_map_for_another_robot_is_refused(folder, small_map):
    from dataclasses import replace

    other = replace(small_map.robot, upper=small_map.robot.upper + 0.1)
    with pytest.raises(BadMap, match="another robot"):
        odm.load_map(folder, robot=other)


def test_a_folder_of_another_kind_is_refused(tmp_path):
    other = write_folder(tmp_path / "other", {"kind": "reach map"}, {})
    with pytest.raises(BadMap, match="holds a 'reach map', not a cell map"):
        odm.load_map(other)


def test_a_folder_that_is_no_map_is_never_replaced(tmp_path):
    home = tmp_path / "precious"
    home.mkdir()
    (home / "thesis.tex").write_text("42")
    with pytest.raises(BadMap, match="left alone"):
        write_folder(home, {}, {})
    assert (home / "thesis.tex").read_text() == "42"


def test_a_write_that_fails_leaves_the_old_map(folder, small_map, monkeypatch):
    before = odm.load_map(folder).hash

    def die(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "save", die)
    with pytest.raises(KeyboardInterrupt):
        small_map.save(folder)
    monkeypatch.undo()
    assert odm.load_map(folder).hash == before
    assert [p.name for p in folder.parent.iterdir()] == ["map"]


def test_a_map_needs_no_urdf(folder, tmp_path, small_map):
    moved = shutil.move(folder, tmp_path / "elsewhere")
    planner = odm.ReactivePlanner(odm.load_map(moved))
    planner.set_goals([small_map.roadmap.nodes[3]])
    q = small_map.roadmap.nodes[50].copy()
    assert planner.step(np.zeros((0, 3)), q=q).status == "replanned"


# --- recipes --------------------------------------------------------------------


def test_an_unknown_key_names_the_nearest_known_one(tmp_path):
    file = tmp_path / "r.toml"
    file.write_text("[roadmap]\nnodez = 5\n")
    with pytest.raises(BadRecipe, match="did you mean 'nodes'"):
        odm.load_recipe(file)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[safety]\nh = 0.0\n", "safety.h is 0.0"),
        ("[safety]\nrho = -1\n", "safety.rho"),
        ("[roadmap]\nnodes = 1\n", "roadmap.nodes"),
        ("[safety]\nmu = nan\n", "safety.mu"),
        ("[robot\n", "not valid TOML"),
    ],
)
def test_values_out_of_range_are_refused(tmp_path, text, words):
    file = tmp_path / "r.toml"
    file.write_text(text)
    with pytest.raises(BadRecipe, match=words):
        odm.load_recipe(file)


def test_an_unknown_recipe_lists_the_known_ones():
    with pytest.raises(BadRecipe, match=r"demo, .*panda"):
        odm.load_recipe("pandaa")


def test_a_map_that_would_not_fit_in_memory_is_refused_before_the_build():
    from dataclasses import replace

    recipe = small_recipe()
    huge = replace(recipe, roadmap=replace(recipe.roadmap, nodes=9_000_000))
    with pytest.raises(BuildRefused, match="GB"):
        odm.build_map(huge)
    fine = replace(
        recipe,
        safety=replace(recipe.safety, h=0.002),
        roadmap=replace(recipe.roadmap, nodes=200_000),
    )
    with pytest.raises(BuildRefused, match="cells of 0.002 m"):
        odm.build_map(fine)


def test_a_grid_of_more_blocks_than_16_bits_count_works_the_same(small_map, rng):
    from dataclasses import replace

    recipe = small_recipe(h=0.008)
    few = replace(recipe, roadmap=replace(recipe.roadmap, nodes=40))
    fine = odm.build_map(few, robot=small_map.robot)
    assert fine.grid.n_blocks > 65535
    assert fine.arm_cells.by_item.block.dtype == np.uint32
    planner = odm.ReactivePlanner(fine)
    points = odm.sample_capsules(np.array([[0, 0, 0.9, 0, 0, 1.4, 0.05]]), 0.03)
    planner.frame.replace(points, len(points))  # a whole step: `odm warmup --fine`
    invalid = planner.invalid_edges()
    valid = np.setdiff1d(np.arange(fine.roadmap.n_edges), invalid)
    occupied = occupied_cells(fine, points)
    some = size(5, 12)
    assert all(edge_cells(fine, e) & occupied for e in rng.choice(invalid, some))
    assert not any(edge_cells(fine, e) & occupied for e in rng.choice(valid, some))


def test_what_holds_the_whole_robot_blocks_every_configuration(small_map, tmp_path):
    """Its surface is near no link; the map said that all is free."""
    from dataclasses import replace

    ball = trimesh.creation.icosphere(3, 3.0)
    ball.vertices[ball.vertices[:, 2].argmax()] *= 0.9  # not convex: held by points
    ball.export(tmp_path / "ball.stl")
    around = {
        "type": "mesh",
        "file": str(tmp_path / "ball.stl"),
        "covering_radius": 0.1,
    }
    recipe = replace(small_recipe(), scenery=(around,))
    with pytest.raises(BuildRefused, match="only 0 of .* check the scenery"):
        odm.build_map(recipe, robot=small_map.robot)


@pytest.mark.parametrize(
    ("scenery", "words"),
    [
        ({"type": "cone"}, "choose one of"),
        ({"type": "box", "size": [1, 1]}, "3 lengths"),
        ({"type": "box", "sizes": [1, 1, 1]}, "no key 'sizes'"),
        ({"type": "plane", "normal": [0, 0, 0]}, "no direction"),
    ],
)
def test_scenery_that_makes_no_solid_is_refused(scenery, words):
    from dataclasses import replace

    with pytest.raises(BadRecipe, match=words):
        odm.build_map(replace(small_recipe(), scenery=(scenery,)))


def test_stages_of_a_build_are_told_in_words():
    """With a payload layer a build said "payload cells of packing"."""
    stages = []
    envelope = odm.load_recipe("panda_carry").payload
    recipe = replace(small_recipe(), payload=replace(envelope, radius=0.03))
    odm.build_map(recipe, 1, lambda stage, *_: stages.append(stage))
    cells = [stage for stage in dict.fromkeys(stages) if "cells" in stage]
    bare = ["cells of nodes", "cells of edges", "packing cells"]
    assert cells == [*bare, *(f"{stage}, with payload" for stage in bare)]
