"""The command line as a user meets it: exit codes, one sentence, whole files."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from odm import build_map, load_map
from sim import cli
from sim.bench_command import bench_names, fill_section
from sim.cli_build import built_facts
from sim.recording import BadRecording, read_recording
from sim.warmup import tiny_recipe

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = ("build", "info", "audit", "run", "demo", "replay", "bench", "warmup")


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


@pytest.fixture
def odm(capsys, monkeypatch):
    """Return a function that runs a command line: (exit code, stdout, stderr)."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["odm", *map(str, words)])
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = stop.code or 0
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return run


def one_sentence(text):
    lines = [line for line in text.splitlines() if line.startswith("odm: ")]
    return len(lines) == 1 and "Traceback" not in text


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(odm, command):
    code, out, _ = odm(command, "--help")
    assert code == 0 and "Usage" in out


def test_a_wrong_option_is_a_usage_error(odm):
    assert odm("info", "--nonsense")[0] == 2
    assert odm("build")[0] == 2
    assert odm("build", "panda", "--robot", "my.urdf")[0] == 2
    assert odm("build", "--robot", "my.urdf", "--lock", "a=b")[0] == 2


@pytest.mark.parametrize(
    "words",
    [
        ("info", "no/such/map"),
        ("audit", "no/such/map"),
        ("run", "--map", "no/such/map"),
        ("run", "--map", "no/such/map", "--motion", "dance"),
        ("replay", "--map", "no/such/map", "--frames", "no.npz"),
        ("build", "no_such_recipe"),
        ("build", "--robot", "no_such.urdf", "--tip", "tool0"),
        ("build", "demo", "--h", "-1"),
        ("bench", "nothing"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(odm, words):
    code, out, err = odm(*words)
    assert code == 1 and out == "" and one_sentence(err), err


def test_json_may_stand_alone_and_never_swallows_an_argument():
    for words, meant in (
        ("info --json maps/a", "info --json=- maps/a"),
        ("info maps/a --json", "info maps/a --json=-"),
        ("info --json a.json maps/a", "info --json=a.json maps/a"),
        ("bench latency --markdown --map m", "bench latency --markdown=- --map m"),
    ):
        assert cli.with_targets(words.split()) == meant.split()


def test_build_makes_a_map_and_does_not_replace_another_one(odm, tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--neighbors", 5, "--out")
    out = tmp_path / "built"
    code, text, _ = odm(*words, out, "--nodes", 40, "--json")
    made = json.loads(text)
    assert code == 0 and made["hash"] == load_map(out).hash
    assert made["nodes"] == load_map(out).roadmap.n_nodes
    code, _, err = odm(*words, out, "--nodes", 50)
    assert code == 1 and "--force" in err and load_map(out).hash == made["hash"]
    assert odm(*words, out, "--nodes", 50, "--force")[0] == 0
    assert load_map(out).hash != made["hash"]
    (tmp_path / "mine").mkdir()
    code, _, err = odm(*words, tmp_path / "mine", "--nodes", 40, "--force")
    assert code == 1 and "not a map folder" in err


def test_a_joint_can_be_locked_on_the_command_line(odm, tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("--robot", urdf, "--tip", "hand", "--lock", "b=0.5", "--nodes", 30)
    assert odm("build", *words, "--out", tmp_path / "locked")[0] == 0
    assert load_map(tmp_path / "locked").robot.joint_names == ("a", "c")


def test_suggest_agrees_with_a_real_build_and_builds_nothing(odm, tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--nodes", 3000)
    code, text, _ = odm(*words, "--out", tmp_path / "map", "--suggest", "--json")
    assert code == 0 and not (tmp_path / "map").exists()
    rows = [r for r in json.loads(text)["rows"] if (r["h"], r["nodes"]) == (0.04, 3000)]
    assert odm(*words, "--out", tmp_path / "map")[0] == 0
    made = built_facts(load_map(tmp_path / "map"), tmp_path / "map", 0.0)
    for mine, real in (
        (rows[0]["edges"], made["edges"]),
        (rows[0]["bytes_per_edge"], made["bytes_per_edge"]["edge_major"]),
        (rows[0]["map_bytes"], made["folder_bytes"]),
    ):
        assert 0.7 * real < mine < 1.3 * real


def test_info_tells_what_the_map_holds(odm, map_dir):
    code, text, _ = odm("info", map_dir, "--json")
    found, cell_map = json.loads(text), load_map(map_dir)
    assert code == 0 and found["hash"] == cell_map.hash
    assert found["safety"] == cell_map.safety.as_dict()
    assert found["roadmap"]["edges"] == cell_map.roadmap.n_edges
    assert sum(found["bytes"][v] for v in ("edge_major", "block_major")) == sum(
        a.nbytes for a in cell_map.arm_cells.arrays().values()
    )
    assert {row["link"] for row in found["cover"]} == set(cell_map.robot.link_names)
    code, text, _ = odm("info", map_dir)
    assert code == 0
    for word in ("rho", "hand", "sticks out [mm]", "floor", cell_map.hash[:12]):
        assert word in text


def test_an_audit_passes_a_sound_map_and_fails_a_spoiled_one(odm, map_dir):
    words = ("audit", map_dir, "--pairs", 2000, "--json")
    code, text, _ = odm(*words)
    assert json.loads(text)["violations"] == 0 and code == 0
    code, text, _ = odm(*words, "--sabotage", "rho")
    assert json.loads(text)["violations"] > 0 and code == 1
    code, _, err = odm("audit", map_dir, "--sabotage", "luck")
    assert code == 1 and one_sentence(err)


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
    sampled = read_recording(tmp_path / "f.npz", load_map(map_dir))
    plain = {k: v for k, v in recording.items() if k != "capsules"}
    plain |= {"points": sampled.points, "offsets": sampled.offsets}
    np.savez(tmp_path / "p.npz", **plain)
    found = []
    for name in ("f.npz", "p.npz"):
        words = ("--frames", tmp_path / name, "--always-replan", "--paths", "--json")
        code, text, _ = odm("replay", "--map", map_dir, *words)
        assert code == 0
        found.append(json.loads(text)["frames"])
    for a, b in zip(*found, strict=True):
        assert (a.pop("certified"), b.pop("certified")) == (
            "whole surface",
            "visible surface",
        )
    assert found[0] == found[1]


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


@pytest.mark.parametrize("name", WRONG)
def test_a_malformed_recording_is_refused(name, odm, map_dir, recording, tmp_path):
    arrays = {key: np.array(value) for key, value in recording.items()}
    WRONG[name](arrays)
    np.savez(tmp_path / "f.npz", **arrays)
    code, out, err = odm("replay", "--map", map_dir, "--frames", tmp_path / "f.npz")
    assert code == 1 and out == "" and one_sentence(err), err


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


def test_a_damaged_map_is_one_sentence(odm, map_dir, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    for file in map_dir.iterdir():
        (broken / file.name).write_bytes(file.read_bytes())
    data = bytearray((broken / "arm.mask.npy").read_bytes())
    data[-5] ^= 1
    (broken / "arm.mask.npy").write_bytes(data)
    code, _, err = odm("info", broken)
    assert code == 1 and one_sentence(err) and "arm.mask" in err


def test_a_run_writes_its_figures(odm, map_dir, tmp_path):
    words = ("--motion", "reach", "--seconds", 1, "--json", tmp_path / "r.json")
    code, out, _ = odm("run", "--map", map_dir, *words)
    record = json.loads((tmp_path / "r.json").read_text())
    assert code == 0 and "p99" in out
    assert record["run"]["motion"] == "reach" and record["run"]["frames"] == 100


def test_benches_are_found_by_name(odm):
    assert "latency" in bench_names()
    code, _, err = odm("bench", "latency")
    assert code == 1 and "--map" in err


def test_a_table_goes_between_its_markers_only(tmp_path):
    page = tmp_path / "page.md"
    marks = [f"<!-- odm bench latency: {side} -->" for side in ("begin", "end")]
    page.write_text(f"before\n{marks[0]}\nold\n{marks[1]}\nafter\n")
    fill_section(page, "latency", "| new |")
    text = page.read_text()
    assert "| new |" in text and "old" not in text
    assert text.startswith("before\n") and text.endswith("\nafter\n")
    with pytest.raises(Exception, match="no section"):
        fill_section(page, "build", "| new |")


def start(words, cwd):
    """Start a Python process in a folder; the project is on its path."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, *words], cwd=cwd, env=env, **pipe)


def test_ctrl_c_during_a_build_leaves_nothing_and_says_so(tmp_path):
    urdf = tiny_recipe(tmp_path).robot.source
    words = ("build", "--robot", urdf, "--tip", "hand", "--nodes", "60000")
    process = start(["-m", "sim.cli", *words, "--out", "built/map"], tmp_path)
    time.sleep(4.0)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted" in err and "Traceback" not in err
    assert not list(tmp_path.glob("built/*")) and not list(tmp_path.glob("built/.*"))


WARM = """
from sim.warmup import run_warmup
run_warmup(lambda *_: None)
"""
PLAY = """
import sys
from sim import cli, warmup
sys.argv = ["odm", "replay", "--map", sys.argv[1], "--frames", "f.npz"]
try:
    cli.main()
except SystemExit as stop:
    assert not stop.code
print("compiled", warmup.cache_misses())
"""


def test_after_a_warmup_a_new_process_compiles_nothing(map_dir, recording, tmp_path):
    np.savez(tmp_path / "f.npz", **recording)
    for words in (["-c", WARM], ["-c", PLAY, str(map_dir)]):
        process = start(words, tmp_path)
        out, err = process.communicate(timeout=600)
        assert process.returncode == 0, err
    assert out.splitlines()[-1] == "compiled 0"
