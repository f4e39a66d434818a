"""Code that numba keeps is loaded ahead, and listed under the types it was made for."""

import errno
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numba
import pytest
from numba.core.caching import IndexDataCacheFile
from numba.core.typeinfer import TypeInferer

from odm.cell_map import _packed
from roadmap.compiling import kept_code
from roadmap.compiling.jit_options import LEAN
from roadmap.compiling.kept_code import KeptTypes, load_kept
from roadmap.errors import PlanningError

ROOT = Path(__file__).resolve().parents[3]


def test_what_is_kept_of_a_loop_is_loaded_without_a_call(small_map):
    assert small_map.arm_cells.by_block  # it was called, or its code lies on disk
    loop = _packed.transpose_packed
    kept = KeptTypes(loop).on(loop.targetctx.codegen().magic_tuple())
    assert kept
    hits = sum(loop.stats.cache_hits.values())
    loop.overloads.clear()
    assert load_kept([loop]) == len(kept) == len(loop.overloads)
    assert sum(loop.stats.cache_hits.values()) == hits + len(kept)


def test_what_cannot_be_loaded_is_left_to_the_first_call():
    assert load_kept([Path]) == 0


def test_a_full_disk_is_told_by_the_folder_of_compiled_loops(monkeypatch, tmp_path):
    def write(self, name, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "_save_data", write)
    kept = IndexDataCacheFile(str(tmp_path), "none", "")
    with pytest.raises(PlanningError, match="kept in .*: No space left on device; "):
        kept.save("key", "data")


@contextmanager
def heard_by(handler):
    """Have `handler` alone hear Ctrl-C, whoever does in this process.

    A thread of `sim.terminal.interrupt` that wakes too late to see the handler would
    take the signal for its own, and end the tests.
    """
    file = signal.set_wakeup_fd(-1)
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        signal.set_wakeup_fd(file)


@pytest.fixture
def plain_ctrl_c():
    """Let Python hear Ctrl-C by itself."""
    with heard_by(signal.default_int_handler):
        yield


def compile_one(monkeypatch, presses):
    """Compile a loop while Ctrl-C is pressed so often; return it, and what was done."""
    whole, done = TypeInferer.propagate, []

    def pressed(*given, **named):
        for _ in range(presses):
            signal.raise_signal(signal.SIGINT)
        done.append(whole(*given, **named))

    monkeypatch.setattr(TypeInferer, "propagate", pressed)
    loop = numba.njit(**LEAN | {"cache": False})(lambda x: x + 1)
    with pytest.raises(KeyboardInterrupt):
        loop(1)
    return loop, done


def test_it_is_raised_when_the_loop_is_compiled_and_a_second_at_once(
    monkeypatch, plain_ctrl_c
):
    loop, done = compile_one(monkeypatch, 1)
    assert len(done) == 1
    assert not compile_one(monkeypatch, 2)[1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    monkeypatch.undo()
    assert loop(1) == 2


def test_another_thread_and_another_handler_are_left_alone():
    loop, told = numba.njit(**LEAN | {"cache": False})(lambda x: x + 2), []
    thread = threading.Thread(target=lambda: told.append(loop(1)))
    thread.start()
    thread.join()
    with heard_by(lambda *what: told.append(what[0])):
        loop(1.0)
        signal.raise_signal(signal.SIGINT)
    assert told == [3, signal.SIGINT]


SAVED_SLOWLY = """
import os, signal, sys, time
from roadmap.compiling.kept_code import GuardedFile
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)  # though who started the tests ignores it
replace, told = os.replace, []
def slow(*names):
    if not told:
        told.append(print("writing", flush=True))
    time.sleep(0.2)
    replace(*names)
os.replace = slow
GuardedFile(sys.argv[1], "loop", "stamp").save("types", "code")
print("went on", flush=True)
"""


class Slow(IndexDataCacheFile):
    """A list that takes its time between reading and writing."""

    def _load_index(self):
        found = super()._load_index()
        time.sleep(0.05)
        return found

    def _save_index(self, overloads):
        time.sleep(0.05)
        super()._save_index(overloads)


def test_two_that_save_at_once_take_turns(tmp_path):
    kinds = [f"types {k}" for k in range(6)]
    files = [Slow(str(tmp_path), "loop", "stamp") for _ in kinds]
    jobs = [
        threading.Thread(target=file.save, args=(kind, f"code of {kind}"))
        for file, kind in zip(files, kinds, strict=True)
    ]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(30.0)
    told = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    assert [told.load(kind) for kind in kinds] == [f"code of {kind}" for kind in kinds]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_process_that_is_ended_while_it_saves_ends_when_the_file_is_whole(
    number, tmp_path
):
    words = [sys.executable, "-c", SAVED_SLOWLY, str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, cwd=ROOT) as process:
        process.stdout.readline()
        process.send_signal(number)
        assert process.wait(30.0) == -number
        assert not process.stdout.read()
    assert not [*tmp_path.glob("*.tmp.*")]
    assert IndexDataCacheFile(str(tmp_path), "loop", "stamp").load("types") == "code"


def test_a_folder_that_cannot_be_locked_is_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr("roadmap.compiling.kept_code._LOCK", "no such folder/lock")
    file = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    file.save("types", "code")
    assert file.load("types") == "code"


def half(data):
    return data[: len(data) // 2]


def with_a_page_of_zeros(data):
    return data[:4096] + bytes(4096) + data[8192:]


def without_its_checksum(data):
    return data[: data.rindex(kept_code._SEAL)]


@pytest.mark.parametrize("damage", [half, bytes, with_a_page_of_zeros])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_file_that_is_damaged_counts_as_not_kept(damage, kind, tmp_path):
    file = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    keys = [("types", b"x" * 9000), ("other types", b"")]
    for key in keys:
        file.save(key, b"code" * 5000)
    assert [file.load(key) for key in keys] == [b"code" * 5000] * 2
    hurt = next(tmp_path.glob(f"*.{kind}"))
    whole = hurt.read_bytes()
    hurt.write_bytes(bytes(len(whole)) if damage is bytes else damage(whole))
    assert None in [file.load(key) for key in keys]
    for key in keys:
        file.save(key, b"code" * 5000)
    assert [file.load(key) for key in keys] == [b"code" * 5000] * 2


def test_a_file_that_a_program_without_us_made_is_loaded(tmp_path):
    file = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    file.save("types", "code")
    for path in tmp_path.glob("*.nb?"):
        path.write_bytes(without_its_checksum(path.read_bytes()))
    assert file.load("types") == "code"
