"""The plain motion: at joint speed limits, starting and stopping at once."""

from typing import Any

import numpy as np

from odm.checks import check_numbers
from odm.execution.executor import MOVING, RETREATING, STANDING
from odm.execution.lookout import SeparationWatch, StandingWatch
from odm.execution.settings import ExecutionSettings, PaceSettings
from odm.execution.threat import Moving
from roadmap.arrays import frozen
from roadmap.kinematics.forward import difference, wrapped
from roadmap.kinematics.joint_tree import check_robot
from roadmap.motion.motion import Commit, SetPoint
from roadmap.ranges import check_number, settings_of
from roadmap.robot.robot import Robot


class Follower:
    """Moves along the corners of a path within the joints' speed limits.

    It stops and starts at once: limits on acceleration and jerk need a timed path.

    Args:
        robot: The robot.
        speed_scale: Share of the joints' speed limits that may be used, in (0, 1].
    """

    def __init__(self, robot: Robot, speed_scale: float = 1.0) -> None:
        self.robot = robot
        self.max_velocity = frozen(speed_scale * robot.max_velocity, np.float64)

    def advance(self, q: np.ndarray, path: np.ndarray, dt: float) -> np.ndarray:
        """Return where the robot is after `dt` seconds on the path.

        Args:
            q: (dof,) configuration now [rad or m].
            path: (k, dof) corners; the first one is at or near `q`.
            dt: Time to move [s].

        Returns:
            (dof,) the new configuration; the last corner if there is time left.
        """
        left = dt
        for corner in path:
            step = difference(self.robot, q, corner)
            needed = float(np.max(np.abs(step) / self.max_velocity))
            if needed > left:
                return wrapped(self.robot, q + step * (left / needed))
            left -= needed
            q = corner
        return np.array(q, float)


class KinematicMover:
    """Follows the planner's paths within the speed limits only.

    The same use as `odm.execution.executor.Executor`, for planners and robots without
    dynamics.

    Args:
        robot: The robot.
        planner: Asked for `separation` while it holds.
        q: (dof,) where the robot stands.
        period: Time between frames [s].
        settings: Its speeds and `min_retreat_separation` are used.

    Attributes:
        state: "moving", "retreating" or "standing".
        reason: Empty: it does not brake.
    """

    at_rest = True  # it can stop at once
    brakes = False
    off = 0.0  # it is taken to be where it is measured

    def __init__(
        self,
        robot: Robot,
        planner: Any,  # noqa: ANN401 (asked for `separation` alone)
        q: np.ndarray,
        period: float,
        settings: ExecutionSettings | None = None,
    ) -> None:
        settings = settings_of(settings, ExecutionSettings)
        check_robot(robot, "max_velocity")
        q = check_numbers(robot, q, "q")
        period = check_number("the period of a mover [s]", period, 1e-9, 1e9)
        self.robot, self.planner, self.period = robot, planner, period
        self.state, self.reason = STANDING, ""
        self._min_retreat_separation = settings.min_retreat_separation
        self._follower = Follower(robot, settings.speed_scale)
        self._retreater = Follower(robot, settings.retreat_scale)
        self._q, self._dq = np.array(q, float), np.zeros(robot.dof)
        self._path = self._q[None]
        self._separation = SeparationWatch(planner)
        self._standing = StandingWatch(planner)
        self._retreat_every = PaceSettings().retreat_every
        self._frame, self._retreat_frame = 0, -self._retreat_every

    @property
    def set_point(self) -> SetPoint:
        """The set-point of this moment."""
        return SetPoint(self._q, self._dq, np.zeros_like(self._q))

    def locate(self, q: np.ndarray) -> None:
        """Go on from q, where the robot is measured to be [rad or m]."""
        if np.isfinite(q).all():
            self._q = np.array(q, float)

    def new_goal(self) -> None:
        """Do nothing: this mover keeps nothing from goal to goal."""

    def commit(self) -> Commit:
        """A new path may begin where the robot is."""
        if self.state != RETREATING:
            self._standing.look()
        return Commit(self._q, 0.0)

    def next_commit(self) -> None:
        """Return None: where the next path will begin is not known."""

    def update(self, answer: Any, commit: Commit, threat: Moving | None) -> None:  # noqa: ANN401
        """Take an answer; `commit` and `threat` change nothing."""
        if answer.status != "holding":
            self._separation.forget()
            self.state, self._path = MOVING, answer.path
            self._retreat_frame = -self._retreat_every
            return
        self._frame += 1
        may_move = self._separation.stays_above(self._min_retreat_separation, self._q)
        if self.state == RETREATING and may_move and self._still_better():
            return
        self.state, self._path = STANDING, self._q[None]
        due = self._frame - self._retreat_frame >= self._retreat_every
        if may_move and due:
            self._retreat_frame, retreat = self._frame, answer.retreat
            if retreat is not None and len(retreat):
                # without its beginning, or the robot would go back there every frame
                self.state, self._path = RETREATING, retreat[-1:]

    def _still_better(self) -> bool:
        """Whether the retreat ends farther from the points than here, as they are."""
        end = self._path[-1]
        left = difference(self.robot, self._q, end)
        there = bool(np.abs(left).max() < 1e-9)
        clear = self._standing.stays_clear(np.stack([self._q, self._q + left]))
        return clear and not there and self._separation.is_better_at(end)

    def advance(self) -> None:
        """Let one period pass."""
        q = self._q
        mover = self._retreater if self.state == RETREATING else self._follower
        if self.state != STANDING:
            q = mover.advance(q, self._path, self.period)
        self._dq = difference(self.robot, self._q, q) / self.period
        self._q = q
