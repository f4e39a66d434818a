"""When a robot should retreat from a person who comes, while it still can.

A robot that has braked stands, and a person who does not look walks into it. So the
person is extrapolated over a short time, at the mean velocity. Where the person would
then block the robot's motion and the place where the robot could stop, the lookout asks
for an evasion.
"""

from typing import Any

import numpy as np

from odm.execution.threat import Threat
from odm.obstacles.obstacles import Obstacles
from roadmap.motion.motion import Motion

_AHEAD = (0.12, 0.24, 0.36, 0.48)  # [s] the person is extrapolated by
# [s] and, to see whether they will meet the robot: at 1 m/s a hand does not get
# from one side of a link to the other between two of these
_MEETS = tuple(0.06 * k for k in range(1, 9))
_BETWEEN_SEARCHES = 0.05  # [s], which take a while
_BETWEEN_LOOKS = 0.02  # [s]


class SeparationWatch:
    """Follows from frame to frame how near the points are to the robot.

    Args:
        planner: Asked with `separation`.

    Attributes:
        last: The separation that was measured last [m]; infinite where none was.
    """

    def __init__(self, planner: Any) -> None:  # noqa: ANN401
        """Nothing was measured."""
        self.planner, self.last = planner, np.inf

    def forget(self) -> None:
        """Begin anew: how fast the points come nearer is not known any more."""
        self.last = np.inf

    def measure(self, q: np.ndarray) -> float:
        """Return the separation at q (dof,) [m]."""
        self.last = self.planner.separation(q)
        return self.last

    def stays_above(self, least: float, q: np.ndarray) -> bool:
        """Whether the separation at q is `least` [m] still, two frames on."""
        before = self.last
        closing = max(before - self.measure(q), 0.0)  # by frame; 0 in the first one
        return self.last - 2 * closing >= least

    def is_better_at(self, q: np.ndarray) -> bool:
        """Whether the points, as they are, are no nearer at another q (dof,)."""
        return self.planner.separation(q) >= self.last - 1e-6


class Lookout:
    """Watches whether a person comes at a robot.

    Args:
        planner: Asked with `blocked_leg` and `evasion`; with `is_met` where it knows
            who is meant to come.
        period: Time between frames [s].
    """

    def __init__(self, planner: Any, period: float) -> None:  # noqa: ANN401
        """Nobody comes."""
        self.planner, self.period = planner, period
        self._wait_s = 0.0
        safety = planner.cell_map.safety
        # a motion that keeps m may come so much nearer, and is no reason to leave
        self._closer = safety.blending + safety.tracking
        self._told = getattr(planner, "is_met", None)

    @property
    def is_due(self) -> bool:
        """Whether it will look when it is asked next."""
        return self._wait_s - self.period <= 1e-9

    def look_at_once(self) -> None:
        """Wait no longer than between two looks: the last evasion was broken off."""
        self._wait_s = min(self._wait_s, _BETWEEN_LOOKS)

    def evasion(
        self,
        motion: Motion,
        t: float,
        threat: Threat,
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return (2, dof) a motion that leads away, or None; ask in every frame.

        It begins where the robot could leave the motion in use.

        Args:
            motion: The motion in use.
            t: The time on it [s].
            threat: The person.
            speed_scale: Share of the speed limits that it will use.
        """
        self._wait_s -= self.period
        if self._wait_s > 1e-9:
            return None
        self._wait_s = _BETWEEN_LOOKS
        if not (threat.leads_on and self._is_hit(motion, t, threat)):
            return None
        q = motion.commit(t, 0.0).q
        if not self._meets(q[None], threat.likely(0.0, *_MEETS)):
            return None
        self._wait_s = _BETWEEN_SEARCHES
        coming = [(t, threat.likely(t)) for t in _AHEAD]
        return self.planner.evasion(q, coming, speed_scale)

    def _is_hit(self, motion: Motion, t: float, threat: Threat) -> bool:
        """Whether its motion, as it is, leads to where the person will be."""
        # first all places on its way against all times at once: mostly nothing is near
        rests = t + _MEETS[0] >= motion.duration
        places = [motion.place(t + k) for k in (_MEETS[:1] if rests else _MEETS)]
        path = np.array([motion.path.at(s)[0] for s in places])
        if (path == path[0]).all():
            path = path[:1]
        if not self._meets(path, threat.likely(*_MEETS)):
            return False
        if len(path) == 1:
            return True
        for q, ahead in zip(path, _MEETS, strict=True):
            if self._meets(q[None], threat.likely(ahead)):
                return True
        return False

    def _meets(self, path: np.ndarray, person: Obstacles | None) -> bool:
        """Whether somebody who is to be evaded would be at a path (k, dof)."""
        if self._told is not None:
            return bool(self._told(path, -self._closer, person))
        return self.planner.blocked_leg(path, -self._closer, person) is not None
