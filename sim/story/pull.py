"""Whether somebody pulls at what the robot holds, from the force at its wrist.

A force-torque sensor at a wrist feels the weight of hand and object, which turns with
the hand, what the robot's own motion adds, noise, and bumps. A person who takes an
object pulls: for some tenths of a second, with some newtons. So the force counts
against a *rest force* that follows it slowly while nobody pulls, and a pull counts when
the mean over `window_s` has been above `force` for `hold_s`. A bump of 30 N that lasts
40 ms raises the mean of 100 ms for little more than 100 ms, which is less than
`hold_s` asks for.
"""

import math
import operator
from collections import deque
from dataclasses import dataclass

import numpy as np

from roadmap.kinematics.forward import tool_pose
from roadmap.motion.motion import SetPoint
from roadmap.ranges import CheckedSettings, setting, settings_of
from roadmap.robot.robot import Robot
from sim.story.wrist import GRAVITY

_H = 1e-3  # [s] of the differences that tell an acceleration


@dataclass(frozen=True)
class PullSettings(CheckedSettings):
    """What counts as a pull.

    Attributes:
        force: Least force that counts, beyond the force at rest [N]. 4 N is what the
            mean over a window of 10 frames with noise of 1 N (one sigma, each axis)
            does not reach, and a fraction of what people pull with.
        hold_s: It must last so long [s]. Less: quicker, and a shove is taken for a
            pull.
        window_s: The force is averaged over this [s].
        rest_s: Time constant with which the force at rest follows [s].
        faint: A force of this share of what would count is told as too weak, if it
            lasts; half of 4 N is above what noise and a trembling hand make.
    """

    force: float = setting(4.0, 0.01, 1000.0, "N")
    hold_s: float = setting(0.2, 0.01, 10.0, "s")
    window_s: float = setting(0.1, 0.001, 10.0, "s")
    rest_s: float = setting(1.0, 0.01, 100.0, "s")
    faint: float = setting(0.5, 0.01, 1.0)


