"""Motions: a path timed within velocity, acceleration and jerk limits.

A motion never changes. Any thread may ask any motion at any time: a control thread
calls `motion.at(t)` at its own rate while a planner thread makes the next motion from
it (`stop`, `rescaled`, `join`) and hands it over by replacing one reference.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roadmap.arrays import as_floats, brief, frozen
from roadmap.errors import BadInput
from roadmap.kinematics.joint_tree import check_robot
from roadmap.motion.blended_path import SAME, BlendedPath, check_scale, unwound
from roadmap.motion.blending import blend_path
from roadmap.motion.export import as_joint_trajectory, sample_times, write_csv
from roadmap.motion.joining import Commit, joined, rescaled
from roadmap.motion.retiming import timed
from roadmap.motion.stopping import quickest_stop
from roadmap.motion.timing import NoProfile, SpeedProfile, State
from roadmap.ranges import check_kind, check_number, is_between
from roadmap.robot.robot import Robot

BLEND = 0.005  # [m] default bound on how far rounded corners deviate


class SetPoint(NamedTuple):
    """Where a motion is at a moment: (dof,) each, rad or m, by seconds."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """A timed path; see `time_path`.

    Attributes:
        path: Its pieces with their limits.
        profile: Arc length over time.
        speed_scale: Share of the velocity limits it uses where nothing else rules.
        jerk_scale: Share of the jerk limits that it uses; a stop uses all of them.
    """

    path: BlendedPath
    profile: SpeedProfile
    speed_scale: float
    jerk_scale: float = 1.0

    __repr__ = brief

    @property
    def duration(self) -> float:
        """Time to its end [s]."""
        return self.profile.duration

    @property
    def deviation(self) -> float:
        """No centre of the cover is farther from the corner path than this [m]."""
        return self.path.deviation

    @property
    def q_end(self) -> np.ndarray:
        """(dof,) where it ends, at rest [rad or m]."""
        return self.path.at(self.length)[0].copy()

    def at(self, t: float) -> SetPoint:
        """Return the set-point `t` seconds after the start.

        Beyond the end the robot stands at the end. Any thread may call this.

        Raises:
            BadInput: `t` is negative or not a number.
        """
        s, v, a = self.profile.state(t)
        q, first, second = self.path.at(s)
        return SetPoint(q.copy(), v * first, (v * v) * second + a * first)

    def sample(self, times: np.ndarray) -> SetPoint:
        """Return the set-points at (n,) times as three (n, dof) arrays, those of `at`.

        Raises:
            BadInput: A time is negative or not a number.
        """
        times = as_floats("times", times)
        if times.ndim != 1:
            raise BadInput(f"times have shape {times.shape}; give (n,) seconds")
        s, v, a = self.profile.states(times)
        q, first, second = self.path.at_all(s)
        v, a = v[:, None], a[:, None]
        return SetPoint(q, v * first, (v * v) * second + a * first)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, the order of q."""
        return self.path.robot.joint_names

    def to_joint_trajectory(self, rate_hz: float = 100.0) -> dict:
        """Return it as plain data in the layout of ROS's JointTrajectory message.

        "joint_names", and "points" with "positions", "velocities", "accelerations"
        [rad or m] and "time_from_start" {"sec", "nanosec"}; the end is a point, too.

        Raises:
            BadInput: The rate is no positive number, or too high for its duration.
        """
        times = sample_times(self.duration, rate_hz)
        return as_joint_trajectory(self.joint_names, times, self.sample(times))

    def to_csv(self, file: str | Path, rate_hz: float = 100.0) -> Path:
        """Write it as CSV: time_s, then each joint's q, dq and ddq; return the file.

        Raises:
            BadInput: As of `to_joint_trajectory`, or the file cannot be written.
        """
        times = sample_times(self.duration, rate_hz)
        return write_csv(file, self.joint_names, times, self.sample(times))

    @property
    def length(self) -> float:
        """Arc length at its end [rad or m of joint space]."""
        return self.profile.end

    def path_from(self, t: float = 0.0, length: float = math.inf) -> np.ndarray:
        """Return corners (k, dof) of what is left from time `t` on.

        A blend stands there as two chords, which deviate less than it does itself.
        `length` ends it early: the arc length of a stop on the same path.
        """
        s = self.profile.state(t).s
        check_number("length", length, -math.inf, math.inf)
        until = min(length, self.length)
        corners = [self.path.at(s)[0]]
        for piece in self.path.pieces:
            if piece.end <= s + SAME:
                continue
            if piece.begin >= until:
                break
            end = min(piece.end, until)
            if piece.d > 0.0:
                corners.append(piece.at(0.5 * (max(s, piece.begin) + end))[0])
            corners.append(piece.at(end)[0])
        return np.array(corners)

    def place(self, t: float) -> float:
        """Return the arc length at time `t` [rad or m of joint space]."""
        return self.profile.state(t).s

    def speed(self, t: float) -> float:
        """Return the speed of the arc length at time `t` [rad or m per second]."""
        return self.profile.state(t).v

    def stop(self, t: float) -> "Motion":
        """Return the quickest stop along the same path, from time `t` on.

        Where it cannot stop before the next blend, it goes on as planned to there, or
        to where it rests next.

        Raises:
            BadInput: `t` is negative or not a number.
        """
        stop = quickest_stop(self.path, self.profile, t)
        return Motion(self.path, stop, self.speed_scale)

    def rescaled(self, t: float, speed_scale: float) -> "Motion":
        """Return the rest from time `t` on at another share of the velocity limits.

        Position, velocity and acceleration go on without a step.

        Raises:
            BadInput: The share lies outside (0, 1], or `t` is no time.
        """
        check_scale(speed_scale)
        rest = rescaled(self.path, self.profile, t, speed_scale)
        return Motion(self.path, rest, speed_scale)

    def gentler(self, t: float, jerk_scale: float) -> "Motion | None":
        """Return the rest from time `t` on within a share of the jerk limits.

        Position, velocity and acceleration go on without a step. Its stops, and what
        else is made of it, have all of the limits again.

        Returns:
            The motion; None where it is too fast for what lies ahead.

        Raises:
            BadInput: The share lies outside (0, 1], or `t` is no time.
        """
        check_scale(jerk_scale, "jerk")
        path = self.path.gentler(jerk_scale)
        try:
            rest = timed(path, self.profile.state(t), self.speed_scale)
        except NoProfile:
            return None
        return Motion(self.path, rest, self.speed_scale, jerk_scale)

    def commit(
        self,
        t: float,
        ahead: float = 0.0,
        least: float = 0.0,
        *,
        through_blends: bool = False,
    ) -> Commit:
        """Return the earliest place at which another path may begin.

        It is where the robot stands if it begins to stop `ahead` seconds after `t`,
        but not before arc length `least`. `through_blends` goes on to behind a blend:
        a path that begins on one leads off at an angle, and the robot must stop there.

        Raises:
            BadInput: `t` is no time, `ahead` is below 0, or `least` is no number.
        """
        place = self.place(t)
        check_number("ahead [s]", ahead, 0.0, math.inf)
        check_number("least, an arc length,", least, -math.inf, math.inf)
        begin = min(t + ahead, self.duration)
        stands = self.length  # a motion that is over has nothing to stop
        if begin < self.duration:
            stands = quickest_stop(self.path, self.profile, begin).end
        s = min(max(stands, place, least), self.length)
        if through_blends:
            s = self.path.behind_blend(s, self.length)
        return Commit(self.path.at(s)[0].copy(), s, begin)

    def join(
        self,
        t: float,
        commit: Commit,
        path: np.ndarray,
        *,
        blend: float = BLEND,
        speed_scale: float | None = None,
        robot: Robot | None = None,
    ) -> "Motion":
        """Return the motion that goes on to a commit point and then along `path`.

        The corner at the commit point is rounded where the robot can be slow enough
        in time; otherwise it stops there and goes on from rest.

        Args:
            t: Present time of this motion [s].
            commit: From `self.commit`, asked no earlier than at `t`.
            path: (k, dof) corners; the first is the commit point.
            blend: As in `time_path`.
            speed_scale: Share of the velocity limits; None keeps the present one.
            robot: The robot with what it carries by now, whose cover bounds what is
                rounded from the commit point on; None: that of this motion.

        Raises:
            BadInput: The path does not begin at the commit point, or leaves the
                joints' limits.
        """
        scale = self.speed_scale if speed_scale is None else speed_scale
        check_scale(scale)
        check_blend(blend)
        check_kind("commit", commit, Commit, "give what Motion.commit returns")
        if robot is not None:
            check_robot(robot, "spheres")
        arguments = (self.path, self.profile, t, commit, path, blend, scale, robot)
        return Motion(*joined(*arguments), scale)


