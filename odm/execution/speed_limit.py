"""Speed near a person: separation, both speeds, and which way they go.

ISO/TS 15066:2016 (now in ISO 10218-2:2025) asks of speed and separation monitoring that

    S >= v_h (T_r + T_s) + v_r T_r + S_s + C + Z

with the speeds of person and robot toward each other v_h, v_r, reaction and stopping
time T_r, T_s, the stopping distance S_s = v_r T_s / 2, what intrudes unseen C and the
errors of both positions Z. Solved for v_r it says how fast a point of the robot may
approach a part of the person:

    v_r <= (S - v_h (T_r + T_s) - C - Z) / (T_r + T_s / 2)

Here S, v_h and v_r are those of each pair of a cover sphere and a part of the person,
along the line between the two: a robot that goes past or away is not slowed. A speed
that cannot be measured counts as 1.6 m/s.

This is a planner's measure, which makes it gentle beside people. It is not a certified
safety function: nothing here is redundant or monitored, and the speed is never brought
below `least_speed`, which the standard's formula would ask for at a hand-over (there
its limits of power and force apply, which are not computed here). That the robot can
stop before the person is there is held by the braking test, with or without it.
"""

from dataclasses import dataclass

import numpy as np

from odm.execution._speed import Mover, fastest_near, share_along
from odm.execution.settings import AheadSettings
from odm.execution.threat import Threat
from roadmap.arrays import writable
from roadmap.kinematics.forward import difference
from roadmap.kinematics.joint_tree import check_robot
from roadmap.motion.motion import Motion
from roadmap.ranges import CheckedSettings, setting, settings_of
from roadmap.robot.robot import Robot

NOBODY = np.zeros((0, 7))
_SMALL = 1e-3  # [rad or m] of a path, for the speeds of points along it


@dataclass(frozen=True)
class SpeedSettings(CheckedSettings):
    """Terms of the standard's formula.

    Attributes:
        reaction_s: T_r, from the measurement to the command [s]: its age and a frame.
        stopping_s: T_s, of a stop at the speeds of a hand-over [s].
        intrusion: C, how far a part may have come in before it is seen [m].
        position_error: Z, of person and robot together [m].
        least_speed: The robot is never slowed below this [m/s]; 0.15 is well below the
            0.25 m/s at which robots beside people are commonly taught.
        unknown_speed: v_h of what is not measured [m/s]: walking, as of ISO 13855.
        hand_near: Distance from the hand that takes part within which `hand_speed` and
            `hand_jerk` count [m]: these four are for comfort, no terms of the standard.
        hand_speed: Largest speed of any robot point there, in any direction [m/s].
        body_near, body_speed: The same of any part of the person [m], [m/s]: what goes
            past a face or a trunk is no closing speed, but nobody likes it fast.
        hand_jerk: Largest jerk of any point near the hand, along its path [m/s3]: that
            of a hand which reaches half a metre in a second (60 D / T^3 of a
            minimum-jerk motion). Stops do not keep it.
    """

    reaction_s: float = setting(0.02, 0.001, 10.0, "s")
    stopping_s: float = setting(0.15, 0.0, 10.0, "s")
    intrusion: float = setting(0.0, 0.0, 10.0, "m")
    position_error: float = setting(0.02, 0.0, 10.0, "m")
    least_speed: float = setting(0.15, 0.001, 10.0, "m/s")
    unknown_speed: float = setting(1.6, 0.0, 100.0, "m/s")
    hand_near: float = setting(0.25, 0.0, 10.0, "m")
    hand_speed: float = setting(0.5, 0.001, 100.0, "m/s")
    hand_jerk: float = setting(30.0, 0.1, np.inf, "m/s3")
    body_near: float = setting(0.20, 0.0, 10.0, "m")
    body_speed: float = setting(0.8, 0.001, 100.0, "m/s")


class SpeedLimit:
    """Says which share of its speed a robot may use, frame by frame."""

    def __init__(self, robot: Robot, settings: SpeedSettings | None = None) -> None:
        """Take the spheres of the links that joints move."""
        check_robot(robot, "max_velocity")
        s = settings_of(settings, SpeedSettings)
        self.robot, self.settings, self._ahead = robot, s, AheadSettings()
        lost = s.intrusion + s.position_error
        times = [s.reaction_s, s.stopping_s, lost]
        speeds = [s.least_speed, s.unknown_speed]
        near = [s.hand_near, s.hand_speed, s.body_near, s.body_speed]
        self._rule = np.array([*times, *speeds, *near])
        self._mover = Mover(
            tree_i=np.array(robot.tree_i),
            tree_f=np.array(robot.tree_f),
            spheres=np.array(robot.spheres),
            body=np.array(robot.sphere_body),
            max_velocity=np.array(robot.max_velocity),
            moving=np.flatnonzero(robot.moving),
            q=np.empty(robot.dof),
            frames=np.empty((len(robot.tree_i), 12)),
            balls=np.array(robot.spheres),
            ahead=np.empty((len(robot.spheres), 3)),
        )

    def share(
        self,
        motion: Motion,
        t: float,
        speed_scale: float,
        threat: Threat,
        hands: np.ndarray | None = None,
        people: int | None = None,
    ) -> float:
        """Return the share of `speed_scale` that is allowed now, in (0, 1].

        At time t [s] on the motion in use, beside the person as seen now, the first
        `people` parts of `threat` (None: all), and `hands` (k, 7), capsules of hands
        that take part [m]; None: none does.
        """
        if t >= motion.duration:
            return 1.0
        times = t, t + self._ahead.direction_s
        here, there = (motion.path.at(motion.place(x))[0] for x in times)
        step = difference(self.robot, here, there)
        rates, known = threat.velocity[:people].reshape(-1, 6), threat.known[:people]
        if not known.all():
            rates = np.where(known[:, None], rates, np.nan)
        person = writable(threat.capsules[:people]), writable(rates)
        hands = NOBODY if hands is None else writable(hands)
        moves = self._mover, writable(here), step, float(speed_scale)
        return share_along(*moves, person, hands, self._rule)

    def jerk_share(self, motion: Motion, t: float, hands: np.ndarray) -> float:
        """Return the share of the jerk limits that is allowed now, in (0, 1].

        Points near one of the `hands` (k, 7) [m], at time t [s] on the motion in use or
        soon, keep `hand_jerk` along their path: what its bends add is left out.
        """
        s = self.settings
        if not (s.hand_near and s.hand_jerk < np.inf and len(hands)):
            return 1.0
        if t >= motion.duration:
            return 1.0
        path, most = motion.path, s.hand_jerk
        for ahead in self._ahead.jerk_s:
            place = motion.place(min(t + ahead, motion.duration))
            q, direction, _ = path.at(place)
            moves = self._mover, writable(q), writable(direction), writable(hands)
            fastest: float = fastest_near(*moves, float(s.hand_near), _SMALL)
            most = max(most, fastest * path.j.item(path.index(place)))
        return s.hand_jerk / most
