"""`odm view` and `odm run --view`: what is refused, before anything is shown."""

import json
import zipfile

import pytest
from planned import plan_by_hand

from handover.scenes.plan_file import write_plan
from sim.cli import main as cli
from sim.view.gate import listening

typer_testing = pytest.importorskip("typer.testing")


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    """Let these tests run where viser is not installed, too."""
    monkeypatch.setattr("sim.view.viewer.check_viewer", lambda: None)


def asked(*words):
    return typer_testing.CliRunner().invoke(cli.app, list(map(str, words)))


def refused(*words):
    """Return the one sentence that a command is refused with."""
    done = asked(*words)
    assert done.exit_code in (1, 2), done.output
    lines = [x for x in done.stderr.splitlines() if x.startswith("odm: ")]
    assert len(lines) == 1 and "Traceback" not in done.stderr
    return lines[0]


@pytest.fixture
def record(tmp_path):
    """Return a file that begins as a recording does, of no use."""
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("recording.json", json.dumps({"format": 99, "sha256": ""}))
    return path


def test_nothing_to_show_is_refused():
    assert "give a recording, or --map MAP" in refused("view")


def test_a_recording_of_another_version_is_refused(record):
    told = refused("view", record)
    assert "has the recording format 99" in told and "update odm-planner" in told


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"words"])
def test_a_file_that_is_no_recording_is_refused(content, tmp_path):
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    assert str(path) in refused("view", path)


def test_a_plan_or_a_scene_is_told_which_command_shows_it(tmp_path):
    plan = write_plan(tmp_path / "plan.json", plan_by_hand())
    other = tmp_path / "a.json"
    other.write_text("{}")
    scene = tmp_path / "a.scene"
    scene.write_text("(noname)+\n")
    assert f"is a hand-over plan, no recording; `odm replay {plan}`" in refused(
        "view", plan
    )
    assert "a.json is a JSON file, no recording" in refused("view", other)
    assert f"--scene {scene} --view` shows" in refused("view", scene)
    film = tmp_path / "a.gif"
    film.write_bytes(b"GIF89a")
    assert "a.gif is a picture, no recording; give the" in refused("view", film)


def test_files_and_maps_that_are_not_there_are_refused(tmp_path):
    assert "there is no file" in refused("view", tmp_path / "none.npz")
    assert "holds no map" in refused("view", "--map", tmp_path)


@pytest.mark.parametrize("at", ["-1", "nan", "inf"])
def test_a_time_that_is_none_is_refused(at, record):
    told = refused("view", record, "--at", at)
    assert "--at" in told and at in told and "give" in told


def test_opened_wider_it_needs_a_token(record):
    told = refused("view", record, "--host", "0.0.0.0", "--token", "")
    assert "give a --token that is not empty" in told


@pytest.mark.parametrize("flag", ["--port", "--host", "--token"])
def test_flags_of_the_page_go_with_the_page(flag, tmp_path):
    told = refused("run", "--map", tmp_path, flag, "1")
    assert told == f"odm: {flag} goes with --view; add that or leave it out"


def test_a_port_that_is_taken_is_refused_before_a_map_is_loaded(tmp_path):
    with listening("127.0.0.1", 0) as other:
        port = other.getsockname()[1]
        told = refused("run", "--map", tmp_path / "none", "--view", "--port", port)
    assert f"port {port} of 127.0.0.1 is taken; give another --port" in told


def test_a_port_that_is_none_is_refused(tmp_path):
    told = refused("run", "--map", tmp_path, "--view", "--port", "70000")
    assert "--port 70000 is no port" in told


def test_the_help_says_local_and_token():
    shown = " ".join(asked("view", "--help").stdout.split())
    for word in ("127.0.0.1", "token", "unencrypted", "Ctrl-C"):
        assert word in shown
    assert "--view" in asked("run", "--help").stdout
