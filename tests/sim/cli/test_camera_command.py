"""`odm camera` and `odm bench camera`: figures, pictures and refusals."""

import json
import re

import numpy as np
import pytest
from seen_scenes import camera_at, picture
from small import small_recipe

import odm as planner

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("matplotlib")

EYE = ["--eye", "1.3", "0", "0.5", "--at", "0", "0", "0.4"]
LENS = ["--fx", "120", "--cx", "79.5", "--cy", "59.5", "--scale", "0.0005"]
HAND = np.array([[0.3, 0.0, 0.5, 0.3, 0.1, 0.5, 0.05]])
Q = np.array([0.4, 0.7, 0.0])


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("camera")
    return planner.build_map(small_recipe()).save(folder / "arm3")


@pytest.fixture(scope="module")
def png(map_dir, tmp_path_factory):
    """A depth image of the small arm and a hand, written by pillow."""
    robot = planner.load_map(map_dir).robot
    pixels = picture(camera_at([1.3, 0, 0.5]), HAND, robot, Q)
    path = tmp_path_factory.mktemp("image") / "depth.png"
    Image.fromarray(pixels).save(path)
    with Image.open(path) as image:
        assert image.mode.startswith("I;16")
        assert (np.array(image) == pixels).all()
    return path


def test_the_command_tells_what_python_tells(odm, map_dir, png, tmp_path):
    file, plot = tmp_path / "camera.json", tmp_path / "cells.png"
    q = ",".join(str(v) for v in Q)
    options = [*EYE, *LENS, "--q", q, "--d-self", "0.005", "--plot", plot]
    code, out, err = odm("camera", png, "--map", map_dir, *options, "--json", file)
    assert code == 0, err
    facts = json.loads(file.read_text())
    cell_map = planner.load_map(map_dir)
    settings = planner.SeenSettings(d_self=0.005)
    space = planner.SeenSpace(cell_map, camera_at([1.3, 0, 0.5]), settings)
    with Image.open(png) as image:
        seen = space.update(np.array(image).astype(np.uint16), Q, 0.0)
    assert facts["points"] == len(seen.points) > 100
    assert facts["cells"] == space.counts()
    assert facts["removed"] == seen.removed and "upper" in seen.removed
    assert facts["image"]["valid"] == seen.readings["valid"]
    assert facts["certified"] == "visible surface" and facts["cpu_ms"] > 0
    assert "occupied" in out and "covering radius" in out
    told = " ".join(out.split())  # who has another unit sees it here
    assert f"where a unit is {1e3 * facts['scale']:g} mm (--scale)" in told
    with Image.open(plot) as drawn:
        assert drawn.size[0] > 2 * drawn.size[1]
        colours = {c for _, c in drawn.convert("RGB").getcolors(1 << 24)}
    assert (0xC4, 0x3E, 0x3E) in colours  # occupied cells are there


def test_json_alone_is_all_that_is_printed(odm, map_dir, png):
    code, out, _ = odm("camera", png, "--map", map_dir, *EYE, *LENS, "--json", "-")
    assert code == 0 and json.loads(out)["cells"]["occupied"] > 0


def test_a_pose_of_six_numbers_is_the_camera_s_own(odm, map_dir, png):
    # z forward is base -x, x right is base y, y down is base -z
    pose = ["--pose", "1.3", "0", "0.5", "-90", "0", "90"]
    code, out, err = odm("camera", png, "--map", map_dir, *pose, *LENS, "--json", "-")
    assert code == 0, err
    level = odm("camera", png, "--map", map_dir, "--eye", "1.3", "0", "0.5", "--at",
                "0", "0", "0.5", *LENS, "--json", "-")  # fmt: skip
    assert json.loads(out)["cells"] == json.loads(level[1])["cells"]


def test_a_camera_may_look_straight_down(odm, map_dir, png):
    at = ["--eye", "0.3", "0", "1.6", "--at", "0.3", "0", "0"]
    code, out, err = odm("camera", png, "--map", map_dir, *at, *LENS, "--json", "-")
    assert code == 0, err
    # z forward is base -z, up in the image is base x, x right is base -y
    pose = ["--pose", "0.3", "0", "1.6", "180", "0", "-90"]
    level = odm("camera", png, "--map", map_dir, *pose, *LENS, "--json", "-")
    assert json.loads(out)["cells"] == json.loads(level[1])["cells"]


