"""Frames in which the goal or the start is walled in, and what they cost."""

import numpy as np

from odm import PlannerSettings, ReactivePlanner, sample_capsules
from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from roadmap.kinematics.forward import sphere_centers
from sim.bench.clock import Clock
from sim.bench.frames import LENGTHS, RADII, ROUND, SPACING, Pair
from sim.tables.table import value_row

_ARMS = 24  # more arms than this do not wall anything in
_TRIES = 40  # placements looked at for each arm
WALLED = {"p99": 500.0}


def walled_in(
    cell_map: CellMap, pairs: list[Pair], seed: int, repeats: int = 10
) -> list:
    """Time frames whose goal, or start, is free but cut off by arms around it.

    Arms are put beside the links one by one, each just outside the clearance, until
    the planner finds no path: so these are the hardest frames of their kind, cut off
    by the last arm only. The search beyond the roadmap is left out: how long such a
    frame looks for another way is a setting.
    """
    rows = []
    for place in ("goal", "start"):
        rng = np.random.default_rng(seed)
        planner = ReactivePlanner(cell_map, True, PlannerSettings(search=0))
        clock = Clock()
        arms = []
        for pair in pairs:
            points, n_arms = wall(planner, pair, place, rng)
            if points is None:
                continue
            arms.append(n_arms)
            for _ in range(repeats):
                clock(planner.step, points, q=pair.q_start, rounding=ROUND)
        note = "free, but cut off by arms around it; same q"
        rows.append(clock.row(f"{place} walled in", note, **WALLED))
        mean = float(np.mean(arms)) if arms else 0.0
        rows.append(value_row(f"... arms around the {place}, mean", mean, ""))
    return rows


def wall(
    planner: ReactivePlanner, pair: Pair, place: str, rng: np.random.Generator
) -> tuple[np.ndarray | None, int]:
    """Return (points, number of arms) that wall a pair's goal or start in, or None."""
    planner.reset()
    planner.set_goals([pair.q_goal])
    q = pair.q_goal if place == "goal" else pair.q_start
    points = np.zeros((0, 3))
    planner.step(points, q=pair.q_start, rounding=ROUND)
    for n_arms in range(1, _ARMS + 1):
        more = _beside(planner, pair, q, points, rng)
        if more is None:
            return None, 0
        points = more
        if planner.step(points, q=pair.q_start, rounding=ROUND).status == HOLDING:
            return points, n_arms
    return None, 0


def _beside(
    planner: ReactivePlanner,
    pair: Pair,
    q: np.ndarray,
    points: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray | None:
    """Return `points` and one more arm beside the links at q; both ends stay free."""
    cell_map = planner.cell_map
    robot, safety = cell_map.robot, cell_map.safety
    keep = safety.rho + safety.m
    centers = sphere_centers(robot, q)
    outer = np.flatnonzero(robot.sphere_body >= max(1, robot.tip_body - 4))
    for _ in range(_TRIES):
        i = rng.choice(outer)
        away = _direction(rng)
        gap = robot.spheres[i, 3] + keep + RADII[1] + rng.uniform(0.002, 0.03)
        middle = centers[i] + gap * away
        along = np.cross(away, _direction(rng))
        along *= 0.5 * LENGTHS[1] / np.linalg.norm(along)
        elbow = middle - along
        shoulder = elbow + LENGTHS[0] * (away if away[2] > -0.5 else _direction(rng))
        rods = np.array(
            [
                np.concatenate([shoulder, elbow, RADII[:1]]),
                np.concatenate([elbow, middle + along, RADII[1:]]),
            ]
        )
        both = np.concatenate([points, sample_capsules(rods, SPACING)])
        planner.step(both, q=pair.q_start, rounding=ROUND)
        ends = (pair.q_start, pair.q_goal)
        if all(planner.separation(end) > keep for end in ends):
            return both
    return None


def _direction(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)