def time_path(
    robot: Robot, path: np.ndarray, *, blend: float = BLEND, speed_scale: float = 1.0
) -> Motion:
    """Time a path within the robot's velocity, acceleration and jerk limits.

    The robot starts and ends at rest. Corners are rounded (`roadmap.motion.blending`);
    where they are not (blend 0, or a turn back) it stops in them.

    Args:
        robot: Its limits hold for every joint at every time.
        path: (k, dof) corners [rad or m], k >= 1; continuous joints go the short way.
        blend: No centre of the sphere cover gets farther from the corner path [m]:
            a share of the clearance m.
        speed_scale: Share of the velocity limits to use, in (0, 1].

    Returns:
        The motion.

    Raises:
        BadInput: Wrong shape, not finite, no corner, a joint more than 1e-3 outside
            its limits, or a value out of its range.
    """
    check_robot(robot, "max_jerk")  # arms of a hand-over plan have limits alone
    check_scale(speed_scale)
    check_blend(blend)
    path = unwound(robot, path)
    pieces, off = blend_path(robot, path, blend)
    blended = BlendedPath.of(robot, pieces, off, frozen(path[0], np.float64))
    profile = timed(blended, State(0.0, 0.0, 0.0), speed_scale)
    return Motion(blended, profile, speed_scale)


def check_blend(blend: float) -> None:
    """Refuse what is no bound on how far rounded corners deviate [m]."""
    if not is_between(blend, 0.0, sys.float_info.max):
        raise BadInput(f"a blend of {blend} m is no bound; give 0 or more")
