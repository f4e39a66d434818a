"""The command line in a process of its own, and what a good error looks like."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def one_sentence(text):
    lines = [line for line in text.splitlines() if line.startswith("odm: ")]
    return len(lines) == 1 and "Traceback" not in text


def start(words, cwd):
    """Start a Python process in a folder; the project is on its path."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, *words], cwd=cwd, env=env, **pipe)
