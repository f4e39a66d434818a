"""The peers, each in its best known setting: what is asked of them, and why so."""

import heapq
from typing import Protocol

import numpy as np

from odm import Obstacles, ReactivePlanner
from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from odm.close_test.static import StaticTest
from sim.bench.rivals.fcl_search import FclPair, FclSearch
from sim.bench.rivals.ompl import OmplPlanner
from sim.bench.rivals.peer_cases import CLUTTER, Case, Frame

LIMIT_S = 1.0  # that OMPL gets for a frame
MOTIONS, MOST_CALLS = 8, 60  # of `improve`: budget, and calls for a scene
_VOXEL = 0.02  # [m] boxes that stand for a cloud where a library takes shapes only


class Peer(Protocol):
    """Who is asked for a path.

    Attributes:
        name: In the table.
        setting: How it is used, and why so.
        cost: Rough seconds of a frame; the dear ones get fewer.
    """

    name: str
    setting: str
    cost: float

    def begin(self, case: Case) -> None:
        """Take a new start and goal; not timed."""

    def path(self, frame: Frame) -> np.ndarray | None:
        """Return the path (k, dof) of a frame, or None; timed."""

    def after(self) -> None:
        """Do what is done between frames; not timed."""


class Ours:
    """The planner of this project, in one of its modes."""

    cost = 1e-3

    def __init__(self, cell_map: CellMap, mode: str) -> None:
        """Make the planner."""
        self.name, self.mode = f"odm, {mode}", mode
        replanned = mode == "replanned"
        self.planner = ReactivePlanner(cell_map, always_replan=replanned)
        self.rho = cell_map.safety.rho
        self.setting = {
            "replanned": "always_replan=True: searched anew, every frame",
            "kept": "as users have it: searched where it is blocked",
            "improved": "improve(4) after each frame, and where a "
            f"scene holds improve({MOTIONS}) up to {MOST_CALLS} times, which is timed",
        }[mode]

    def begin(self, case: Case) -> None:
        """Take start and goal, and one frame to warm up."""
        self.case, self.q = case, case.q_start
        self.planner.reset()
        self.planner.set_goals([case.q_goal])
        first = case.frames[0]
        boxes = Obstacles.of(first.boxes).boxes
        self.obstacles = Obstacles(capsules=len(first.rods), boxes=boxes)
        if case.kind != CLUTTER:
            self.path(first)

    def path(self, frame: Frame) -> np.ndarray | None:
        """Step once; a scene that holds is improved, where this mode does."""
        answer = self._step(frame)
        improves = self.mode == "improved"
        calls = 0
        while answer.status == HOLDING and self.case.kind == CLUTTER and improves:
            calls += 1
            if calls > MOST_CALLS:
                break
            if self.planner.improve(MOTIONS):
                answer = self._step(frame)
        return None if answer.status == HOLDING else answer.path

    def after(self) -> None:
        """Improve, where this mode does."""
        if self.mode == "improved":
            self.planner.improve(4)

    def _step(self, frame: Frame):  # noqa: ANN202 (an answer)
        if frame.cloud is not None:
            return self.planner.step(frame.cloud, q=self.q, covering_radius=self.rho)
        self.obstacles.capsules[:] = frame.rods
        return self.planner.step(self.obstacles, q=self.q)


OUR_MODES = ("replanned", "kept", "improved")


class ShapesPair(FclPair):
    """The robot in python-fcl against whatever a frame holds."""

    def __init__(self, cell_map: CellMap) -> None:
        """Register the robot's solids; one box serves all voxels."""
        super().__init__(cell_map)
        self.voxel = self._fcl.Box(_VOXEL, _VOXEL, _VOXEL)
        self.low, self.high = cell_map.grid.origin, cell_map.grid.upper

    def set_frame(self, frame: Frame) -> None:
        """Take a frame; a cloud as boxes of 2 cm in reach, in a broad phase."""
        if frame.cloud is None:
            super(FclPair, self).set_obstacles(frame.solids())
            return
        fcl, cloud = self._fcl, frame.cloud
        near = ((self.low <= cloud) & (cloud <= self.high)).all(axis=1)
        voxels = np.unique(np.floor(cloud[near] / _VOXEL).astype(np.int64), axis=0)
        self._obstacles = [
            fcl.CollisionObject(self.voxel, fcl.Transform(center))
            for center in (voxels + 0.5) * _VOXEL
        ]
        self._manager = fcl.DynamicAABBTreeCollisionManager()
        self._manager.registerObjects(self._obstacles)
        self._manager.setup()


class Ompl(OmplPlanner):
    """RRT-Connect or PRM of OMPL with a python-fcl validity checker, simplified."""

    def __init__(self, cell_map: CellMap, seed: int, planner: str) -> None:
        """Set it up; it raises OmplMissing where OMPL is not installed."""
        super().__init__(cell_map, seed)
        self.kind, self.cost = planner, 0.3
        self.name = f"OMPL {planner}"
        self.checker = ShapesPair(cell_map)
        self.setting = (
            "python-fcl checks exact convex solids in AABB trees, every 0.05 rad; from "
            f"scratch in each frame, {LIMIT_S:g} s at most (a roadmap that is kept "
            "goes stale), then simplifySolution; contact only, no clearance"
        )

    def begin(self, case: Case) -> None:
        """Take start and goal."""
        self.case = case

    def path(self, frame: Frame) -> np.ndarray | None:
        """Plan one frame from scratch."""
        self.checker.set_frame(frame)
        return self.planned(self.case.q_start, self.case.q_goal, LIMIT_S, self.kind)

    def after(self) -> None:
        """Do nothing."""


