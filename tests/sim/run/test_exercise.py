"""After the exercise no frame waits for a kernel that was never called before."""

import gc
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
from small import AWAY, HOME

import odm
from sim.people.human_motion import make_motion
from sim.run.places import DEMO, warm_up

_CODE = """
import importlib, pkgutil, sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from small import AWAY, HOME, small_recipe
import odm, roadmap
from sim.loop.warmup import exercise

cell_map = odm.build_map(small_recipe(), threads=1)
exercise(cell_map)
found = set()
for package in (odm, roadmap):
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not info.name.rpartition(".")[2].startswith("_"):
            continue
        found |= {
            value for value in vars(importlib.import_module(info.name)).values()
            if isinstance(value, Dispatcher)
        }
from odm.close_test._shells import hulls_apart
from odm.execution._speed import share_along
from odm.execution._threat import follow
from odm.execution.shell_test import ShellTest
from odm.execution.threat import Watcher
from roadmap.motion.motion import time_path
late = [k.py_func.__name__ for k in (hulls_apart, share_along, follow)
        if not k.signatures]
if late:
    sys.exit("never called: " + ", ".join(late))
known = {kernel: len(kernel.signatures) for kernel in found}
watcher, arm = Watcher(), np.array([[0.6, 0.0, 0.3, 0.6, 0.0, 0.5, 0.05]])
for now in (0.0, 0.01, 0.02):
    person = watcher.look(arm, now)
rng = np.random.default_rng(3)
for always in (True, False):
    planner = odm.ReactivePlanner(cell_map, always)
    goals, q = [AWAY, HOME], HOME
    middle = np.array([0.3, 0.0, 0.3])
    for k in range(500):
        if k % 125 == 0:
            planner.set_goals(goals[k // 125 % 2 :][:1])
        middle = np.clip(middle + rng.normal(0.0, 0.02, 3), -0.5, 0.6)
        points = middle + rng.normal(0.0, 0.03, (12, 3))
        if k % 50 == 49:
            planner.see(points, q=q, stamp=0.01 * k - 0.005, now=0.01 * k - 0.005)
            motion = time_path(cell_map.robot, np.array([q, q + 1e-3]))
            stop = motion, 0.0, 0.0, motion.stop(0.0)
            ShellTest(planner).passes(*stop, person, 0.0)
        answer = planner.step(points, q=q, stamp=0.01 * k, now=0.01 * k)
        _ = answer.reason, answer.retreat
        planner.improve(4)
        if len(answer.path) > 1:
            leg = answer.path[1] - q
            q = q + leg * min(1.0, 0.02 / max(1e-9, np.abs(leg).max()))
new = [k.py_func.__name__ for k in found if len(k.signatures) > known[k]]
sys.exit("first called in a frame: " + ", ".join(sorted(new)) if new else 0)
"""


def test_the_exercise_calls_every_kernel_of_a_frame():
    paths = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-c", _CODE],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_warming_up_leaves_nothing_for_the_garbage_collection_in_a_frame(small_map):
    planner = odm.ReactivePlanner(small_map)
    try:
        brief = replace(DEMO, duration_s=1.0)
        warm_up(planner, np.stack([HOME, AWAY]), make_motion("sweep"), brief)
        assert gc.get_freeze_count() > 10_000
    finally:
        gc.unfreeze()
