"""When the robot should get out of the way of who comes, before it cannot any more.

Braking ends in a stand, and who does not look comes on. So the robot looks at where
the person's drift leads within a short time: if that is in the way of its motion, and
where it could stop as well, it asks for a motion out of the way.
"""

import numpy as np

from odm.execution.threat import Threat
from roadmap.motion.motion import Commit, Motion

AHEAD = (0.12, 0.24, 0.36, 0.48)  # [s] it looks ahead so far
AGAIN = 0.05  # [s] between two searches, which take a while
LOOKS = 0.02  # [s] between two looks


class Lookout:
    """Watches whether a person comes at a robot.

    Args:
        planner: Asked with `blocked_leg` and `way_out`.
        period: Time between frames [s].
    """

    def __init__(self, planner: object, period: float) -> None:
        """Nobody comes."""
        self.planner, self.period = planner, period
        self._wait_s = 0.0

    def way_out(
        self,
        motion: Motion,
        t: float,
        commit: Commit,
        threat: Threat,
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return (2, dof) a motion out of the way, or None; ask in every frame.

        Args:
            motion: The motion in use.
            t: The time on it [s].
            commit: Where it could leave it.
            threat: The person.
            speed_scale: Share of the speed limits that it will use.
        """
        self._wait_s -= self.period
        if self._wait_s > 1e-9:
            return None
        self._wait_s = LOOKS
        if not len(threat.points) or threat.likely(0.0) is None:
            return None
        if not self._is_hit(motion, t, threat):
            return None
        points = threat.likely(0.0, *AHEAD)
        if self.planner.blocked_leg(commit.q[None], 0.0, points) is None:
            return None
        self._wait_s = AGAIN
        coming = [(t, threat.likely(t)) for t in AHEAD]
        return self.planner.way_out(commit.q, coming, speed_scale)

    def _is_hit(self, motion: Motion, t: float, threat: Threat) -> bool:
        """Whether its motion, as it is, leads to where the person will be."""
        for ahead in AHEAD[1::2]:
            q = motion.at(t + ahead).q[None]
            if self.planner.blocked_leg(q, 0.0, threat.likely(ahead)) is not None:
                return True
        return False
