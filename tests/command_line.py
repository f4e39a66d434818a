"""The command line in a process of its own, and what a good error looks like."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def one_sentence(text):
    lines = [line for line in text.splitlines() if line.startswith("odm: ")]
    return len(lines) == 1 and "Traceback" not in text


def hear(action=signal.SIG_DFL):
    """Hear signals as from a terminal, though the suite's parent may ignore them."""
    for number in SIGNALS:
        signal.signal(number, action)


@contextlib.contextmanager
def started(words, cwd, action=signal.SIG_DFL):
    """Start a Python process in a folder; its whole group is gone at the end."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
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
