"""`odm bench scene`: changes of the scene, goals by pose, holding without a layer.

Each change is timed beside the frame after it, since what a call leaves undone the next
frame would pay. Poses are those of valid configurations drawn at random that are no
nodes, each of them asked for once.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from odm import Box, Mesh, ReactivePlanner, load_map
from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from roadmap.errors import BadConfiguration
from roadmap.kinematics.forward import tool_pose
from roadmap.transforms import pose_of
from sim.bench.clock import Clock
from sim.bench.frames import ROUND, make_pairs
from sim.tables.header import header
from sim.tables.table import value_row

BOX_MS, MESH_MS = 5.0, 60.0
POSE_P50_MS, POSE_P99_MS = 5.0, 20.0
SETTLED = 10  # of so many changes, one is settled as a whole
SIDE = 0.1  # [m] of the box; the mesh is a dented ball of that radius
_NOBODY = np.zeros((0, 3))


def run(
    map_dir: str | Path,
    *,
    seed: int = 1,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure on a map.

    Args:
        map_dir: Folder of a built map.
        seed: Of places and poses.
        short: Few of everything: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".
    """
    tell = tell or (lambda text: None)
    cell_map = load_map(map_dir, verify=False)
    times = 4 if short else 60
    mesh = dented_ball(2 if short else 4)
    tell("changes of the scene")
    rows = _changes(cell_map, mesh, times, seed)
    tell("goals by pose")
    rows += _poses(cell_map, 6 if short else 200, seed)
    if cell_map.payload is None:
        tell("a held object without a layer")
        rows += _held(cell_map, *((2, 4) if short else (20, 20)), seed)
    setup = {
        "nodes": cell_map.roadmap.n_nodes,
        "edges": cell_map.roadmap.n_edges,
        "box": f"{SIDE:g} m, at random places in reach",
        "mesh": f"a dented ball, {len(mesh.faces)} triangles, as large",
        "seed": seed,
    }
    return {"bench": "scene", "header": header(cell_map), "setup": setup, "rows": rows}


def dented_ball(fineness: int) -> Mesh:
    """Return a closed mesh that is not convex: 5120 triangles of fineness 4."""
    import trimesh

    ball = trimesh.creation.icosphere(fineness, 0.5 * SIDE)
    vertices = np.array(ball.vertices)
    height = vertices[:, 2] / (0.5 * SIDE)
    vertices[:, 2] -= 0.5 * SIDE * np.maximum(height, 0.0) ** 2
    return Mesh(vertices, ball.faces)


def _changes(cell_map: CellMap, mesh: Mesh, times: int, seed: int) -> list[dict]:
    """Time changes of the scene, and the frame after each, of a robot that goes on."""
    planner = ReactivePlanner(cell_map)
    pair = make_pairs(cell_map, 1, 2, seed)[0]
    planner.set_goals([pair.q_goal])
    planner.step(_NOBODY, q=pair.q_start)
    rng, rows = np.random.default_rng(seed), []
    half = 0.3 * (cell_map.grid.upper - cell_map.grid.origin)
    middle = 0.5 * (cell_map.grid.upper + cell_map.grid.origin)

    def somewhere() -> np.ndarray:
        p = middle + rng.uniform(-half, half)
        p[2] = abs(p[2]) + 0.1
        return pose_of(p, rng.uniform(-1.0, 1.0, 3))

    for name, thing, most in (
        ("box", Box([SIDE] * 3), BOX_MS),
        (f"mesh of {len(mesh.faces)} triangles", mesh, MESH_MS),
    ):
        add, move, remove, settle, after, improve = (Clock() for _ in range(6))
        waits = []
        for k in range(times + 1):
            if k == 1:  # once for what is made at the first use
                add, move, remove, settle, after, improve = (Clock() for _ in range(6))
            add(planner.scene.add, "it", thing, somewhere())
            after(planner.step, _NOBODY, q=pair.q_start)
            move(planner.scene.move, "it", somewhere())
            after(planner.step, _NOBODY, q=pair.q_start)
            waits.append(planner.scene.waiting)
            improve(planner.improve)
            if k % SETTLED == 0:
                settle(planner.scene.test_waiting)
            remove(planner.scene.remove, "it")
            after(planner.step, _NOBODY, q=pair.q_start)
        rows += [
            add.row(f"scene.add, {name}", "", p99=1e3 * most),
            move.row(f"scene.move, {name}", "", p99=1e3 * most),
            remove.row(f"scene.remove, {name}", "", p99=1e3 * BOX_MS),
            after.row("... frame after a change", "path kept, or joined anew"),
            value_row("... edges that wait for their test", np.mean(waits), ""),
            improve.row("... improve between frames, some of them tested"),
            settle.row("... scene.test_waiting, all of them"),
        ]
    return rows


