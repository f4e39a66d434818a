"""Rows that time the planner frame by frame."""

import time
from collections.abc import Callable
from itertools import pairwise
from unittest.mock import patch

import numpy as np

from odm import ReactivePlanner
from odm.answer import HOLDING, IN_USE
from odm.cell_map.cell_map import CellMap
from odm.exact.distances import ExactRobot
from roadmap.kinematics.forward import difference
from sim.bench.clock import Clock
from sim.bench.core.touched import bytes_touched
from sim.bench.frames import RATE_HZ, Pair, all_keep
from sim.tables.table import value_row

REPLAN = {"p50": 14.0, "p99": 70.0}
BLOCKED = {"p50": 20.0, "p99": 90.0}
BLOCKED_SHARE = 0.6  # of the frames of the pairs that BLOCKED is asked of
KEPT = {"p50": 8.0, "p95": 14.0, "p99": 90.0}
FOLLOW = {"p50": 10.0, "p99": 150.0}
CHANGED = 0.5  # [rad or m] between paths of successive frames
_SHARES = np.linspace(0.0, 1.0, 50)  # of the paths' lengths, where they are compared
_AT_GOAL = 1e-6  # [rad or m]
_SEARCHED = "... frames that searched, or hold"
# straight motions are looked at in every so many frames, so far apart [rad or m]
_LOOK_EVERY, _LOOK_STEP = 20, 0.02


def replanned(cell_map: CellMap, pairs: list[Pair]) -> list:
    """Time frames replanned from scratch at the same q; by shapes, then by points."""
    clock, vertices = _replanned(cell_map, pairs, shapes=True)
    sampled, _ = _replanned(cell_map, pairs, shapes=False)
    blocked = vertices != 2
    note = "same q, searched from scratch in every frame; capsules written in place"
    return [
        clock.row("capsules in -> path out", note, **REPLAN),
        clock.row("... frames with a path", "", vertices > 0),
        clock.row("... frames without a path", "holding", vertices == 0),
        clock.row("... straight motion blocked", "by its close test", blocked),
        value_row("frames without a path", 100 * np.mean(vertices == 0), "%"),
        value_row("frames with the straight motion blocked", 100 * blocked.mean(), "%"),
        sampled.row("points in -> path out", "the same frames, sampled"),
        *_straight_motions(cell_map, pairs, ~blocked),
    ]


def _straight_motions(
    cell_map: CellMap, pairs: list[Pair], found: np.ndarray
) -> list[dict]:
    """Compare the straight motions that were `found` free with exact geometry."""
    exact, m, keeps = ExactRobot(cell_map.robot), cell_map.safety.m, []
    for pair in pairs:
        dq = difference(cell_map.robot, pair.q_start, pair.q_goal)
        pieces = int(np.ceil(np.abs(dq).max() / _LOOK_STEP))
        places = pair.q_start + np.linspace(0.0, 1.0, 1 + pieces)[:, None] * dq
        some = pair.capsules[::_LOOK_EVERY]
        keeps += [all_keep(exact, places, rods, m) for rods in some]
    free = np.array(keeps)
    looked = found.reshape(len(pairs), -1)[:, ::_LOOK_EVERY].ravel()
    note = f"every {_LOOK_EVERY}th frame, in places {_LOOK_STEP:g} rad apart"
    share = looked[free].mean() if free.any() else np.nan
    return [
        value_row("straight motions that keep m by exact geometry", 100 * free.mean(),
                  "%", note),
        value_row("... called free, of those", 100 * share, "%"),
    ]  # fmt: skip


def blocked(cell_map: CellMap, pairs: list[Pair]) -> list:
    """Time frames replanned from scratch whose straight motion is blocked."""
    clock, vertices = _replanned(cell_map, pairs, shapes=True)
    bent, note = vertices != 2, "other pairs, across whose straight motion the arm is"
    return [
        clock.row("straight motion blocked -> path out", note, bent, **BLOCKED),
        value_row("... share of these pairs' frames", 100 * bent.mean(), "%",
                  least=100 * BLOCKED_SHARE),
        value_row("... frames without a path", 100 * np.mean(vertices == 0), "%"),
    ]  # fmt: skip


