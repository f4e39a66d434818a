"""Where another robot can be until this one stands: by its intent, or by its limits.

Two robots of one cell tell each other what they hold tested: their path up to the next
set-point and the stop behind it. Nothing else can follow without a new test.
So each tests its own path against *all* that the other may still sweep, at any time:
what the two can sweep before they both stand never meets, whoever is late.

A robot that tells nothing is bounded by its joints: from the measured q and dq it goes
no faster than its limits of velocity and acceleration let it.
"""

import math
from dataclasses import dataclass

import numpy as np

from odm.execution.executor import Executor
from odm.obstacles.robot_surface import RobotSurface
from roadmap.errors import BadInput
from roadmap.motion.motion import Motion

_STEP = 0.02  # time between two places on a stretch, if it is short [s]
_MOST = 24  # places on one stretch


@dataclass(frozen=True, eq=False)
class Stretch:
    """What a robot may do next: a motion from one time on it to another.

    Attributes:
        motion: The motion.
        begin, end: Times on it [s].
    """

    motion: Motion
    begin: float
    end: float


Intent = tuple[Stretch, ...]


def intent_of(executor: Executor) -> Intent:
    """Return all that an executor may still do without another test.

    Args:
        executor: In a frame in which it was updated, or before its first one.
    """
    motion, t = executor.motion, executor.t
    held = executor.held
    if held is None or held is motion:
        return (Stretch(motion, t, motion.duration),)
    turn = min(t + max(0.0, -executor.held_t), motion.duration)
    stop = Stretch(held, max(0.0, executor.held_t), held.duration)
    return (Stretch(motion, t, turn), stop)


@dataclass(frozen=True, eq=False)
class IntentThreat:
    """Everything another robot may still sweep; in the place of a `Threat`.

    Attributes:
        points: (k, 3) its surface at places along its path [m].
        radius: What moves between two of them stays within this of a point [m].
        fastest: The highest speed of any of its points now, at most [m/s].
    """

    points: np.ndarray
    radius: float
    fastest: float

    def between(self, begin: float, end: float) -> tuple[np.ndarray, float]:
        """Return points and radius: the same at all times, whoever is late."""
        return self.points, self.radius


def intent_threat(
    surface: RobotSurface, intent: Intent, T_base_other: np.ndarray
) -> IntentThreat:
    """Return what a robot with an intent may sweep.

    Within a time of `half` from the middle of a piece joint j moves by at most
    abs(dq_j) half + a_j half^2 / 2, and a point by the sum over j times its bound of
    motion.

    Args:
        surface: The other robot's moving links.
        intent: From `intent_of`.
        T_base_other: (4, 4) its base in the frame of the robot that asks.
    """
    limit = surface.robot.max_acceleration
    clouds, radius, fastest = [], 0.0, 0.0
    for stretch in intent:
        span = max(stretch.end - stretch.begin, 0.0)
        n = int(np.clip(np.ceil(span / _STEP), 1, _MOST))
        half = 0.5 * span / n
        for k in range(n):
            point = stretch.motion.at(stretch.begin + (2 * k + 1) * half)
            speed = np.abs(point.dq)
            moved = speed * half + 0.5 * limit * half * half
            clouds.append(surface.at(point.q, T_base_other).copy())
            radius = max(radius, _most(surface, moved))
            fastest = max(fastest, _most(surface, speed))
    return IntentThreat(np.concatenate(clouds), radius, fastest)


@dataclass(frozen=True, eq=False)
class LimitsThreat:
    """Where a robot can be that tells only its joints; in the place of a `Threat`.

    Attributes:
        surface: Its moving links.
        T_base_other: (4, 4) its base in the frame of the robot that asks.
        q, dq: (dof,) measured [rad or m, by seconds].
        age: Age of both [s]; None or NaN where it is not known.
        speed_scale: Share of its velocity limits that it keeps to.
        acceleration: (dof,) bound on its joints' accelerations [rad/s2 or m/s2].
    """

    surface: RobotSurface
    T_base_other: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    age: float | None
    speed_scale: float
    acceleration: np.ndarray

    def between(self, begin: float, end: float) -> tuple[np.ndarray, float]:
        """Return points (n, 3) and the radius of balls that hold it meanwhile [m].

        At tau in [begin, end] joint j is within abs(dq_j) half + a_j end^2 / 2 of
        q + dq middle, and never farther from q than its velocity limit takes it. The
        radius is infinite where the age is not known.
        """
        if self.age is None or not 0.0 <= self.age < math.inf:
            return self.surface.at(self.q, self.T_base_other).copy(), math.inf
        begin, end = max(begin, 0.0), max(begin, end, 0.0)  # sums of times round
        begin, end = begin + self.age, end + self.age
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        by_speed = np.abs(self.dq) * half + 0.5 * self.acceleration * end * end
        ahead = self.dq * middle
        fastest = self.speed_scale * self.surface.robot.max_velocity
        by_limit = fastest * end + np.abs(ahead)
        moved = np.minimum(by_speed, by_limit)
        points = self.surface.at(self.q + ahead, self.T_base_other)
        return points.copy(), _most(self.surface, moved)

    @property
    def fastest(self) -> float:
        """The highest speed of any of its points now, at most [m/s]."""
        return _most(self.surface, np.abs(self.dq))


def limits_threat(
    surface: RobotSurface,
    T_base_other: np.ndarray,
    q: np.ndarray,
    dq: np.ndarray,
    age: float | None = 0.0,
    speed_scale: float = 1.0,
) -> LimitsThreat:
    """Return the threat of a robot known by its joints alone.

    Raises:
        BadInput: It moves faster than it is said to, or its state is not finite.
    """
    robot = surface.robot
    q, dq = np.asarray(q, float), np.asarray(dq, float)
    for name, value in (("q", q), ("dq", dq)):
        if value.shape != (robot.dof,) or not np.isfinite(value).all():
            raise BadInput(
                f"{name} of the other robot is {value}; give {robot.dof} finite numbers"
            )
    over = np.abs(dq) - speed_scale * robot.max_velocity
    if (over > 1e-6).any():
        j = int(over.argmax())
        raise BadInput(
            f"the other robot's {robot.joint_names[j]} moves at {abs(dq[j]):.3g}, more "
            f"than the {speed_scale * robot.max_velocity[j]:.3g} per second it is said "
            "to keep to; give its true share of the limits"
        )
    acceleration = np.asarray(robot.max_acceleration)
    return LimitsThreat(surface, T_base_other, q, dq, age, speed_scale, acceleration)


def _most(surface: RobotSurface, moved: np.ndarray) -> float:
    """Return how far any point gets where joint j moves by `moved[j]`, at most."""
    return float((surface.motion_bounds @ moved).max(initial=0.0))
