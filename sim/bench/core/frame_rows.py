"""Rows that time the planner frame by frame."""

import numpy as np

from odm import ReactivePlanner
from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from sim.bench.clock import Clock
from sim.bench.frames import RATE_HZ, ROUND, Pair
from sim.tables.table import value_row

REPLAN = {"p50": 20.0, "p99": 150.0}
FOLLOW = {"p50": 40.0, "p99": 300.0}
_AT_GOAL = 1e-6  # [rad or m]


def replanned(cell_map: CellMap, pairs: list[Pair]) -> list:
    """Time frames replanned from scratch at the same q."""
    planner = ReactivePlanner(cell_map, always_replan=True)
    clock, vertices = Clock(), []
    for pair in pairs:
        points = pair.points()
        planner.reset()
        planner.set_goals([pair.q_goal])
        planner.step(points[0], q=pair.q_start, rounding=ROUND)
        answers = [
            clock(planner.step, p, q=pair.q_start, rounding=ROUND) for p in points
        ]
        vertices += [len(a.path) for a in answers]
    vertices = np.array(vertices)
    blocked = vertices != 2
    note = "same q, searched from scratch in every frame"
    return [
        clock.row("points in -> path out", note, **REPLAN),
        clock.row("... frames with a path", "", vertices > 0, **REPLAN),
        clock.row("... frames without a path", "holding", vertices == 0),
        clock.row("... straight motion blocked", "by its close test", blocked),
        value_row("frames without a path", 100 * np.mean(vertices == 0), "%"),
        value_row("frames with the straight motion blocked", 100 * blocked.mean(), "%"),
    ]


def followed(cell_map: CellMap, pairs: list[Pair]) -> list:
    """Time frames of a robot that moves along its path, replanned or only looked at."""
    note = "q new every frame, at joint speed limits, searched from scratch"
    always, turned = _follow(cell_map, pairs, True)
    lazily, _ = _follow(cell_map, pairs, False)
    return [
        always.row("robot follows its path", note, **FOLLOW),
        lazily.row("... replan when blocked", "searched only where it is blocked"),
        turned.row("... first step to a new goal", "not among those above", p99=5000.0),
    ]


def _follow(cell_map: CellMap, pairs: list[Pair], always: bool) -> tuple[Clock, Clock]:
    """Return the times of all steps but those that are the first to a new goal."""
    planner = ReactivePlanner(cell_map, always_replan=always)
    clock, turned = Clock(), Clock()
    for pair in pairs:
        points = pair.points()
        goals, at = [pair.q_goal, pair.q_start], 0
        q = pair.q_start
        planner.reset()
        planner.set_goals(goals[:1])
        planner.step(
            points[0], q=q, rounding=ROUND
        )  # the first step at a q never seen: another row
        timed = clock
        for p in points:
            answer = timed(planner.step, p, q=q, rounding=ROUND)
            timed = clock
            if answer.status == HOLDING:
                continue
            q = advance(answer.path, cell_map.robot.max_velocity, 1.0 / RATE_HZ)
            if np.abs(q - goals[at]).max() < _AT_GOAL:
                at, timed = 1 - at, turned
                planner.set_goals(goals[at : at + 1])
    return clock, turned


def advance(path: np.ndarray, max_velocity: np.ndarray, period: float) -> np.ndarray:
    """Return where a path (k, dof) leads to in `period` [s] at joint speed limits."""
    left = period
    for a, b in zip(path[:-1], path[1:], strict=True):
        needed = (np.abs(b - a) / max_velocity).max()
        if needed > left:
            return a + (b - a) * (left / needed)
        left -= needed
    return path[-1].copy()


def first_steps(cell_map: CellMap, pairs: list[Pair], each: int = 5) -> list:
    """Time the first step at a configuration that the planner has never seen."""
    planner, clock = ReactivePlanner(cell_map, always_replan=True), Clock()
    for pair in pairs:
        planner.set_goals([pair.q_goal])
        step = max(1, len(pair.capsules) // each)
        for points in pair.part(slice(None, None, step)).points():
            planner.reset()
            clock(planner.step, points, q=pair.q_start, rounding=ROUND)
    note = "nothing known of q: motions to near nodes are tested and swept"
    return [clock.row("first step at a q never seen", note, p99=5000.0)]


def goal_setting(cell_map: CellMap, pairs: list[Pair], seed: int) -> list:
    """Time set_goals: a roadmap node, any valid configuration, unchanged goals."""
    planner = ReactivePlanner(cell_map)
    node, free, same = Clock(), Clock(), Clock()
    rng = np.random.default_rng(seed)
    for pair in pairs:
        planner.reset()
        at = rng.integers(cell_map.roadmap.n_nodes)
        q_node = cell_map.roadmap.nodes[at].copy()
        node(planner.set_goals, [q_node])
        free(planner.set_goals, [pair.q_goal])
        same(planner.set_goals, [pair.q_goal])
    return [
        node.row("set_goals, a roadmap node", "", p99=1000.0),
        free.row("set_goals, any valid configuration", "", p99=10000.0),
        same.row("set_goals, unchanged", "checked, nothing done"),
    ]
