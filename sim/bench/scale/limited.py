"""A map opened by a process that may not take half as much memory as the map has."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from sim.bench.frames import Pair

_SCRIPT = """
import json, resource, sys, time
import numpy as np
import odm
from odm.cell_map.estimate import _taken

folder, share, q_start, q_goal, capsules = json.loads(sys.stdin.read())
q_start, q_goal, capsules = map(np.array, (q_start, q_goal, capsules))

def frames(cell_map):
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

if share:  # what is loaded and compiled before does not count
    small = odm.load_map(sys.argv[1], verify=False) if len(sys.argv) > 1 else None
    size = sum(f.stat().st_size for f in __import__("pathlib").Path(folder).iterdir())
    limit = _taken() + int(share * size)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
cell_map = odm.load_map(folder, verify=False)
times, answers = frames(cell_map)
refused = None
if share:
    try:
        odm.load_map(folder, verify=True)
        refused = False
    except MemoryError:
        refused = True
print(json.dumps([times, answers, refused]))
"""


def answered_within(folder: Path, pair: Pair, share: float) -> dict:
    """Ask a map for frames with and without a limit of memory (RLIMIT_DATA).

    Args:
        folder: Of the map; it is mapped, not read.
        pair: Start, goal and frames.
        share: Of the map's bytes that the process may take beyond what it has before.

    Returns:
        "answers" (frames with a path), "times" (p99 with the limit over p99 without)
        and "note"; where the process fails, 0, NaN and why.
    """
    free = _asked(folder, pair, 0.0)
    tight = _asked(folder, pair, share)
    note = f"RLIMIT_DATA at {share:g} of the folder's bytes, beyond the interpreter's"
    if isinstance(tight, str) or isinstance(free, str):
        why = tight if isinstance(tight, str) else free
        return {"answers": 0.0, "times": np.nan, "note": f"{note}; it failed: {why}"}
    p99 = [float(np.percentile(t, 99)) for t in (tight[0], free[0])]
    told = "does not fit" if tight[2] else "would fit, too"
    note += f"; there, the verified copy of the map {told}"
    return {"answers": float(tight[1]), "times": p99[0] / p99[1], "note": note}


def _asked(folder: Path, pair: Pair, share: float) -> list | str:
    rows = [pair.q_start.tolist(), pair.q_goal.tolist(), pair.capsules.tolist()]
    told = json.dumps([str(folder), share, *rows])
    path = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        input=told,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["no word"])[-1][:200]
    return json.loads(done.stdout)
