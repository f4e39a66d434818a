"""How far a robot is from its set-point, and whether it is held still there.

A robot that follows late is where its set-point was: anywhere on the way that those of
the last `latency_s` lead. Farther off than the tracking share allows it was pushed, or
follows later than is known.
"""

import math
from collections import deque
from itertools import islice

import numpy as np

from odm.execution.settings import TrackingSettings
from roadmap.kinematics.forward import difference
from roadmap.motion.blending import joint_motion_bounds
from roadmap.robot.robot import Robot

_ROUNDING = 1e-9  # [m]


class TrackingMonitor:
    """Compares the measured configuration with the set-point.

    A deviation within `share` [m] counts as none. So does one from where the set-point
    was in the last `latency_s` [s].

    Attributes:
        off: How far any point of the robot may be from its set-point [m]; 0 within the
            share, infinite where the measured q is not finite.
        offset: (dof,) from the set-point to where it is [rad or m].
        note: One sentence about a push in this frame, or "".
    """

    def __init__(
        self,
        robot: Robot,
        share: float,
        period: float,
        settings: TrackingSettings = TrackingSettings(),
        latency_s: float = 0.0,
    ) -> None:
        self.robot, self.period, self.settings = robot, period, settings
        self.off, self.offset, self.note = 0.0, np.zeros(robot.dof), ""
        self._share, self._latency_s = share + _ROUNDING, latency_s
        self._bounds = joint_motion_bounds(robot)
        self._still: tuple[np.ndarray, float] | None = None  # where, for so long [s]
        self._last = 0.0  # how far it was when that was known last [m]
        recalled_s = max(latency_s, settings.recalled_s)
        # set-points of the frames before, the latest first
        self._left: deque[np.ndarray] = deque(maxlen=math.ceil(recalled_s / period))

    def carry(self, robot: Robot) -> None:
        """Take the robot with what it carries now, whose points are looked at."""
        if robot is not self.robot:
            self.robot, self._bounds = robot, joint_motion_bounds(robot)

    def measure(self, set_point: np.ndarray, q: np.ndarray) -> None:
        """Take the set-point and the measured q, (dof,) each [rad or m]."""
        far, offset, self.note = math.inf, self.offset, ""
        if np.isfinite(q).all():
            offset = difference(self.robot, set_point, q)
            far = self._from_way(set_point, q, self._latency_s)[0]
            if far > self._share:
                far = float(self._bounds @ np.abs(offset))
            self._last = far
        self.off = far if far > self._share else 0.0
        if not self.off:
            self._still = None
            return
        self.offset = offset
        self.note = "nobody knows where it is; stopped"
        if far < math.inf:
            self.note = self._why(set_point, q)

    def _why(self, set_point: np.ndarray, q: np.ndarray) -> str:
        """Return a sentence about a robot at q that is off its set-point."""
        off, late = f"{1e3 * self.off:.0f} mm", 1e3 * self._latency_s
        least, ago = self._from_way(set_point, q, math.inf)
        if least > self._share:
            return f"pushed {off} off its path; stopped"
        return (
            f"{off} behind, where its set-point was {1e3 * ago:.0f} ms ago; stopped "
            f"(it may be {late:g} ms late, as ExecutionSettings.latency_s says)"
        )

    def leave(self, set_point: np.ndarray) -> None:
        """Keep the set-point (dof,) of a frame that is over [rad or m]."""
        self._left.appendleft(set_point)

    def _from_way(
        self, set_point: np.ndarray, q: np.ndarray, within_s: float
    ) -> tuple[float, float]:
        """Return how far q is from where the set-points of late led along [m].

        And how long ago they were at the nearest place [s].
        """
        n = min(within_s / self.period, len(self._left))  # periods, parts of one, too
        offset = difference(self.robot, set_point, q)
        off = float(self._bounds @ np.abs(offset))
        if not n or off <= self._share:
            return off, 0.0
        left = islice(self._left, math.ceil(n))
        here = np.array([offset, *(difference(self.robot, at, q) for at in left)])
        step = np.diff(here, axis=0)
        most = np.minimum(n - np.arange(len(step)), 1.0)
        scaled = self._bounds * step
        down = np.einsum("ij,ij->i", scaled, self._bounds * here[:-1])
        length = np.einsum("ij,ij->i", scaled, scaled)
        along = np.clip(-down / np.where(length > 0.0, length, 1.0), 0.0, most)
        places = np.vstack([here[:1], here[:-1] + along[:, None] * step])
        far = np.abs(places) @ self._bounds
        k = int(far.argmin())
        late = self.period * (k - 1 + along[k - 1]) if k else 0.0
        return float(far[k]), late

    def unmeasured(self) -> None:
        """Note a frame without a measurement: the last known deviation counts."""
        if math.isfinite(self.off):
            return
        self.off = self._last if self._last > self._share else 0.0
        self.note = ""
        if self.off:
            self.note = (
                f"was {1e3 * self.off:.0f} mm off its path when seen last; stopped"
            )

    def moves(self) -> None:
        """Restart the time for which the robot has been held still."""
        self._still = None

    def held_still(self, q: np.ndarray) -> bool:
        """Whether the robot has been near q for `held_s`."""
        if not math.isfinite(self.off):
            return False
        where, long = self._still or (q, 0.0)
        moved = self._bounds @ np.abs(difference(self.robot, where, q))
        if moved > self.settings.still:
            where, long = q, 0.0
        self._still = np.array(where), long + self.period
        return long >= self.settings.held_s

    def restart(self) -> None:
        """Where the robot is has become its set-point."""
        self.off, self._last, self._still = 0.0, 0.0, None
        self._left.clear()
        self.note = self.note.replace("stopped", "goes on from there")
