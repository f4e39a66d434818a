"""The planner as the executor asks it in the last phase: who may touch what.

On the way everything is heeded by everything. In the last phase of a give the payload
may touch the receiving hand, of a receive the finger pads the object
(`odm.frame.last_phase`); the arm keeps its whole clearance from both, always.
"""

import numpy as np

from odm.obstacles.obstacles import Obstacles
from odm.planner.planner import ReactivePlanner


class PhasePlanner:
    """A planner whose tests of stops know the phase.

    Args:
        planner: The planner.

    Attributes:
        phase: "give", "receive" or None.
        classes: (k,) class of each of the shapes that are told.
    """

    def __init__(self, planner: ReactivePlanner) -> None:
        """Be in no phase."""
        self.planner = planner
        self.phase: str | None = None
        self.classes = np.zeros(0, np.int8)

    def __getattr__(self, name: str) -> object:
        """Everything else is the planner's."""
        return getattr(self.planner, name)

    def blocked_leg(
        self,
        path: np.ndarray,
        extra: float = 0.0,
        points: Obstacles | None = None,
    ) -> int | None:
        """Return the first blocked leg; see `ReactivePlanner.blocked_leg`."""
        if self.phase is None or points is None:
            return self.planner.blocked_leg(path, extra, points)
        times = len(points) // max(1, len(self.classes))  # several moments at once
        points.shape_classes = np.tile(self.classes, times)
        return self.planner.blocked_leg(path, extra, points, phase=self.phase)

    def line_free(self, q: np.ndarray, q_end: np.ndarray, there: Obstacles) -> bool:
        """Whether a straight motion passes all four tests, by the rules of the phase.

        Args:
            q: (dof,) its start [rad or m].
            q_end: (dof,) its end, within the limits.
            there: All shapes, in the order of `classes`.
        """
        planner = self.planner
        robot = planner.robot
        within = (q_end >= robot.lower) & (q_end <= robot.upper) | robot.continuous
        if not within.all():
            return False
        dq = planner.frame.difference(q, q_end)
        if planner.static.why(q, dq) is not None:
            return False
        return self.blocked_leg(np.array([q, q + dq]), 0.0, there) is None
