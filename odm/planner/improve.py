"""What is done between frames: better goals, shorter paths, joining, smoothing.

A frame answers and no more. What is found here becomes a candidate, which the next
frame tests before it takes it. All of it is counted, so the same frames and the same
budgets give the same bytes.
"""

from collections.abc import Callable

import numpy as np

from odm.frame.frame import Frame
from odm.planner.attaching import Attacher
from odm.planner.path import CandidatePath, Candidates, PathInUse
from odm.planner.settings import ImproveSettings
from odm.planner.smooth import Smoother
from odm.search import _step as step


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


class Improver:
    """Betters the path in use between frames, within a budget of tests.

    In this order: the robot is joined to the roadmap anew where that may help; a better
    path is searched; what cuts the path shortest is made; the straight motion to the
    goal is tested; then cuts from corner to corner and changes in between, half of the
    budget each.
    """

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        candidate: CandidatePath,
        cutter: Cutter,
        smoother: Smoother,
        join: Callable[[], bool],
        settings: ImproveSettings = ImproveSettings(),
    ) -> None:
        self.settings = settings
        self.frame, self.path, self.candidate = frame, path, candidate
        self.cutter, self.smoother, self._join = cutter, smoother, join
        self.reset()

    def reset(self) -> None:
        """Begin again: look at the first occasion."""
        self._next = 0  # frame of the next look
        self.smoother.reset()

    def save(self) -> dict[str, np.ndarray]:
        """Return when it looks again, and how far smoothing has come."""
        return {"look": np.array(self._next)} | self.smoother.save()

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Go on as what was saved."""
        self._next = int(saved["look"])
        self.smoother.load(saved)

    def note_search(self) -> None:
        """Note that this very frame searched a path: to look is left for the next."""
        self._next = max(self._next, self.frame.number + 1)

    def cut(self, budget: int) -> int:
        """Look for cuts only, by which the next search shortens its path."""
        return self.cutter.run(budget)[0]

    def run(self, budget: int, ahead: np.ndarray | None) -> int:
        """Spend the budget; return how many changes were made to the candidate."""
        candidate, smoother, made = self.candidate, self.smoother, 0
        if budget > 0 and self.frame.number >= self._next:
            self._next = self.frame.number + self.settings.look_every
            budget -= 1 + self.settings.join_takes * self._join()
            if budget < 0:  # to look is left for the next call
                self._next = 0
                return 0
            made += self._look(ahead)
        candidate.begin()
        cuts, budget = smoother.cut(budget, ahead)
        made += cuts
        if budget > 0:
            straight = smoother.go_straight(ahead)
            budget -= straight >= 0
            made += straight > 0
        # cuts and changes take turns where one test is all there is
        half = budget // 2 if budget > 1 else budget * (self.frame.number % 2)
        cuts, left = self.cutter.run(half)
        if cuts:
            self._next = 0
        made += cuts + smoother.run(budget - half + left, ahead)
        candidate.end()
        return made

    def _look(self, ahead: np.ndarray | None) -> int:
        """Search a better path than the one in use; return 1 where it is offered."""
        frame = self.frame
        found = bool(step.offer_better(frame.memory.table))
        if found and ahead is not None and self.candidate.locate(ahead)[0] < 0:
            self.candidate.withdraw()  # the path up to there stays
            return 0
        if frame.memory.numbers.off_path.item():
            self._next = frame.number + 1  # a robot beside its path offers none
        return int(found)
