"""`odm bench ompl`: how many frames OMPL answers that we answer too, and how long.

RRT-Connect of the package `ompl` gets one second per frame, exact collision checks
(python-fcl on the convex solids; self-collision and scenery by the same compiled test
as the planner's, since no other knows the same pairs) and its own path simplification.
It plans for contact with the arm; we keep the clearance m.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from odm import CellMap, ReactivePlanner, load_map
from odm.answer import HOLDING
from odm.close_test.static import StaticTest
from roadmap.errors import PlanningError
from sim.bench.clock import Clock, time_row
from sim.bench.frames import CONDITIONS, ROUND, Pair, make_pairs
from sim.bench.rivals.fcl_search import FclPair
from sim.tables.header import header
from sim.tables.table import value_row

LIMIT_S = 1.0
ANSWERED, LENGTH = 95.0, 1.6  # [%], ratio
_RESOLUTION = 0.05  # [rad] between two checks of a motion


class OmplMissing(PlanningError):
    """The optional package `ompl` is not installed."""


def run(
    map_dir: str | Path,
    *,
    pairs: int = 30,
    frames: int = 200,
    each: int = 4,
    seed: int = 1,
    condition: str = "every",
    limit_s: float = LIMIT_S,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Compare answers and path lengths on `each` frames of every pair.

    Our planner sees every frame and improves between frames, as a user's loop does;
    OMPL plans from scratch at the frames that are compared.

    Raises:
        OmplMissing: The package is not installed.
    """
    cell_map, tell = load_map(map_dir, verify=False), tell or (lambda text: None)
    other = OmplPlanner(cell_map, seed)
    ours, rows = Clock(), []
    for k, pair in enumerate(make_pairs(cell_map, pairs, frames, seed, condition)):
        tell(f"pair {k + 1} of {pairs}")
        picked = np.linspace(frames - 1, 0, each, endpoint=False).round().astype(int)
        rows += _compare(cell_map, pair, set(picked.tolist()), other, ours, limit_s)
    setup = {"pairs": pairs, "frames compared": len(rows), "seed": seed}
    setup["OMPL's limit"] = f"{limit_s} s"
    setup["start and goal"] = CONDITIONS[condition]
    table = _rows(np.array(rows, float).reshape(-1, 7), ours)
    return {"bench": "ompl", "header": header(cell_map), "setup": setup, "rows": table}


def _compare(
    cell_map: CellMap, pair: Pair, picked: set[int], other: "OmplPlanner",
    ours: Clock, limit_s: float,
) -> list[tuple]:  # fmt: skip
    """Return (found, length, OMPL found, its length, its us, ends clear, bent)."""
    planner = ReactivePlanner(cell_map)
    planner.set_goals([pair.q_goal])
    rows = []
    for frame, points in enumerate(pair.points()):
        answer = ours(planner.step, points, q=pair.q_start, rounding=ROUND)
        if frame in picked:
            begun = time.perf_counter_ns()
            path = other.solve(pair, pair.capsules[frame], limit_s)
            took = 1e-3 * (time.perf_counter_ns() - begun)
            found, its = answer.status != HOLDING, path is not None
            clear = found or _clear(planner, pair)
            bent = len(answer.path) > 2
            rows.append(
                (found, length(answer.path), its, length(path), took, clear, bent)
            )
        planner.improve(4)
    return rows


def _clear(planner: ReactivePlanner, pair: Pair) -> bool:
    """Return whether start and goal keep the planner's own clearance in this frame."""
    keep = planner.cell_map.safety.rho + planner.cell_map.safety.m
    return all(planner.separation(q) > keep for q in (pair.q_start, pair.q_goal))


