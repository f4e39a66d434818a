"""`odm bench attach`: taking an object into the hand, frames with it, letting go.

Two planners on one map see the same frames turn by turn, one with the map's whole
payload envelope in its hand, one with nothing: the ratio of their frames does not
depend on what else the machine does. Pairs whose start or goal cannot be held with the
envelope are drawn again.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from odm import Box, ReactivePlanner, carried_object, load_map
from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from odm.cell_map.payload import required
from roadmap.errors import BadInput
from roadmap.transforms import pose_of
from sim.bench.clock import Clock
from sim.bench.core.frame_rows import advance
from sim.bench.frames import RATE_HZ, ROUND, Pair, make_pairs
from sim.tables.header import header
from sim.tables.table import value_row

ATTACH_MS, RATIO = 5.0, 1.5
_FINE_BALLS = 8  # of an object of many spheres


def run(
    map_dir: str | Path,
    *,
    seed: int = 1,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure with a map that has a payload layer.

    Args:
        map_dir: Folder of a built map.
        seed: Of the pairs.
        short: Few of everything: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".

    Raises:
        BadInput: The map has no payload layer, or no pair can be held with one.
    """
    tell = tell or (lambda text: None)
    cell_map = load_map(map_dir, verify=False)
    layer = required(cell_map)
    pairs, frames, times = (4, 12, 5) if short else (40, 120, 60)
    bare, loaded = (ReactivePlanner(cell_map) for _ in range(2))
    loaded.attach(layer.spheres)
    tell("pairs")
    drawn = _held(loaded, make_pairs(cell_map, pairs, frames, seed))
    tell("attach and detach")
    rows = _hand(cell_map, drawn[0], times)
    tell("frames searched from scratch")
    always = [ReactivePlanner(cell_map, always_replan=True) for _ in range(2)]
    always[1].attach(layer.spheres)
    rows += _frames("searched from scratch", always, drawn, moving=False)
    tell("frames of a robot on its way")
    rows += _frames("a robot on its way", [bare, loaded], drawn, moving=True)
    tell("storage")
    arm = cell_map.arm_cells.bytes_by_view()[0]
    own = sum(a.nbytes for a in layer.arrays().values())
    share = value_row("payload layer on disk", 1e-6 * own, "MB")
    of = value_row("... of the arm's edge-major view", 100 * own / arm, "%")
    n = cell_map.roadmap.n_nodes
    closed = 100 * layer.closed[n:].mean()
    shut = value_row("edges that the envelope closes", closed, "%")
    setup = {
        "pairs": len(drawn),
        "frames": len(drawn) * frames,
        "seed": seed,
        "envelope": str(layer.recipe.as_dict()),
        "in the hand": f"the envelope itself, {len(layer.spheres)} spheres",
    }
    return {
        "bench": "attach",
        "header": header(cell_map),
        "setup": setup,
        "rows": [*rows, share, of, shut],
    }


def _held(loaded: ReactivePlanner, pairs: list[Pair]) -> list[Pair]:
    """Keep the pairs whose ends are valid with the payload."""
    still = np.zeros(loaded.robot.dof)
    good = [
        p
        for p in pairs
        if loaded.static.motion_free(np.array(p.q_start), still)
        and loaded.static.motion_free(np.array(p.q_goal), still)
    ]
    if not good:
        raise BadInput(
            "no pair of configurations can be held with the payload envelope; measure "
            "with a smaller one"
        )
    return good


def _hand(cell_map: CellMap, pair: Pair, times: int) -> list[dict]:
    """Time attach, the frame after it, and detach, of objects that fit."""
    layer = required(cell_map)
    T = pose_of(layer.recipe.position, layer.recipe.rpy)
    size = layer.recipe.radius or 0.5 * min(layer.recipe.size)
    side = 1.1 * size / np.sqrt(3)
    brick = carried_object(Box([side, side, side]))
    corners = 0.25 * size * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    balls = np.hstack([corners, np.full((_FINE_BALLS, 1), 0.3 * size)])
    things = {
        "1 sphere": (np.array([[0.0, 0.0, 0.0, 0.9 * size]]), T),
        f"{_FINE_BALLS} spheres": (balls, T),
        f"a box made ready, {len(brick.spheres)} spheres": (brick, T),
    }
    rows, points = [], pair.points()
    for name, (thing, T_tool_object) in things.items():
        planner = ReactivePlanner(cell_map)
        planner.set_goals([pair.q_goal])
        attach, first, detach = Clock(), Clock(), Clock()
        for k in range(times + 1):
            if k == 1:  # once for what is made at the first use
                attach, first, detach = Clock(), Clock(), Clock()
            planner.step(points[k % len(points)], q=pair.q_start, rounding=ROUND)
            attach(planner.attach, thing, T_tool_object)
            first(planner.step, points[k % len(points)], q=pair.q_start, rounding=ROUND)
            detach(planner.detach)
        rows.append(attach.row(f"attach {name}", "", max=1e3 * ATTACH_MS))
        rows.append(first.row("... first frame after", "its goal is joined anew"))
        rows.append(detach.row("... detach"))
    return rows


def _frames(
    name: str, planners: list[ReactivePlanner], pairs: list[Pair], moving: bool
) -> list[dict]:
    """Time frames of both planners turn by turn."""
    clocks, held = (Clock(), Clock()), [0, 0]
    for pair in pairs:
        at = [pair.q_start, pair.q_start]
        for planner in planners:
            planner.reset()
            planner.set_goals([pair.q_goal])
        points = pair.points()
        for k, planner in enumerate(planners):
            planner.step(points[0], q=at[k], rounding=ROUND)
        for frame in points:
            for k, planner in enumerate(planners):
                answer = clocks[k](planner.step, frame, q=at[k], rounding=ROUND)
                held[k] += answer.status == HOLDING
                if moving and answer.status != HOLDING:
                    at[k] = advance(
                        answer.path, planner.robot.max_velocity, 1.0 / RATE_HZ
                    )
    total = len(clocks[0].cpu)
    ratio = np.median(clocks[1].cpu) / np.median(clocks[0].cpu)
    return [
        clocks[0].row(f"frame, {name}, empty hand"),
        clocks[1].row(f"frame, {name}, with payload"),
        value_row("... p50 with over p50 without, CPU", ratio, "times", most=RATIO),
        value_row("... frames that hold, empty hand", 100 * held[0] / total, "%"),
        value_row("... frames that hold, with payload", 100 * held[1] / total, "%"),
    ]
