"""Competitor: lazy A* with a compiled sphere-capsule check on the same cover."""

from typing import NamedTuple

import numpy as np

from odm.cell_map.cell_map import CellMap
from roadmap.kinematics.forward import difference
from sim.bench.rivals import _compiled_search as kernels
from sim.bench.rivals.query import Query

_CHORDS = 32  # by which the sweep of a motion is measured


class Race(NamedTuple):
    """Arrays of the competitor; see `_compiled_search.lazy_a_star`."""

    nodes: np.ndarray
    edges: np.ndarray
    edge_dq: np.ndarray
    edge_pieces: np.ndarray
    adj_ptr: np.ndarray
    adj_node: np.ndarray
    adj_edge: np.ndarray
    adj_length: np.ndarray
    memo: np.ndarray
    ends: np.ndarray
    join_node: np.ndarray
    join_length: np.ndarray
    join_q: np.ndarray
    join_dq: np.ndarray
    join_pieces: np.ndarray
    frames: np.ndarray
    point: np.ndarray
    counts: np.ndarray


class OpenList(NamedTuple):
    """Entries of the search and their heap, as the planner's own has them."""

    done: np.ndarray
    e_node: np.ndarray
    e_ref: np.ndarray
    e_from: np.ndarray
    e_g: np.ndarray
    heap_f: np.ndarray
    heap_e: np.ndarray


class CompiledSearch:
    """Keeps the arrays of the compiled competitor for one map.

    It keeps the clearance m and half the motion bound, as the map does; being given
    true capsules, it needs no covering radius: its checks are tighter than cells.
    """

    what = (
        "same roadmap, attachments, cost-to-go and cover; numba; capsules, clearance m "
        "+ mu/2; samples at most mu apart, counted ahead, coarse ones first; body "
        "balls first; verdicts remembered within the frame"
    )

    def __init__(self, cell_map: CellMap) -> None:
        """Work out ahead how finely every edge has to be sampled."""
        self.robot, self.roadmap = cell_map.robot, cell_map.roadmap
        self.arm = cell_map.arm
        self.mu = cell_map.safety.mu
        self.margin = cell_map.safety.m + 0.5 * self.mu
        self.widest = np.zeros(len(self.robot.tree_i))
        np.maximum.at(self.widest, self.arm.body, self.arm.spheres[:, 3])
        roadmap = self.roadmap
        q = np.ascontiguousarray(roadmap.nodes[roadmap.edges[:, 0]])
        self.edge_dq = difference(self.robot, q, roadmap.nodes[roadmap.edges[:, 1]])
        self.edge_pieces = self._pieces(q, self.edge_dq)
        n, room = roadmap.n_nodes, 2 * roadmap.n_edges + 4096
        self.memo = np.full(n + roadmap.n_edges, -1, np.int64)
        self.scratch = _open_list(n, room)
        self.frame = 0

    def set_query(self, query: Query) -> None:
        """Take start and goal with their attachments."""
        nodes = self.roadmap.nodes
        ids = np.concatenate([query.start_nodes, query.goal_nodes, [-1]])
        k = len(query.start_nodes)
        q_from = np.repeat(query.q_start[None], len(ids), axis=0)
        q_from[k:-1] = nodes[query.goal_nodes]
        q_to = np.repeat(query.q_goal[None], len(ids), axis=0)
        q_to[:k] = nodes[query.start_nodes]
        dq = difference(self.robot, q_from, q_to)
        straight = np.linalg.norm(dq[-1] * self.roadmap.weights)
        length = np.concatenate([query.start_lengths, query.goal_lengths, [straight]])
        self.query, self.n_starts, self.n_goals = query, k, len(query.goal_nodes)
        pieces = self._pieces(q_from, dq)
        pieces[-1] *= query.straight
        roadmap, n_bodies = self.roadmap, len(self.robot.tree_i)
        self.race = Race(
            roadmap.nodes, roadmap.edges, self.edge_dq, self.edge_pieces,
            roadmap.adj_ptr, roadmap.adj_node, roadmap.adj_edge, roadmap.adj_length,
            self.memo, np.stack([query.q_start, query.q_goal]), ids, length, q_from, dq,
            pieces, np.zeros((n_bodies, 12)), np.zeros(self.robot.dof),
            np.zeros(4, np.int64),
        )  # fmt: skip

    def search(self, rods: np.ndarray) -> np.ndarray | None:
        """Search one frame from scratch; the path (k, dof) or None."""
        self.frame += 1
        s = self.scratch
        entry = kernels.lazy_a_star(
            self.race, s, self.arm, self.widest, rods, self.margin, self.frame,
            self.n_starts, self.n_goals, self.query.h,
        )  # fmt: skip
        if entry < 0:
            return None
        vertices = []
        while entry >= 0:
            vertices.append(int(s.e_node[entry]))
            entry = int(s.e_from[entry])
        nodes = [self.roadmap.nodes[v] for v in vertices[:0:-1]]
        return np.stack([self.query.q_start, *nodes, self.query.q_goal])

    def _pieces(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        out = np.zeros(len(q), np.int64)
        centers = np.zeros((_CHORDS + 1, len(self.arm.spheres), 3))
        frames = np.zeros((len(self.robot.tree_i), 12))
        kernels.count_pieces(
            self.arm, np.ascontiguousarray(q), np.ascontiguousarray(dq), self.mu,
            frames, centers, out,
        )  # fmt: skip
        return out


def _open_list(n: int, room: int) -> OpenList:
    return OpenList(
        np.zeros(n + 1, np.int64), np.zeros(room, np.int32), np.zeros(room, np.int32),
        np.zeros(room, np.int32), np.zeros(room), np.zeros(room),
        np.zeros(room, np.int32),
    )  # fmt: skip
