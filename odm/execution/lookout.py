"""When a robot should retreat from a person who comes, while it still can.

A robot that has braked stands, and a person who does not look walks into it. So the
person is extrapolated over a short time, at the mean velocity. Where the person would
then block the robot's motion and the place where the robot could stop, the lookout asks
for an evasion.
"""

from typing import Any

import numpy as np

from odm.execution.settings import LookoutSettings
from odm.execution.threat import Threat
from odm.obstacles.obstacles import Obstacles
from roadmap.motion.motion import Motion


class SeparationWatch:
    """Follows from frame to frame how near the points are to the robot.

    `last` is the separation that was measured last [m]; infinite where none was.
    """

    def __init__(self, planner: Any) -> None:  # noqa: ANN401
        self.planner, self.last = planner, np.inf

    def forget(self) -> None:
        """Forget past separations: how fast the points come nearer is unknown again."""
        self.last = np.inf

    def measure(self, q: np.ndarray) -> float:
        """Return the separation at q (dof,) [m]."""
        self.last = self.planner.separation(q)
        return self.last

    def stays_above(self, least: float, q: np.ndarray) -> bool:
        """Whether the separation at q is `least` [m] still, two frames on.

        Never in the first frame: nobody knows yet how fast the points come nearer.
        """
        before = self.last
        closing = max(before - self.measure(q), 0.0)  # by frame
        return self.last - 2 * closing >= least

    def is_better_at(self, q: np.ndarray) -> bool:
        """Whether the points, as they are, are no nearer at another q (dof,)."""
        return self.planner.separation(q) >= self.last - 1e-6


class StandingWatch:
    """Sees what stands still around a robot, and whether that has changed.

    A planner without `static` knows of nothing: no path is clear then.
    """

    def __init__(self, planner: Any) -> None:  # noqa: ANN401
        self.planner = planner
        self.seen = self.now

    @property
    def now(self) -> object:
        """What stands there now: another object after any change."""
        return getattr(getattr(self.planner, "static", None), "place", None)

    def look(self) -> None:
        """Remember what stands there: a motion that is planned now heeds it."""
        self.seen = self.now

    def is_clear(self, path: np.ndarray) -> bool:
        """Whether a path (k, dof) is clear of itself and of all that stands still."""
        static = getattr(self.planner, "static", None)
        if static is None:
            return False
        legs = np.diff(path, axis=0) if len(path) > 1 else np.zeros_like(path)
        return bool(static.motions_free(path[: len(legs)], legs).all())

    def stays_clear(self, path: np.ndarray) -> bool:
        """Whether the rest (k, dof) of a motion is clear of what has come since."""
        if self.now is self.seen:
            return True
        self.look()
        return self.is_clear(path)


class Lookout:
    """Watches whether a person comes at a robot.

    Args:
        planner: Asked with `blocked_leg` and `evasion`; with `is_met` where it knows
            who is meant to come.
        period: Time between frames [s].
        settings: How far ahead it looks, and how often.
    """

    def __init__(
        self,
        planner: Any,  # noqa: ANN401
        period: float,
        settings: LookoutSettings = LookoutSettings(),
    ) -> None:
        self.planner, self.period, self.settings = planner, period, settings
        self._wait_s = 0.0
        safety = planner.cell_map.safety
        # a motion that keeps m may come so much nearer, and is no reason to leave
        self._closer = safety.blending + safety.tracking
        self._is_met = getattr(planner, "is_met", None)

    @property
    def is_due(self) -> bool:
        """Whether it will look when it is asked next."""
        return self._wait_s - self.period <= 1e-9

    def look_at_once(self) -> None:
        """Wait no longer than between two looks: the last evasion was broken off."""
        self._wait_s = min(self._wait_s, self.settings.between_looks)

    def evasion(
        self, motion: Motion, t: float, threat: Threat, speed_scale: float
    ) -> np.ndarray | None:
        """Return (2, dof) a motion that leads away, or None; ask in every frame.

        It begins where the robot could leave the motion in use, at time t on it, and
        uses `speed_scale` of the speed limits.
        """
        self._wait_s -= self.period
        if self._wait_s > 1e-9:
            return None
        s = self.settings
        self._wait_s = s.between_looks
        if not (threat.leads_on and self._is_hit(motion, t, threat)):
            return None
        q = motion.commit(t, 0.0).q
        if not self._meets(q[None], threat.likely(0.0, *s.meets)):
            return None
        self._wait_s = s.between_searches
        coming = [(t, threat.likely(t)) for t in s.ahead]
        return self.planner.evasion(q, coming, speed_scale)

    def _is_hit(self, motion: Motion, t: float, threat: Threat) -> bool:
        """Whether its motion, as it is, leads to where the person will be."""
        # first all places on its way against all times at once: mostly nothing is near
        meets = self.settings.meets
        rests = t + meets[0] >= motion.duration
        places = [motion.place(t + k) for k in (meets[:1] if rests else meets)]
        path = np.array([motion.path.at(s)[0] for s in places])
        if (path == path[0]).all():
            path = path[:1]
        if not self._meets(path, threat.likely(*meets)):
            return False
        if len(path) == 1:
            return True
        pairs = zip(path, meets, strict=True)
        return any(self._meets(q[None], threat.likely(ahead)) for q, ahead in pairs)

    def _meets(self, path: np.ndarray, person: Obstacles | None) -> bool:
        """Whether somebody who is to be evaded would be at a path (k, dof)."""
        if self._is_met is not None:
            return bool(self._is_met(path, -self._closer, person))
        return self.planner.blocked_leg(path, -self._closer, person) is not None
