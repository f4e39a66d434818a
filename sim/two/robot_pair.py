"""The exact distance of two robots: the audit of a run of both."""

import numpy as np

from odm.audit._exact import nearest_pair
from odm.audit.exact import ExactRobot
from roadmap.errors import BadInput
from roadmap.robot.robot import Robot


class ExactPair:
    """Exact solids of two robots, one in the base frame of the other.

    Args:
        first, second: The robots.
        T_world_base: (4, 4) base of the second in the base frame of the first.
    """

    def __init__(self, first: Robot, second: Robot, T_world_base: np.ndarray) -> None:
        """Gather the solids of all links, the standing ones included."""
        self.names = first.name, second.name
        self.first, self.second = ExactRobot(first, True), ExactRobot(second, True)
        self.T = np.asarray(T_world_base, float)

    def distance(self, q_first: np.ndarray, q_second: np.ndarray) -> float:
        """Return the exact distance of the robots [m]; at most 0 where they touch."""
        use = np.ones(len(self.first.body), bool)
        return self._between(use, q_first, q_second)

    def require_apart(self, least: float) -> None:
        """Refuse standing links nearer than `least` [m] to each other.

        Raises:
            BadInput: They are; the robots could never be moved apart.
        """
        one, two = self.first, self.second
        use, other = one.body == 0, two.body == 0
        if not (use.any() and other.any()):
            return
        q = [np.zeros(r.robot.dof) for r in (one, two)]
        gap = self._between(use, q[0], q[1], other)
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
        use: np.ndarray,
        q_first: np.ndarray,
        q_second: np.ndarray,
        other: np.ndarray | None = None,
    ) -> float:
        frames = self._moved(self.second.frames(q_second))
        mine, found = self.first.frames(q_first), np.empty(2, np.int64)
        best = np.inf
        if other is None:
            return float(
                nearest_pair(
                    self.first.convexes, use, mine, self.second.convexes, frames,
                    best, found,
                )[0]
            )  # fmt: skip
        # from the second one's side, where its solids can be chosen
        for i in np.flatnonzero(other):
            far = frames.copy()
            far[np.arange(len(far)) != i, 9:] += 1e3
            gap = nearest_pair(
                self.first.convexes, use, mine, self.second.convexes, far, best, found
            )[0]
            best = min(best, float(gap))
        return best

    def _moved(self, frames: np.ndarray) -> np.ndarray:
        """Return poses (n, 12) of the second robot's frame in the world's."""
        R, p = self.T[:3, :3], self.T[:3, 3]
        rotation = (R @ frames[:, :9].reshape(-1, 3, 3)).reshape(-1, 9)
        origin = frames[:, 9:] @ R.T + p
        return np.ascontiguousarray(np.concatenate([rotation, origin], axis=1))
