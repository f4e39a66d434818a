"""One start and goal on the roadmap, as the planner attached them."""

from dataclasses import dataclass

import numpy as np

from odm import ReactivePlanner
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference
from sim.bench.frames import Pair

_AT_ONCE = 1000  # motions that are joined in one call


@dataclass(frozen=True, eq=False)
class Query:
    """What a competitor is asked: the planner's own attachments, free of cells.

    Attributes:
        roadmap: The graph.
        q_start, q_goal: (dof,) ends.
        start_nodes, goal_nodes: (k,) nodes joined with either end.
        start_lengths, goal_lengths: (k,) their weighted lengths.
        straight: True if the straight motion may be used at all (self-collision).
        h: (n,) cost to go from every node, on the whole roadmap.
    """

    roadmap: Roadmap
    q_start: np.ndarray
    q_goal: np.ndarray
    start_nodes: np.ndarray
    start_lengths: np.ndarray
    goal_nodes: np.ndarray
    goal_lengths: np.ndarray
    straight: bool
    h: np.ndarray

    def length(self, path: np.ndarray) -> float:
        """Return the weighted length of a path (k, dof)."""
        steps = np.diff(path, axis=0) * self.roadmap.weights
        return float(np.linalg.norm(steps, axis=1).sum())


def query_of(planner: ReactivePlanner, pair: Pair) -> Query:
    """Have a planner attach both ends of a pair with nobody about; return the query.

    All motions that it would try are joined now: by itself it joins the start when it
    first finds the straight motion blocked, and more of both between frames. So take a
    planner that is not timed.
    """
    planner.reset()
    planner.set_goals([pair.q_goal])
    planner.step(np.zeros((0, 3)), q=pair.q_start)
    planner.attacher.join_start(at_once=True)
    while planner.attacher.attach_more(_AT_ONCE):
        pass
    m, roadmap = planner.memory, planner.cell_map.roadmap
    n_starts, n_goals = int(m.start_connections.count[0]), int(m.goals.number[0])
    dq = difference(planner.robot, pair.q_start, pair.q_goal)
    return Query(
        roadmap,
        pair.q_start,
        pair.q_goal,
        m.start_connections.node[:n_starts].copy(),
        m.start_connections.length[:n_starts].copy(),
        m.goals.node[0, :n_goals].copy(),
        m.goals.length[0, :n_goals].copy(),
        bool(planner.static.motion_free(pair.q_start, dq)),
        m.goals.h[0].copy(),
    )
