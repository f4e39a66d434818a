"""The exact distance of two robots: the audit of a run of both."""

import numpy as np

from odm.exact._distances import nearest_pair
from odm.exact.distances import ExactRobot
from roadmap.errors import BadInput
from roadmap.robot.robot import Robot

AWAY = 1e3  # [m] solids that do not count are put so far away


class ExactPair:
    """Exact solids of two robots, one in the base frame of the other.

    Args:
        first, second: The robots.
        T_world_base: (4, 4) base of the second in the base frame of the first.
    """

    def __init__(self, first: Robot, second: Robot, T_world_base: np.ndarray) -> None:
        self.names = first.name, second.name
        self.first, self.second = ExactRobot(first, True), ExactRobot(second, True)
        self.T = np.asarray(T_world_base, float)

    def distance(self, q_first: np.ndarray, q_second: np.ndarray) -> float:
        """Return the exact distance of the robots [m]; at most 0 where they touch."""
        return self._between(
            self.first.body >= 0, self.second.body >= 0, q_first, q_second
        )

    def require_apart(self, least: float) -> None:
        """Refuse standing links nearer than `least` [m]: they cannot be moved apart."""
        standing = self.first.body == 0, self.second.body == 0
        if not all(part.any() for part in standing):
            return
        q = [np.zeros(r.robot.dof) for r in (self.first, self.second)]
        gap = self._between(*standing, *q)
        if gap <= least:
            x, y = self.T[:2, 3]
            raise BadInput(
                f"the bases of {self.names[0]} and {self.names[1]} at ({x:.2f}, "
                f"{y:.2f}) m are {100 * max(gap, 0):.1f} cm apart, no more than the "
                f"clearance of {100 * least:.1f} cm: they would always be in contact; "
                "move the second base away"
            )

    def _between(
        self,
        mine: np.ndarray,
        theirs: np.ndarray,
        q_first: np.ndarray,
        q_second: np.ndarray,
    ) -> float:
        """Return the distance of the solids chosen by (n,) bool of each [m]."""
        frames = self._moved(self.second.frames(q_second))
        frames[~theirs, 9:] += AWAY  # the test chooses solids of its first robot only
        nearest = nearest_pair(
            self.first.convexes, mine, self.first.frames(q_first),
            self.second.convexes, frames, np.inf, np.empty(2, np.int64),
        )  # fmt: skip
        return float(nearest[0])

    def _moved(self, frames: np.ndarray) -> np.ndarray:
        """Return poses (n, 12) of the second robot's frame in the world's."""
        R, p = self.T[:3, :3], self.T[:3, 3]
        rotation = (R @ frames[:, :9].reshape(-1, 3, 3)).reshape(-1, 9)
        origin = frames[:, 9:] @ R.T + p
        return np.ascontiguousarray(np.concatenate([rotation, origin], axis=1))
