"""`odm run` with a recorded person, and the options that do not go together."""

import json
from functools import partial

import pytest
from mocap_files import person, write_bvh, write_csv

from odm import build_map
from sim.loop.warmup import tiny_recipe


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("person")
    return build_map(tiny_recipe(folder), threads=1).save(folder / "sample")


@pytest.fixture
def odm(odm):
    return partial(odm, "run")


CLIPS = [(write_csv, "a.csv"), (write_bvh, "b.bvh")]


@pytest.mark.parametrize(("write", "name"), CLIPS)
def test_a_recorded_person_is_played_and_what_was_guessed_is_said(
    odm, map_dir, tmp_path, write, name
):
    clip = tmp_path / name
    write(clip, person(n_frames=150))
    out = tmp_path / "r.json"
    words = ("--motion", "mocap", "--file", clip, "--seconds", 2, "--json", out)
    code, shown, _ = odm("--map", map_dir, *words)
    record = json.loads(out.read_text())
    assert code == 0 and "shorter than the run" in " ".join(shown.split())
    assert record["run"]["motion"] == name and record["run"]["frames"] == 200
    assert any("joints named as" in note for note in record["notes"])


def test_without_seconds_a_clip_is_played_once(odm, map_dir, tmp_path):
    write_csv(tmp_path / "a.csv", person(n_frames=150))
    out = tmp_path / "r.json"
    words = ("--motion", "mocap", "--file", tmp_path / "a.csv", "--json", out)
    assert odm("--map", map_dir, *words)[0] == 0
    assert 140 <= json.loads(out.read_text())["run"]["frames"] <= 151


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--motion", "mocap"), "--file"),
        (("--motion", "sweep", "--file", "a.csv"), "--motion mocap"),
        (("--motion", "mocap", "--file", "no.bvh"), "no.bvh"),
        (("--motion", "keyboard", "--plot", "p.png"), "--plot"),
        (("--motion", "keyboard"), "terminal"),
        (("--motion", "walk"), "walk"),
        (("--motion", "sweep", "--rate", 0), "rate"),
    ],
)
def test_what_does_not_go_together_is_one_sentence(odm, map_dir, words, told):
    code, _, err = odm("--map", map_dir, *words)
    assert code == 2 and told in err and err.count("odm: ") == 1
