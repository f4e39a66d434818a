"""`odm replay`: the same answers every time, and no malformed recording is played."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import one_sentence, started
from rows import each

from odm import ReactivePlanner, build_map, load_map
from sim.loop.recording import BadRecording, read_recording
from sim.loop.replay import play
from sim.loop.warmup import tiny_recipe


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    return build_map(tiny_recipe(folder), threads=1).save(folder / "sample")


@pytest.fixture(scope="module")
def recording(map_dir):
    """Return the arrays of a recording: a hand comes, stays in the way, and goes."""
    nodes = load_map(map_dir).roadmap.nodes
    x = 0.35 + np.abs(np.linspace(-0.6, 0.6, 60))
    hand = np.array([[a, 0.0, 0.1, a + 0.3, 0.0, 0.4, 0.05] for a in x])
    return {
        "capsules": hand[:, None],
        "q_start": nodes[0],
        "q_goal": nodes[-1],
        "rate_hz": np.float64(50.0),
    }


def test_a_replay_is_the_same_every_time_but_for_the_clock(
    odm, map_dir, recording, tmp_path
):
    np.savez(tmp_path / "f.npz", **recording)
    records = []
    for name in ("a.json", "b.json"):
        words = ("--frames", tmp_path / "f.npz", "--json", tmp_path / name)
        assert odm("replay", "--map", map_dir, *words)[0] == 0
        records.append(json.loads((tmp_path / name).read_text()))
    latency = [record.pop("latency_s") for record in records]
    assert records[0] == records[1]
    assert len(records[0]["frames"]) == len(latency[0]["frames"]) == 60
    assert records[0]["map_hash"] == load_map(map_dir).hash
    assert set(latency[0]["summary"]["total"]) == {"p50", "p99", "max"}


def test_points_with_offsets_replay_like_the_capsules_they_come_from(
    odm, map_dir, recording, tmp_path
):
    np.savez(tmp_path / "f.npz", **recording)
    cell_map = load_map(map_dir)
    sampled = read_recording(tmp_path / "f.npz", cell_map)
    plain = {k: v for k, v in recording.items() if k != "capsules"}
    plain |= {"points": sampled.points, "offsets": sampled.offsets}
    np.savez(tmp_path / "p.npz", **plain)
    words = ("--frames", tmp_path / "p.npz", "--always-replan", "--paths", "--json")
    code, text, _ = odm("replay", "--map", map_dir, *words)
    assert code == 0
    # of points nothing is known but their covering radius
    unround = replace(sampled, rounding=None)
    shapes = play(cell_map, unround, always_replan=True, paths=True)
    found = [json.loads(json.dumps(shapes))["frames"], json.loads(text)["frames"]]
    for a, b in zip(*found, strict=True):
        assert (a.pop("certified"), b.pop("certified")) == (
            "whole surface",
            "visible surface",
        )
    assert found[0] == found[1]


def test_the_planner_is_told_how_round_the_capsules_of_a_frame_are(
    map_dir, recording, tmp_path, monkeypatch
):
    told = []

    class Listening(ReactivePlanner):
        def step(self, *args, rounding=None, **kwargs):
            told.append(rounding)
            return super().step(*args, rounding=rounding, **kwargs)

    monkeypatch.setattr("sim.loop.replay.ReactivePlanner", Listening)
    far = [[2.0, 2.0, 0.1, 2.0, 2.0, 0.4, radius] for radius in (0.04, 0.09, 0.03)]
    two = np.concatenate([recording["capsules"][:3], np.array(far)[:, None]], axis=1)
    np.savez(tmp_path / "f.npz", **{**recording, "capsules": two})
    cell_map = load_map(map_dir)
    play(cell_map, read_recording(tmp_path / "f.npz", cell_map))
    assert told == [0.04, 0.05, 0.03]
    nobody = {**recording, "capsules": np.zeros((2, 0, 7))}
    np.savez(tmp_path / "f.npz", **nobody)
    play(cell_map, read_recording(tmp_path / "f.npz", cell_map))
    assert told[3:] == [None, None]


def test_the_robot_stands_still_while_the_planner_holds(map_dir, recording, tmp_path):
    hand = recording["capsules"].copy()
    hand[5:15] = [0.0, 0.0, 0.2, 0.0, 0.0, 0.5, 0.3]  # all around the robot
    np.savez(tmp_path / "f.npz", **{**recording, "capsules": hand})
    cell_map = load_map(map_dir)
    rows = play(cell_map, read_recording(tmp_path / "f.npz", cell_map))["frames"]
    pairs = list(zip(rows, rows[1:], strict=False))
    held = [(a, b) for a, b in pairs if a["status"] == "holding"]
    assert len(held) == 10 and all(a["q"] == b["q"] for a, b in held)
    assert rows[4]["q"] != rows[5]["q"] and rows[15]["q"] != rows[16]["q"]


def test_points_outside_the_grid_are_counted_by_frame(map_dir, recording, tmp_path):
    plain = {k: v for k, v in recording.items() if k != "capsules"}
    points = np.array([[9.0, 0, 0], [0.5, 0.5, 0.5], [0, -50.0, 0], [0, 0, 30.0]])
    plain |= {"points": points, "offsets": np.array([0, 2, 4])}
    np.savez(tmp_path / "p.npz", **plain)
    cell_map = load_map(map_dir)
    found = play(cell_map, read_recording(tmp_path / "p.npz", cell_map))
    assert [row["points_outside"] for row in found["frames"]] == [1, 2]
    assert found["summary"]["points_outside"] == 3


WRONG = {
    "no start": lambda f: f.pop("q_start"),
    "no frames": lambda f: f.pop("capsules"),
    "both kinds": lambda f: f.update(points=np.zeros((0, 3)), offsets=[0, 0]),
    "short start": lambda f: f.update(q_start=np.zeros(2)),
    "start is NaN": lambda f: f.update(q_start=np.full(3, np.nan)),
    "goal out of limits": lambda f: f.update(q_goal=np.full(3, 9.0)),
    "words": lambda f: f.update(q_goal=np.array(["a", "b", "c"])),
    "rate 0": lambda f: f.update(rate_hz=0.0),
    "rate is NaN": lambda f: f.update(rate_hz=np.nan),
    "rates": lambda f: f.update(rate_hz=np.ones(2)),
    "flat capsules": lambda f: f.update(capsules=np.zeros((4, 7))),
    "six columns": lambda f: f.update(capsules=np.zeros((4, 1, 6))),
    "radius 0": lambda f: f["capsules"].__setitem__((3, 0, 6), 0.0),
    "NaN capsule": lambda f: f["capsules"].__setitem__((3, 0, 0), np.nan),
    "no capsules": lambda f: f.update(capsules=np.zeros((0, 1, 7))),
}


@each("name", WRONG)
def test_a_malformed_recording_is_refused(name, odm, map_dir, recording, tmp_path):
    arrays = {key: np.array(value) for key, value in recording.items()}
    WRONG[name](arrays)
    np.savez(tmp_path / "f.npz", **arrays)
    code, out, err = odm("replay", "--map", map_dir, "--frames", tmp_path / "f.npz")
    assert code == 2 and out == "" and one_sentence(err), err


@pytest.mark.parametrize(
    "offsets", [[0, 5, 3, 10], [1, 10], [0, 9], [0], [0.0, 10.0], [[0, 10]]]
)
def test_offsets_must_ascend_from_0_to_the_end(offsets, map_dir, recording, tmp_path):
    arrays = {k: v for k, v in recording.items() if k != "capsules"}
    arrays |= {"points": np.full((10, 3), 5.0), "offsets": np.array(offsets)}
    np.savez(tmp_path / "f.npz", **arrays)
    with pytest.raises(BadRecording, match="offsets"):
        read_recording(tmp_path / "f.npz", load_map(map_dir))


def test_what_is_no_npz_is_refused(map_dir, tmp_path):
    for data in (b"", b"PK\x03\x04 broken", b"\x93NUMPY", b"hello"):
        (tmp_path / "f.npz").write_bytes(data)
        with pytest.raises(BadRecording, match="npz"):
            read_recording(tmp_path / "f.npz", load_map(map_dir))


WARM = """
from sim.loop.warmup import run_warmup
from sim.terminal.compiling import Compiling
if Compiling("warmup").missing():  # `make test` begins with a warm-up
    run_warmup(lambda *_: None)
"""
PLAY = """
import sys
from sim.cli import main as cli
from sim.loop import warmup
sys.argv = ["odm", "replay", "--map", sys.argv[1], "--frames", "f.npz"]
try:
    cli.main()
except SystemExit as stop:
    assert not stop.code
print("compiled", warmup.cache_misses())
"""


def test_after_a_warmup_a_new_process_compiles_nothing(map_dir, recording, tmp_path):
    np.savez(tmp_path / "f.npz", **recording)
    for words, warm in ((["-c", WARM], {}), (["-c", PLAY, str(map_dir)], None)):
        with started(words, tmp_path, warm=warm) as process:
            out, err = process.communicate(timeout=600)
        assert process.returncode == 0, err
    assert out.splitlines()[-1] == "compiled 0"
