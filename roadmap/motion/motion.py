"""Motions: a path timed within velocity, acceleration and jerk limits.

A motion never changes. Any thread may ask any motion at any time: a control thread
calls `motion.at(t)` at its own rate while a planner thread makes the next motion from
it (`stop`, `rescaled`, `join`) and hands it over by replacing one reference.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.motion.blending import lay_way
from roadmap.motion.joining import Commit, joined
from roadmap.motion.stopping import quickest_stop
from roadmap.motion.timed_path import NEAR, SAME, Way, check_scale, unwound
from roadmap.motion.timing import (
    NoProfile,
    Phase,
    Profiles,
    State,
    after,
    fill,
    junction_speeds,
)
from roadmap.robot.robot import Robot

BLEND = 0.005  # [m] default bound on what the blending of corners gives away
_MEETS = 1e-6  # a phase begins at the end of a piece, give or take that
_STEADY = 1e-3  # less is no acceleration: a rounding of v by e leaves sqrt(e j) of it
_SETTLE = (1.0, 0.75, 0.5, 0.25, 0.1, 0.0)  # shares of a speed that are tried


class SetPoint(NamedTuple):
    """Where a motion is at a moment: (dof,) each, rad or m, by seconds."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """A timed path; see `time_path`.

    Attributes:
        duration: Time to its end [s].
        speed_scale: Share of the velocity limits it uses where nothing else rules.
        deviation: No centre of the cover strays farther from the corner path [m].
    """

    duration: float
    speed_scale: float
    _way: Way
    _phases: tuple[Phase, ...]
    _end: float

    @property
    def deviation(self) -> float:
        """No centre of the cover strays farther from the corner path [m]."""
        return self._way.stray

    @property
    def q_end(self) -> np.ndarray:
        """(dof,) where it ends, at rest [rad or m]."""
        return self._way.at(self._end)[0].copy()

    def at(self, t: float) -> SetPoint:
        """Return the set-point `t` seconds after the start.

        Beyond the end the robot stands at the end. Any thread may call this.

        Raises:
            BadInput: `t` is negative or not a number.
        """
        s, v, a = self._state(t)
        q, first, second = self._way.at(s)
        return SetPoint(q.copy(), v * first, (v * v) * second + a * first)

    def sample(self, times: np.ndarray) -> SetPoint:
        """Return the set-points at (n,) times as three (n, dof) arrays."""
        points = [self.at(t) for t in np.asarray(times, float)]
        return SetPoint(*(np.array(rows) for rows in zip(*points, strict=True)))

    @property
    def length(self) -> float:
        """Arc length of its way at its end [rad or m of joint space]."""
        return self._end

    def path_from(self, t: float = 0.0, length: float = math.inf) -> np.ndarray:
        """Return corners (k, dof) of what is left from time `t` on.

        A blend stands there as two chords, which stray less than it does itself.
        `length` ends it early: the arc length of a stop on the same way.
        """
        s = self._state(t).s
        until = min(length, self._end)
        corners = [self._way.at(s)[0]]
        for piece in self._way.pieces:
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
        return self._state(t).s

    def speed(self, t: float) -> float:
        """Return the speed of the arc length at time `t` [rad or m per second]."""
        return self._state(t).v

    def stop(self, t: float) -> "Motion":
        """Return the quickest stop along the same path, from time `t` on.

        Where it cannot stop before the next blend, it goes on as planned to there, or
        to its end.

        Raises:
            BadInput: `t` is negative or not a number.
        """
        profiles = quickest_stop(self, t)
        return self._with(self._way, profiles, self.speed_scale)

    def rescaled(self, t: float, speed_scale: float) -> "Motion":
        """Return the rest from time `t` on at another share of the velocity limits.

        Position, velocity and acceleration go on without a step.

        Raises:
            BadInput: The share lies outside (0, 1], or `t` is no time.
        """
        check_scale(speed_scale)
        try:
            return self._go_on(t, self._way, speed_scale)
        except NoProfile:  # from rest it always goes on
            halt = self.stop(t)
            rest = State(halt._end, 0.0, 0.0)
            return halt._then(self._timed(self._way, rest, speed_scale), self._way)

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
        """
        begin = min(t + ahead, self.duration)
        s = min(max(self.stop(begin)._end, self._state(t).s, least), self._end)
        if through_blends:
            s = self._way.behind_blend(s, self._end)
        return Commit(self._way.at(s)[0].copy(), s, begin)

    def join(
        self,
        t: float,
        commit: Commit,
        path: np.ndarray,
        *,
        blend: float = BLEND,
        speed_scale: float | None = None,
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

        Raises:
            BadInput: The path does not begin at the commit point, or leaves the
                joints' limits.
        """
        return joined(self, t, commit, path, blend, speed_scale)

    # --- inside ----------------------------------------------------------------

    def _state(self, t: float) -> State:
        if not t >= 0.0:
            raise BadInput(f"a motion has no set-point at {t} s; ask from 0 s on")
        if t >= self.duration or not self._phases:
            return State(self._end, 0.0, 0.0)
        k = bisect_right(self._phases, t, key=_begins) - 1
        phase = self._phases[max(k, 0)]
        s, v, a = after(phase, t - phase.t)
        return State(min(s, self._end), max(v, 0.0), a)

    @classmethod
    def _with(cls, way: Way, profiles: Profiles, scale: float) -> "Motion":
        return cls(
            profiles.t, scale, way, tuple(profiles.phases), float(profiles.state.s)
        )

    def _repeat(self, profiles: Profiles, t: float, s_end: float) -> None:
        """Add what this motion does from time `t` until arc length `s_end`."""
        phases = self._phases
        if not any(abs(p.s - s_end) < _MEETS and abs(p.a) < _STEADY for p in phases):
            raise NoProfile(f"no piece of the motion ends at arc length {s_end}")
        k = max(0, bisect_right(phases, t, key=_begins) - 1)
        while phases[k].s < s_end - _MEETS:
            phase = phases[k]
            end = phases[k + 1].t
            state = after(phase, t - phase.t)
            profiles.phases.append(Phase(profiles.t, *state, phase.j))
            profiles.t += end - t
            t, k = end, k + 1
        # the end itself, so that the next piece is the next one's
        profiles.state = State(max(phases[k].s, s_end), phases[k].v, phases[k].a)

    def _stop_later(self, t: float, begin: float) -> "Motion":
        """Return the motion from `t` on that goes on as planned, then stops."""
        stop = self.stop(begin)
        phases = []
        ends = [phase.t for phase in self._phases[1:]] + [begin]
        for phase, end in zip(self._phases, ends, strict=True):
            end = min(end, begin)
            here = max(t, phase.t)
            if here < end:
                phases.append(Phase(here - t, *after(phase, here - phase.t), phase.j))
        rest = (p._replace(t=p.t + begin - t) for p in stop._phases)
        total = begin - t + stop.duration
        return Motion(total, stop.speed_scale, self._way, (*phases, *rest), stop._end)

    def _then(self, later: "Motion", way: Way) -> "Motion":
        """Return this motion followed by another on the same way."""
        phases = tuple(p._replace(t=p.t + self.duration) for p in later._phases)
        total = self.duration + later.duration
        return Motion(total, later.speed_scale, way, self._phases + phases, later._end)

    def _finish(self, profiles: Profiles, t: float) -> None:
        """Add what this motion does from time `t` to its end."""
        for k, phase in enumerate(self._phases):
            last = k + 1 == len(self._phases)
            end = self.duration if last else self._phases[k + 1].t
            if end <= t:
                continue
            begin = max(t, phase.t)
            state = after(phase, begin - phase.t)
            profiles.phases.append(Phase(profiles.t, *state, phase.j))
            profiles.t += end - begin
        profiles.state = State(self._end, 0.0, 0.0)

    def _go_on(
        self, t: float, way: Way, scale: float, until: float = math.inf
    ) -> "Motion":
        """Time a way from the state at `t`, or from a later end of a piece.

        The way is the present one up to arc length `until`.
        """
        state = self._state(t)
        head = Profiles(state)
        while True:
            try:
                rest = self._timed(way, head.state, scale)
                break
            except NoProfile:
                k = way.index_of(head.state)
                end = way.pieces[k].end
                if end > until + SAME:
                    raise
                self._repeat(head, t + head.t, end)
                if way.index_of(head.state) <= k:
                    raise
        later = tuple(p._replace(t=p.t + head.t) for p in rest._phases)
        return Motion(
            head.t + rest.duration, scale, way, tuple(head.phases) + later, rest._end
        )

    @classmethod
    def _timed(cls, way: Way, state: State, scale: float) -> "Motion":
        """Time a way from a state on it; raises NoProfile."""
        if not way.pieces:
            return cls._with(way, Profiles(State(state.s, 0.0, 0.0)), scale)
        limits = np.minimum(scale * way.swift, way.turning)
        ends = np.array([p.end for p in way.pieces])
        stops = way.corners
        k = way.index_of(state)
        natural = state.v + state.a * abs(state.a) / (2.0 * way.j[k])
        if max(state.v, natural) > (1.0 + 1e-6) * min(way.swift[k], way.turning[k]):
            raise NoProfile(f"{state.v} is too fast for the piece ahead")
        wanted = max(0.0, min(natural, limits[k]))
        for share in _SETTLE:
            profiles = Profiles(state)
            v = share * wanted
            if state.a != 0.0 or abs(v - state.v) > SAME:
                profiles.to_speed(v, way.a[k], way.j[k])
            s = profiles.state.s
            if s > ends[k] + NEAR:
                continue
            lengths = np.diff(np.maximum(ends[k:], s), prepend=s)
            rest = (limits[k:], stops[k:], way.a[k:], way.j[k:])
            speeds = junction_speeds(lengths, *rest)
            if v > speeds[0] + SAME:
                continue
            fill(profiles, ends[k:], limits[k:], speeds, way.a[k:], way.j[k:])
            return cls._with(way, profiles, scale)
        raise NoProfile(f"the state {state} leaves no time to slow down")


def time_path(
    robot: Robot, path: np.ndarray, *, blend: float = BLEND, speed_scale: float = 1.0
) -> Motion:
    """Time a path within the robot's velocity, acceleration and jerk limits.

    The robot starts and ends at rest. Corners are rounded (`roadmap.motion.blending`);
    where they are not (blend 0, or a turn back) it stops in them.

    Args:
        robot: Its limits hold for every joint at every time.
        path: (k, dof) corners [rad or m], k >= 1; continuous joints go the short way.
        blend: No centre of the sphere cover strays farther from the corner path [m]:
            a share of the clearance m.
        speed_scale: Share of the velocity limits to use, in (0, 1].

    Returns:
        The motion.

    Raises:
        BadInput: Wrong shape, not finite, no corner, a joint more than 1e-3 outside
            its limits, or a value out of its range.
    """
    check_scale(speed_scale)
    if not 0.0 <= blend < math.inf:
        raise BadInput(f"a blend of {blend} m is no bound; give 0 or more")
    path = unwound(robot, path)
    pieces, stray = lay_way(robot, path, blend)
    way = Way.of(robot, pieces, stray, frozen(path[0], np.float64))
    return Motion._timed(way, State(0.0, 0.0, 0.0), speed_scale)


def _begins(phase: Phase) -> float:
    return phase.t
