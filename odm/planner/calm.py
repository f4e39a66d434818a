"""New ways keep clear of where the obstacles have been lately, where they can.

A hand that trembles comes and goes over the same place. A way that is free only while
the hand is at the far end of its tremble is blocked a moment later; one that keeps
clear of all places of the last quarter of a second, and a little more, is not. This
only ranks ways: what is free, and what blocks the way in use, is decided by the
frame's own points alone.
"""

from typing import TYPE_CHECKING

import numpy as np

from odm.close_test.sorted_clouds import SortedCloud
from odm.search import _frame as frame
from odm.search import _step as step

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

_KEPT = 26  # earlier frames kept
_MOST = 1024  # points kept of each
_PERIOD_S = 0.01  # between two frames where no time is given [s]
_SHIFTS = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])


class Calm:
    """Chooses between going on, a calm new way, one that is only just free, or none.

    Args:
        planner: Whose ways they are.
    """

    def __init__(self, planner: "ReactivePlanner") -> None:
        """Nothing was seen."""
        self.planner = planner
        settings = planner.settings
        self.recent = Recent(planner, settings.memory_s, settings.calm)
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self.recent.reset()
        self._bare = False  # the way in use was only just free when it was taken
        self._wary = 0  # frames in a row such a way must be there to be taken

    def choose(self, points: np.ndarray, q: np.ndarray) -> int:
        """Answer a frame whose points were taken; codes of `odm/search/_step.py`.

        The way in use is judged by the frame's own points. Where a new one is wanted,
        it is looked for among all that `recent` leaves free, then by the points alone.
        """
        planner = self.planner
        code = step.judge(planner.memory.table, points, q, False)
        if code == step.BESIDE:
            code = planner.judge(points, q)
        if code != step.LOOK:
            return code
        around = self.recent.around()
        if len(around) > len(planner.memory.cloud.where):
            planner._make_room(2 * len(around))
            frame.take_points(planner.memory.table, points)
            code = planner.judge(points, q)
        code = self._look(around)
        if code == step.NO_PATH and self.recent.margin > 0.0:
            code = self._look(self.recent.lately())
        frame.take_points(planner.memory.table, points)
        if code == step.NO_PATH:
            return self._barely(points)
        if code == step.PLANNED:
            self._bare, self._wary = False, 0
            step.adopt(planner.memory.table)
        return code

    def better(self, points: np.ndarray, q: np.ndarray, found: int) -> int:
        """Look for a way to a better goal, though the way in use is free.

        A calm one, or one that is only just free: a goal beside a hand is near where
        the hand has lately been, always. Such a way must be found in `looks` looks.

        Args:
            points: (n, 3) of the frame; they were taken.
            q: (dof,) where the robot is; its start was attached.
            found: Looks in a row that found one before this.
        """
        planner = self.planner
        s, m = planner.settings, planner.memory
        m.numbers.look[0] = 1
        code = planner.judge(points, q)
        if code != step.LOOK:
            return code
        m.numbers.better[0] = found
        if s.memory_s:
            code = self._look(self.recent.around())
            frame.take_points(m.table, points)
            if code == step.PLANNED:
                self._bare, self._wary = False, 0
                step.adopt(m.table)
                return code
            m.numbers.better[0] = found
        code = step.look(m.table, points, s.margin, s.close_tests, s.looks)
        if code == step.PLANNED and m.spare.count[1] >= m.way.count[1]:
            return step.FOLLOWING  # no better goal: only a shorter way
        if code == step.PLANNED:
            self._bare = True
            step.adopt(m.table)
        return code

    def _look(self, points: np.ndarray) -> int:
        """Look for a new way among other points than the frame's, which are gone."""
        s, table = self.planner.settings, self.planner.memory.table
        frame.take_points(table, points)
        return step.look(table, points, s.margin, s.close_tests, s.looks)

    def _barely(self, points: np.ndarray) -> int:
        """Look for a way that is only just free.

        Where the last such way was blocked, the next one must be there for `patience`
        frames in a row: what opens and closes as a hand trembles is not taken.
        """
        s, table = self.planner.settings, self.planner.memory.table
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


class Recent:
    """The points of the last frames, and the present ones grown a little.

    Args:
        planner: Whose points they are.
        memory_s: How far back [s].
        margin: How far the present points are shifted along the axes [m].
    """

    def __init__(
        self, planner: "ReactivePlanner", memory_s: float, margin: float
    ) -> None:
        """Nothing was seen."""
        self.planner = planner
        self.memory_s, self.margin = memory_s, margin
        self._apart = 0.9 * memory_s / (_KEPT - 1)  # between kept frames; clocks round
        self._ring = np.zeros((_KEPT, _MOST, 3))
        self._count = np.zeros(_KEPT, np.int64)
        self._time = np.zeros(_KEPT)
        self._union = np.zeros((0, 3))
        self._clouds = SortedCloud(planner.cell_map.grid)
        self._laid_out: object = None
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._time[:] = -np.inf
        self._next, self._now, self._frame = 0, 0.0, 0
        self._points: np.ndarray | None = None
        self._sorted = -1

    def take(self, points: np.ndarray, now: float | None) -> None:
        """Begin a frame: keep its points; older ones once in a while.

        Args:
            points: (n, 3) points of the frame [m].
            now: Time [s]; None counts frames of 10 ms.
        """
        self._frame += 1
        now = self._now + _PERIOD_S if now is None else now
        if now < self._now:  # a clock that was set back: another beginning
            self._time[:] = -np.inf
        self._now, self._points = now, points
        if now - self._time.item(self._next - 1) < self._apart:
            return
        step = -(-len(points) // _MOST) or 1
        some = points[::step]
        self._ring[self._next, : len(some)] = some
        self._count[self._next], self._time[self._next] = len(some), now
        self._next = (self._next + 1) % _KEPT

    def around(self) -> np.ndarray:
        """Return (m, 3) points: this frame's, those shifted, and the last frames'."""
        return self._together(_SHIFTS if self.margin > 0.0 else _SHIFTS[:1])

    def lately(self) -> np.ndarray:
        """Return (m, 3) points: this frame's and the last frames'."""
        return self._together(_SHIFTS[:1])

    def _together(self, shifts: np.ndarray) -> np.ndarray:
        points = self._points
        n = len(points)
        kept = np.flatnonzero(self._time >= self._now - self.memory_s)
        total = len(shifts) * n + int(self._count[kept].sum())
        if total > len(self._union):
            self._union = np.zeros((2 * total, 3))
        out = self._union[:total]
        for k, shift in enumerate(shifts):
            np.add(points, self.margin * shift, out=out[k * n : (k + 1) * n])
        end = len(shifts) * n
        for k in kept:
            size = int(self._count[k])
            out[end : end + size] = self._ring[k, :size]
            end += size
        return out

    def cloud(self) -> object:
        """Return them as a sorted cloud for the close test."""
        if self._sorted != self._frame:
            self._laid_out = self._clouds.of(self.around())
            self._sorted = self._frame
        return self._laid_out
