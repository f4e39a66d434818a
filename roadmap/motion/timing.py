"""Speed profiles: arc length over time within speed, acceleration and jerk, by ruckig.

The speed at the ends of the pieces comes from a pass backward and a pass forward;
acceleration is zero there. Between them ruckig (Berscheid, Kroeger 2021) finds the
quickest profile. All profiles are kept as constant-jerk phases.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from ruckig import (
    ControlInterface,
    InputParameter,
    Result,
    Ruckig,
    RuckigError,
    Trajectory,
)

from roadmap.errors import BadInput, PlanningError
from roadmap.motion._timing import reachable

_BACK = 1e-9  # slower than this is at rest, not backwards [rad or m per second]
_NOTHING = 1e-8  # no length to speak of [rad or m of joint space]
_MEETS = 1e-6  # a phase begins at the end of a piece, give or take that
_STEADY = 1e-3  # less is no acceleration: a rounding of v by e leaves sqrt(e j) of it


class Phase(NamedTuple):
    """Constant jerk from time t on, at arc length s, speed v and acceleration a."""

    t: float
    s: float
    v: float
    a: float
    j: float


class State(NamedTuple):
    """Arc length, speed and acceleration."""

    s: float
    v: float
    a: float


class NoProfile(PlanningError):
    """No profile keeps the limits from this state."""


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Arc length over time: phases one after the other, then rest.

    Attributes:
        phases: In order of time, from 0 s on.
        duration: Time to the end of the last one [s].
        end: Arc length at which it comes to rest [rad or m of joint space].
    """

    phases: tuple[Phase, ...]
    duration: float
    end: float

    def state(self, t: float) -> State:
        """Return the state at time `t` [s]; beyond the duration it rests at the end.

        Raises:
            BadInput: `t` is negative or not a number.
        """
        try:
            sound = bool(t >= 0.0)
        except (TypeError, ValueError):  # text, nothing, or several at a time
            sound = False
        if not sound:
            raise BadInput(f"a motion has no set-point at {t} s; ask from 0 s on")
        if t >= self.duration or not self.phases:
            return State(self.end, 0.0, 0.0)
        phase = self.phases[self.index(t)]
        s, v, a = after(phase, t - phase.t)
        return State(min(s, self.end), max(v, 0.0), a)

    def states(self, times: np.ndarray) -> np.ndarray:
        """Return what `state` does at (n,) times, to the last bit: (3, n) s, v, a."""
        for t in times[~(times >= 0.0)]:
            self.state(t)  # says why there is none
        found = np.zeros((3, len(times)))
        found[0] = self.end
        inside = np.flatnonzero(times < self.duration)
        if not self.phases or not len(inside):
            return found
        phases = np.array(self.phases)
        t = times[inside]
        at = np.maximum(0, np.searchsorted(phases[:, 0], t, side="right") - 1)
        begin, s, v, a, j = phases[at].T
        state = after(Phase(begin, s, v, a, j), t - begin)
        found[0, inside] = np.where(self.end < state.s, self.end, state.s)
        found[1, inside] = np.where(0.0 > state.v, 0.0, state.v)
        found[2, inside] = state.a
        return found

    def rest_after(self, t: float) -> float:
        """Return when it rests next after `t` [s], on its way or at its end."""
        for phase in self.phases:
            if phase.t > t and phase.v == phase.a == 0.0:
                return phase.t
        return self.duration

    def index(self, t: float) -> int:
        """Return the phase that holds time `t` [s]."""
        return max(0, bisect_right(self._begins, t) - 1)

    @cached_property
    def _begins(self) -> list[float]:
        return [phase.t for phase in self.phases]

    def then(self, later: "SpeedProfile") -> "SpeedProfile":
        """Return this profile followed by another, which begins where this one ends."""
        if not self.phases:
            return later
        begin = self.duration
        phases = tuple(Phase(begin + t, *state) for t, *state in later.phases)
        return SpeedProfile(self.phases + phases, begin + later.duration, later.end)


