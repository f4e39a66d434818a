"""The test behind every set-point: can the robot stop before the person is there?

The path up to the end of a stop is tested against the shapes that hold the person at
all times of it (design, step 7; `odm.execution.threat` proves that they do).
"""

import math
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from odm.execution.settings import ExecutionSettings, PaceSettings, StopTestSettings
from odm.execution.threat import Moving, Threat, ThreatSettings
from odm.obstacles.obstacles import Obstacles
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls
from roadmap.kinematics.joint_tree import check_robot
from roadmap.motion.motion import Motion
from roadmap.ranges import check_kind, check_number
from roadmap.robot.robot import Robot

_ROUNDING = 1e-9  # [m]

# what to do about a robot that takes long to stop, for messages
OWN_LIMITS = (
    "if its limits of acceleration and jerk are those assumed where a URDF has none, "
    "give its own in [robot] of its recipe"
)


class HeldOut(Protocol):
    """Tells a person and what they hold out apart, and tests what is held out."""

    def parted(self, threat: Threat) -> tuple[Threat, Threat | None]:
        """Return where the person can be, and what they hold out; None: nothing."""

    def blocked_leg(
        self, path: np.ndarray, extra: float, points: Obstacles
    ) -> int | None:
        """Return the first leg of a path (k, dof) that what is held out blocks.

        None: there is none. It keeps `extra` [m] beyond the clearance; `points` are
        what is held out, and nobody, at any number of moments.
        """


class BrakingTest:
    """Tests stops against a person who moves on.

    Its planner answers `blocked_leg`: a planner of this package, or a `HeldOut`. That
    tests by the cover, so a planner is told not to `use_tight_ends`, where no stop
    would pass.

    Args:
        planner: See above.
        latency_s: The robot is where its set-point was up to so long ago [s].
        settings: How finely it tests.
    """

    def __init__(
        self,
        planner: Any,  # noqa: ANN401
        latency_s: float = 0.0,
        settings: StopTestSettings = StopTestSettings(),
    ) -> None:
        self.planner, self.settings, self.latency_s = planner, settings, latency_s
        if hasattr(planner, "use_tight_ends"):
            planner.use_tight_ends(False)

    def passes(
        self,
        motion: Motion,
        t: float,
        begin: float,
        stop: Motion,
        threat: Moving,
        closer: float = 0.0,
        off: float = 0.0,
    ) -> bool:
        """Whether the path to a stop is free at the times at which the robot is on it.

        The whole path is tested first, against all places where the person can be until
        the robot stands: enough while nobody is near. Then it is tested in pieces by
        time.

        Args:
            motion: The motion in use.
            t: The present time on it [s].
            begin: When the stop begins, on the same clock [s].
            stop: The stop on the same path.
            threat: Where the person, or another robot, can be.
            closer: How much nearer than m the robot may come [m].
            off: How far from the motion any point of the robot may be [m]: so much more
                distance is kept.
        """
        closer = closer - off
        before = max(begin - t, 0.0)  # the stop; a motion may be over
        there, more = threat.between(0.0, before + stop.duration + self.latency_s)
        path = motion.path_from(t, stop.length)
        if self.planner.blocked_leg(path, more - closer, there) is None:
            return True
        if not self._clear(motion, t, begin, 0.0, threat, closer):
            return False
        return self._clear(stop, 0.0, stop.duration, before, threat, closer)

    def left_behind(
        self, motion: Motion, t: float, begin: float, stop: Motion, threat: Threat
    ) -> np.ndarray | None:
        """Return (k,) which parts of the person are near and left by a motion.

        Each sphere of the cover is compared with each part of the person: where it is
        expected in the middle of the time, grown by how far it may come if it
        accelerates no harder than so far. A near part must get farther from every
        sphere from place to place until the robot stands; else None. This does not tell
        whether they touch: `passes` does, which has the same arguments.
        """
        time = max(begin - t, 0.0) + stop.duration + self.latency_s
        there, more = threat.as_so_far().between(0.0, time)
        # what answers `blocked_leg` alone knows no frame
        frame = getattr(self.planner, "frame", None)
        if frame is None or not math.isfinite(more) or not len(there.capsules):
            return None
        robot = frame.static.robot  # with what is in its hand
        rods = moved_rods(there.capsules, frame.base_world)
        keeps = frame.cell_map.safety.m + self.settings.near
        before, found = None, np.zeros(len(rods), bool)
        for s in np.linspace(motion.place(t), stop.length, self.settings.places):
            balls = cover_balls(robot, motion.path.at(s)[0])[robot.moving]
            gaps = ball_gaps(balls, rods)
            near = gaps < keeps
            if before is not None and (near & (gaps < before - _ROUNDING)).any():
                return None
            before, found = gaps, found | near.any(axis=0)
        return found

    def _clear(
        self,
        motion: Motion,
        begin: float,
        end: float,
        later: float,
        threat: Moving,
        closer: float,
    ) -> bool:
        """Test a motion from `begin` to `end`, which is at `later` from now on."""
        n = max(1, math.ceil((end - begin) / self.settings.slice_s - 1e-6))
        for k in range(n):
            a = begin + (end - begin) * k / n
            b = begin + (end - begin) * (k + 1) / n
            until = later + b - begin + self.latency_s
            there, more = threat.between(later + a - begin, until)
            corners = motion.path_from(a, motion.place(b))
            if self.planner.blocked_leg(corners, more - closer, there) is not None:
                return False
        return True


def stop_time(robot: Robot, speed_scale: float, period: float) -> float:
    """Return how long the longest of the joints' stops takes [s].

    From `speed_scale` of the joints' limits, after one more period.
    """
    speed = speed_scale * robot.max_velocity
    a, jerk = robot.max_acceleration, robot.max_jerk
    # either it comes to its full deceleration, or half of the time goes by until then
    times = np.where(
        speed >= a * a / jerk, speed / a + a / jerk, 2.0 * (speed / jerk) ** 0.5
    )
    return period + float(times.max())


def slowest_stop(
    robot: Robot, settings: ExecutionSettings, period: float, threat: ThreatSettings
) -> tuple[float, float]:
    """Return how long the shortest stop takes [s], and how far somebody comes [m].

    That is the stop from the slowest level of speed, of the joint that takes longest by
    its acceleration and jerk, one period late. The person stands at first, as far as
    the sensor can tell, and starts off as hard as is assumed of them. The robot gets no
    nearer to them than that and the clearance: it would brake as soon as it moved.

    Args:
        robot: The robot.
        settings: Of its execution.
        period: Time between frames [s].
        threat: What is assumed of the person, and of the sensor.
    """
    check_robot(robot, "max_jerk")
    check_kind("settings", settings, ExecutionSettings, "give ExecutionSettings(...)")
    period = check_number("period [s]", period, 1e-4, 10.0)
    check_kind("threat", threat, ThreatSettings, "give ThreatSettings(...)")
    time = stop_time(robot, settings.slowest_scale, period) + settings.latency_s
    if time <= PaceSettings().quick_s:  # nobody is expected to speed up harder
        threat = replace(threat, jerk=0.0)
    return time, threat.displacement_bound(time, period)