class PullDetector:
    """Tells a pull that lasts from noise and bumps.

    Attributes:
        force: Of the last frame, beyond the force at rest, averaged [N].
        lasted: For how long it has been above the threshold [s].
        felt: Whether a force was measured since `restart`.
        weak: A force that lasted and did not count, the last one since `restart` [N]:
            one that the object does not account for, or a faint pull; 0: there is none.
        counts_from: How strong that would have to be [N].
    """

    def __init__(self, settings: PullSettings | None = None) -> None:
        self.settings = settings_of(settings, PullSettings)
        self._recent: deque[tuple[float, list[float]]] = deque()
        # of what is felt, then of what is held; numbers, since there are few
        self._rest: list[float] | None = None
        self.force, self.lasted, self.felt = 0.0, 0.0, False
        self.weak, self.counts_from = 0.0, 0.0
        self._weak_s = 0.0
        self._way = [0.0, 0.0, 0.0]  # in which a pull began

    @property
    def pulls(self) -> bool:
        """Whether there is a force above the threshold now."""
        return self.lasted > 0.0

    @property
    def pulled(self) -> bool:
        """Whether it has lasted."""
        return self.lasted >= self.settings.hold_s - 1e-9

    @property
    def why_weak(self) -> str:
        """What to do about a pull that does not count; empty: there is none."""
        if not self.weak:
            return ""
        return (
            f"somebody pulls with {self.weak:.1f} N, less than the "
            f"{self.counts_from:.1f} N that count now: pull harder, or give a smaller "
            "force in StorySettings(pull=PullSettings(force=...)); where nobody pulls, "
            "tare the sensor, or tell what the object weighs (mass_kg)"
        )

    def forget(self) -> None:
        """Take the next force for that at rest: the hand holds something else now."""
        self._recent.clear()
        self._rest, self.force, self.lasted = None, 0.0, 0.0

    def restart(self) -> None:
        """Ask for a new pull, as long as the first; the force at rest stays."""
        self.lasted, self.felt, self.weak, self._weak_s = 0.0, False, 0.0, 0.0

    def feel(
        self,
        wrench: np.ndarray | None,
        dt: float,
        moving: bool = False,
        taken: np.ndarray | None = None,
        own: np.ndarray | None = None,
    ) -> None:
        """Take one measurement.

        Args:
            wrench: (6,) force [N] and torque [N m] at the wrist, in any frame that is
                the same from call to call. What is not finite is no pull, nor is None:
                a sensor that fails never opens the hand.
            dt: Time since the one before [s].
            moving: Whether the robot moves: what its own motion adds is no pull
                unless it is three times as strong.
            taken: (3,) the weight of what has just come into the hand, turned with the
                hand [N]; None: nothing has. So much of it as hangs there already is no
                pull, and the force at rest stays that of the empty hand.
            own: (3,) force of what is held, by its mass and the robot's motion, turned
                with the hand [N]; None: not known. A force no larger than what this
                differs from its own value at rest is the robot's doing, and no pull.
                Nor is this very force: it is what is left when somebody lets go again
                who took hold so gently that their pull counts as at rest.
        """
        wrench = np.asarray(wrench, float)
        felt = wrench.tolist()
        if wrench.shape != (6,) or not all(map(math.isfinite, felt)):
            self.force, self.lasted, self._weak_s = 0.0, 0.0, 0.0
            return
        s, self.felt = self.settings, True
        known = [0.0, 0.0, 0.0] if own is None else own.tolist()
        mean = self._mean(felt[:3] + known, dt)
        if self._rest is None:
            self._rest = mean
        off = [now - rest for now, rest in zip(mean, self._rest, strict=True)]
        pull, added = off[:3], math.hypot(*off[3:])
        if taken is not None and taken.any():
            pull = _without(taken, np.array(pull)).tolist()
        self.force = math.hypot(*pull)
        others = math.inf  # what the object does not account for
        if own is not None:
            others = math.dist(mean[:3], mean[3:])
        least = added + s.force * (3.0 if moving else 1.0)
        if self.force >= least and others >= s.force:
            # one that swings to and fro is a thing that shakes, and nobody's pull
            if not self.lasted or sum(map(operator.mul, pull, self._way)) <= 0.0:
                self.lasted, self._way = 0.0, pull
            self.lasted += dt
            self.weak = 0.0
            return
        self.lasted = 0.0
        steady = own is not None and others >= s.force
        if moving or not (steady or self.force >= s.faint * least):
            self._weak_s = 0.0
        elif steady:
            self._note_weak(others, others + least - self.force, dt)
        else:
            self._note_weak(self.force, least, dt)
        if taken is not None:
            return
        quick = moving or added > s.force
        follows = min(1.0, dt / (0.1 * s.rest_s if quick else s.rest_s))
        self._rest = [a + follows * b for a, b in zip(self._rest, off, strict=True)]

    def _mean(self, felt: list[float], dt: float) -> list[float]:
        """Return the mean over the window, this measurement (6,) included [N]."""
        self._recent.append((dt, felt))
        kept = sum(passed for passed, _ in self._recent)
        while (
            len(self._recent) > 1
            and kept - self._recent[0][0] >= self.settings.window_s - 1e-9
        ):
            kept -= self._recent.popleft()[0]
        forces = [force for _, force in self._recent]
        return [sum(axis) / len(forces) for axis in zip(*forces, strict=True)]

    def _note_weak(self, force: float, counts_from: float, dt: float) -> None:
        """Note a force [N] that does not count, once it has lasted."""
        self._weak_s += dt
        if self._weak_s >= self.settings.hold_s - 1e-9:
            self.weak, self.counts_from = force, counts_from


def _without(weight: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return a force (3,) less as much of a weight (3,) as is in it [N]."""
    hangs = float(force @ weight) / float(weight @ weight)
    return force - min(1.0, max(0.0, hangs)) * weight


def carried_force(
    robot: Robot,
    point: SetPoint,
    T_tool_object: np.ndarray,
    mass_kg: float,
    T_world_base: np.ndarray | None = None,
) -> np.ndarray:
    """Return (3,) the force of what is held on the hand, tool frame [N].

    Its weight, and what the motion at a set-point adds to that.

    Args:
        robot: The robot.
        point: The set-point.
        T_tool_object: (4, 4) how it is held [m].
        mass_kg: Its mass [kg].
        T_world_base: (4, 4) pose of the robot's base [m]; None: it stands upright.
    """
    up = np.array([0.0, 0.0, 1.0]) if T_world_base is None else T_world_base[2, :3]
    pull = GRAVITY * up
    T = tool_pose(robot, point.q)
    if point.dq.any() or point.ddq.any():
        bend = 0.5 * _H * _H * point.ddq
        ways = (bend + _H * point.dq, bend - _H * point.dq)
        places = [tool_pose(robot, point.q + way) @ T_tool_object[:, 3] for way in ways]
        off = places[0] + places[1] - 2.0 * (T @ T_tool_object[:, 3])
        pull = pull + off[:3] / (_H * _H)
    return -mass_kg * (T[:3, :3].T @ pull)
