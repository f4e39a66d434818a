"""`odm run --record` and `odm replay` as a user meets them."""

import json
import shutil
from itertools import product

import numpy as np
import pytest
from command_line import started
from forms import some
from keyboard_pty import User
from mocap_files import write_bvh
from recorded import crane_recipe, tampered

from odm import build_map, load_map, load_recipe
from sim.cli import build_command as cli_build
from sim.cli import view
from sim.cli.replay_command import holds_facts, merged
from sim.loop.loop import Loop
from sim.loop.warmup import tiny_recipe
from sim.record import read_record, run_again, write_record

LIVE = """
import sys
from pathlib import Path
from sim.keyboard import KeyboardPerson
from sim.run import places, runner
from sim.run.request import RunRequest
warm_up = places.warm_up
def spoil(planner, *options):
    warm_up(planner, *options)
    planner.always_replan = True
places.warm_up = spoil
places.find_places = lambda planner: planner.cell_map.roadmap.nodes[[0, -1]]
run = KeyboardPerson()
map_dir, record = map(Path, sys.argv[1:])
runner.run(RunRequest(map_dir, "keyboard", rate=50.0, record=record), run)
sys.exit(run.exit_code)
"""


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    return build_map(tiny_recipe(folder), threads=1).save(folder / "sample")


@pytest.fixture(autouse=True)
def places(monkeypatch):
    """Let the robot go between two nodes: few are on this map."""
    monkeypatch.setattr("sim.run.places.find_places", _two_nodes)


def _two_nodes(planner):
    return planner.cell_map.roadmap.nodes[[0, -1]]


@pytest.fixture(scope="module")
def run_file(tmp_path_factory):
    """Return where the run of `file` is recorded, by the first who asks for it."""
    return tmp_path_factory.mktemp("recorded") / "run.npz"


@pytest.fixture
def file(odm, map_dir, run_file):
    """Return a recorded run of two seconds; nobody changes it."""
    if not run_file.exists():
        words = ("--map", map_dir, "--seconds", 2, "--record", run_file)
        code, _, err = odm("run", *words)
        assert code == 0 and f"200 frames in {run_file}" in err
    return run_file


def sentence(text):
    (line,) = [line for line in text.splitlines() if line.startswith("odm: ")]
    assert "Traceback" not in text
    return line


@pytest.mark.parametrize(
    ("motion", "execution"),
    some(product(("sweep", "mocap"), ("kinematic", "timed")), 1, 2),
)
def test_a_recorded_run_replayed_is_the_same_bytes(
    motion, execution, odm, map_dir, tmp_path
):
    words = ["run", "--map", map_dir, "--motion", motion, "--execution", execution]
    if motion == "mocap":
        words += ["--file", write_bvh(tmp_path / "clip.bvh")]
    record, again = tmp_path / "run.npz", tmp_path / "again.npz"
    shown = tmp_path / "run.json"
    code, _, err = odm(*words, "--seconds", 1, "--record", record, "--json", shown)
    assert code == 0, err
    words = ("--map", map_dir, "--record", again, "--json", tmp_path / "again.json")
    code, out, err = odm("replay", record, *words)
    assert code == 0 and out.startswith("same: 100 frames"), err
    assert again.read_bytes() == record.read_bytes()
    told = json.loads(shown.read_text())["run"]
    del told["timing"]
    replayed = json.loads((tmp_path / "again.json").read_text())
    assert replayed.pop("holds") is not None and replayed == told
    assert told["trajectory_sha256"] in out
    code, text, _ = odm("replay", again, "--map", map_dir, "--json")
    assert code == 0 and text == (tmp_path / "again.json").read_text()


def test_a_flipped_number_ends_with_exit_code_1_and_its_frame(
    odm, map_dir, file, tmp_path
):
    def flip(gap):
        gap[42] += 1e-12

    path = tampered(file, tmp_path / "bad.npz", "separation.npy", flip)
    code, out, err = odm("replay", path, "--map", map_dir)
    assert code == 1 and "same" not in out
    told = sentence(err)
    assert "frame 42 (0.420 s)" in told and "separation was" in told
    assert "altered after the run: separation" in told


