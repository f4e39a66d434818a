"""The plain way to move: at joint speed limits, starting and stopping at once."""

import numpy as np

from odm.execution.execution import (
    MOVING,
    RETREAT_EVERY,
    RETREATING,
    STANDING,
    ExecutionSettings,
)
from odm.execution.follower import Follower
from odm.execution.threat import Threat
from roadmap.kinematics.forward import difference
from roadmap.motion.motion import Commit, SetPoint
from roadmap.robot.robot import Robot


class KinematicMover:
    """Follows the planner's paths within the speed limits only.

    The same use as `odm.execution.execution.Executor`, for planners and robots without
    dynamics.

    Args:
        robot: The robot.
        planner: Asked for `separation` while it holds.
        q: (dof,) where the robot stands.
        period: Time between frames [s].
        settings: Its speeds and `stand_below` are used.

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
        planner: object,
        q: np.ndarray,
        period: float,
        settings: ExecutionSettings | None = None,
    ) -> None:
        """Stand at q."""
        settings = settings or ExecutionSettings()
        self.robot, self.planner, self.period = robot, planner, period
        self.state, self.reason = STANDING, ""
        self._stand_below = settings.stand_below
        self._follower = Follower(robot, settings.speed_scale)
        self._retreater = Follower(robot, settings.retreat_scale)
        self._q, self._dq = np.array(q, float), np.zeros(robot.dof)
        self._path = self._q[None]
        self._gap = np.inf
        self._frame, self._asked = 0, -RETREAT_EVERY

    @property
    def set_point(self) -> SetPoint:
        """The set-point of this moment."""
        return SetPoint(self._q, self._dq, np.zeros_like(self._q))

    def locate(self, q: np.ndarray) -> None:
        """Go on from q, where the robot is measured to be [rad or m]."""
        if np.isfinite(q).all():
            self._q = np.array(q, float)

    def new_goal(self) -> None:
        """Nothing is kept from goal to goal."""

    def commit(self) -> Commit:
        """A new path may begin where the robot is."""
        return Commit(self._q, 0.0)

    def ahead(self) -> None:
        """It is not known where the next path will begin: somewhere near."""

    def heed(self, answer: object, commit: Commit, threat: Threat | None) -> None:
        """Take an answer; `commit` and `threat` change nothing."""
        if answer.status != "holding":
            self._gap = np.inf
            self.state, self._path = MOVING, answer.path
            self._asked = -RETREAT_EVERY
            return
        self._frame += 1
        wise = self._wise()
        if self.state == RETREATING and wise and self._still_better():
            return
        self.state, self._path = STANDING, self._q[None]
        if wise and self._frame - self._asked >= RETREAT_EVERY:
            self._asked, retreat = self._frame, answer.retreat
            if retreat is not None and len(retreat):
                # without its beginning, or the robot would go back there every frame
                self.state, self._path = RETREATING, retreat[-1:]

    def _still_better(self) -> bool:
        """Whether the way out leads farther from the points than here, as they are."""
        end = self._path[-1]
        there = bool(np.abs(difference(self.robot, self._q, end)).max() < 1e-9)
        return not there and self.planner.separation(end) >= self._gap - 1e-6

    def advance(self) -> None:
        """Let one period pass."""
        q = self._q
        mover = self._retreater if self.state == RETREATING else self._follower
        if self.state != STANDING:
            q = mover.advance(q, self._path, self.period)
        self._dq = difference(self.robot, self._q, q) / self.period
        self._q = q

    def _wise(self) -> bool:
        """Whether it may move at all: the person is not about to touch it."""
        before, self._gap = self._gap, self.planner.separation(self._q)
        closing = max(before - self._gap, 0.0)  # by frame; not known in the first one
        return self._gap - 2 * closing >= self._stand_below
