"""How far a robot is from its set-point, and whether it is held still there."""

import math

import numpy as np

from odm.execution.settings import TrackingSettings
from roadmap.kinematics.forward import difference
from roadmap.motion.blending import joint_motion_bounds
from roadmap.robot.robot import Robot

_ROUNDING = 1e-9  # [m]


class TrackingMonitor:
    """Compares the measured configuration with the set-point.

    A deviation within `share` [m] counts as none.

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
    ) -> None:
        self.robot, self.period, self.settings = robot, period, settings
        self.off, self.offset, self.note = 0.0, np.zeros(robot.dof), ""
        self._share = share + _ROUNDING
        self._bounds = joint_motion_bounds(robot)
        self._still: tuple[np.ndarray, float] | None = None  # where, for so long [s]
        self._last = 0.0  # how far it was when that was known last [m]

    def carry(self, robot: Robot) -> None:
        """Take the robot with what it carries now, whose points are looked at."""
        if robot is not self.robot:
            self.robot, self._bounds = robot, joint_motion_bounds(robot)

    def measure(self, set_point: np.ndarray, q: np.ndarray) -> None:
        """Take the set-point and the measured q, (dof,) each [rad or m]."""
        far, offset, self.note = math.inf, self.offset, ""
        if np.isfinite(q).all():
            offset = difference(self.robot, set_point, q)
            far = self._last = float(self._bounds @ np.abs(offset))
        self.off = far if far > self._share else 0.0
        if not self.off:
            self._still = None
            return
        self.offset = offset
        self.note = "nobody knows where it is; stopped"
        if far < math.inf:
            self.note = f"pushed {1e3 * far:.0f} mm off its path; stopped"

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
        self.note = self.note.replace("stopped", "goes on from there")
