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
WALLED, FIRST = {"p99": 500.0}, {"p99": 3000.0}


def walled_in(
    cell_map: CellMap, pairs: list[Pair], seed: int, repeats: int = 10
) -> list:
    """Time frames whose goal, or start, is free but cut off by arms around it.

    Arms are put beside the links one by one, each just outside the clearance, until
    the planner finds no path in any of so many frames, in which it joins more motions
    to both ends: so these are the hardest frames of their kind, cut off by the last arm
    only. The first such frame, which joins the start, is a first step at a q never seen
    and told apart. The search beyond the roadmap is left out: how long such a frame
    looks for another way is a setting.
    """
    rows = []
    for place in ("goal", "start"):
        rng = np.random.default_rng(seed)
        planner = ReactivePlanner(cell_map, True, PlannerSettings(search=0))
        clock, first, held, arms = Clock(), Clock(), [], []
        for pair in pairs:
            points, n_arms = wall(planner, pair, place, rng, repeats)
            if points is None:
                continue
            arms.append(n_arms)
            _begin_anew(planner, pair)
            for timed in (first, *[clock] * (repeats - 1)):
                answer = timed(planner.step, points, q=pair.q_start, rounding=ROUND)
                held.append(answer.status == HOLDING)
        note = "free, but cut off by arms around it; same q, both ends new"
        rows.append(clock.row(f"{place} walled in", note, **WALLED))
        note = "it joins the start, as the first step at a q never seen"
        rows.append(first.row("... the first frame with them", note, **FIRST))
        share = 100.0 * float(np.mean(held)) if held else np.nan
        rows.append(value_row("... frames that hold", share, "%", least=100.0))
        mean = float(np.mean(arms)) if arms else 0.0
        rows.append(value_row(f"... arms around the {place}, mean", mean, ""))
    return rows


def wall(
    planner: ReactivePlanner,
    pair: Pair,
    place: str,
    rng: np.random.Generator,
    frames: int,
) -> tuple[np.ndarray | None, int]:
    """Return (points, number of arms) that wall a pair's goal or start in, or None.

    The planner, to which both ends are new, holds in so many frames with them.
    """
    q = pair.q_goal if place == "goal" else pair.q_start
    points = np.zeros((0, 3))
    for n_arms in range(1, _ARMS + 1):
        more = _beside(planner, pair, q, points, rng)
        if more is None:
            return None, 0
        points = more
        _begin_anew(planner, pair)
        answers = (
            planner.step(points, q=pair.q_start, rounding=ROUND) for _ in range(frames)
        )
        if all(answer.status == HOLDING for answer in answers):
            return points, n_arms
    return None, 0


def _begin_anew(planner: ReactivePlanner, pair: Pair) -> None:
    """Let a planner have a pair's goal, and its first frame with nobody about.

    It knows no motions of either end but those that it joins now.
    """
    planner.set_goals([pair.q_start])  # so that the goal is one never seen
    planner.set_goals([pair.q_goal])
    planner.reset()
    planner.step(np.zeros((0, 3)), q=pair.q_start)


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
