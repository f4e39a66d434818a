"""Straight motions from corner to corner instead of a part of the path in use."""

import numpy as np

from odm.frame.frame import Frame
from odm.planner.attaching import Attacher
from odm.planner.path import Candidates, PathInUse
from odm.planner.settings import ImproveSettings


class Cutter:
    """Tests cuts from vertex to vertex of the path in use, between two frames.

    The path itself is left alone, since the robot is on it; what is found is a
    candidate with its cells, by which the next search shortens its path.
    """

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        candidates: Candidates,
        attacher: Attacher,
        settings: ImproveSettings = ImproveSettings(),
    ) -> None:
        self.settings = settings
        self.frame, self.path = frame, path
        self.candidates, self.attacher = candidates, attacher

    def run(self, budget: int) -> tuple[int, int]:
        """Test at most `budget` cuts; return how many were found, and the rest."""
        frame, path = self.frame, self.path
        if len(path) < 3:
            return 0, budget
        found = 0
        standing = self.attacher.is_attached(frame.q)
        first = path.segment + (0 if standing else 1)
        last = len(path) - 1
        for gap in range(last - first, 1, -1):
            for i in range(first, last - gap + 1):
                if budget <= 0:
                    break
                tested, cut = self._try(i, i + gap, standing and i == first)
                budget -= tested
                found += cut
        return found, budget

    def _try(self, i: int, j: int, from_start: bool) -> tuple[int, int]:
        """Test the cut from vertex i to j once; returns (tests, cuts)."""
        frame, path = self.frame, self.path
        q_a = np.ascontiguousarray(frame.q if from_start else path.q[i])
        a = int(frame.memory.goals.count[1] if from_start else path.vertex[i])
        b = int(path.vertex[j])
        if self.candidates.is_known(a, b):
            return 0, 0
        dq = frame.difference(q_a, path.q[j])
        if not self._shorter(q_a, dq, i, j):
            return 0, 0
        if not frame.motion_clear(q_a, dq):
            return 1, 0
        item = -1
        if frame.static.motion_free(q_a, dq):
            item = self.attacher.sweep(q_a[None], dq[None])
        self.candidates.add(a, b, item)
        return 1, int(item >= 0)

    def _shorter(self, q_a: np.ndarray, dq: np.ndarray, i: int, j: int) -> bool:
        weights = self.frame.cell_map.roadmap.weights
        corners = np.concatenate([q_a[None], self.path.q[i + 1 : j + 1]])
        now = np.linalg.norm(np.diff(corners, axis=0) * weights, axis=1).sum()
        most = (1.0 - self.settings.min_cut_saving) * now
        return bool(np.linalg.norm(dq * weights) < most)