def _poses(cell_map: CellMap, n: int, seed: int) -> list[dict]:
    """Time `set_goals(poses=...)` of one pose, to ready."""
    planner = ReactivePlanner(cell_map)
    robot, rng = cell_map.robot, np.random.default_rng(seed)
    pair = make_pairs(cell_map, 1, 2, seed)[0]
    planner.step(_NOBODY, q=pair.q_start)
    poses = []
    while len(poses) < n + 1:
        q = rng.uniform(robot.lower, robot.upper)
        if planner.static.motion_free(q, np.zeros_like(q)):
            poses.append(tool_pose(robot, q))
    clock, after, found, goals, solutions = Clock(), Clock(), 0, 0, 0
    for k, T in enumerate(poses):
        if k == 1:  # once for what is made at the first use
            clock, after, found, goals, solutions = Clock(), Clock(), 0, 0, 0
        try:
            report = clock(planner.set_goals, poses=[T])
        except BadConfiguration:
            continue
        found += 1
        goals, solutions = goals + len(report.goals), solutions + len(report.solutions)
        after(planner.step, _NOBODY, q=pair.q_start)
    asked = {"p50": 1e3 * POSE_P50_MS, "p99": 1e3 * POSE_P99_MS}
    each = max(1, found)
    return [
        clock.row("set_goals of one pose", "that a valid configuration has", **asked),
        after.row("... first frame after", "the start is joined, the path found"),
        value_row("... poses with a valid solution", 100 * found / n, "%"),
        value_row("... valid solutions of a pose", solutions / each, ""),
        value_row("... of them set as goals", goals / each, ""),
    ]


def _held(cell_map: CellMap, pairs: int, frames: int, seed: int) -> list[dict]:
    """Time frames with a ball in the hand that no layer of the map knows of."""
    planner, bare = (ReactivePlanner(cell_map, always_replan=True) for _ in range(2))
    attach, rows = Clock(), []
    ball = np.array([[0.0, 0.0, 0.05, 0.05]])
    attach(planner.attach, ball)
    planner.detach()
    attach = Clock()
    attach(planner.attach, ball)
    still = np.zeros(cell_map.robot.dof)
    clocks, held, total = (Clock(), Clock()), [0, 0], 0
    for pair in make_pairs(cell_map, pairs, frames, seed):
        ends = np.array(pair.q_start), np.array(pair.q_goal)
        if not all(planner.static.motion_free(q, still) for q in ends):
            continue
        both = (planner, bare)
        for one in both:
            one.reset()
            one.set_goals([pair.q_goal])
        for points in pair.points():
            total += 1
            for k, one in enumerate(both):
                answer = clocks[k](one.step, points, q=pair.q_start, rounding=ROUND)
                held[k] += answer.status == HOLDING
    rows = [attach.row("attach a ball, no payload layer")]
    for k, what in enumerate(("with it", "empty hand, same frames")):
        rows += [
            clocks[k].row(f"... frame searched from scratch, {what}"),
            value_row("... frames that hold", 100 * held[k] / max(1, total), "%"),
        ]
    return rows
