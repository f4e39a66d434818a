"""The command line in a process of its own, and what a good error looks like."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from warm_process import WarmPopen

ROOT = Path(__file__).resolve().parents[1]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

# `python -c SOON build ...`: as `odm build ...`, with a line for each stage at once
SOON = """
from sim.terminal import progress
progress.FIRST_S = progress.EVERY_S = 0.0
from sim.__main__ import main
main()
"""


def one_sentence(text):
    lines = [line for line in text.splitlines() if line.startswith("odm: ")]
    return len(lines) == 1 and "Traceback" not in text


def hear(action=signal.SIG_DFL):
    """Hear signals as from a terminal, though the suite's parent may ignore them."""
    for number in SIGNALS:
        signal.signal(number, action)


@contextlib.contextmanager
def started(words, cwd, action=signal.SIG_DFL, warm=None, **streams):
    """Start a Python process in a folder; its whole group is gone at the end.

    `warm`: what `WarmPopen` is told; None: a process of its own from the first line on.
    `streams`: other than pipes, as for `subprocess.Popen`.
    """
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    pipe |= streams
    if warm is not None:
        process = WarmPopen(words, cwd=cwd, env=env, **warm, **pipe)
    else:
        process = subprocess.Popen(
            [sys.executable, *words],
            cwd=cwd,
            env=env,
            start_new_session=True,
            preexec_fn=lambda: hear(action),
            **pipe,
        )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def wait_for(stream, text):
    """Read lines until one holds `text`."""
    for line in stream:
        if text in line:
            return line
    raise AssertionError(f"it ended without {text!r}")