def test_a_record_of_other_versions_says_so(odm, map_dir, file, tmp_path):
    record = read_record(file)
    record.head["versions"]["numpy"] = "0.1"
    record.head["outcome"]["trips"] += 1
    path = write_record(record, tmp_path / "old.npz")
    code, _, err = odm("replay", path, "--map", map_dir)
    assert code == 1
    assert f"recorded with numpy 0.1, not {np.__version__}" in sentence(err)


def test_holds_are_listed_without_a_map(odm, crane_urdf, tmp_path):
    from recorded import new_loop, recorded

    folder = tmp_path / "crane"
    cell_map = load_map(build_map(crane_recipe(crane_urdf), threads=1).save(folder))
    record = recorded(new_loop(cell_map, duration_s=6.0), cell_map)
    path = write_record(record, tmp_path / "run.npz")
    code, out, _ = odm("replay", path, "--holds")
    lines = out.splitlines()
    assert code == 0 and f"{len(record.holds)} holds" in lines[0] and record.holds
    told = [row for row, _ in merged(holds_facts(record)["rows"])]
    for hold in [row for row in told if row["what"] in ("holding", "retreating")]:
        start = f"{hold['start_s']:.3f} s to"
        (line,) = [line for line in lines if start in line and "later" not in line]
        assert line.endswith(hold["reason"])
    code, out, _ = odm("replay", path, "--holds", "--json")
    data = json.loads(out)
    assert code == 0 and data["holds"] == len(record.holds)
    starts = [row["start_s"] for row in data["rows"]]
    assert starts == sorted(starts) and record.holds[0]["start_s"] in starts


def test_stretches_of_one_reason_that_are_hardly_apart_become_one():
    def row(start, end, what, reason="a stop takes 5 ms"):
        return {"start_s": start, "end_s": end, "what": what, "reason": reason}

    rows = [
        row(0.1, 0.2, "slowed"),
        row(0.3, 0.4, "braked", "a stop takes 5.5 ms"),
        row(0.4, 0.5, "slowed", ""),
        row(0.5, 0.6, "holding", "goal 1 is blocked"),
        row(0.7, 0.8, "holding", "goal 2 is blocked"),
        row(1.8, 1.9, "holding", "goal 2 is blocked"),
    ]
    assert merged(rows) == [
        (row(0.1, 0.4, "braked"), 2),
        (rows[2], 1),
        (row(0.5, 0.8, "holding", "goal 1 is blocked"), 2),
        (rows[5], 1),
    ]


@pytest.mark.parametrize("only", ["--recipe-out", "--build", "--holds"])
def test_what_goes_with_a_replay_is_refused_where_there_is_none(
    odm, file, only, tmp_path
):
    name = {"--recipe-out": ["r.toml"], "--build": ["made"], "--holds": []}[only]
    words = [only, *(tmp_path / n for n in name)]
    code, out, err = odm("replay", file, *words, "--record", tmp_path / "a.npz")
    assert code == 2 and not out
    assert f"--record goes with a replay, not with {only}" in sentence(err)
    if only != "--holds":
        code, out, err = odm("replay", file, *words, "--json", tmp_path / "a.json")
        assert code == 2 and not out and f"not with {only}; leave" in sentence(err)
    assert not list(tmp_path.glob("*"))


def test_another_map_is_refused_with_both_hashes(odm, map_dir, file, tmp_path):
    other = tiny_recipe(tmp_path, 0.05)
    folder = build_map(other, threads=1).save(tmp_path / "other")
    file = file.rename(file.with_name("run of today.npz"))
    code, _, err = odm("replay", file, "--map", folder)
    told = sentence(err)
    file.rename(file.with_name("run.npz"))
    assert code == 2
    for one in (map_dir, folder):
        assert load_map(one).hash[:12] in told
    assert f"odm replay '{file}' --build DIR" in told  # as a shell takes it


