"""`odm run-two`: tables, figures, pictures, and errors in one sentence."""

import json

import numpy as np
import pytest

from sim.cli.two_command import base_pose


@pytest.fixture(scope="module")
def map_dir(small_map, tmp_path_factory):
    return small_map.save(tmp_path_factory.mktemp("two") / "arm3")


def test_a_short_run_writes_its_figures_and_pictures(odm, map_dir, tmp_path):
    out = tmp_path / "new" / "out"
    code, said, _ = odm(
        "run-two", "--map", map_dir, "--seconds", 1.5, "--out", out,
        "--base", 0.9, 0, 180,
    )  # fmt: skip
    assert code == 0
    assert "contacts while a planned robot moves" in said and "trips" in said
    figures = json.loads((out / "two_robots.json").read_text())
    assert figures["contacts"] == 0 and len(figures["trips"]) == 2
    assert figures["base_m"] == [0.9, 0.0, 0.0]
    assert len(set(figures["map_hashes"])) == 1

    from PIL import Image

    with Image.open(out / "two_robots.png") as picture:
        seen = np.asarray(picture.convert("RGB"), int)
    # both robots are drawn, each in its own colour
    green = (seen[..., 1] - seen[..., 0] > 25).sum()
    orange = (seen[..., 0] - seen[..., 2] > 25).sum()
    assert min(green, orange) > 2000
    with Image.open(out / "two_robots.gif") as film:
        assert film.n_frames > 5


def test_json_stands_alone_on_the_terminal(odm, map_dir):
    code, said, _ = odm(
        "run-two", "--map", map_dir, "--seconds", 0.5, "--base", 5, 0, 0, "--json",
        "--other", "scripted",
    )  # fmt: skip
    assert code == 0
    assert json.loads(said)["other"] == "scripted"


def test_a_scripted_robot_alone_is_scripted_too(odm, map_dir):
    _, said, _ = odm(
        "run-two", "--map", map_dir, "--seconds", 5, "--base", 5, 0, 0, "--json",
        "--other", "scripted", "--rate", 20,
    )  # fmt: skip
    figures = json.loads(said)
    assert figures["alone_trips_per_minute"] == figures["trips_per_minute"]


def test_a_base_in_the_first_robot_is_one_sentence(odm, map_dir):
    code, _, said = odm(
        "run-two", "--map", map_dir, "--seconds", 1, "--base", 0.1, 0, 0
    )
    assert code == 2
    assert "always be in contact; move the second base away" in said
    assert "Traceback" not in said


def test_a_base_that_is_no_number_and_a_wrong_other_are_refused(odm, map_dir):
    code, _, said = odm("run-two", "--map", map_dir, "--base", "nan", 0, 0)
    assert code == 2 and "--base X is nan" in said
    code, _, said = odm("run-two", "--map", map_dir, "--other", "human")
    assert code == 2 and "planned or scripted" in said


def test_a_contact_makes_the_exit_code_one(odm, map_dir, monkeypatch):
    from sim.two.two_result import TwoResult

    monkeypatch.setattr(TwoResult, "contacts", 1)
    code, said, _ = odm("run-two", "--map", map_dir, "--seconds", 0.1)
    assert code == 1 and "contacts" in said


def test_by_default_they_face_each_other_within_reach(small_map):
    T = base_pose(small_map, None)
    assert np.allclose(T[:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    assert 0.5 < T[0, 3] < 1.3 and T[1, 3] == 0.0
