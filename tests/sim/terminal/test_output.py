"""What a command writes: whole files, pipes, and a standard output without room."""

import errno
import os
import stat
import threading
from pathlib import Path

import pytest
import typer

from roadmap.builds.unfinished import beside
from roadmap.errors import BadInput
from sim.terminal.output import guarded, no_room, show_json, write_text


def test_a_pipe_is_written_to_and_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="a device or a pipe"), beside(pipe):
        pass
    read = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    show_json({"a": 1}, str(pipe))
    reader.join(10.0)
    assert read == ['{\n "a": 1\n}\n'] and stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_link_keeps_leading_to_what_it_names(tmp_path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    link.symlink_to(real)
    write_text(link, "1")
    assert link.is_symlink() and real.read_text() == "1"


def test_a_file_is_called_what_the_user_called_it(tmp_path, monkeypatch):
    """One command named its picture in full, and its figures as they were typed."""
    monkeypatch.chdir(tmp_path)
    assert write_text(Path("out/plan.json"), "{}") == Path("out/plan.json")
    assert (tmp_path / "out/plan.json").read_text() == "{}"


def test_a_full_device_is_told_with_its_name(monkeypatch):
    full = "/dev/full"
    if not os.path.exists(full) or not stat.S_ISCHR(os.stat(full).st_mode):
        pytest.skip("there is no /dev/full here")

    def never(*_):
        raise AssertionError("it would have been replaced")

    monkeypatch.setattr(os, "replace", never)
    with pytest.raises(OSError) as told:
        write_text(full, "1")
    assert told.value.filename == full and told.value.errno == errno.ENOSPC


def test_a_standard_output_without_room_is_one_sentence(capfd):
    assert no_room(OSError(errno.ENOSPC, "No space left", "map")) is None
    assert no_room(OSError(errno.ENOENT, "no such file")) is None
    assert no_room(ValueError("x")) is None


@pytest.mark.parametrize(
    ("inner", "typed"),
    [
        ("a is 1; change it in LoopSettings", "a is 1; choose another value, see"),
        ("; name them in PlannerSettings(finger_pads=...)", "name them with --pads"),
        ("; check its pose T_base_camera", "; check --eye, or --pose"),
        (
            "x.urdf is a robot; give it as source of the [robot] of a recipe",
            "x.urdf is a robot; give it with --robot, and",
        ),
        ("nodes is 1; change it in the recipe", "; change it in the recipe"),
    ],
)
def test_a_remedy_is_told_for_who_typed_a_command(capsys, inner, typed):
    @guarded
    def command():
        raise BadInput(inner)

    with pytest.raises(typer.Exit):
        command()
    told = capsys.readouterr().err
    assert typed in told and "Settings" not in told and "..." not in told
