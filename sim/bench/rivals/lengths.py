"""Path lengths beside those of OMPL, on the same frames: first answer, and improved."""

import time

import numpy as np

from odm import ReactivePlanner
from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from sim.bench.frames import Pair
from sim.bench.rivals.ompl import OmplMissing, OmplPlanner, length
from sim.tables.table import value_row

IMPROVE_US, BUDGET = 200.0, 4  # CPU time of `improve` for a path, and each call's tests
OMPL_S = 1.0  # that OMPL has for a frame; it simplifies what it found
FIRST, IMPROVED, ANSWERED = 1.45, 1.0, 99.9  # ratios; [%]
_FRAMES = (0.25, 0.5, 1.0)  # where in a pair's frames


def compared(cell_map: CellMap, pairs: list[Pair], seed: int = 1) -> list[dict]:
    """Compare three frames of each pair; each is the first at a start never seen.

    The path is improved until the thread has spent IMPROVE_US on it: the last call may
    end later.
    """
    name = "path length, median ratio to OMPL simplified"
    try:
        other = OmplPlanner(cell_map, seed)
    except OmplMissing:
        return [value_row(f"{name}: OMPL is not installed", float("nan"), "")]
    planner, found = ReactivePlanner(cell_map), []
    first_and_improved(planner, pairs[0], 0)  # compiled, and warm
    for pair in pairs:
        for share in _FRAMES:
            k = max(0, round(share * len(pair.capsules)) - 1)
            its = other.solve(pair, pair.capsules[k], OMPL_S)
            if its is not None:
                found.append((*first_and_improved(planner, pair, k), length(its)))
    first, better, its = np.array(found, float).reshape(-1, 3).T
    mine, solved = first > 0.0, np.maximum(first, better) > 0.0
    better = np.where(better > 0.0, better, first)
    note = "joint space, rad; each frame as the first at its start"
    return [
        value_row(f"{name}, first answer", _ratio(first, its, mine), "", note,
                  most=FIRST),
        value_row(f"{name}, improved", _ratio(better, its, mine), "",
                  f"improve({BUDGET}) until {IMPROVE_US:g} us of CPU time are spent",
                  most=IMPROVED),
        value_row("... frames compared", int(mine.sum()), "frames"),
        value_row("frames answered, of those OMPL solves", _share(solved), "%",
                  f"RRT-Connect, {OMPL_S:g} s, contact only", least=ANSWERED),
    ]  # fmt: skip


def first_and_improved(
    planner: ReactivePlanner, pair: Pair, k: int
) -> tuple[float, float]:
    """Return how long the first answer to frame k is and the improved one; 0: none."""
    ask, q, spent = pair.asked()[k], pair.q_start, 0
    planner.set_goals([pair.q_goal])
    planner.reset()
    answer = ask(planner, q)
    first = 0.0 if answer.status == HOLDING else length(answer.path)
    while spent < 1e3 * IMPROVE_US:
        begun = time.thread_time_ns()
        planner.improve(BUDGET, ahead=q)
        spent += time.thread_time_ns() - begun
        answer = ask(planner, q)
    return first, length(answer.path)


def _share(solved: np.ndarray) -> float:
    return 100.0 * float(solved.mean()) if len(solved) else float("nan")


def _ratio(ours: np.ndarray, its: np.ndarray, keep: np.ndarray) -> float:
    """Return the median ratio where both have a path, without what rounding adds."""
    if not keep.any():
        return float("nan")
    return round(float(np.median(ours[keep] / its[keep])), 6)