class ProfileBuilder:
    """Collects phases one after the other, from a state on.

    Attributes:
        phases: The phases so far.
        t: Time at their end [s].
        state: State at their end.
    """

    def __init__(self, state: State) -> None:
        self.phases: list[Phase] = []
        self.t, self.state = 0.0, state
        self._otg: Any = None  # made when it is needed

    def profile(self) -> SpeedProfile:
        """Return what was collected."""
        return SpeedProfile(tuple(self.phases), self.t, float(self.state.s))

    def repeat(self, profile: SpeedProfile, t: float, s_end: float) -> None:
        """Add what a profile does from `t` until arc length `s_end`.

        NoProfile: no phase of it begins there without acceleration.
        """
        phases = profile.phases
        if not any(abs(p.s - s_end) < _MEETS and abs(p.a) < _STEADY for p in phases):
            raise NoProfile(f"no piece of the motion ends at arc length {s_end}")
        k = profile.index(t)
        while phases[k].s < s_end - _MEETS:
            phase = phases[k]
            end = phases[k + 1].t
            state = after(phase, t - phase.t)
            self.phases.append(Phase(self.t, *state, phase.j))
            self.t += end - t
            t, k = end, k + 1
        # the end itself, so that the next piece is the next one's
        self.state = State(max(phases[k].s, s_end), phases[k].v, phases[k].a)

    def finish(self, profile: SpeedProfile, t: float) -> None:
        """Add what a profile does from time `t` until it rests, on its way or at last.

        A profile that could not go on otherwise has a stop on its way.
        """
        ends = [phase.t for phase in profile.phases[1:]] + [profile.duration]
        rest = profile.rest_after(t)
        for phase, end in zip(profile.phases, ends, strict=False):
            if end <= t:
                continue
            if phase.t >= rest:
                self.state = State(phase.s, 0.0, 0.0)
                return
            begin = max(t, phase.t)
            state = after(phase, begin - phase.t)
            self.phases.append(Phase(self.t, *state, phase.j))
            self.t += end - begin
        self.state = State(profile.end, 0.0, 0.0)

    def to_speed(self, v: float, a: float, j: float) -> None:
        """Add the quickest change to speed `v` and no acceleration within a and j."""
        self._begin(self.state, a, j)
        self._input.control_interface = ControlInterface.Velocity
        self._input.max_velocity = [math.inf]
        self._input.target_velocity, self._input.target_acceleration = [v], [0.0]
        self._run(None, v)

    def to_rest(self, a: float, j: float) -> None:
        """Add the quickest stop within a and j, as `to_speed` would, but much faster.

        A stop is asked for in every frame. It falls to -p and rises to 0: with
        acceleration a_0, p^2 = j v + a_0^2 / 2, or a constant -a in between.
        """
        _, v, a_0 = self.state
        if v + a_0 * abs(a_0) / (2.0 * j) <= 0.0 or abs(a_0) > a:
            self.to_speed(0.0, a, j)
            return
        a, j = float(a), float(j)
        peak, level = math.sqrt(j * v + 0.5 * a_0 * a_0), 0.0
        if peak > a:
            peak, level = a, (v + (0.5 * a_0 * a_0 - a * a) / j) / a
        t, state = self.t, self.state
        for dt, jerk in (((a_0 + peak) / j, -j), (level, 0.0), (peak / j, j)):
            if dt > 0.0:
                phase = Phase(t, *state, jerk)
                self.phases.append(phase)
                t, state = t + dt, after(phase, dt)
        self.t, self.state = t, State(state.s, 0.0, 0.0)

    def to_place(self, s: float, v: float, fastest: float, a: float, j: float) -> None:
        """Add the quickest profile to arc length `s` with speed `v`."""
        begin = self.state
        self._begin(begin, a, j)
        self._input.control_interface = ControlInterface.Position
        self._input.max_velocity = [max(fastest, begin.v, v)]
        self._input.target_position = [s - begin.s]
        self._input.target_velocity, self._input.target_acceleration = [v], [0.0]
        self._run(s, v)

    def _begin(self, begin: State, a: float, j: float) -> None:
        if self._otg is None:
            self._otg, self._input = Ruckig(1), InputParameter(1)
        self._input.max_acceleration, self._input.max_jerk = [a], [j]
        # relative to the present place, which keeps all digits
        self._input.current_position = [0.0]
        self._input.current_velocity = [begin.v]
        self._input.current_acceleration = [begin.a]

    def _calculated(self) -> Trajectory:
        """Return what ruckig finds, with a little less acceleration where that is none.

        On the border between two kinds of profiles (a motion from rest to rest of
        2 a^3 / j^2) it often finds neither.
        """
        trajectory, limit = Trajectory(1), self._input.max_acceleration[0]
        why: object = None
        for less in (0.0, 1e-9, 1e-6):
            self._input.max_acceleration = [limit * (1.0 - less)]
            try:
                why = self._otg.calculate(self._input, trajectory)
            except RuckigError as error:
                why = str(error).strip().partition("\n")[0]
            if why in (Result.Working, Result.Finished):
                return trajectory
        raise NoProfile(f"ruckig finds no profile from {self.state}: {why}")

    def _run(self, s_end: float | None, v_end: float) -> None:
        trajectory = self._calculated()
        profile = trajectory.profiles[0][0]
        t, (s, v, a) = self.t, self.state
        steps = [*zip(profile.brake.t, profile.brake.j, strict=True)]
        steps += zip(profile.t, profile.j, strict=True)
        left = trajectory.duration
        before = len(self.phases)
        for dt, j in steps:
            if dt <= 0.0:
                continue
            phase = Phase(t, s, v, a, j)
            self.phases.append(phase)
            s, v, a = end = after(phase, dt)
            t, left = t + dt, left - dt
            if _slowest(phase, end) < -_BACK:
                del self.phases[before:]
                raise NoProfile(f"the state {self.state} could not but go back")
        if abs(left) > 1e-6:
            raise NoProfile(f"a profile of {trajectory.duration} s has another length")
        self.t = t
        self.state = State(s if s_end is None else s_end, v_end, 0.0)