def test_without_a_map_it_looks_where_maps_are_built(
    odm, map_dir, file, tmp_path, monkeypatch
):
    monkeypatch.setattr("sim.cli.replay_command.MAPS", tmp_path / "none")
    code, _, err = odm("replay", file)
    assert code == 2 and "--build" in sentence(err)
    monkeypatch.setattr("sim.cli.replay_command.MAPS", map_dir.parent)
    code, out, err = odm("replay", file)
    assert code == 0 and out.startswith("same"), err


def test_recipe_and_map_come_out_of_the_file(odm, map_dir, file, tmp_path):
    recipe, built = tmp_path / "r.toml", tmp_path / "built"
    code, _, err = odm("replay", file, "--recipe-out", recipe, "--build", built)
    assert code == 0, err
    assert load_recipe(recipe).as_dict() == load_map(map_dir).recipe.as_dict()
    assert load_map(built).hash == load_map(map_dir).hash
    assert odm("replay", file, "--map", built)[0] == 0


def test_a_truncated_recording_is_one_sentence(odm, map_dir, file, tmp_path):
    part = tmp_path / "part.npz"
    part.write_bytes(file.read_bytes()[:5000])
    code, _, err = odm("replay", part, "--map", map_dir)
    assert code == 2 and "truncated or damaged" in sentence(err)


def test_the_planner_of_the_run_knows_nothing_of_the_warming_up(
    odm, map_dir, tmp_path, monkeypatch
):
    def spoil(planner, *options):
        planner.always_replan = True

    monkeypatch.setattr("sim.run.places.warm_up", spoil)
    words = ("--map", map_dir, "--seconds", 1, "--record", tmp_path / "run.npz")
    assert odm("run", *words)[0] == 0
    head = read_record(tmp_path / "run.npz").head
    assert not head["planner"]["always_replan"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("run.txt",), "is written as .npz only"),
        (("folder.npz",), "is a folder"),
        (("file/run.npz",), "is no folder; choose another"),
    ],
)
@pytest.mark.parametrize("motion", ["sweep", "keyboard"])
def test_a_target_that_cannot_be_written_is_refused_before_the_run(
    words, told, motion, odm, tmp_path, monkeypatch
):
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("sim.keyboard.live.open_terminal", lambda: (None, None))
    target = ("--record", tmp_path.joinpath(*words))
    # the map is read after the target was tried
    words = ("--motion", motion, "--map", tmp_path / "no_map")
    code, _, err = odm("run", *words, *target)
    assert code == 2 and told in sentence(err)


def test_ctrl_c_writes_what_was_run(odm, map_dir, tmp_path, monkeypatch):
    frame = Loop.frame

    def interrupted(loop):
        if loop.index == 123 and loop.settings.duration_s == 10.0:
            raise KeyboardInterrupt
        return frame(loop)

    monkeypatch.setattr(Loop, "frame", interrupted)
    words = ("--map", map_dir, "--seconds", 10, "--record", tmp_path / "run.npz")
    code, _, err = odm("run", *words)
    assert code == 130 and "interrupted" in err and "123 frames in" in err
    assert list(tmp_path.iterdir()) == [tmp_path / "run.npz"]
    monkeypatch.undo()
    record = read_record(tmp_path / "run.npz")
    assert record.frames == 123
    again = run_again(record, load_map(map_dir))
    assert (
        write_record(again, tmp_path / "again.npz").read_bytes()
        == (tmp_path / "run.npz").read_bytes()
    )


