"""A map opened by a process that may not take half as much memory as the map has."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from sim.bench.frames import Pair

_SCRIPT = """
import gc, json, pathlib, resource, sys, time
import numpy as np
import odm
from odm.cell_map.estimate import taken_memory

folder, share, q_start, q_goal, capsules = json.loads(sys.stdin.read())
q_start, q_goal, capsules = map(np.array, (q_start, q_goal, capsules))

def frames():
    cell_map = odm.load_map(folder, verify=False)
    planner = odm.ReactivePlanner(cell_map, always_replan=True)
    obstacles = odm.Obstacles(capsules=capsules.shape[1])
    planner.set_goals([q_goal])
    times, answers = [], 0
    for rods in capsules:
        obstacles.capsules[:] = rods
        begun = time.thread_time()
        answer = planner.step(obstacles, q=q_start)
        times.append(time.thread_time() - begun)
        answers += answer.status != "holding"
    return times[1:], answers

frames()  # what is compiled does not count
free, _ = frames()
gc.collect()
size = sum(f.stat().st_size for f in pathlib.Path(folder).iterdir())
limit = taken_memory() + int(share * size)
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
tight, answers = frames()
try:
    odm.load_map(folder, verify=True)
    fits = True
except (MemoryError, RuntimeError):  # no memory for numbers, or for a thread
    fits = False
print(json.dumps([free, tight, answers, fits]))
"""


def answered_within(folder: Path, pair: Pair, share: float) -> dict:
    """Ask a map for frames without and with a limit of memory (RLIMIT_DATA).

    Args:
        folder: Of the map; it is mapped, not read.
        pair: Start, goal and frames.
        share: Of the map's bytes that the process may take beyond what it has before.

    Returns:
        "answers" (frames with a path), "times" (p99 with the limit over p99 without),
        "fits" (whether a verified copy in memory would do) and "note"; where the
        process fails, 0, NaN and why.
    """
    rows = [pair.q_start.tolist(), pair.q_goal.tolist(), pair.capsules.tolist()]
    path = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        input=json.dumps([str(folder), share, *rows]),
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    note = (
        f"RLIMIT_DATA at {share:g} of the folder's bytes, beyond what the process has"
    )
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["no word"])[-1][:200]
        failed = {"answers": 0.0, "times": np.nan, "fits": None}
        return failed | {"note": f"{note}; it failed: {why}"}
    free, tight, answers, fits = json.loads(done.stdout)
    note += f"; a verified copy {'would fit, too' if fits else 'does not fit there'}"
    times = float(np.percentile(tight, 99) / np.percentile(free, 99))
    return {"answers": float(answers), "times": times, "fits": fits, "note": note}
