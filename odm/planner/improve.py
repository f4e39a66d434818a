"""What is done between frames: better goals, shorter paths, joining, smoothing.

A frame answers and no more. What is found here becomes a candidate, which the next
frame tests before it takes it. All of it is counted, so the same frames and the same
budgets give the same bytes.
"""

from collections.abc import Callable

import numpy as np

from odm.frame.frame import Frame
from odm.planner.path import CandidatePath, PathInUse
from odm.planner.settings import ImproveSettings
from odm.planner.shortcuts import Cutter
from odm.planner.smooth import Smoother
from odm.search import _step as step


class Improver:
    """Betters the path in use between frames, within a budget of tests.

    In this order: the robot is joined to the roadmap anew where that may help; a better
    path is searched; the straight motion to the goal is tested; then cuts from corner
    to corner and changes in between, half of the budget each.
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