def _replanned(
    cell_map: CellMap, pairs: list[Pair], shapes: bool
) -> tuple[Clock, np.ndarray]:
    """Return the times, and the number of corners of each path."""
    planner, clock, vertices = (
        ReactivePlanner(cell_map, always_replan=True),
        Clock(),
        [],
    )
    for pair in pairs:
        frames = pair.asked(shapes)
        pair.begin(planner, frames[0])
        vertices += [len(clock(ask, planner, pair.q_start).path) for ask in frames]
    return clock, np.array(vertices)


def kept(cell_map: CellMap, pairs: list[Pair]) -> list:
    """Time frames of a planner as users have it: the path is kept while it is free."""
    planner, clock = ReactivePlanner(cell_map), Clock()
    changed, touched, around, stays = [], [], [], []
    for pair in pairs:
        frames = pair.asked()
        pair.begin(planner, frames[0])
        answers = [clock(ask, planner, pair.q_start) for ask in frames]
        paths = [answer.path for answer in answers]
        stays += [answer.stage == IN_USE for answer in answers]
        around += python_around(planner, frames[-1], pair.q_start)
        changed += [
            difference_of(last, path) > CHANGED
            for last, path in pairwise(paths)
            if len(last) and len(path)
        ]
        # the same again: to count what a frame touches empties the processor's caches
        pair.begin(planner, frames[0])
        for ask in frames:
            ask(planner, pair.q_start)
            segment, points = planner.path.segment, len(planner.points)
            touched.append(bytes_touched(planner.memory, segment, points))
    note, share = "same q, default settings, searched only where it is blocked", 0.5
    late = float(np.percentile(clock.wall, 95)) / 1e3
    return [
        clock.row("path kept while it is free", note, **KEPT),
        value_row("... p95", late, "us"),
        value_row(_SEARCHED, 100 * np.mean(np.logical_not(stays)), "%"),
        value_row(
            "... Python around the compiled calls", np.median(around), "us", most=3
        ),
        value_row(
            "... changed by more than 0.5 rad", 100 * np.mean(changed), "%", most=share
        ),
        value_row("... bytes touched, estimated, p50", np.median(touched), "bytes"),
        value_row("... the same, p99", np.percentile(touched, 99), "bytes"),
        _kept_by_points(cell_map, pairs),
        _improved(cell_map, pairs),
    ]


def python_around(
    planner: ReactivePlanner, ask: Callable, q: np.ndarray, times: int = 40
) -> list[float]:
    """Time what of a frame is not inside its compiled call [us]; it is repeated.

    The call is wrapped by clocks meanwhile. What those take beside it is measured
    around a function that does nothing, and left out.
    """
    inside, around, alone = [0], [], []

    def timed(function: Callable) -> Callable:
        def call(*args: object) -> object:
            begun = time.perf_counter_ns()
            result = function(*args)
            inside[0] += time.perf_counter_ns() - begun
            return result

        return call

    def left(call: Callable, *args: object) -> float:
        inside[0], begun = 0, time.perf_counter_ns()
        call(*args)
        return 1e-3 * (time.perf_counter_ns() - begun - inside[0])

    idle = timed(lambda *_: None)
    frame = planner.frame  # which has been asked by the same arrays
    with patch.object(frame, "step_again", timed(frame.step_again)):
        for _ in range(times):
            around.append(left(ask, planner, q))
            alone.append(left(idle, *range(2)))
    # one of the two clocks that `left` reads is around what is measured, always
    clocks = np.median(alone) - np.median([left(int) for _ in range(times)])
    return [max(0.0, t - clocks) for t in around]


def _kept_by_points(cell_map: CellMap, pairs: list[Pair]) -> dict:
    """Time the same frames where the arm is given as points."""
    planner, clock = ReactivePlanner(cell_map), Clock()
    for pair in pairs:
        frames = pair.asked(shapes=False)
        pair.begin(planner, frames[0])
        for ask in frames:
            clock(ask, planner, pair.q_start)
    return clock.row("... the same frames, sampled", "points at hand")


