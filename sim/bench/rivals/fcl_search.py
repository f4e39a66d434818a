"""Competitor: lazy A* with online python-fcl checks, as a user would write it."""

import heapq
import math

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.exact.fcl_robot import FclRobot
from roadmap.kinematics.forward import difference
from roadmap.kinematics.joint_tree import PRISMATIC
from sim.bench.frames import shapes
from sim.bench.rivals.query import Query

STEP_RAD, STEP_M = 0.05, 0.01  # largest joint step between two checks


class FclSearch:
    """Lazy A* in Python; every check is a broad-phase query of python-fcl.

    The robot is its exact convex solids, the arm two fcl capsules; contact only, no
    clearance. Motions are sampled every 0.05 rad (0.01 m) of the fastest joint.
    """

    what = (
        "same roadmap, attachments and cost-to-go; python-fcl with AABB-tree managers, "
        "exact convex solids against two capsules, contact only, no clearance; samples "
        "every 0.05 rad or 1 cm of joint motion, by bisection order; verdicts "
        "remembered within the frame"
    )

    def __init__(self, cell_map: CellMap) -> None:
        """Make the collision objects."""
        self.robot, self.roadmap = cell_map.robot, cell_map.roadmap
        self.checker = FclPair(cell_map)
        slides = np.zeros(self.robot.dof, bool)
        of_slides = self.robot.tree_i[self.robot.tree_i[:, 2] == PRISMATIC, 1]
        slides[of_slides] = True
        self.step = np.where(slides, STEP_M, STEP_RAD)

    def set_query(self, query: Query) -> None:
        """Take start and goal with their attachments."""
        self.query = query
        lengths = query.goal_lengths.tolist()
        self.into_goal = dict(zip(query.goal_nodes.tolist(), lengths, strict=True))

    def search(self, rods: np.ndarray) -> np.ndarray | None:
        """Search one frame from scratch; the path (k, dof) or None."""
        self.checker.set_obstacles(rods)
        query, self.node_memo, self.edge_memo = self.query, {}, {}
        ends = (query.q_start, query.q_goal)
        if not all(self.checker.free(q) for q in ends):
            return None
        if query.straight and self.motion_free(*ends):
            return np.stack(ends)
        return self._a_star()

    def path_free(self, path: np.ndarray, rods: np.ndarray) -> bool:
        """Return whether no sample of a whole path (k, dof) touches the arm."""
        self.checker.set_obstacles(rods)
        nodes = all(self.checker.free(q) for q in path)
        legs = zip(path[:-1], path[1:], strict=True)
        return nodes and all(self.motion_free(a, b) for a, b in legs)

    def motion_free(self, q_from: np.ndarray, q_to: np.ndarray) -> bool:
        """Test the samples between two configurations, coarse ones first."""
        dq = difference(self.robot, q_from, q_to)
        pieces = max(1, math.ceil((np.abs(dq) / self.step).max()))
        shares = np.arange(1, pieces)
        # the more often an index can be halved, the earlier it is looked at
        order = np.argsort([-(k & -k) for k in shares.tolist()], kind="stable")
        return all(self.checker.free(q_from + dq * (shares[k] / pieces)) for k in order)

    def _a_star(self) -> np.ndarray | None:
        query, goal = self.query, -1
        done, came, heap, count = set(), {}, [], 0
        starts = query.start_nodes.tolist()
        for v, g in zip(starts, query.start_lengths.tolist(), strict=True):
            heapq.heappush(heap, (g + query.h[v], count, g, v, None))
            count += 1
        while heap:
            _, _, g, v, parent = heapq.heappop(heap)
            if v in done:
                continue
            if v != goal and not self._node_free(v):
                done.add(v)
                continue
            if not self._way_free(parent, v):
                continue
            done.add(v)
            came[v] = parent
            if v == goal:
                return self._path(came, goal)
            for w, length in self._next(v):
                if w not in done:
                    h = 0.0 if w == goal else query.h[w]
                    heapq.heappush(heap, (g + length + h, count, g + length, w, v))
                    count += 1
        return None

    def _next(self, v: int):  # noqa: ANN202 (pairs of vertex and length)
        roadmap = self.roadmap
        if v in self.into_goal:
            yield -1, self.into_goal[v]
        part = slice(roadmap.adj_ptr[v], roadmap.adj_ptr[v + 1])
        yield from zip(
            roadmap.adj_node[part].tolist(), roadmap.adj_length[part].tolist(),
            strict=True,
        )  # fmt: skip

    def _node_free(self, v: int) -> bool:
        if v not in self.node_memo:
            self.node_memo[v] = self.checker.free(self.roadmap.nodes[v])
        return self.node_memo[v]

    def _way_free(self, parent: int | None, v: int) -> bool:
        key = (parent, v) if parent is None or parent < v else (v, parent)
        if key not in self.edge_memo:
            nodes, query = self.roadmap.nodes, self.query
            a = query.q_start if parent is None else nodes[parent]
            b = query.q_goal if v == -1 else nodes[v]
            self.edge_memo[key] = self.motion_free(a, b)
        return self.edge_memo[key]

    def _path(self, came: dict, goal: int) -> np.ndarray:
        vertices, v = [], came[goal]
        while v is not None:
            vertices.append(self.roadmap.nodes[v])
            v = came[v]
        return np.stack([self.query.q_start, *vertices[::-1], self.query.q_goal])


class FclPair(FclRobot):
    """The robot's moving solids against an arm: managers on both sides."""

    def __init__(self, cell_map: CellMap) -> None:
        """Register the robot's solids once."""
        super().__init__(cell_map.robot)
        self.own = self._fcl.DynamicAABBTreeCollisionManager()
        self.own.registerObjects(self._objects)
        self.own.setup()

    def set_obstacles(self, rods: np.ndarray) -> None:
        """Take capsules (k, 7) as the obstacles."""
        super().set_obstacles(shapes(rods))

    def free(self, q: np.ndarray) -> bool:
        """Return whether no moving solid touches an obstacle at q."""
        fcl = self._fcl
        self._place(q)
        self.own.update()
        data = fcl.CollisionData()
        self.own.collide(self._manager, data, fcl.defaultCollisionCallback)
        return not data.result.is_collision
