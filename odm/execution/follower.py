"""The simplest way to follow a path: straight on, as fast as the slowest joint may."""

import numpy as np

from roadmap.arrays import frozen
from roadmap.kinematics.forward import difference
from roadmap.robot.robot import Robot


class Follower:
    """Moves along the corners of a path within the joints' speed limits.

    It stops and starts at once: limits on acceleration and jerk need a timed path.

    Args:
        robot: The robot.
        speed_scale: Share of the joints' speed limits that may be used, in (0, 1].
    """

    def __init__(self, robot: Robot, speed_scale: float = 1.0) -> None:
        """Scale the limits."""
        self.robot = robot
        self.max_velocity = frozen(speed_scale * robot.max_velocity, np.float64)

    def advance(
        self, q: np.ndarray, path: np.ndarray, dt: float, scale: float = 1.0
    ) -> np.ndarray:
        """Return where the robot is after `dt` seconds on the path.

        Args:
            q: (dof,) configuration now [rad or m].
            path: (k, dof) corners; the first one is at or near `q`.
            dt: Time to move [s].
            scale: Share of this follower's speed to use.

        Returns:
            (dof,) the new configuration; the last corner if there is time left.
        """
        left = dt
        for corner in path:
            step = difference(self.robot, q, corner)
            needed = float(np.max(np.abs(step) / (scale * self.max_velocity)))
            if needed > left:
                return self._wrapped(q + step * (left / needed))
            left -= needed
            q = corner
        return np.array(q, float)

    def _wrapped(self, q: np.ndarray) -> np.ndarray:
        """Keep continuous joints in [-pi, pi)."""
        turned = (q + np.pi) % (2 * np.pi) - np.pi
        return np.where(self.robot.continuous, turned, q)
