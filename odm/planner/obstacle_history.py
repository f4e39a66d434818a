"""Where the obstacles have been lately: new paths keep clear of it where they can."""

import numpy as np

from odm.close_test.sorted_clouds import SortedCloud
from odm.obstacles.grid import WorkspaceGrid

_KEPT = 26  # earlier frames kept
_MOST = 1024  # points kept of each
_PERIOD_S = 0.01  # between two frames where no time is given [s]
_SHIFTS = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])


class ObstacleHistory:
    """The points of the last frames, and the present ones grown a little.

    Args:
        grid: The map's grid.
        memory_s: How far back [s].
        margin: How far the present points are shifted along the axes [m].
    """

    def __init__(self, grid: WorkspaceGrid, memory_s: float, margin: float) -> None:
        """Nothing was seen."""
        self.memory_s, self.margin = memory_s, margin
        self._apart = 0.9 * memory_s / (_KEPT - 1)  # between kept frames; clocks round
        self._ring = np.zeros((_KEPT, _MOST, 3))
        self._count = np.zeros(_KEPT, np.int64)
        self._time = np.zeros(_KEPT)
        self._union = np.zeros((0, 3))
        self._clouds = SortedCloud(grid)
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

    def save(self) -> dict[str, np.ndarray]:
        """Return the points that are kept, frame after frame."""
        kept = np.flatnonzero(np.isfinite(self._time))
        points = [self._ring[k, : self._count[k]] for k in kept]
        return {
            "points": np.concatenate([np.zeros((0, 3)), *points]),
            "count": self._count[kept],
            "time": self._time.copy(),
            "now": np.array(self._now),
            "next": np.array(self._next),
            "present": np.zeros((0, 3))
            if self._points is None
            else self._points.copy(),
        }

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Keep the points that were saved; those of the frame are `present`."""
        self.reset()
        self._time[:] = saved["time"]
        kept, end = np.flatnonzero(np.isfinite(self._time)), 0
        for k, size in zip(kept, saved["count"].tolist(), strict=True):
            self._ring[k, :size] = saved["points"][end : end + size]
            self._count[k] = size
            end += size
        self._now, self._next = float(saved["now"]), int(saved["next"])
        self._points = saved["present"].copy()