def test_sigterm_writes_what_was_run(map_dir, tmp_path):
    script = f"""
import signal, sys
from sim.loop.loop import Loop
from sim.__main__ import main
frame = Loop.frame
def ended(loop):
    if loop.index == 123 and loop.settings.duration_s == 10.0:
        signal.raise_signal(signal.SIGTERM)
    return frame(loop)
Loop.frame = ended
words = ["run", "--map", {str(map_dir)!r}, "--seconds", "10", "--record", "run.npz"]
sys.argv = ["odm", *words]
main()
"""
    with started(["-c", script], tmp_path, warm={"exercised": True}) as process:
        err = process.communicate(timeout=60)[1]
    assert process.returncode == 143 and "123 frames in run.npz" in err, err
    assert err.count("interrupted") == 1 and "Traceback" not in err
    assert read_record(tmp_path / "run.npz").frames == 123


@pytest.mark.parametrize("end", [b"q", b"\x03"])
def test_a_live_run_with_the_keyboard_is_repeated(end, map_dir, tmp_path):
    out = tmp_path / "run.npz"
    warm = dict(columns=100, lines=40, warm={"exercised": True})
    with User("-c", LIVE, map_dir, out, **warm) as user:
        user.see("of [0-9,]+ edges")
        for keys in (b"\x1b[A" * 6, b"wwww", b"+\x1b[C\x1b[C"):
            user.type(keys)
            user.look(0.2)
        user.see("0:0[1-9]")
        user.type(end)
        assert user.end() == (0 if end == b"q" else 130) and user.restored
    record = read_record(out)
    assert record.head["motion"]["name"] == "keyboard" and record.frames > 40
    assert not record.head["planner"]["always_replan"]  # not the one that was spoilt
    assert len(np.unique(record.arrays["capsules"][:, 0, 0])) > 5
    again = run_again(record, load_map(map_dir))
    assert write_record(again, tmp_path / "again.npz").read_bytes() == out.read_bytes()


def test_options_of_the_other_kind_of_file_are_refused(odm, map_dir, file, tmp_path):
    code, _, err = odm("replay", file, "--map", map_dir, "--always-replan")
    assert code == 2 and "--always-replan goes with recorded obst" in sentence(err)
    np.savez(tmp_path / "frames.npz", capsules=np.zeros((1, 1, 7)))
    code, _, err = odm("replay", tmp_path / "frames.npz", "--holds")
    assert code == 2 and "--holds goes with a recorded run" in sentence(err)
    assert odm("replay", tmp_path / "frames.npz")[0] == 2
    assert odm("replay")[0] == 2
    assert odm("replay", file, "--frames", file)[0] == 2


def test_a_map_in_a_folder_of_another_name_is_found(
    odm, map_dir, file, tmp_path, monkeypatch
):
    """`odm build --robot my.urdf --out maps/built/mine` makes a map named my."""
    monkeypatch.chdir(tmp_path)
    code, _, err = odm("replay", file)
    assert code == 2 and "is in no folder of maps/built; give its" in sentence(err)
    mine = tmp_path / "maps/built/mine"
    shutil.copytree(map_dir, mine)
    (tmp_path / "maps/built/broken").mkdir()
    (tmp_path / "maps/built/broken/manifest.json").write_text("[]")
    code, out, _ = odm("replay", file)
    assert code == 0 and out.startswith("same: 200 frames")
    _, lacking = view._map_of(read_record(file), view.ViewRequest(file=file))
    assert not lacking
    # another map that has the name is told apart, as ever
    other = tiny_recipe(tmp_path)
    head = read_record(file).head["map"]
    build_map(other, threads=1).save(tmp_path / "maps/built" / head["name"])
    named = tmp_path / "maps/built" / head["name"]
    manifest = json.loads((named / "manifest.json").read_text())
    (named / "manifest.json").write_text(json.dumps(manifest | {"hash": "another"}))
    assert odm("replay", file)[0] == 0
    shutil.rmtree(mine)
    code, _, err = odm("replay", file)
    assert code == 2 and "maps/built" in sentence(err)


def test_the_default_folder_is_that_of_odm_build():
    from sim.cli import replay_command

    assert replay_command.MAPS is cli_build.MAPS