def _rows(found: np.ndarray, ours: Clock) -> list[dict]:
    mine, its = found[:, 0] > 0, found[:, 2] > 0
    both = mine & its
    bent = both & (found[:, 6] > 0)
    shared = 100.0 * both.sum() / max(1, its.sum())
    clear = its & (found[:, 5] > 0)
    of_clear = 100.0 * (both & clear).sum() / max(1, clear.sum())
    note = "following or replanning as blocked, improve(4) between frames"
    return [
        value_row("frames OMPL finds a path in", 100.0 * its.mean(), "%"),
        value_row("... of those answered with a path", shared, "%", least=ANSWERED),
        value_row("... where both ends keep rho + m by the cover", of_clear, "%",
                  least=ANSWERED),
        value_row("answered, not found by OMPL", int((mine & ~its).sum()), "frames"),
        value_row("path length, median ratio to OMPL simplified", _ratio(found, both),
                  "", "joint space, rad", most=LENGTH),
        value_row("... where ours is not straight", _ratio(found, bent), ""),
        value_row("path length, ours, median", _median(found[both, 1]), "rad"),
        value_row("path length, OMPL's, median", _median(found[both, 3]), "rad"),
        ours.row("the planner", note),
        time_row("OMPL RRT-Connect, simplified", "where it found a path",
                 found[its, 4], None),
    ]  # fmt: skip


def length(path: np.ndarray | None) -> float:
    """Return the joint-space length of a path (k, dof), 0 for none."""
    if path is None or len(path) < 2:
        return 0.0
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _ratio(found: np.ndarray, keep: np.ndarray) -> float:
    return _median(found[keep, 1] / found[keep, 3])


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


class OmplPlanner:
    """RRT-Connect with exact checks of one robot.

    Args:
        cell_map: Robot and limits.
        seed: OMPL's random numbers start from here.
    """

    def __init__(self, cell_map: CellMap, seed: int) -> None:
        """Set space and checks up."""
        try:
            from ompl import base, geometric, util
        except ImportError as error:
            raise OmplMissing(
                "the package `ompl` is not installed; install it with: "
                "pip install 'ompl==2.0.1', or leave this bench out"
            ) from error
        util.setLogLevel(util.LogLevel.LOG_NONE)
        util.RNG.setSeed(seed)
        self.base, self.geometric = base, geometric
        self.robot, self.checker = cell_map.robot, FclPair(cell_map)
        self.static = StaticTest(
            self.robot, cell_map.scenery, cell_map.safety, cell_map.grid, threads=1
        )
        dof = self.robot.dof
        self.still = np.zeros(dof)
        self.space = base.RealVectorStateSpace(dof)
        bounds = base.RealVectorBounds(dof)
        for j in range(dof):
            bounds.setLow(j, float(self.robot.lower[j]))
            bounds.setHigh(j, float(self.robot.upper[j]))
        self.space.setBounds(bounds)
        extent = self.space.getMaximumExtent()
        self.space.setLongestValidSegmentFraction(_RESOLUTION / extent)

    def solve(self, pair: Pair, rods: np.ndarray, limit_s: float) -> np.ndarray | None:
        """Plan one frame from scratch; the simplified path (k, dof) or None."""
        self.checker.set_obstacles(rods)
        return self.planned(pair.q_start, pair.q_goal, limit_s)

    def planned(
        self,
        q_start: np.ndarray,
        q_goal: np.ndarray,
        limit_s: float,
        kind: str = "RRT-Connect",
    ) -> np.ndarray | None:
        """Plan among the checker's obstacles by RRT-Connect or PRM, as `solve`."""
        setup = self.geometric.SimpleSetup(self.space)
        setup.setStateValidityChecker(self._valid)
        setup.setStartAndGoalStates(self._state(q_start), self._state(q_goal))
        made = {"RRT-Connect": self.geometric.RRTConnect, "PRM": self.geometric.PRM}
        setup.setPlanner(made[kind](setup.getSpaceInformation()))
        setup.solve(limit_s)
        if not setup.haveExactSolutionPath():
            return None
        setup.simplifySolution()
        dof = self.robot.dof
        states = setup.getSolutionPath().getStates()
        return np.array([[s[j] for j in range(dof)] for s in states])

    def _valid(self, state) -> bool:  # noqa: ANN001 (an OMPL state)
        q = np.array([state[j] for j in range(self.robot.dof)])
        return self.static.motion_free(q, self.still) and self.checker.free(q)

    def _state(self, q: np.ndarray):  # noqa: ANN202 (an OMPL state)
        state = self.space.allocState()
        for j, value in enumerate(q.tolist()):
            state[j] = value
        return state
