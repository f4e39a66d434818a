"""Rows of the map itself: direct view, clouds, bytes, loading, a new process."""

import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from odm import ReactivePlanner, load_map, sample_capsules
from odm.cell_map.cell_map import CellMap
from sim.bench.clock import Clock, time_row
from sim.bench.frames import Pair
from sim.tables.table import TRUTH, value_row

CLOUD = 20_000
ON_ARM = 2_000  # points of the cloud that lie on the arm
IMPROVE = 4  # what `improve` is given between two frames
_FIRST_ANSWER = """
import sys
import numpy as np
import odm
cell_map = odm.load_map(sys.argv[1], verify=False)
planner = odm.ReactivePlanner(cell_map)
q_start, q_goal, capsules = (np.array(eval(a)) for a in sys.argv[2:5])
planner.set_goals([q_goal])
answer = planner.step(odm.sample_capsules(capsules, spacing=0.03), q=q_start)
print(answer.status, flush=True)
"""


def direct_map(cell_map: CellMap, pairs: list[Pair], keep_every: int = 1) -> list:
    """Time all invalid nodes and edges, from scratch and by changes; compare them."""
    afresh, following = ReactivePlanner(cell_map), ReactivePlanner(cell_map)
    scratch, changes, equal = Clock(), Clock(), True
    for pair in pairs:
        for points in pair.points()[::keep_every]:
            afresh.step(points, q=pair.q_start)
            following.step(points, q=pair.q_start)
            found = scratch(_from_scratch, afresh)
            followed = changes(_invalid, following)
            equal &= all(map(np.array_equal, found, followed))
    note = "invalid_nodes() and invalid_edges()"
    return [
        scratch.row("direct map, from scratch", note, p50=400.0),
        changes.row("direct map, by changes", note, p50=100.0),
        value_row("... both equal", float(equal), TRUTH, least=1.0),
    ]


def _from_scratch(planner: ReactivePlanner) -> tuple[np.ndarray, np.ndarray]:
    planner.direct.clear()
    return _invalid(planner)


def _invalid(planner: ReactivePlanner) -> tuple[np.ndarray, np.ndarray]:
    return planner.invalid_nodes(), planner.invalid_edges()


