"""What is unfinished goes with the process, whatever it was doing at that moment."""

import errno
import shutil
import threading

import pytest

from roadmap.builds import unfinished
from roadmap.builds.unfinished import beside, kept_unless_ended, put_file, remove_all


@pytest.fixture
def process(monkeypatch):
    """A process that may be ended: nothing of it stays with this one."""
    monkeypatch.setattr(unfinished, "_PATHS", set())
    monkeypatch.setattr(unfinished, "_PUTTING", threading.Lock())
    monkeypatch.setattr(unfinished, "_ENDED", threading.Event())


def test_a_full_disk_is_told_of_what_was_to_be_written(process, tmp_path):
    with pytest.raises(OSError) as told, beside(tmp_path / "map"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert told.value.filename == str(tmp_path / "map")


def test_a_removal_that_ctrl_c_cut_in_two_is_finished(process, tmp_path, monkeypatch):
    def cut(path, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(shutil, "rmtree", cut)
        with beside(tmp_path / "map") as made:
            made.mkdir()
            (made / "half").touch()
    assert list(tmp_path.iterdir())
    remove_all()
    assert not list(tmp_path.iterdir())


def test_what_an_error_kept_still_goes_where_the_process_is_ended(process, tmp_path):
    folder = tmp_path / ".map.chunks"
    with pytest.raises(ValueError), kept_unless_ended(folder):
        put_file(folder / "chunk", b"done")
        raise ValueError
    assert list(folder.iterdir())
    remove_all()
    assert not list(tmp_path.iterdir())


def test_what_is_finished_stays_where_the_process_is_ended(process, tmp_path):
    with kept_unless_ended(tmp_path / "kept"):
        (tmp_path / "kept").mkdir()
    put_file(tmp_path / "there" / "file", b"whole")
    remove_all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept", "there"]


def test_behind_the_removal_nothing_is_begun(process, tmp_path, monkeypatch):
    class Waits(Exception):
        pass

    def wait(seconds):
        raise Waits

    monkeypatch.setattr(unfinished.time, "sleep", wait)
    remove_all()
    monkeypatch.setattr(unfinished, "_PUTTING", threading.Lock())  # it was too slow
    with pytest.raises(Waits):
        put_file(tmp_path / "folder" / "chunk", b"late")
    with pytest.raises(Waits), kept_unless_ended(tmp_path / "folder"):
        (tmp_path / "folder").mkdir()
    assert not list(tmp_path.iterdir())
