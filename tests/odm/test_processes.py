"""Jobs in processes of their own: in order, and what ends one is told."""

import operator
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from odm.processes import in_processes
from roadmap.errors import PlanningError

ROOT = Path(__file__).resolve().parents[2]


def test_processes_give_results_in_the_order_of_their_jobs():
    with in_processes(2, operator.neg, [20, 3, 9, "x"]) as found:
        assert [next(found) for _ in range(3)] == [-20, -3, -9]
        with pytest.raises(TypeError, match="unary"):
            next(found)


def finish_first(folder):
    """Be ended by SIGTERM, but not before something is done."""

    def finish(*_):
        time.sleep(0.05)
        (folder / "whole").touch()
        os._exit(0)

    signal.signal(signal.SIGTERM, finish)


def test_a_process_may_finish_what_it_has_begun(tmp_path):
    with in_processes(1, time.sleep, [0, 60], finish_first, (tmp_path,)) as found:
        next(found)
    assert (tmp_path / "whole").exists()


def refuse():
    """Hear no SIGTERM."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


def test_who_refuses_to_end_is_ended():
    begun = time.monotonic()
    with in_processes(1, time.sleep, [0, 600], refuse) as found:
        next(found)
    assert time.monotonic() - begun < 300.0


ENDED = """
import os, time
from odm.processes import end_all, in_processes
with in_processes(1, time.sleep, [0, 60]) as found:
    next(found)
    end_all()
    try:
        os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        print("nobody is left")
"""


def test_python_s_own_process_beside_does_not_outlive_us():
    words = [sys.executable, "-c", ENDED]
    told = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout == "nobody is left\n" and not told.stderr


def test_a_process_that_was_killed_is_told_in_a_sentence():
    with in_processes(1, os._exit, [9]) as found:
        with pytest.raises(PlanningError, match=r"it was killed.*take fewer processes"):
            next(found)
