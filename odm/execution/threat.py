"""Where a person can be within a time: speed and separation in space and time.

ISO/TS 15066 counts the person's speed *toward the robot*, 1.6 m/s walking and 2 m/s for
an arm where it is not measured (ISO 13855). Here it is measured: each capsule's ends
are followed from frame to frame. A person who rests, passes by or moves away slows the
robot less than one who comes.

The ball. Let an end's measured places be within e (`noise`) of the true ones, and its
acceleration at most a until now; from now on that bound grows by j in every second
(`jerk`). Its velocity is taken as the mean over a window W, v = (p(0) - p(-W)) / W. The
true velocity *now* differs from the true mean by at most a W / 2, and the measured mean
from that by at most 2 e / W. So after a time t the end is within

    R(t) = e + (2 e / W + a W / 2) t + a t^2 / 2 + j t^3 / 6

of p(0) + v t; it gets there if it speeds up as hard as it can all the time. Somebody
who moves gently now does so for the moment, not for a second: a robot that takes 0.3 s
to stop has to expect more of them than one that takes 0.04 s. The last term makes
nobody faster than a part whose velocity is not known may be, in any direction; so it
adds to R(t) no more than to e + (`speed` + |v|) t. The window is the frame that makes
the second term least, W = 2 sqrt(e / a) if there is one; without noise the frame
before. At all times from b to c, the end is within R(c) + |v| (c - b) / 2 of where v
leads it by the middle of them.

The capsule. It is all points within its radius r of the segment between its ends. Let
each end be within R of where it is expected. A place of the axis, (1 - s) a + s b, is
within (1 - s) R + s R = R of the same place of the expected axis. So every point of the
true capsule is within r + R of the expected axis: the expected capsule with the radius
r + R holds it, inside and surface, whatever it does between its ends: turn, stretch, or
spin about itself. Nothing is sampled, so nothing is added for samples; and each part
grows by its own R.

Radii. A tracker that does not see a part leaves it where it was, and lets its radius
grow as fast as it may come. Its velocity is 0 then, and that of nobody. Where a radius
has grown since the frame before, it is taken to go on growing at that rate w, up to
the largest plausible speed: w t is added to R(t). So a part that is within r of where
it is shown, and no faster than w, is held at all times. One that shrinks by d, as a
part that is seen again does, is taken to keep its size from now on. It was within d of
where it was shown, so d / W is added to the error of its velocity; where that makes as
much as `speed`, its velocity is not known.

Left alone. An object that stands where nobody can reach it within a time T has not been
accelerated for as long as that was so, and is not within T. Its velocity was the same
over the window, so that 2 e / W is all that can be wrong with it, and from now on it is
within e + 2 e / W t + a s^2 / 2 + j s^3 / 6 of where that leads, s = max(0, t - T).

Names. Velocities are nonsense where parts exchange their names, or where one jumps. A
part is followed only while it is where it was expected to be, and no other part was
expected there; see `odm.execution._threat.follow`. Its velocity counts from the third
frame on that agrees. Where one is not known, R is e + speed * t about p(0), with w in
the place of the speed where the radius grows faster.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from odm.execution._threat import (
    Ability,
    Tracks,
    fastest_of,
    follow,
    write_between,
    write_likely,
    write_rates,
    write_sharpest,
)
from odm.execution.settings import FollowSettings
from odm.obstacles.obstacles import Obstacles
from roadmap.arrays import as_floats, writable
from roadmap.errors import BadInput
from roadmap.ranges import (
    CheckedSettings,
    check_kind,
    check_seconds,
    setting,
    settings_of,
)

_STEADY = 1e-9  # [m] radii that are placed anew round
_FOLLOW = FollowSettings()
_OF_PARTS = (
    "capsules", "velocity", "error", "drift", "most", "window", "widening", "untouched"
)  # fmt: skip


@dataclass(frozen=True)
class ThreatSettings(CheckedSettings):
    """Bounds on a person's motion, and on the error of its measurement.

    Attributes:
        speed: Speed bound of a part whose velocity is not known [m/s].
        acceleration: Largest acceleration of a part until now [m/s2]. A reach
            of 0.4 m in 0.8 s along a minimum-jerk curve takes 3.6 m/s2; a thrust with
            a peak of 2 m/s over 0.45 m takes 15, at which a robot hardly moves beside
            a person.
        jerk: How fast that bound grows from now on [m/s3], up to `speed`. That reach
            has 47 at most, people at work several hundred for a moment. 0: for a person
            who moves gently, and goes on to (decision 0104).
        noise: Bound on the error of a measured capsule end [m]. 0 suits a simulated
            person, whose capsules are exact; 0.001 to 0.003 a marker system; 0.02 and
            more a skeleton from one depth camera.
        max_plausible_speed: A measured speed above this is a tracking fault: an error,
            or parts that have exchanged their names [m/s].
        max_plausible_acceleration: The same for accelerations [m/s2]: a hand that
            trembles by 2 cm at 5 Hz has 20. Between `acceleration` and this a person
            does more than is assumed of them: their velocity counts, but the balls may
            be too small.
        rise: Factor on the hardest acceleration of the last fifth of a second: what a
            person may reach next, `acceleration` at least (`Threat.as_lately`). Of the
            parts of eight recordings 0.3 % get farther than that by 5 mm within the
            80 ms of a stop; with 1 0.9 %, and 9 % farther than with 4 m/s2 for all
            (decision 0072).
    """

    speed: float = setting(2.0, 0.0, 100.0, "m/s")
    acceleration: float = setting(4.0, 0.0, 1e4, "m/s2")
    noise: float = setting(0.0, 0.0, 1.0, "m")
    max_plausible_speed: float = setting(5.0, 0.0, 1000.0, "m/s")
    max_plausible_acceleration: float = setting(60.0, 0.0, 1e4, "m/s2")
    rise: float = setting(1.5, 0.0, 100.0)
    jerk: float = setting(80.0, 0.0, 1e6, "m/s3")

    @property
    def window(self) -> float:
        """Time over which a mean velocity is best known [s]; 0: the shortest there is.

        See the module; 1 s at most, and the drift's where nobody speeds up.
        """
        if not self.noise:
            return 0.0
        a = self.acceleration
        return min(2.0 * math.sqrt(self.noise / a) if a else _FOLLOW.drift_s, 1.0)

    def velocity_error(self, window: float) -> float:
        """Return the bound on the error of a mean velocity over a time [s], in m/s."""
        return 2.0 * self.noise / window + 0.5 * self.acceleration * window

    def displacement_bound(self, time: float, period: float) -> float:
        """Return how far somebody who seems to stand may be after a time [m].

        Args:
            time: From the last frame on [s].
            period: Time between frames [s], over some of which velocities are averaged.
        """
        frames = max(1, math.floor(self.window / period + 1e-9))
        longest, fastest = max(_FOLLOW.drift_s, self.window), self.noise
        fastest += self.speed * time
        if period > longest + 1e-9:  # nobody is followed from frame to frame
            return fastest
        known = max(frames, math.floor(longest / period + 1e-9))
        near = (frames, min(frames + 1, known))  # the best time lies between them
        error = min(self.velocity_error(n * period) for n in near)
        near = self.noise + error * time + 0.5 * self.acceleration * time * time
        return max(near, min(near + self.jerk * time**3 / 6.0, fastest))


class Moving(Protocol):
    """Who moves near a robot: a person (`Threat`), a cloud, or another robot."""

    def between(self, begin: float, end: float) -> tuple[np.ndarray | Obstacles, float]:
        """Return shapes or points, and how much more distance holds all meanwhile [m].

        Infinite where they can be anywhere.
        """

    def displacement_bound(self, time: float) -> float:
        """Return how far they may be from where they are expected by then [m]."""

    @property
    def fastest(self) -> float:
        """The highest speed of any of them [m/s]."""


@dataclass(frozen=True, eq=False)
class Threat:
    """A person's capsules and how their ends move.

    Attributes:
        capsules: (k, 7) ends a and b and radius [m].
        velocity: (k, 2, 3) velocity of each end [m/s], 0 where it is not known.
        error: (k,) bound on the errors of the velocities [m/s]; infinite for a part
            whose velocity is not known.
        age: Age of the data [s]; None or NaN: not known, and nothing holds the person.
        settings: What a person is able to do.
        drift: (k, 2, 3) mean velocity of each end in the last fifth of a second [m/s];
            None takes `velocity`.
        unknown: A part whose velocity is not known is no faster [m/s]: as fast as
            the settings say, or as any part was lately, which may be this one.
        past: Times [s] and ends (n, 2, 3) [m] of the last fifth of a second, the
            latest last.
        rows: (k,) which of those ends each part is; None: the first k.
        most: (k,) largest acceleration of each part [m/s2]; None: the settings'.
        window: (k,) time over which each velocity is a mean [s], where that is known.
        widening: (k,) how fast each radius grows [m/s]; None: none does.
        untouched: (k,) for how long nothing accelerates each part [s]; None: none.
        follow: How they were followed.
        jerk: How fast the largest acceleration grows from now on [m/s3]; None: as the
            settings say.
    """

    capsules: np.ndarray
    velocity: np.ndarray
    error: np.ndarray
    age: float | None
    settings: ThreatSettings
    drift: np.ndarray | None = None
    unknown: float = 0.0
    past: tuple[tuple[float, np.ndarray], ...] = ()
    rows: np.ndarray | None = None
    most: np.ndarray | None = None
    window: np.ndarray | None = None
    widening: np.ndarray | None = None
    untouched: np.ndarray | None = None
    follow: FollowSettings = _FOLLOW
    jerk: float | None = None

    def of(self, these: np.ndarray | slice) -> "Threat":
        """Return the threat of some of the parts alone."""
        rows = np.arange(len(self.capsules)) if self.rows is None else self.rows
        some: dict[str, Any] = {"rows": rows[these]}
        for name in _OF_PARTS:
            known = getattr(self, name)
            some[name] = None if known is None else known[these]
        return replace(self, **some)

    def left_alone(self, these: slice, time: float) -> "Threat":
        """Return the threat where nothing accelerates some parts; see the module.

        Args:
            these: Which parts: those of an object that stands.
            time: Nobody can reach them for so long [s], nor could they for as long as
                their velocities are averaged over.
        """
        if self.window is None:
            return self
        known = np.zeros(len(self.capsules), bool)
        known[these] = self.known[these]
        untouched, error = np.where(known, max(time, 0.0), 0.0), np.array(self.error)
        error[known] = 2.0 * self.settings.noise / self.window[known]
        return replace(self, untouched=untouched, error=error)

    def as_lately(self) -> "Threat":
        """Return the threat of a person who accelerates at least as hard as lately.

        Each change of velocity from frame to frame counts, `rise` times; with `noise`
        each over 60 ms, as far as the noise shows it. A change beyond what is plausible
        is a fault of the sensor and does not count. A person who keeps within the
        settings is bounded by them. Nobody is expected to speed up harder than so: see
        `as_so_far`.
        """
        s = self.settings
        if len(self.past) < 3 or not s.acceleration:
            return self.as_so_far()
        seen = np.array([ends for _, ends in self.past])
        if self.rows is not None:
            seen = seen.take(self.rows, axis=1)  # in C order, unlike seen[:, rows]
        times = np.array([t for t, _ in self.past])
        most = np.zeros(seen.shape[1])
        span = float(self.follow.spurt_s) if s.noise else 0.0
        write_sharpest(times, seen, span, float(s.noise), most)
        most = np.minimum(s.rise * most, s.max_plausible_acceleration)
        most = np.maximum(most, s.acceleration)
        error = self.error
        if self.window is not None:  # more of it in the mean velocity, too
            more = 0.5 * (most - s.acceleration) * self.window
            if self.untouched is not None:
                more = np.where(self.untouched > 0.0, 0.0, more)
            error = error + more
        return replace(self, most=most, error=error, jerk=0.0)

    @property
    def expects_harder(self) -> bool:
        """Whether the person may accelerate harder from now on than so far."""
        return (self.settings.jerk if self.jerk is None else self.jerk) > 0.0

    def as_so_far(self) -> "Threat":
        """Return the threat of a person who accelerates no harder than so far.

        For robots that stop quickly, and for evasions: expected to do more, a person
        would keep the robot from moving at all.
        """
        return replace(self, jerk=0.0) if self.expects_harder else self

    @cached_property
    def known(self) -> np.ndarray:
        """(k,) whether the velocity of a part is known."""
        return np.isfinite(self.error)

    def between(self, begin: float, end: float) -> tuple[Obstacles, float]:
        """Return capsules that hold the person at all times, and 0.

        From `begin` to `end` seconds from now; see the module. Infinite instead of 0
        where the times or the age are not known, or are too long.
        """
        age = age_of(self.age)
        room = self._room
        if not math.isfinite(age + begin + end):
            return room, math.inf
        begin, end = max(begin, 0.0), max(begin, end, 0.0)  # sums of times round
        s, most = self.settings, self.follow.most_growth
        jerk = s.jerk if self.jerk is None else self.jerk
        limits = tuple(map(float, (s.noise, self._unknown, most, jerk)))
        growth = self._ability, limits, begin + age, end + age, room.capsules
        return room, 0.0 if write_between(*growth) else math.inf

    def displacement_bound(self, time: float) -> float:
        """Return how far a part may be from where its velocity leads it by then [m]."""
        there, more = self.between(time, time)
        grown = there.capsules[:, 6] - self.capsules[:, 6]
        return math.inf if more else float(grown.max(initial=0.0))

    def likely(self, *times: float) -> Obstacles | None:
        """Return the capsules where they will be at some times from now [s].

        As their mean velocities bring them: where they are likely to be, not where
        they can be. None where no velocities are known, or not the age.
        """
        if not self.leads_on:
            return None
        drift = self.velocity if self.drift is None else self.drift
        ahead = age_of(self.age) + np.array(times)
        there = Obstacles(capsules=len(times) * len(self.capsules))
        parts = writable(self.capsules), writable(drift)
        write_likely(*parts, ahead, there.capsules)
        return there

    @property
    def leads_on(self) -> bool:
        """Whether it is known where any of the parts are likely to be soon."""
        return age_of(self.age) < math.inf and bool(self.known.any())

    @cached_property
    def fastest(self) -> float:
        """The highest speed of any part [m/s]."""
        parts = self._ability
        speed: float = fastest_of(parts.velocity, parts.error)[0]
        return speed if self.known.all() else max(self._unknown, speed)

    @property
    def _unknown(self) -> float:
        return max(self.settings.speed, self.unknown)

    @cached_property
    def _ability(self) -> Ability:
        n, most = len(self.capsules), self.most
        if most is None:
            most = np.full(n, self.settings.acceleration, float)
        others = (self.widening, self.untouched)
        parts = (self.capsules, self.velocity, self.error, most)
        parts += tuple(np.zeros(n) if row is None else row for row in others)
        return Ability(*map(writable, parts))

    @cached_property
    def _room(self) -> Obstacles:
        return Obstacles(capsules=len(self.capsules))


@dataclass(frozen=True, eq=False)
class SteadyParts:
    """A person some parts of whom speed up no harder from now on than so far.

    All parts are told, in their order: who tests them may know each by its number.

    Attributes:
        threat: The person.
        steady: (k,) which parts do not speed up harder.
    """

    threat: Threat
    steady: np.ndarray

    @cached_property
    def _so_far(self) -> Threat:
        return self.threat.as_so_far()

    def between(self, begin: float, end: float) -> tuple[Obstacles, float]:
        """Return capsules that hold the person at all times; see `Threat.between`."""
        there, more = self.threat.between(begin, end)
        so_far, less = self._so_far.between(begin, end)
        there.capsules[self.steady] = so_far.capsules[self.steady]
        return there, max(more, less)

    def displacement_bound(self, time: float) -> float:
        """Return how far a part may be from where it is expected by then [m]."""
        return self.threat.displacement_bound(time)

    @property
    def fastest(self) -> float:
        """The highest speed of any part [m/s]."""
        return self.threat.fastest


@dataclass(frozen=True, eq=False)
class CloudThreat:
    """A cloud of points, of whose motion nothing is known but a bound on its speed.

    Attributes:
        points: (n, 3) points on the surfaces of who moves, within the map's rho [m];
            those that no motion reaches, too: not of a cloud that a planner cropped.
        age: Age of the points [s]; None or NaN: not known, and nothing holds them.
        settings: Its `speed` and `noise` count.

    Raises:
        BadInput: No (n, 3) numbers, an age that is none, or other settings.
    """

    points: np.ndarray
    age: float | None
    settings: ThreatSettings

    def __post_init__(self) -> None:
        points = as_floats("the points of a cloud", self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise BadInput(
                f"the points of a cloud have shape {points.shape}; give (n, 3) [m]"
            )
        if self.age is not None:
            check_seconds("the age of the points", self.age)
        remedy = "give ThreatSettings(...)"
        check_kind("settings", self.settings, ThreatSettings, remedy)
        object.__setattr__(self, "points", points)

    def between(self, begin: float, end: float) -> tuple[np.ndarray, float]:
        """Return the points, and how far they may have come by `end` [m]."""
        return self.points, self.displacement_bound(
            end if begin + end < math.inf else math.inf
        )

    def displacement_bound(self, time: float) -> float:
        """Return how far a point may have come by then [m]."""
        passed = age_of(self.age) + max(time, 0.0)
        if not passed < math.inf:
            return math.inf
        return self.settings.noise + self.settings.speed * passed

    @property
    def fastest(self) -> float:
        """The highest speed of any point [m/s]."""
        return self.settings.speed


def age_of(age: float | None) -> float:
    """Return the age of data [s]; infinite where it is not known."""
    return age if age is not None and 0.0 <= age < math.inf else math.inf


def rods_of(threat: Moving | None) -> np.ndarray:
    """Return capsules (k, 7) that hold who is told of, as shown and by now [m].

    None for a cloud: wherever its points are, they may come from there.
    """
    shown = [np.zeros((0, 7))]
    if isinstance(threat, Threat):
        shown.append(threat.capsules)
    if threat is not None:
        there, more = threat.between(0.0, 0.0)
        if isinstance(there, Obstacles) and math.isfinite(more):
            shown += [there.capsules, there.spheres[:, [0, 1, 2, 0, 1, 2, 3]]]
    return np.concatenate(shown)


class Watcher:
    """Follows a person's capsules from frame to frame.

    Args:
        settings: What a person is able to do.
        follow: For how long, and when a velocity counts.
    """

    def __init__(
        self, settings: ThreatSettings | None = None, follow: FollowSettings = _FOLLOW
    ) -> None:
        self.follow = follow
        self.settings = s = settings_of(settings, ThreatSettings)
        plausible = s.max_plausible_acceleration, s.max_plausible_speed
        self._limits = np.array([s.noise, s.acceleration, *plausible])
        self._window = s.window
        self._past: deque[tuple[float, np.ndarray]] = deque()
        self._radii: deque[np.ndarray] = deque()  # of the same frames [m]
        self._count = np.zeros(0, np.int64)  # frames each part was followed for
        self._rates = np.zeros((2, 0, 2, 3))  # velocity now, and drift [m/s]
        self._slack = np.zeros(0)  # bound on the errors of the first [m/s]
        self._windows = np.zeros(0)  # time over which the first are means [s]
        self._fastest = (-math.inf, 0.0)  # when a part was fastest, and its speed [m/s]
        self._told: Threat | None = None  # the last one

    def look(self, capsules: np.ndarray, now: float, age: float | None = 0.0) -> Threat:
        """Return the threat of a frame.

        Capsules that are told again, with the time that they had, are the same ones at
        another age: so a loop asks that is quicker than its tracker.

        Args:
            capsules: (k, 7) person: a, b, radius [m], where `step` has them; the same
                parts in every frame.
            now: Time of the capsules [s]: when they were measured.
            age: Age of the capsules [s]; None: not known, they may be anywhere.

        Raises:
            BadInput: No (k, 7) numbers, or a time that is no number.
        """
        capsules = np.array(as_floats("the person's capsules", capsules))
        if capsules.ndim != 2 or capsules.shape[1] != 7:
            raise BadInput(
                f"the person's capsules have shape {capsules.shape}; give (k, 7): two "
                "ends and a radius [m] of each part, (0, 7) for nobody"
            )
        # as Python's own: numpy would warn of the time between two that are infinite
        now = check_seconds("now", now)
        if age is not None:
            age = check_seconds("the age of the capsules", age)
        told = self._told
        if told is not None and now == self._past[-1][0]:
            if np.array_equal(capsules, told.capsules):
                return replace(told, age=age)
        ends = np.ascontiguousarray(capsules[:, :6])  # one layout, one compiled loop
        self._follow(ends.reshape(-1, 2, 3), capsules[:, 6], now)
        self._measure(now)
        grown = self._grown()
        sure = self._count >= self.follow.confirmed
        rates, error = self._rates, self._slack  # others in the next frame
        if not sure.all():
            rates = np.where(sure[:, None, None], rates, 0.0)
            error = np.where(sure, error, math.inf)
        unknown = self._lately(rates[0], error, now)
        how = (self.settings, rates[1], unknown, tuple(self._past))
        self._told = Threat(
            capsules,
            rates[0],
            error,
            age,
            *how,
            window=self._windows,
            widening=grown,
            follow=self.follow,
        )
        return self._told

    def _grown(self) -> np.ndarray | None:
        """Return (k,) how fast the radii grow [m/s]; None where none does."""
        if len(self._past) < 2:
            return None
        before, radii = self._radii[-2], self._radii[-1]
        if not (radii > before + _STEADY).any():
            return None
        passed = self._past[-1][0] - self._past[-2][0]
        grown = np.maximum(radii - before, 0.0) / passed
        return np.minimum(grown, self.settings.max_plausible_speed)

    def _lately(self, velocity: np.ndarray, error: np.ndarray, now: float) -> float:
        """Return how fast a part that was lost may be by now [m/s].

        The fastest part of the last fifth of a second counts, with what its velocity
        may be wrong by and what an acceleration can have added.
        """
        fastest: float = sum(fastest_of(velocity, error))
        before, speed = self._fastest
        passed = now - before
        if passed < 0.0:  # of a frame that came late, or of a clock that was set back
            self._fastest, passed = (now, speed), 0.0
        if not passed <= self.follow.drift_s or fastest >= speed:
            self._fastest, passed, speed = (now, fastest), 0.0, fastest
        return speed + self.settings.acceleration * passed

    def _follow(self, ends: np.ndarray, radii: np.ndarray, now: float) -> None:
        """Take a frame: which parts are those of the frame before?"""
        past = self._past
        longest = max(self.follow.drift_s, self._window) + 1e-9
        passed = now - past[-1][0] if past else math.nan
        same = bool(past) and past[-1][1].shape == ends.shape
        if same and 0.0 < passed <= longest:
            count = np.empty(len(ends), np.int64)
            before = Tracks(past[-1][1], self._rates[0], self._slack, self._count)
            follow(ends, before, passed, self._limits, count)
            self._count = count
        else:
            past.clear()
            self._radii.clear()
            self._count = np.ones(len(ends), np.int64)
        past.append((now, ends))
        self._radii.append(radii)
        while len(past) > 2 and now - past[0][0] > longest:
            past.popleft()
            self._radii.popleft()

    def _measure(self, now: float) -> None:
        """Take the velocities of all parts: the best bounded ones, and the drift."""
        s, past = self.settings, self._past
        last, ends = len(past) - 1, past[-1][1]
        n = len(ends)
        self._rates, self._windows = np.zeros((2, n, 2, 3)), np.zeros(n)
        self._slack = np.full(n, math.inf)
        counts = set(self._count.tolist())
        for count in counts:
            first = max(0, last + 1 - count)
            if first >= last:
                continue
            i = last - 1  # the shortest time is best where nothing is wrong by noise
            if s.noise:
                times = range(i, first - 1, -1)
                i = min(times, key=lambda k: s.velocity_error(now - past[k][0]))
            # mostly all were followed for as long
            these = self._count == count if len(counts) > 1 else slice(None)
            window, longest = now - past[i][0], now - past[first][0]
            frames = ends[these], past[i][1][these], past[first][1][these]
            # seen for less than the drift: it rested before
            passed = np.array([window, max(longest, self.follow.drift_s)])
            rates = np.empty((2, *frames[0].shape))
            write_rates(*frames, passed, rates)
            self._rates[:, these] = rates
            self._slack[these] = s.velocity_error(window)
            self._windows[these] = window
            shrunk = self._radii[i] - self._radii[last]
            if (shrunk > _STEADY).any():  # some are seen again
                self._saw_again(these, np.maximum(shrunk, 0.0) / window)

    def _saw_again(self, these: np.ndarray | slice, error: np.ndarray) -> None:
        """Count with how wrong the velocities of parts are that were not seen.

        Args:
            these: Parts that were measured over the same time.
            error: (k,) by how much that of each part is [m/s].
        """
        self._slack[these] += error[these]
        unknown = np.zeros(len(error), bool)
        unknown[these] = error[these] >= self.settings.speed
        self._count[unknown] = 1