def _improved(cell_map: CellMap, pairs: list[Pair]) -> dict:
    """Time the same where the path is improved between frames, which is not timed."""
    planner, clock = ReactivePlanner(cell_map), Clock()
    for pair in pairs:
        frames = pair.asked()
        pair.begin(planner, frames[0])
        for ask in frames:
            clock(ask, planner, pair.q_start)
            planner.improve(4)
    return clock.row("... improve(4) between frames", "the step alone is timed")


def difference_of(one: np.ndarray, other: np.ndarray) -> float:
    """Return how far two paths (k, dof) are apart in a joint at most [rad or m].

    Compared at the same shares of their lengths.
    """
    return float(np.abs(_along(one) - _along(other)).max())


def _along(path: np.ndarray) -> np.ndarray:
    ends = np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))
    lengths = np.concatenate([[0.0], ends])
    at = _SHARES * lengths[-1]
    return np.stack([np.interp(at, lengths, joint) for joint in path.T], axis=1)


def followed(cell_map: CellMap, pairs: list[Pair]) -> list:
    """Time frames of a robot that moves along its path, replanned or only looked at."""
    note = "q new every frame, at joint speed limits, searched where it is blocked"
    lazily, turned, kept = _follow(cell_map, pairs, False)
    always, *_ = _follow(cell_map, pairs, True)
    return [
        lazily.row("robot follows its path", note, **FOLLOW),
        value_row(_SEARCHED, 100 * np.mean(np.logical_not(kept)), "%"),
        always.row("... searched from scratch", "in every frame"),
        turned.row("... first step to a new goal", "not among those above", p99=5000.0),
    ]


def _follow(
    cell_map: CellMap, pairs: list[Pair], always: bool
) -> tuple[Clock, Clock, list[bool]]:
    """Return the times of all steps, those of the first to a new goal apart.

    And which of the others kept the path in use.
    """
    planner = ReactivePlanner(cell_map, always_replan=always)
    clock, turned, kept = Clock(), Clock(), []
    for pair in pairs:
        frames, q = pair.asked(), pair.q_start
        goals, at = [pair.q_goal, pair.q_start], 0
        pair.begin(planner, frames[0])
        timed = clock
        for ask in frames:
            answer = timed(ask, planner, q)
            if timed is clock:
                kept.append(answer.stage == IN_USE)
            timed = clock
            if answer.status == HOLDING:
                continue
            q = advance(answer.path, cell_map.robot.max_velocity, 1.0 / RATE_HZ)
            if np.abs(q - goals[at]).max() < _AT_GOAL:
                at, timed = 1 - at, turned
                planner.set_goals(goals[at : at + 1])
    return clock, turned, kept


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
        for ask in pair.asked()[::step]:
            planner.reset()
            clock(ask, planner, pair.q_start)
    note = "nothing known of q: motions to near nodes are tested"
    return [clock.row("first step at a q never seen", note, p99=3000.0)]


def goal_setting(cell_map: CellMap, pairs: list[Pair], seed: int) -> list:
    """Time set_goals: a roadmap node, any valid configuration, unchanged goals.

    It joins a goal by a few motions. The others follow when a frame finds no path, and
    between frames: how long they take together is told apart.
    """
    planner = ReactivePlanner(cell_map)
    node, free, same, later = Clock(), Clock(), Clock(), Clock()
    rng, joined = np.random.default_rng(seed), []
    number, wanted = planner.memory.goals.number, planner.settings.goal_connections
    for pair in pairs:
        planner.reset()
        at = rng.integers(cell_map.roadmap.n_nodes)
        q_node = cell_map.roadmap.nodes[at].copy()
        node(planner.set_goals, [q_node])
        free(planner.set_goals, [pair.q_goal])
        same(planner.set_goals, [pair.q_goal])
        joined.append(number.item(0))
        later(planner.attacher.attach_more, wanted)
    return [
        node.row("set_goals, a roadmap node", "", p99=1000.0),
        free.row("set_goals, any valid configuration", "", p99=4000.0),
        value_row(f"... motions into it by then, of {wanted}", np.mean(joined), ""),
        later.row("... the others, in frames without a path or in improve", ""),
        same.row("set_goals, unchanged", "checked, nothing done"),
    ]