def camera_cloud(capsules: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return 20 000 raw points: an arm, the body it hangs on, a wall behind, (n, 3)."""
    arm = sample_capsules(capsules, 0.0055)
    arm = arm[rng.permutation(len(arm))[:ON_ARM]]
    shoulder = capsules[0, :3]
    n_body = CLOUD // 4
    body = shoulder + [0.12, 0.15, -0.15] + rng.uniform(-1, 1, (n_body, 3)) * [
        0.02, 0.2, 0.35
    ]  # fmt: skip
    n_wall = CLOUD - n_body - len(arm)
    wall = rng.uniform([1.2, -1.5, 0.0], [1.22, 1.5, 2.0], (n_wall, 3))
    return np.concatenate([arm, body, wall])[rng.permutation(CLOUD)]


def cameras(cell_map: CellMap, pairs: list[Pair], few: list[Pair], seed: int) -> list:
    """Time a camera's 20 000 points: in a loop, and in frames of their own."""
    return camera_loop(cell_map, pairs, seed) + clouds(cell_map, few, seed)


def camera_loop(cell_map: CellMap, pairs: list[Pair], seed: int) -> list:
    """Time the frames of a loop with a camera of 33 Hz: 20 000 points in, path out.

    As `odm run` asks: the path in use is kept, and `improve` works between frames.
    """
    planner, clock = ReactivePlanner(cell_map), Clock()
    rng, rho = np.random.default_rng(seed), cell_map.safety.rho
    for pair in pairs:
        planner.reset()
        planner.set_goals([pair.q_goal])
        for k, rods in enumerate(pair.capsules[::3]):
            points = camera_cloud(rods, rng)
            asked = partial(planner.step, points, pair.q_start, covering_radius=rho)
            # the first frame of a pair pays for a q never seen, which has its own row
            clock(asked) if k else asked()
            planner.improve(IMPROVE)
    note = (
        f"a loop at 33 Hz, improve({IMPROVE}) between its frames, same q in each pair"
    )
    return [clock.row("20 000 raw points -> path", note, p50=150.0, p99=600.0)]


def clouds(cell_map: CellMap, pairs: list[Pair], seed: int, each: int = 10) -> list:
    """Time raw points of a camera: 20 000 in, path out; and what else a loop asks."""
    planner, clock = ReactivePlanner(cell_map, always_replan=True), Clock()
    to_stop, apart = Clock(), Clock()
    rng = np.random.default_rng(seed)
    rho = cell_map.safety.rho
    for pair in pairs:
        planner.reset()
        planner.set_goals([pair.q_goal])
        step = max(1, len(pair.capsules) // each)
        seen = [camera_cloud(rods, rng) for rods in pair.capsules[::step]]
        planner.step(seen[0], q=pair.q_start, covering_radius=rho)
        for points in seen:
            clock(planner.step, points, q=pair.q_start, covering_radius=rho)
        ahead = np.array([pair.q_start, pair.q_goal])
        for points in seen:
            planner.step(points, q=pair.q_start, covering_radius=rho)
            apart(planner.separation, pair.q_start)
            to_stop(planner.blocked_leg, ahead, 0.1, points)
    note = f"{ON_ARM} on the arm, the rest on the body behind it and a wall; same q"
    name = "... searched anew in frames 0.2 s apart, no improve between"
    return [
        clock.row(name, note, p50=150.0, p99=600.0),
        to_stop.row("... whether a motion keeps 10 cm more from them", "blocked_leg"),
        apart.row("... how near they are", "separation"),
    ]


def storage(map_dir: Path, cell_map: CellMap, repeats: int = 5) -> list:
    """Return bytes per edge of both views and the times to load the map."""
    n = cell_map.roadmap.n_edges
    edge_major, block_major = cell_map.arm_cells.bytes_by_view()
    folder = sum(f.stat().st_size for f in map_dir.iterdir())
    verified, unverified = Clock(), Clock()
    for _ in range(repeats):
        verified(load_map, map_dir, verify=True)
        unverified(load_map, map_dir, verify=False)
    return [
        value_row(
            "bytes per edge, edge-major view",
            edge_major / n,
            "bytes",
            "on disk and in memory",
            most=500,
        ),
        value_row(
            "bytes per edge, direct view",
            block_major / n,
            "bytes",
            "in memory, derived",
            most=900,
        ),
        value_row("bytes per edge, folder", folder / n, "bytes"),
        # threads hash the arrays, so that one thread's CPU time says nothing
        time_row("load, verified", "", 1e-3 * np.array(verified.wall), None, p50=300e3),
        unverified.row("load, unverified", "", p50=50e3),
    ]


def first_answer(map_dir: Path, pair: Pair, repeats: int = 3) -> list:
    """Time a new process from its start to its first answer, compiled code cached."""
    args = [str(map_dir)]
    args += [repr(a.tolist()) for a in (pair.q_start, pair.q_goal, pair.capsules[0])]
    path = os.pathsep.join(p for p in sys.path if p)
    wall, cpu = [], []
    for _ in range(repeats + 1):
        busy, begun = _children_seconds(), time.perf_counter()
        subprocess.run(
            [sys.executable, "-c", _FIRST_ANSWER, *args],
            env={**os.environ, "PYTHONPATH": path}, check=True, capture_output=True,
        )  # fmt: skip
        wall.append(1e6 * (time.perf_counter() - begun))
        cpu.append(1e6 * (_children_seconds() - busy))
    # the first run may still compile
    note = "interpreter, imports, load, set_goals, one frame; then it exits"
    wall, cpu = np.array(wall[1:]), np.array(cpu[1:])
    return [time_row("first answer of a new process", note, wall, cpu, p50=2e6)]


def _children_seconds() -> float:
    used = os.times()
    return used.children_user + used.children_system
