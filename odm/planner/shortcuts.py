"""Straight motions instead of a part of the path in use, or of all that is left."""

import numpy as np

from odm.frame.frame import Frame
from odm.planner.attaching import Attacher
from odm.planner.hysteresis import Hysteresis
from odm.planner.path import Candidates, PathInUse

_CUT_SAVES = 0.02  # a cut must save this share of what it replaces
_WAIT = 8  # frames from a look that found the straight motion blocked to the next
_DETOUR = 1.1  # times the straight length: a rest shorter than that stays


class Polisher:
    """Tests cuts from vertex to vertex of the path in use, between two frames.

    The path itself is left alone, since the robot is on it; what is found is a
    candidate with its cells, by which the next search shortens its path.

    Args:
        frame: The present frame.
        path: The path in use.
        candidates: Where cuts are remembered.
        attacher: Makes the cells of a cut.
    """

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        candidates: Candidates,
        attacher: Attacher,
    ) -> None:
        """Keep what it works on."""
        self.frame, self.path = frame, path
        self.candidates, self.attacher = candidates, attacher

    def run(self, budget: int) -> tuple[int, int]:
        """Test at most `budget` cuts; return how many were found, and the rest."""
        frame, path = self.frame, self.path
        if len(path) < 3:
            return 0, budget
        found = 0
        standing = self.attacher.is_fresh(frame.q)
        first = path.segment + (0 if standing else 1)
        last = len(path) - 1
        for gap in range(last - first, 1, -1):
            for i in range(first, last - gap + 1):
                if budget <= 0:
                    break
                tested, cut = self._try(i, i + gap, standing and i == first)
                budget -= tested
                found += cut
        if found:
            path.look_soon()
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
        return bool(np.linalg.norm(dq * weights) < (1.0 - _CUT_SAVES) * now)


class Straightener:
    """Goes straight to the goal where that is free.

    From an attached start the search itself tries the straight motion, by its cells.
    For a robot under way there are none: the close test decides.

    Args:
        frame: The present frame.
        path: The path in use, which is replaced.
        attacher: Knows whether the search has tried it.
        hysteresis: Knows what to keep clear of.
    """

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        attacher: Attacher,
        hysteresis: Hysteresis,
    ) -> None:
        """No look has found anything."""
        self.frame, self.path = frame, path
        self.attacher, self.hysteresis = attacher, hysteresis
        self._next = 0  # frame of the next look

    def reset(self) -> None:
        """Look again in the next frame: there are other goals, or another start."""
        self._next = 0

    def save(self) -> dict[str, np.ndarray]:
        """Return when it looks again."""
        return {"next": np.array(self._next)}

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Look again when that was saved."""
        self._next = int(saved["next"])

    def run(self) -> None:
        """Take the straight motion for a path that was just found, where it is free."""
        frame, path = self.frame, self.path
        now = frame.number
        if now < self._next or self.attacher.is_fresh(frame.q):
            return
        q = frame.q.copy()
        dq = frame.difference(q, path.q[len(path) - 1])
        length = float(np.linalg.norm(dq * frame.cell_map.roadmap.weights))
        if path.rest_length(q) < _DETOUR * length:
            return
        free = frame.motion_clear(q, dq, self.hysteresis.cloud())
        if not free or not frame.static.motion_free(q, dq):
            self._next = now + _WAIT
            return
        path.go_straight(int(frame.memory.goals.count[2]), q)
