"""`odm run --targets meet` timed, by keys, by a recording, and with bad input."""

import json
import shutil
from dataclasses import replace

import pytest
from command_line import one_sentence
from keyboard_pty import User
from mocap_files import person, write_csv

from sim.run.request import RunRequest
from sim.run.runner import run

KEYS = (
    "run", "--targets", "meet", "--motion", "keyboard", "--rate", "50",
    "--between", "0.9", "0.9", "--json",
)  # fmt: skip


def test_timed_it_gets_to_its_targets_within_its_limits(meet_maps):
    asked = RunRequest(
        meet_maps[0],
        "reach",
        seconds=4.0,
        seed=1,
        rate=50.0,
        execution="timed",
        targets="meet",
        reach=meet_maps[1],
        between=(0.9, 0.9),
        json="-",
        audit_s=0,
    )
    data = run(asked)
    told = data["targets"]
    assert told["contacts"] == 0 and told["arrivals"] >= 1
    time = told["share_of_time"]
    assert time.get("there", 0.0) + time.get("on the way", 0.0) > 0.5
    plain = run(replace(asked, execution="kinematic"))
    assert plain["run"]["trajectory_sha256"] != data["run"]["trajectory_sha256"]


def test_keys_move_the_arm_whose_targets_are_pursued(meet_maps, tmp_path):
    """Real bytes at a real terminal: the arm moves, the robot goes to its targets."""
    out = tmp_path / "keys.json"
    words = ["-m", "sim.cli.main", *KEYS, out, "--map", meet_maps[0]]
    words += ["--reach", meet_maps[1]]
    with User(*words, columns=100, lines=40, warm={"exercised": True}) as user:
        user.see("of [0-9,]+ edges")
        user.see("0:0[1-9]")
        for keys in (b"wwww", b"\x1b[A\x1b[A", b"+"):
            user.type(keys)
            user.look(0.2)
        user.see("0:0[4-9]")
        user.type(b"q")
        assert user.end() == 0 and user.restored
        assert "Targets of the interaction workspace" in user.sent
    data = json.loads(out.read_text())
    told = data["targets"]
    assert data["ended"] == "q" and told["contacts"] == 0
    assert [key for _, key in data["keys"]] == ["w"] * 4 + ["up"] * 2 + ["+"]
    assert sum(told["share_of_time"].values()) == pytest.approx(1.0, abs=1e-3)
    assert told["share_of_time"].get("no target", 0.0) < 0.5


def test_keys_end_by_ctrl_c_as_shells_expect(meet_maps, tmp_path):
    out = tmp_path / "keys.json"
    words = ["-m", "sim.cli.main", *KEYS, out, "--map", meet_maps[0]]
    words += ["--reach", meet_maps[1]]
    with User(*words, warm={"exercised": True}) as user:
        user.see("of [0-9,]+ edges")
        user.type(b"\x03")
        assert user.end() == 130 and user.restored
    assert json.loads(out.read_text())["exit_code"] == 130


def test_a_recording_is_played_by_the_command(odm, meet_maps, tmp_path):
    clip = write_csv(tmp_path / "clip.csv", person(120))
    words = ["run", "--targets", "meet", "--motion", "mocap", "--file", clip]
    words += ["--map", meet_maps[0], "--reach", meet_maps[1], "--seconds", "1"]
    code, out, err = odm(*words, "--rate", "50", "--side", "left", "--json")
    assert code == 0, err
    data = json.loads(out)
    assert data["run"]["frames"] == 50 and data["targets"]["contacts"] == 0


def test_nobody_in_reach_is_a_run_without_targets(odm, meet_maps):
    words = ["run", "--targets", "meet", "--map", meet_maps[0], "--reach", meet_maps[1]]
    for motion in ("sweep", "tremble"):
        more = ["--seconds", "1", "--rate", "50", "--motion", motion, "--json"]
        code, out, err = odm(*words, *more, "--between", "3", "3")
        assert code == 0, err
        told = json.loads(out)["targets"]
        assert told["share_of_time"] == {"no target": 1.0}
        assert told["audit"]["judged"] == told["audit"]["out_of_reach"] == 0
        assert 0.5 < told["missing_m"] < 3.0


@pytest.mark.parametrize("name", ["quality.npy", "way.npy", "manifest.json"])
@pytest.mark.parametrize("how", ["cut", "gone"])
def test_a_broken_reach_map_is_told_in_one_sentence(
    odm, meet_maps, tmp_path, name, how
):
    broken = tmp_path / "broken"
    shutil.copytree(meet_maps[1], broken)
    file = broken / name
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    words = ["run", "--targets", "meet", "--map", meet_maps[0], "--reach", broken]
    code, out, err = odm(*words, "--seconds", "1")
    assert code == 2 and one_sentence(err) and "broken" in err
    assert "Targets" not in out


def test_no_time_is_no_run(odm, meet_maps):
    words = ["run", "--targets", "meet", "--map", meet_maps[0], "--reach", meet_maps[1]]
    for seconds in ("0", "-1", "nan"):
        code, _, err = odm(*words, "--seconds", seconds)
        assert code == 2 and "--seconds" in err and one_sentence(err)