class BruteForce:
    """Every node and edge of our roadmap is tested by python-fcl, then Dijkstra."""

    name, cost = "brute-force fcl", 30.0
    setting = (
        "the same roadmap in python-fcl: all nodes, then all edges between free ones "
        "every 0.05 rad in bisection order, with the planner's own attachments; "
        "the shortest path of what is left is the answer: a direct map without the map"
    )

    def __init__(self, cell_map: CellMap) -> None:
        """Make the collision objects."""
        self.search = FclSearch(cell_map)
        self.search.checker = ShapesPair(cell_map)
        self.planner = ReactivePlanner(cell_map)
        self.roadmap = cell_map.roadmap

    def begin(self, case: Case) -> None:
        """Take the attachments that our planner makes of both ends."""
        from sim.bench.frames import Pair
        from sim.bench.rivals.query import query_of

        pair = Pair(case.q_start, case.q_goal, case.frames[0].rods[None], case.kind)
        self.query = query_of(self.planner, pair)

    def path(self, frame: Frame) -> np.ndarray | None:
        """Invalidate everything, then search."""
        check, roadmap, query = self.search.checker, self.roadmap, self.query
        check.set_frame(frame)
        nodes = [check.free(q) for q in roadmap.nodes]
        free = np.zeros(roadmap.n_edges, bool)
        for e, (a, b) in enumerate(roadmap.edges):
            if nodes[a] and nodes[b]:
                ends = roadmap.nodes[a], roadmap.nodes[b]
                free[e] = self.search.motion_free(*ends)
        if not (check.free(query.q_start) and check.free(query.q_goal)):
            return None
        if query.straight and self.search.motion_free(query.q_start, query.q_goal):
            return np.stack([query.q_start, query.q_goal])
        return self._dijkstra(np.array(nodes), free)

    def after(self) -> None:
        """Do nothing."""

    def _dijkstra(self, nodes: np.ndarray, free: np.ndarray) -> np.ndarray | None:
        roadmap, query, motion_free = (
            self.roadmap,
            self.query,
            self.search.motion_free,
        )
        into = dict(zip(query.goal_nodes.tolist(), query.goal_lengths, strict=True))
        heap = [
            (g, v, -1)
            for v, g in zip(
                query.start_nodes.tolist(), query.start_lengths, strict=True
            )
            if nodes[v] and motion_free(query.q_start, roadmap.nodes[v])
        ]
        heapq.heapify(heap)
        came: dict[int, int] = {}
        while heap:
            g, v, parent = heapq.heappop(heap)
            if v in came:
                continue
            came[v] = parent
            if v == roadmap.n_nodes:
                return self._along(came, parent)
            if v in into and motion_free(roadmap.nodes[v], query.q_goal):
                heapq.heappush(heap, (g + into[v], roadmap.n_nodes, v))
            part = slice(roadmap.adj_ptr[v], roadmap.adj_ptr[v + 1])
            for w, e, d in zip(
                roadmap.adj_node[part].tolist(),
                roadmap.adj_edge[part].tolist(),
                roadmap.adj_length[part].tolist(),
                strict=True,
            ):
                if free[e] and w not in came:
                    heapq.heappush(heap, (g + d, w, v))
        return None

    def _along(self, came: dict[int, int], v: int) -> np.ndarray:
        row = []
        while v >= 0:
            row.append(self.roadmap.nodes[v])
            v = came[v]
        return np.stack([self.query.q_start, *row[::-1], self.query.q_goal])


class StopOnly:
    """A robot that knows one path and stops while it is blocked."""

    name, cost = "stop-only fcl", 5e-3
    setting = (
        "the path our planner finds while nobody is there, looked at every 0.05 rad in "
        "each frame: driven or not, never replanned"
    )

    def __init__(self, cell_map: CellMap) -> None:
        """Make the collision objects."""
        self.search = FclSearch(cell_map)
        self.search.checker = ShapesPair(cell_map)
        self.planner = ReactivePlanner(cell_map)
        self.static = StaticTest(
            cell_map.robot, cell_map.scenery, cell_map.safety, cell_map.grid, threads=1
        )

    def begin(self, case: Case) -> None:
        """Find the path without obstacles."""
        self.planner.reset()
        self.planner.set_goals([case.q_goal])
        answer = self.planner.step(np.zeros((0, 3)), q=case.q_start)
        self.known = None if answer.status == HOLDING else answer.path

    def path(self, frame: Frame) -> np.ndarray | None:
        """Return the path that is known, if it is free."""
        if self.known is None:
            return None
        check = self.search.checker
        check.set_frame(frame)
        if not all(check.free(q) for q in self.known):
            return None
        legs = zip(self.known[:-1], self.known[1:], strict=True)
        return (
            self.known if all(self.search.motion_free(*leg) for leg in legs) else None
        )

    def after(self) -> None:
        """Do nothing."""