def _cut(path):
    """Write the first half of an image."""
    Image.effect_noise((160, 120), 50).convert("I;16").save(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: Image.new("RGB", (160, 120)).save(p), "mode RGB"),
        (lambda p: Image.new("L", (160, 120)).save(p), "mode L"),
        (lambda p: p.write_text("no image"), "is no image"),
        (_cut, "cannot be read to its end"),
        (lambda p: None, "No such file"),
        (
            lambda p: Image.fromarray(np.zeros((120, 160), np.uint16)).save(p),
            "sees nothing",
        ),
    ],
)
def test_what_is_no_depth_image_is_refused_in_one_sentence(
    odm, map_dir, tmp_path, make, words
):
    path = tmp_path / "bad.png"
    make(path)
    plot = tmp_path / "out.png"
    options = [*EYE, *LENS, "--plot", plot]
    code, out, err = odm("camera", path, "--map", map_dir, *options)
    lines = [line for line in err.splitlines() if line.startswith("odm: ")]
    unfit = words == "sees nothing"  # an image, but a robot would hold
    assert code == (1 if unfit else 2) and len(lines) == 1 and words in lines[0]
    assert lines[0].count(path.name) == 1
    assert not plot.exists() and not out


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        ([], "160 x 120 pixels, but .* 640 x 480; give --fx, --cx, --cy of"),
        (LENS[:4], "give --cy of this camera"),
        ([*LENS[:2], "--cx", "5000", *LENS[4:]], "no cell .* in view .* cx and cy"),
    ],
)
def test_intrinsics_of_another_image_are_refused(odm, map_dir, png, lens, words):
    code, out, err = odm("camera", png, "--map", map_dir, *EYE, *lens)
    assert code == 2 and not out and re.search(words, err), err


def test_joints_that_are_none_are_refused(odm, map_dir, png):
    for q, words in (("a,b,c", "no list of numbers"), ("1,2", "3 moving joints")):
        code, _, err = odm("camera", png, "--map", map_dir, "--q", q)
        assert code == 2 and words in err
    for q, words in (("0,9,0", "bend"), ("0,-40,60", "degrees"), ("0,nan,0", "finite"),
                     ("0,0,90", "degrees")):  # fmt: skip
        code, _, err = odm("camera", png, "--map", map_dir, "--q", q)
        assert code == 2 and words in err and err.count("odm: ") == 1, err


def test_the_bench_shows_times_and_the_hand(odm, map_dir, tmp_path):
    file = tmp_path / "bench.json"
    code, out, err = odm("bench", "camera", "--map", map_dir, "--short", "--json", file)
    assert code == 0, err
    rows = {row["name"]: row for row in json.loads(file.read_text())["rows"]}
    first = rows["depth image -> cells"]
    assert first["n"] == 20 and first["asked"] == {"p50": 3000.0}
    assert rows["... every pixel has a reading: readings, mean"]["value"] == 640 * 480
    assert rows["... blocks the motion into it"]["value"] == 1
    assert rows["... which is free without it"]["value"] == 1
    stay = [row for name, row in rows.items() if "points that stay" in name]
    assert len(stay) == 1 and stay[0]["value"] >= 95.0


def test_an_image_of_an_empty_room_is_told_and_drawn(odm, map_dir, tmp_path):
    png, file, plot = (tmp_path / n for n in ("empty.png", "c.json", "cells.png"))
    Image.fromarray(np.full((120, 160), 65535, np.uint16)).save(png)
    words = ["camera", png, "--map", map_dir, *EYE, *LENS]
    code, out, err = odm(*words)
    assert code == 1 and "sees nothing" in " ".join((out + err).split())
    code, out, err = odm(*words, "--clear", "2.5", "--json", file, "--plot", plot)
    assert code == 0, err
    facts = json.loads(file.read_text())
    assert facts["image"]["clear"] == 120 * 160 and facts["cells"]["free"] > 1000
    assert facts["depth_m"] == [] and plot.stat().st_size > 1000
    assert facts["thinnest_m"] == camera_at([1.3, 0, 0.5]).thinnest(2.5)
    assert "19200 are clear" in " ".join(out.split())
    code, out, err = odm(*words, "--clear", "50")
    assert code == 2 and "clear_m 50.0 of empty.png" in " ".join((out + err).split())


def test_an_image_of_far_walls_alone_is_drawn(odm, map_dir, tmp_path):
    """No cell is occupied: the layer that was drawn was out of reach, and it fell."""
    png, plot = tmp_path / "walls.png", tmp_path / "cells.png"
    Image.fromarray(np.full((120, 160), 30000, np.uint16)).save(png)
    words = ["camera", png, "--map", map_dir, *EYE, *LENS, "--plot", plot]
    code, out, err = odm(*words)
    assert code == 0, err
    assert plot.stat().st_size > 1000