def after(phase: Phase, dt: float) -> State:
    """Return the state `dt` seconds into a phase."""
    _, s, v, a, j = phase
    return State(
        s + dt * (v + dt * (0.5 * a + dt * j / 6.0)),
        v + dt * (a + 0.5 * dt * j),
        a + dt * j,
    )


def _slowest(phase: Phase, end: State) -> float:
    """Return the lowest speed from the begin of a phase to a state on it."""
    slowest = min(phase.v, end.v)
    if phase.a < 0.0 < end.a:
        slowest = min(slowest, after(phase, -phase.a / phase.j).v)
    return slowest


def passing(phases: list[Phase], s: float) -> tuple[float, float]:
    """Return speed and acceleration at arc length `s`; of the last phase, its start.

    Speed falls along a stop, so a phase takes it from its begin to the next one's.
    """
    for phase, later in zip(phases, phases[1:], strict=False):
        if phase.s <= s < later.s:
            _, s_0, v, a, j = phase
            low, high = 0.0, later.t - phase.t
            for _ in range(50):
                middle = 0.5 * (low + high)
                # as `after`, without what is not needed
                if s_0 + middle * (v + middle * (0.5 * a + middle * j / 6.0)) < s:
                    low = middle
                else:
                    high = middle
            state = after(phase, high)
            return state.v, state.a
    return phases[-1].v, phases[-1].a


def junction_speeds(
    lengths: list[float],
    limits: list[float],
    stops: list[bool],
    a: list[float],
    j: list[float],
) -> list[float]:
    """Return speeds at the ends of pieces (n + 1,) from which the rest can be made.

    `stops` (n + 1,) are ends that must be passed at rest. The first speed is the
    highest allowed, not one that was asked for.
    """
    n = len(lengths)
    speeds = [0.0] * (n + 1)
    for k in range(n - 1, -1, -1):
        limit = limits[k] if k == 0 else min(limits[k - 1], limits[k])
        if stops[k]:
            limit = 0.0
        speeds[k] = reachable(speeds[k + 1], lengths[k], limit, a[k], j[k])
        speeds[k] = min(speeds[k], limit)
    return speeds


def fill(
    profiles: ProfileBuilder,
    ends: list[float],
    limits: list[float],
    speeds: list[float],
    a: list[float],
    j: list[float],
) -> None:
    """Add the profiles over all pieces, whose ends (n,) and junction speeds are given.

    `profiles` must stand at the start of the first piece or in it, at no acceleration.
    """
    for k in range(len(ends)):
        state = profiles.state
        left = ends[k] - state.s
        if left <= _NOTHING:
            profiles.state = state._replace(s=max(state.s, ends[k]))
            continue
        v = reachable(state.v, left, min(speeds[k + 1], limits[k]), a[k], j[k])
        profiles.to_place(ends[k], min(v, speeds[k + 1]), limits[k], a[k], j[k])
