"""`odm grasps`: sets on disk, told in words or JSON, drawn, refused in a line."""

import json
import signal

import pytest
from command_line import SOON, one_sentence, started, wait_for

from handover import load_grasps

FEW = ("--samples", "4", "--rolls", "2")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build a set in a process of its own; returns folder, output and JSON."""
    folder = tmp_path_factory.mktemp("grasps")
    words = ["-m", "sim.cli.main", "grasps", "build", "--object", "cup", "--hand"]
    words += ["sdh", *FEW, "--plot", "cup.png", "--json=facts.json"]
    with started(words, folder, warm={}) as process:
        out, err = process.communicate(timeout=500)
    assert process.returncode == 0, err
    return folder, out, json.loads((folder / "facts.json").read_text())


def test_a_build_stores_a_set_under_its_name_and_says_what_it_is(built):
    folder, out, facts = built
    place = folder / "maps" / "built" / "grasps" / "cup-sdh_left"
    grasps = load_grasps(place)
    assert facts["grasps"] == len(grasps) > 0
    assert f"{len(grasps)} grasps of 8 tried" in out
    assert facts["hash"] == grasps.hash and grasps.hash[:12] in out
    assert (folder / "cup.png").stat().st_size > 20_000
    assert facts["quality"]["least"] >= grasps.built["settings"]["least"]


def test_info_tells_the_same(built, odm):
    folder, _, facts = built
    place = folder / "maps" / "built" / "grasps" / "cup-sdh_left"
    code, out, _ = odm("grasps", "info", str(place), "--json=-")
    told = json.loads(out)
    assert code == 0 and told["hash"] == facts["hash"]
    assert told["grasps"] == facts["grasps"]


@pytest.mark.parametrize(
    "words, told",
    [
        (("--object", "hamer", "--hand", "sdh"), "no object 'hamer'"),
        (("--object", "cup", "--hand", "claw"), "no hand 'claw'"),
        (("--object", "cup", "--hand", "sdh", "--samples", "0"), "samples is 0"),
        (("--object", "cup", "--hand", "sdh", "--friction", "9"), "friction is 9"),
    ],
)
def test_bad_input_is_one_sentence(words, told, odm, tmp_path):
    code, _, err = odm("grasps", "build", *words, "--out", str(tmp_path / "set"))
    assert code == 2 and one_sentence(err) and told in err
    assert not (tmp_path / "set").exists()


def test_what_is_no_grasp_set_is_left_alone(odm, tmp_path):
    (tmp_path / "mine").mkdir()
    words = ("--object", "cup", "--hand", "sdh", "--out", str(tmp_path / "mine"))
    code, _, err = odm("grasps", "build", *words)
    assert code == 2 and one_sentence(err) and "holds no grasp set" in err
    code, _, err = odm("grasps", "info", str(tmp_path / "mine"))
    assert code == 2 and one_sentence(err) and "build one with" in err


def test_ctrl_c_leaves_nothing(tmp_path):
    words = ["-c", SOON, "grasps", "build", "--object", "hammer", "--hand"]
    words += ["sdh", "--samples", "400", "--rolls", "6", "--out", "set"]  # minutes
    with started(words, tmp_path, warm={}) as process:
        wait_for(process.stderr, "closing hands")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130 and "nothing half-written" in err
    assert list(tmp_path.iterdir()) == []
