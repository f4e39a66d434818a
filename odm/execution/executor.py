"""From the planner's answers to set-points: joined, timed, and braked for the person.

At every moment there is a stop that was tested: before a set-point is passed on, the
path up to the end of the stop that could begin behind it is tested against the points,
grown by how far the person can come meanwhile. Where the test fails the robot slows
down; where that does not help it takes the stop it holds.

A pushed robot is beside the motion that was tested (`Executor.locate`). Within the
tracking share of m, less the error of its encoders, it goes on. Farther off it stops on
its path as quickly as it can: besides the push itself, this stop beside the tested path
is the only motion that is not tested. It may go on retreating from a person instead, if
that is free where it really is: from the person by balls grown by its offset, from
itself and the scenery at the very offset. Once it rests, or is held still, its
set-point becomes the place where it is: the planner plans from there, and tests the
first leg in full.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from odm.execution.lookout import Lookout, SeparationWatch, StandingWatch
from odm.execution.settings import ExecutionSettings, PaceSettings
from odm.execution.shell_test import ShellTest
from odm.execution.stop_test import BrakingTest, HeldOut, stop_time
from odm.execution.threat import Moving, SteadyParts, Threat, rods_of
from odm.execution.timed_before import TimedBefore
from odm.execution.tracking import TrackingMonitor
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, wrapped
from roadmap.motion.motion import Commit, Motion, SetPoint, time_path
from roadmap.ranges import check_number, settings_of
from roadmap.robot.robot import Robot

MOVING, SLOWED, BRAKED = "moving", "slowed", "braked"
RETREATING, STANDING = "retreating", "standing"
JerkRule = Callable[[Motion, float], float]  # the share for a motion's rest from t [s]
# of a robot, which are its own whatever it holds
_LIMITS = ("lower", "upper", "max_velocity", "max_acceleration", "max_jerk")
_COMES = "somebody comes"
_TOO_NEAR = "somebody is too near for it to move: it stands until they are farther"


class Executor:
    """Holds the motion in use and decides in every frame how it goes on.

    Each frame calls `locate` (if q is measured), `commit`, the planner from there,
    `update` with its answer, then `advance`.

    Args:
        robot: The robot.
        planner: Asked with `blocked_leg`, `separation` and `evasion` where it has them.
        q: (dof,) where the robot stands [rad or m].
        period: Time between frames [s].
        settings: See ExecutionSettings.
        pace: How it goes from speed to speed.

    Attributes:
        motion, t: The motion in use, and the time on it [s].
        held, held_t: The stop that was tested, taken where nothing else is, and the
            time on it [s], negative before it begins; None where nobody was about.
        state: "moving", "slowed", "braked", "retreating" or "standing".
        reason: One sentence: why it is slowed or braked, or may not take a way out.
        brakes: Whether the planner can test the path of a stop.
        quick: Whether it stops so soon that nobody is expected to accelerate harder
            meanwhile than so far (`PaceSettings.quick_s`).
        timed_path: Whether the last `update` timed a new path, which takes a while.
    """

    def __init__(
        self,
        robot: Robot,
        planner: Any,  # noqa: ANN401 (whatever answers some of the questions)
        q: np.ndarray,
        period: float,
        settings: ExecutionSettings | None = None,
        pace: PaceSettings = PaceSettings(),
    ) -> None:
        self.robot, self.planner = robot, planner
        self.period = check_number("the period of an executor [s]", period, 1e-4, 10.0)
        s = self.settings = settings_of(settings, ExecutionSettings)
        self.pace, self._lower, self.scales = pace, s.lower, _levels(s, pace)
        self._last_level = len(self.scales) - 1
        self._shares = (self.scales / self.scales[0]).tolist()
        self.motion, self.t = time_path(robot, as_floats("q", q)[None]), 0.0
        self.held: Motion | None = None
        self.held_t, self._braked_s = 0.0, 0.0
        self.state, self.reason = STANDING, ""
        late = s.latency_s
        self.quick = late + stop_time(robot, s.slowest_scale, period) <= pace.quick_s
        self.brakes = callable(getattr(planner, "blocked_leg", None))
        self._clearance, self._blend, tracking = 0.0, s.blend, pace.tracking
        if self.brakes:
            safety = planner.cell_map.safety
            self._clearance, tracking = safety.m, safety.tracking
            self._blend = min(self._blend, safety.blending)
        self._closer = max(self._clearance - s.yield_gap, 0.0)  # than m, leaving
        share = max(tracking - s.encoder_error, 0.0)
        self._tracking = TrackingMonitor(robot, share, period, latency_s=late)
        self._test, self._shells = BrakingTest(planner, late), ShellTest(planner, late)
        self._standing, self._timed = StandingWatch(planner), TimedBefore()
        self._separation = SeparationWatch(planner)
        looks = self.brakes and callable(getattr(planner, "evasion", None)) and s.yields
        self._lookout = Lookout(planner, period) if looks else None
        # the planner's robot with what it holds, and ours with the same
        self._loaded = robot, robot
        self._held_out: tuple[HeldOut, BrakingTest] | None = None  # see `part_from`
        # whether this frame timed a new path, and whether it looked if somebody comes
        self.timed_path = self._looked = False
        self._tried = 0  # frame in which a higher speed was tried last
        self._level = 0  # of speed; 0 is full speed
        self._least_level = 0  # none faster is used, see `limit_speed`
        self._jerk_rule: JerkRule | None = None  # see `limit_jerk`
        self._share, self._share_of = 1.0, -1  # what it allows, and in which frame
        self._kept: Motion | None = None  # that was within it, or could not be
        self._kept_at = 0  # frame in which that was looked at
        self._hindered = -math.inf  # frame in which it last slowed down for somebody
        self._frame, self._held_s = 0, 0.0  # the planner has held for so long
        self._retreat_frame = self._told_frame = -pace.retreat_every  # looked for then
        self._updated = False  # whether a frame was answered since the last period
        self._evading = False  # it retreats from somebody, whatever the planner says
        # an evasion that was refused, speeds that were not tried yet, and what stood
        self._left: tuple[np.ndarray, tuple[float, ...], object] | None = None
        self._on_path = False  # whether the motion follows the last answer's path
        self._corners = np.zeros((0, robot.dof))  # of that path
        self._path_begin = 0.0  # arc length on the motion at which that path begins
        # the set-point of a motion and a time: a frame asks for it several times
        self._point: tuple[Motion, float, SetPoint] | None = None
        self._next: tuple[Motion, float, float, Commit] | None = None  # `next_commit`

    @property
    def off(self) -> float:
        """How far any point of the robot may be from its set-point [m].

        0 while that is within what the tracking share leaves.
        """
        return self._tracking.off

    @property
    def set_point(self) -> SetPoint:
        """The set-point of this moment; continuous joints in [-pi, pi)."""
        known = self._point
        if known is None or known[0] is not self.motion or known[1] != self.t:
            point = self.motion.at(self.t)
            point = point._replace(q=wrapped(self.robot, point.q))
            known = self._point = self.motion, self.t, point
        q, dq, ddq = known[2]
        return SetPoint(q.copy(), dq.copy(), ddq.copy())

    @property
    def carrying(self) -> Robot:
        """The robot with what is in its hand, where the planner tells of that.

        What it holds is beyond the links: where a corner is rounded, or the robot is
        pushed, it gets farther off than they do. The limits are those of `robot`.
        """
        static, robot = getattr(self.planner, "static", None), self.robot
        held = robot if static is None else static.robot
        if held is not self._loaded[0]:
            if len(held.spheres) > len(robot.spheres):
                limits = {name: getattr(robot, name) for name in _LIMITS}
                robot = replace(held, **limits)
            self._loaded = held, robot
        return self._loaded[1]

    @property
    def at_rest(self) -> bool:
        """Whether the motion in use is over."""
        return self.t >= self.motion.duration

    @property
    def looks_out(self) -> bool:
        """Whether the next `update` looks if somebody comes, which takes a while."""
        return self._lookout is not None and self._lookout.is_due

    def new_goal(self) -> None:
        """Take the next answer's path in any case."""
        self._on_path = False

    def limit_speed(self, share: float) -> None:
        """Use no more than this share of the full speed from the next frame on.

        The fastest level within it is taken, the slowest one where there is none, but
        none at which it creeps. This is for the comfort of people: that the robot can
        stop is tested with or without it.

        Args:
            share: Of the speed at `speed_scale`; 1 for all of it.
        """
        check_number("the share of the speed", share, 0.0, sys.float_info.max)
        within = [k for k, low in enumerate(self._shares) if low <= share + 1e-9]
        self._least_level = min([*within, self.settings.levels - 1])

    def limit_jerk(self, rule: JerkRule | None) -> None:
        """Use no more of the jerk limits than a rule allows, from the next frame on.

        What is planned keeps it, where it still can; whatever brakes for somebody, gets
        out of their way, or goes on after that, uses all of the limits.

        Args:
            rule: Returns the share, in (0, 1], for the rest of a motion from a time on
                it [s], as `SpeedLimit.jerk_share` does; None: all of the limits.
        """
        self._jerk_rule = rule

    def part_from(self, held_out: HeldOut | None) -> None:
        """Test who is evaded, and what they hold out, each by rules of its own.

        Args:
            held_out: Knows which is which; None: all that is told of is the person.
        """
        self._held_out = None
        if held_out is not None:
            self._held_out = held_out, BrakingTest(held_out, self.settings.latency_s)

    def commit(self) -> Commit:
        """Return where a new path would begin: the planner plans from there.

        It is on the path in use, even if the robot has not come to its beginning yet.
        A retreat from somebody goes to its end.
        """
        if self.state != RETREATING:
            self._standing.look()
        least = self._least(self.t)
        known = self._next
        if known is not None and known[0] is self.motion:
            if known[1:3] == (self.t, least):
                return known[3]
        return self._commit_at(self.t, least)

    def next_commit(self) -> np.ndarray:
        """Return (dof,) where the next frame's path will begin, if nothing changes."""
        t = self.t + self.period
        least = self._least(t)
        commit = self._commit_at(t, least)
        self._next = (self.motion, t, least, commit)
        return commit.q

    def _commit_at(self, t: float, least: float) -> Commit:
        delay = self.settings.commit_delay_s
        return self.motion.commit(t, delay, least, through_blends=True)

    def _least(self, t: float) -> float:
        """Return the arc length before which no new path begins."""
        if self._evading:
            return math.inf
        on_path = self._on_path and t < self.motion.duration
        return self._path_begin if on_path else 0.0

    def update(self, answer: Any, commit: Commit, threat: Moving | None) -> None:  # noqa: ANN401
        """Take an answer planned from `commit`, then brake where it must be.

        Args:
            answer: The planner's answer.
            commit: From `commit`, in this frame.
            threat: Where the person can be; None where nobody is about. A retreat is
                tested against this, what stands still, and what else the frame shows
                where it is now.
        """
        if self.quick and isinstance(threat, Threat):
            threat = threat.as_so_far()
        self._frame += 1
        self._updated, self._looked, self.timed_path = True, self.looks_out, False
        if self.off:
            self._retreat_on_or_stop(threat)
            return
        if self._evades(threat):
            return
        if answer.status == "holding":
            self._held_s += self.period
            if not self._goes_on(threat):
                self._hold(answer, threat)
        else:
            self._held_s = 0.0
            self._separation.forget()
            if answer.status == "replanned" or not self._continues(answer.path):
                self._join(answer.path, commit)
        if self.state != RETREATING and self._on_path:
            self._keep_jerk()
            self._brake(threat)
        self.reason = self._tracking.note or self.reason

    def _continues(self, path: np.ndarray) -> bool:
        """Whether a path leads over what is left of the corners of the one in use."""
        left = len(path) - 1
        if not self._on_path or left > len(self._corners):
            return False
        return np.array_equal(path[1:], self._corners[len(self._corners) - left :])

    def _join(self, path: np.ndarray, commit: Commit) -> None:
        """Leave the motion in use for a path at the commit point."""
        scale = float(self.scales[self._level])
        joint = self.motion, self.t, commit, path, self._blend, scale
        self._take(self._timed.join(*joint, self.carrying))
        self.timed_path = True
        self._on_path, self._corners = True, path[1:]
        self._path_begin = commit.s
        if self.state != BRAKED:
            self.state = MOVING

    def advance(self) -> None:
        """Let one period pass; without an answer since the last one, brake.

        This is the watchdog of a late frame or planner: only the path to the end of a
        stop behind this set-point was tested.
        """
        if not self._updated and not self.at_rest:
            self._stop_as_tested()
            self.reason = "no frame was answered in time"
        self._updated = False
        self._tracking.leave(self.set_point.q)
        self.t += self.period
        self.held_t += self.period

    # --- pushed -----------------------------------------------------------------

    def locate(self, q: np.ndarray) -> None:
        """Tell where the robot is measured to be now; before `commit`, if at all.

        A robot that is off its set-point by more than the tracking share of m allows,
        and off where that was in the last `latency_s`, is stopped. Once it has stood
        still there for a tenth of a second, q becomes its set-point. Until then no
        answer of the planner is taken.

        Args:
            q: (dof,) [rad or m]; what is not finite is nowhere, and it stops.

        Raises:
            BadInput: Another shape.
        """
        q = as_floats("the measured q", q)
        if q.shape != (self.robot.dof,):
            raise BadInput(
                f"the measured q has shape {q.shape}, but the robot {self.robot.dof} "
                "joints; give one value for each"
            )
        if self._tracking.note:
            self.reason = ""
        self._tracking.carry(self.carrying)
        self._tracking.measure(self.set_point.q, q)
        if not self.off:
            return
        if not self.at_rest:
            self._tracking.moves()
            if self.state not in (RETREATING, BRAKED):
                self._stop_as_tested()
        elif self._tracking.held_still(q):
            self._restart_at(q)

    def locate_nowhere(self) -> None:
        """Tell that nothing measures where the robot is now; before `commit`.

        It is at its set-point then, unless it was off when that was known last.
        """
        if self._tracking.note:
            self.reason = ""
        self._tracking.unmeasured()

    def _restart_at(self, q: np.ndarray) -> None:
        """Take q, where the robot is, for its set-point."""
        robot = self.robot
        within = np.where(robot.continuous, q, np.clip(q, robot.lower, robot.upper))
        self._take(time_path(robot, within[None]))
        self._on_path, self._evading, self.held = False, False, None
        self.state, self._level = STANDING, 0
        self._tracking.restart()
        self._separation.forget()

    def _retreat_on_or_stop(self, threat: Moving | None) -> None:
        """Go on with a retreat if that is free beside the motion, too; else stop."""
        if self.state == RETREATING and not self.at_rest:
            free = self._may_move() and self._offset_free()
            if free and self._retreat_free(self.motion, self.t, threat):
                return
            self._stop_as_tested()
        self._evading = self._on_path = False
        self.reason = self._tracking.note
        self.state = STANDING if self.at_rest else BRAKED

    def _offset_free(self) -> bool:
        """Whether all that stands still is clear of the motion, moved by the offset."""
        if not math.isfinite(self.off):
            return False
        path = self.motion.path_from(self.t) + self._tracking.offset
        return self._standing.is_clear(path)

    # --- hold, retreat ----------------------------------------------------------

    def _stays_clear(self) -> bool:
        """Whether a retreat is clear of what was put up since it was planned."""
        return self._standing.stays_clear(self.motion.path_from(self.t))

    def _evades(self, threat: Moving | None) -> bool:
        """Whether it retreats from who comes, and takes no answer."""
        if self._evading:
            self._evading = not self.at_rest
            if self._evading:
                if self._stays_clear() and self._evades_on(threat):
                    # a frame may have been lost, and the stop taken meanwhile
                    self.state, self.reason = RETREATING, _COMES
                    return True
                self._evading = False
                self._stop_and_stand()
                if self._lookout is not None:
                    self._lookout.look_at_once()
                return True
            self.state, self.reason = STANDING, ""
        if self._lookout is None or not isinstance(threat, Threat):
            return False  # nobody is about, or another robot that tells its intent
        if self._left is not None:  # of the evasion that was found last
            path, shares, place = self._left
            if self.at_rest and place is self._standing.now and self._begins_here(path):
                return self._begin_evading(path, threat, shares)
            self._left = None
        # as if at the usual speed: that it takes time to get up speed is not reckoned
        scale = self.settings.speed_scale
        path = self._lookout.evasion(self.motion, self.t, threat, scale)
        if path is None:
            return False
        return self._begin_evading(path, threat, self.pace.retreats)

    def _evades_on(self, threat: Moving | None) -> bool:
        """Go on with an evasion as fast as the braking test allows; False: not at all.

        A faster robot takes longer to stop, but the person gets farther meanwhile: so
        the speed that passes falls as they come near, and rises as they fall back.
        """
        robot, motion, full = self.robot, self.motion, self.settings.yield_scale
        threat = _as_lately(threat)
        if self._evasion_free(motion, self.t, threat):
            if motion.speed_scale < full:
                scale = min(full, motion.speed_scale / self._lower)
                faster = motion.rescaled(self.t, scale)
                if self._evasion_free(faster, 0.0, threat):
                    self._take(faster)
            return True
        now = float(np.abs(motion.at(self.t).dq / robot.max_velocity).max())
        for share in self.pace.evasions:
            scale = max(share * min(now, full), self.pace.slowest)
            slower = motion.rescaled(self.t, scale)
            if self._evasion_free(slower, 0.0, threat):
                self._take(slower)
                return True
        return False

    def _begin_evading(
        self, path: np.ndarray, threat: Moving, shares: tuple[float, ...]
    ) -> bool:
        """Retreat along a path as fast as the braking test allows; False if not now.

        A standing robot tries one speed in a frame and the others in the next ones:
        each test takes all that a frame has left beside the search for the path.
        """
        threat, self._left = _as_lately(threat), None
        stands, commit = self.at_rest, self.motion.commit(self.t, 0.0)
        for k, share in enumerate(shares):
            scale = share * self.settings.yield_scale
            motion = self.motion.join(
                self.t, commit, path, blend=0, speed_scale=scale, robot=self.carrying
            )
            if self._evasion_free(motion, 0.0, threat):
                self._take(motion)
                self._evading, self._on_path = True, False
                self.state, self.reason = RETREATING, _COMES
                return True
            if stands and k + 1 < len(shares):
                self._left = path, shares[k + 1 :], self._standing.now
                break
        return False

    def _goes_on(self, threat: Moving | None) -> bool:
        """Whether it goes on along the path that it had, before it begins to hold.

        The path beyond its stop may be blocked; the path to the end of the stop is free
        here of what the frame has and of what stands still. What the person may do
        meanwhile the braking test asks next, as in every frame.
        """
        if self._held_s > self.settings.hold_delay_s + 1e-9:
            return False
        if not self._on_path or self.at_rest or self.state == BRAKED:
            return False
        if not (self.brakes and isinstance(threat, Threat)):
            return False  # another robot is told the stop, not where this would go on
        stop = self._stop_behind(self.motion, self.t)[1]
        path = self.motion.path_from(self.t, stop.length)
        return self._standing.is_clear(path) and self.planner.blocked_leg(path) is None

    def _hold(self, answer: Any, threat: Moving | None) -> None:  # noqa: ANN401
        self._on_path, self.reason = False, ""
        may_move = self._may_move()
        if self.state == RETREATING and not self.at_rest:
            better = self._separation.is_better_at(self.motion.q_end)
            goes_on = may_move and better and self._stays_clear()
            if goes_on and self._retreat_free(self.motion, self.t, threat):
                return
            self._stop_and_stand()
        elif self.at_rest:
            self.state = STANDING
            due = self._frame - self._retreat_frame >= self.pace.retreat_every
            if may_move and due:
                self._retreat_frame = self._frame
                self._retreat(answer.retreat, threat)
            if not may_move and self._gets_away(answer):
                self.reason = _TOO_NEAR
        elif self.state != STANDING:
            self._stop_and_stand()

    def _gets_away(self, answer: Any) -> bool:  # noqa: ANN401
        """Whether there is a retreat, or lately was: to look for one takes a while."""
        if self._frame - self._told_frame >= self.pace.retreat_every:
            self._told_frame, self._leaves = self._frame, answer.retreat is not None
        return self._leaves

    def _stop_and_stand(self) -> None:
        """Take the stop that was tested where there is one, and stand."""
        self._stop_as_tested()
        self.state = STANDING

    def _retreat(self, path: np.ndarray | None, threat: Moving | None) -> None:
        """Retreat along a path, as fast as the person lets it."""
        if path is None or not self._begins_here(path):
            return
        for share in self.pace.retreats:
            scale = share * self.settings.retreat_scale
            motion = time_path(self.robot, path, blend=0, speed_scale=scale)
            if self._retreat_free(motion, 0.0, threat):
                self._take(motion)
                self.state = RETREATING
                return

    def _retreat_free(self, motion: Motion, t: float, threat: Moving | None) -> bool:
        """Test a retreat until it can stand: it may come nearer than m, not touch."""
        if not self._clear_of_others(motion, t, threat):
            return False
        if threat is None or not self.brakes:
            self.held = None
            return True
        if isinstance(threat, Threat):
            threat = threat.as_so_far()
        return self._stop_free(motion, t, threat, closer=self._clearance)

    def _evasion_free(self, motion: Motion, t: float, threat: Moving | None) -> bool:
        """Test an evasion until it can stand: by the cover, and else by the shells."""
        if threat is None or not self.brakes:
            return self._retreat_free(motion, t, threat)
        if not self._clear_of_others(motion, t, threat):
            return False
        closer = self._closer
        if self._stop_free(motion, t, threat, closer=closer):
            return True
        if self.off or not isinstance(threat, Threat):
            return False
        begin, stop = self._stop_behind(motion, t)
        how, person = (motion, t, begin, stop), threat
        if self._held_out is not None:
            held_out, test = self._held_out
            person, there = held_out.parted(threat)
            if there is not None and not test.passes(*how, there, closer):
                return False
        if not self._shells.passes(*how, person, self.settings.yield_gap):
            return False
        self._hold_ready(stop)
        return True

    def _clear_of_others(self, motion: Motion, t: float, threat: Moving | None) -> bool:
        """Test a retreat until it can stand against what no threat tells of."""
        is_clear = getattr(self.planner, "clear_of_others", None)
        if is_clear is None:
            return True
        stop = self._stop_behind(motion, t)[1]
        path = motion.path_from(t, stop.length)
        return bool(is_clear(path, self.off - self._closer, rods_of(threat)))

    def _begins_here(self, path: np.ndarray) -> bool:
        """Whether a path begins at the set-point: from elsewhere it proves nothing."""
        if not len(path):
            return False
        off = difference(self.robot, self.set_point.q, path[0])
        return bool(np.abs(off).max() < 1e-6)

    def _may_move(self) -> bool:
        """Whether it may move at all: the person is not about to touch it."""
        least = self.settings.min_retreat_separation + self.off
        return self._separation.stays_above(least, self.set_point.q)

    # --- braking ----------------------------------------------------------------

    def _brake(self, threat: Moving | None) -> None:
        """Leave a motion in use whose next set-point has a tested stop behind it."""
        if threat is None or not self.brakes:
            self._raise_to_full()
            self.held = None
            return
        if self.state == BRAKED:
            self._braked_s += self.period
            self._set_off(threat)
            return
        self._keep_limit(threat)
        if self._may_go(self.motion, self.t, threat):
            self._try_faster(threat)
            self.state = SLOWED if self._level else MOVING
            return
        self.reason, self._hindered = self._why(threat), self._frame
        self._level = min(self._level + 1, self._last_level)
        scale = float(self.scales[self._level])
        slower = self._timed.rescaled(self.motion, self.t, scale)
        if self._may_go(slower, 0.0, threat):
            self._take(slower)
            self.state = SLOWED
            return
        self._stop_as_tested()

    def _keep_jerk(self) -> None:
        """Go on within the limit of the jerk, or with more of it where that allows."""
        motion, t = self.motion, self.t
        if self._jerk_rule is None or self.at_rest or self.state == BRAKED:
            return
        if motion is self._kept and self._frame % self.pace.keep_every:
            return
        # one frame later beside a look out and a new path, which take as long
        if self._looked and self.timed_path and self._frame - self._kept_at <= 1:
            return
        self._kept_at = self._frame
        used, share, again = motion.jerk_scale, self._jerk_share(), self.pace.again
        if again * share < used or again * used < share:
            kept = self._gentler(motion, t, share)
            if kept is not None:
                self._take(kept)
        self._kept = self.motion

    def _rescaled(self, level: int) -> Motion:
        """Return the rest at another level of speed, as gentle as it has to be."""
        motion = self.motion.rescaled(self.t, float(self.scales[level]))
        share = self._jerk_share()
        return motion if share >= 1.0 else self._gentler(motion, 0.0, share) or motion

    def _gentler(self, motion: Motion, t: float, share: float) -> Motion | None:
        """Return the rest of a motion with a share of the jerk, or with little more."""
        for more in (1.0, self.pace.harder):
            found = motion.gentler(t, min(1.0, more * share))
            if found is not None:
                return found
        return None

    def _jerk_share(self) -> float:
        """Return the share of the jerk that is allowed, worked out once a frame.

        It is all of it just after slowing down for a person: beside them a gentle start
        would creep for seconds.
        """
        lately = (self._frame - self._hindered) * self.period < self.pace.hindered_s
        if self._jerk_rule is None or lately:
            return 1.0
        if self._share_of != self._frame:
            self._share = self._jerk_rule(self.motion, self.t)
            self._share_of = self._frame
        return self._share

    def _keep_limit(self, threat: Moving) -> None:
        """Slow down to the limit, if a stop from there is free, too."""
        if self._level >= self._least_level:
            return
        slower = self._rescaled(self._least_level)
        if self._may_go(slower, 0.0, threat):
            self._take(slower)
            self._level, self.reason = self._least_level, "slower, near the person"

    def _set_off(self, threat: Moving) -> None:
        """Go on after a stop that was long, or would not come again in a moment.

        Else it would start and stop in turn at the place where it has to stand.
        """
        rested = self._braked_s >= self.pace.rests_s - 1e-9
        for level in sorted({self._level, self._last_level}):
            motion, held = self._rescaled(level), (self.held, self.held_t)
            later = min(self.pace.set_off_s, motion.duration)
            lasts = self._may_go(motion, later, threat)
            self.held, self.held_t = held  # the stop from here, not from there
            goes = lasts or rested and level == self._last_level
            if goes and self._may_go(motion, 0.0, threat):
                self._take(motion)
                self._level, self.state = level, SLOWED if level else MOVING
                return
        self.reason, self._hindered = self._why(threat), self._frame
        self._stop_as_tested()

    def _stop_as_tested(self) -> None:
        """Take the stop that was tested one frame ago, or before."""
        self._braked_s = self._braked_s if self.state == BRAKED else 0.0
        self.state = BRAKED
        if self.held is None:
            self._take(self.motion.stop(self.t))
        elif self.motion is not self.held:
            self.motion, self.t = self.held, self.held_t
            self._on_path = False  # it may lie on the path before the last one

    def _try_faster(self, threat: Moving) -> None:
        if self._level <= self._least_level:
            return
        # not in a frame that looked out: to time the rest anew takes as long
        if self._looked and self._frame - self._tried <= 1:
            return
        self._tried = self._frame
        faster = self._rescaled(self._level - 1)
        if self._may_go(faster, 0.0, threat, self.pace.look_ahead_s):
            self._take(faster)
            self._level -= 1
            self.reason = self.reason if self._level else ""

    def _raise_to_full(self) -> None:
        if self._level or self.state == BRAKED:
            self._level = 0
            self._take(self._rescaled(0))
        self.state, self.reason = MOVING, ""

    def _may_go(
        self, motion: Motion, t: float, threat: Moving, delay: float = 0.0
    ) -> bool:
        """Whether the stop test passes.

        A motion away from who is near may use the clearance down to `yield_gap`: a
        robot that stands too near to somebody is not safer there than on its way from
        them. Who is not near may speed up as hard as ever (decision 0115).
        """
        if self._stop_free(motion, t, threat, delay):
            return True
        if self.off or not isinstance(threat, Threat):
            return False
        begin, stop = self._stop_behind(motion, t)
        left = self._test.left_behind(motion, t, begin, stop, threat)
        if left is None:
            return False
        closer = self._closer
        if threat.expects_harder and not left.all():
            person = SteadyParts(threat, left)
            if not self._test.passes(motion, t, begin, stop, person, closer):
                return False
        return self._stop_free(motion, t, threat.as_lately(), closer=closer)

    def _stop_free(
        self,
        motion: Motion,
        t: float,
        threat: Moving,
        delay: float = 0.0,
        closer: float = 0.0,
    ) -> bool:
        """Test the path from `t` to the end of a stop behind the next set-point.

        Afterwards the robot rests, and the stop is held. With a `delay` [s] the stop
        may also begin that much later. The robot may come `closer` than m [m]. It may
        be `off` its motion by more than m allows for; the balls grow by that.
        """
        begin, stop = self._stop_behind(motion, t, delay)
        how = (threat, closer, self.off)
        if not self._test.passes(motion, t, begin, stop, *how):
            return False
        if delay > 0.0:  # the stop that is held begins behind the next set-point
            begin, stop = self._stop_behind(motion, t)
            if not self._test.passes(motion, t, begin, stop, *how):
                return False
        self._hold_ready(stop)
        return True

    def _stop_behind(
        self, motion: Motion, t: float, delay: float = 0.0
    ) -> tuple[float, Motion]:
        """Return when a stop behind the next set-point begins [s], and that stop."""
        begin = min(t + self.period + delay, motion.duration)
        return begin, motion.stop(begin)

    def _hold_ready(self, stop: Motion) -> None:
        self.held, self.held_t = stop, -self.period

    def _why(self, threat: Moving) -> str:
        stop = self.motion.stop(self.t)
        time = self.period + stop.duration
        far, where = threat.displacement_bound(time), "anywhere"
        if far < math.inf:
            where = f"up to {100 * far:.0f} cm from where they are expected"
        return (
            f"a stop takes {1e3 * time:.0f} ms, and by then the person can be in its "
            f"way: at up to {threat.fastest:.2f} m/s, and {where}"
        )

    def _take(self, motion: Motion) -> None:
        self.motion, self.t = motion, 0.0


def _levels(settings: ExecutionSettings, pace: PaceSettings) -> np.ndarray:
    """Return (k,) shares of the joints' speed limits, those it creeps at last."""
    usual = settings.speed_scale * settings.lower ** np.arange(settings.levels)
    return np.append(usual, settings.slowest_scale * np.asarray(pace.creeps))


def _as_lately(threat: Moving | None) -> Moving | None:
    """Return a person who speeds up as they lately did, others as they are."""
    return threat.as_lately() if isinstance(threat, Threat) else threat
