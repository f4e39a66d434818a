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
from odm.execution.robot_spheres import RobotSpheres
from odm.execution.settings import IntentSettings
from odm.execution.threat import age_of
from odm.obstacles.obstacles import Obstacles
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.motion.motion import Motion
from roadmap.ranges import check_kind, check_number, check_seconds
from roadmap.transforms import check_pose, moved_points

_SPHERES = "give RobotSpheres(...) of the other robot"
_INTENT = "give what intent_of returns"


@dataclass(frozen=True, eq=False)
class Stretch:
    """What a robot may do next: a motion from time `begin` on it to `end` [s]."""

    motion: Motion
    begin: float
    end: float


Intent = tuple[Stretch, ...]


def intent_of(executor: Executor) -> Intent:
    """Return all that an executor may still do without another test.

    Args:
        executor: In a frame in which it was updated, or before its first one.

    Raises:
        BadInput: Its robot follows late: it may be where no motion leads any more; or
            it is no executor.
    """
    if not hasattr(executor, "settings"):
        check_kind("executor", executor, (), "give the other robot's Executor")
    late = executor.settings.latency_s
    if late:
        raise BadInput(
            f"a robot that follows up to {late:g} s late (ExecutionSettings.latency_s) "
            "is not where its intent says; tell its joints instead, by limits_threat"
        )
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
        swept: Spheres that hold it at all times of its intent.
        spread: The most that any of them was grown by for its motion [m].
        fastest: The highest speed of any of its points now, at most [m/s].
    """

    swept: Obstacles
    spread: float
    fastest: float

    def between(self, begin: float, end: float) -> tuple[Obstacles, float]:
        """Return what it may sweep, and 0: the same at all times, whoever is late."""
        return self.swept, 0.0

    def displacement_bound(self, time: float) -> float:
        """Return how far it may be from the places that stand for its way [m]."""
        return self.spread


def intent_threat(
    spheres: RobotSpheres, intent: Intent, T_base_other: np.ndarray
) -> IntentThreat:
    """Return what a robot with an intent may sweep.

    Within a time of `half` from the middle of a piece joint j moves by at most
    |dq_j| half + a_j half^2 / 2, and the centre of a sphere by the sum over j times its
    motion bound. So a sphere that is larger by that sum holds it all the time.

    Args:
        spheres: The other robot's moving links.
        intent: From `intent_of`.
        T_base_other: (4, 4) its base where `step` of the robot that asks has obstacles:
            in that one's base frame, or in the world after `set_base`.

    Raises:
        BadInput: Arguments of another kind, or a pose that is not rigid.
    """
    check_kind("spheres", spheres, RobotSpheres, _SPHERES)
    check_kind("intent", intent, (tuple, list), _INTENT)
    for stretch in intent:
        check_kind("a part of intent", stretch, Stretch, _INTENT)
    settings = IntentSettings()
    limit = np.asarray(spheres.robot.max_acceleration)
    T = check_pose(T_base_other, "T_base_other")
    rows, spread, fastest = [np.zeros((0, 4))], 0.0, 0.0
    for stretch in intent:
        span = max(stretch.end - stretch.begin, 0.0)
        n = int(np.clip(np.ceil(span / settings.step_s), 1, settings.most))
        half = 0.5 * span / n
        for k in range(n):
            point = stretch.motion.at(stretch.begin + (2 * k + 1) * half)
            speed = np.abs(point.dq)
            grown = spheres.moved(speed * half + 0.5 * limit * half * half)
            placed = spheres.at(point.q)
            placed[:, :3] = moved_points(placed[:, :3], T)
            placed[:, 3] += grown
            rows.append(placed)
            spread = max(spread, float(grown.max(initial=0.0)))
            fastest = max(fastest, float(spheres.moved(speed).max(initial=0.0)))
    return IntentThreat(Obstacles(spheres=np.concatenate(rows)), spread, fastest)


@dataclass(frozen=True, eq=False)
class LimitsThreat:
    """Where a robot can be that tells only its joints; in the place of a `Threat`.

    Attributes:
        spheres: Its moving links.
        T_base_other: (4, 4) its base where `step` of the robot that asks has obstacles:
            in that one's base frame, or in the world after `set_base`.
        q, dq: (dof,) measured [rad or m, by seconds].
        age: Age of both [s]; None or NaN where it is not known.
        speed_scale: Share of its velocity limits that it keeps to.
        acceleration: (dof,) bound on its joints' accelerations [rad/s2 or m/s2].
    """

    spheres: RobotSpheres
    T_base_other: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    age: float | None
    speed_scale: float
    acceleration: np.ndarray

    def between(self, begin: float, end: float) -> tuple[Obstacles, float]:
        """Return spheres that hold it at all times from begin to end [s], and 0.

        At tau in [begin, end] joint j is within |dq_j| half + a_j end^2 / 2 of
        q + dq middle, and never farther from q than its velocity limit takes it. Each
        sphere is larger by how far its centre gets with that. Infinite instead of 0
        where the age is not known.
        """
        age = age_of(self.age)
        if not math.isfinite(age + begin + end):
            return self.spheres.obstacles(self.q, self.T_base_other), math.inf
        begin, end = max(begin, 0.0), max(begin, end, 0.0)  # sums of times round
        begin, end = begin + age, end + age
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        rows = self.spheres.at(self.q + self.dq * middle, self.T_base_other)
        rows[:, 3] += self._grown(middle, half, end)
        return Obstacles(spheres=rows), 0.0

    def displacement_bound(self, time: float) -> float:
        """Return how far it may be by then from where its speed leads [m]."""
        end = max(time, 0.0) + age_of(self.age)
        if not end < math.inf:
            return math.inf
        return float(self._grown(end, 0.0, end).max(initial=0.0))

    @property
    def fastest(self) -> float:
        """The highest speed of any of its points now, at most [m/s]."""
        return float(self.spheres.moved(self.dq).max(initial=0.0))

    def _grown(self, middle: float, half: float, end: float) -> np.ndarray:
        by_speed = np.abs(self.dq) * half + 0.5 * self.acceleration * end * end
        fastest = self.speed_scale * self.spheres.robot.max_velocity
        by_limit = fastest * end + np.abs(self.dq * middle)
        return self.spheres.moved(np.minimum(by_speed, by_limit))


def limits_threat(
    spheres: RobotSpheres,
    T_base_other: np.ndarray,
    q: np.ndarray,
    dq: np.ndarray,
    age: float | None = 0.0,
    speed_scale: float = 1.0,
) -> LimitsThreat:
    """Return the threat of a robot known by its joints alone.

    Raises:
        BadInput: It moves faster than it is said to, its state is not finite, or an
            argument is of another kind.
    """
    check_kind("spheres", spheres, RobotSpheres, _SPHERES)
    if age is not None:
        check_seconds("the age of the other robot's joints", age)
    T_base_other = check_pose(T_base_other, "T_base_other")
    robot = spheres.robot
    q, dq = as_floats("q", q), as_floats("dq", dq)
    name = "the other robot's speed_scale"
    speed_scale = check_number(name, speed_scale, 0.0, math.inf)
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
    return LimitsThreat(spheres, T_base_other, q, dq, age, speed_scale, acceleration)
