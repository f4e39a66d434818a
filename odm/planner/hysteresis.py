"""When a path is given up for another one: hysteresis against trembling obstacles.

A hand that trembles comes and goes over the same place. A path that is free only while
the hand is at the far end of its tremble is blocked a moment later; one that keeps
clear of all places of the last quarter of a second, and a little more, is not. This
only ranks paths: what is free, and what blocks the path in use, is decided by the
frame's own points alone.
"""

import numpy as np

from odm.frame.frame import Frame
from odm.planner.obstacle_history import ObstacleHistory
from odm.planner.path import PathInUse
from odm.planner.settings import PlannerSettings
from odm.search import _step as step


class Hysteresis:
    """Chooses between going on, a steady new path, one only just free, or none.

    A steady path keeps clear of where the obstacles have been; see `ObstacleHistory`.

    Args:
        frame: The present frame.
        path: The path in use.
        history: Where the obstacles have been.
        settings: See PlannerSettings.
        always_replan: Search from scratch in every frame: no hysteresis at all.

    Attributes:
        always_replan: As given; it may be changed.
    """

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        history: ObstacleHistory,
        settings: PlannerSettings,
        always_replan: bool,
    ) -> None:
        """No path was chosen."""
        self.frame, self.path, self.history = frame, path, history
        self.settings, self.always_replan = settings, always_replan
        self.reset()

    def reset(self) -> None:
        """Forget how the path in use was chosen."""
        self._bare = False  # it was only just free when it was taken
        self._wary = 0  # frames in a row such a path must be there to be taken

    @property
    def waits(self) -> bool:
        """Whether paths that are only just free are not taken now."""
        return self._wary > 0

    @property
    def patience(self) -> int:
        """Frames that such a path must be there after one was blocked."""
        calm = self.settings.memory_s and not self.always_replan
        return self.settings.patience if calm else 0

    def cloud(self) -> object:
        """Return what new legs keep clear of: the points, and where they have been."""
        if self.always_replan or not self.settings.memory_s:
            self.frame.sort()
            return self.frame.memory.cloud
        return self.history.cloud()

    def step(self, points: np.ndarray, q: np.ndarray) -> int:
        """Answer a frame whose points were taken; codes of `odm/search/_step.py`."""
        s = self.settings
        if not self.always_replan and s.memory_s:
            return self._choose(points, q)
        table, always = self.frame.memory.table, self.always_replan
        code = step.step(table, points, q, always, s.margin, s.close_tests, s.looks)
        if code != step.BESIDE:
            return code
        self.path.certify_beside(q)
        return self.step(points, q)

    def _choose(self, points: np.ndarray, q: np.ndarray) -> int:
        """Judge the path in use by the frame's own points; look for another one.

        It is looked for among all that the history leaves free, then by the points
        alone.
        """
        frame = self.frame
        code = self.path.judge(points, q)
        if code != step.LOOK:
            return code
        around = self.history.around()
        if len(around) > len(frame.memory.cloud.where):
            frame.make_room(2 * len(around))
            frame.look_at(points)
            code = self.path.judge(points, q)
        code = self._look(around)
        if code == step.NO_PATH and self.history.margin > 0.0:
            code = self._look(self.history.lately())
        frame.look_at(points)
        if code == step.NO_PATH:
            return self._barely(points)
        if code == step.PLANNED:
            self._bare, self._wary = False, 0
            step.adopt(frame.memory.table)
        return code

    def better(self, points: np.ndarray, q: np.ndarray, found: int) -> int:
        """Look for a path to a better goal, though the path in use is free.

        A steady one, or one that is only just free: a goal beside a hand is near where
        the hand has lately been, always. Such a path must be found in `looks` looks.

        Args:
            points: (n, 3) of the frame; they were taken.
            q: (dof,) where the robot is; its start was attached.
            found: Looks in a row that found one before this.
        """
        s, m = self.settings, self.frame.memory
        self.path.look_soon()
        code = self.path.judge(points, q)
        if code != step.LOOK:
            return code
        m.numbers.better[0] = found
        if s.memory_s:
            code = self._look(self.history.around())
            self.frame.look_at(points)
            if code == step.PLANNED:
                self._bare, self._wary = False, 0
                step.adopt(m.table)
                return code
            m.numbers.better[0] = found
        code = step.look(m.table, points, s.margin, s.close_tests, s.looks)
        if code == step.PLANNED and m.spare.count[1] >= m.way.count[1]:
            return step.FOLLOWING  # no better goal: only a shorter path
        if code == step.PLANNED:
            self._bare = True
            step.adopt(m.table)
        return code

    def _look(self, points: np.ndarray) -> int:
        """Look for a new path among other points than the frame's, which are gone."""
        s, table = self.settings, self.frame.memory.table
        self.frame.look_at(points)
        return step.look(table, points, s.margin, s.close_tests, s.looks)

    def _barely(self, points: np.ndarray) -> int:
        """Look for a path that is only just free.

        Where the last such path was blocked, the next one must be there for `patience`
        frames in a row: what opens and closes as a hand trembles is not taken.
        """
        s, table = self.settings, self.frame.memory.table
        if self._bare:
            self._bare, self._wary = False, s.patience
        code = step.look(table, points, s.margin, s.close_tests, s.looks)
        if code != step.PLANNED:
            self._wary = s.patience if self._wary else 0
            return code
        self._wary = max(0, self._wary - 1)
        if self._wary:
            return step.NO_PATH
        self._bare = True
        step.adopt(table)
        return code

    def save(self) -> dict[str, np.ndarray]:
        """Return how the path in use was chosen."""
        return {"counts": np.array([self._bare, self._wary], np.int64)}

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Take up what was saved."""
        self._bare, self._wary = bool(saved["counts"][0]), int(saved["counts"][1])
