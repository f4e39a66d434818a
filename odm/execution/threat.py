"""Where a person can be within a time: speed and separation in space and time.

ISO/TS 15066 counts the person's speed *toward the robot*, 1.6 m/s walking and 2 m/s for
an arm where it is not measured (ISO 13855). Here it is measured: each capsule's ends
are followed from frame to frame. A person who rests, passes by or moves away slows the
robot less than one who comes.

The ball. Let an end's measured places be within e (`noise`) of the true ones, and its
acceleration at most a. Its velocity is taken as the mean over a window W,
v = (p(0) - p(-W)) / W. The true velocity *now* differs from the true mean by at most
a W / 2, and the measured mean from that by at most 2 e / W. So after a time t the end
is within

    e + (2 e / W + a W / 2) t + a t^2 / 2

of p(0) + v t; it gets there if it speeds up by a all the time. The window is the frame
that makes the second term least, W = 2 sqrt(e / a) if there is one; without noise the
frame before. What lies between the ends is between their errors, too.

The surface. A point of a capsule is moved with it as with a rigid body, by its axis
alone: a turn of the capsule about itself does not move its surface. A body that turns
by w and grows by g along its axis is carried to a copy that is longer across, by
k = sqrt(1 + w^2 t^2) + |g| t at most. So samples that cover it within rho are within
k rho of each other afterwards, and the true surface lies at most (k - 1) r inside the
copy's: (k - 1) (rho + r) more. Radii are taken not to change.

Names. Velocities are nonsense where parts exchange their names, or where one jumps. A
part is followed only while it is where it was expected to be, and no other part was
expected there; see `odm.execution._threat.follow`. Its velocity counts from the third
frame on that agrees. Where one is not known, the balls have the radius e + speed * t.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from odm.execution._threat import Tracks, follow, near_points, velocities
from roadmap.ranges import check_settings

_DRIFT = 0.2  # [s] a hand that trembles at 5 Hz or faster gets nowhere in this time
_CONFIRMED = 3  # frames that agree on a velocity


@dataclass(frozen=True)
class ThreatSettings:
    """Bounds on a person's motion, and on the error of its measurement.

    Attributes:
        speed: Speed bound of a part whose velocity is not known [m/s].
        acceleration: Largest acceleration of a part [m/s2]. A reach
            of 0.4 m in 0.8 s along a minimum-jerk curve takes 3.6 m/s2; a thrust with
            a peak of 2 m/s over 0.45 m takes 15, at which a robot hardly moves beside
            a person.
        noise: Bound on the error of a measured capsule end [m]. 0 suits a simulated
            person, whose capsules are exact; 0.001 to 0.003 a marker system; 0.02 and
            more a skeleton from one depth camera.
        max_plausible_speed: A measured speed above this is a tracking fault: an error,
            or parts that have exchanged their names [m/s].
        max_plausible_acceleration: The same for accelerations [m/s2]: a hand that
            trembles by 2 cm at 5 Hz has 20. Between `acceleration` and this a person
            does more than is assumed of them: their velocity counts, but the balls may
            be too small.
        horizon_s: Only points that can reach the robot within this time are kept [s]; a
            stop that takes longer is tested against all of them.
    """

    speed: float = 2.0
    acceleration: float = 4.0
    noise: float = 0.0
    max_plausible_speed: float = 5.0
    max_plausible_acceleration: float = 60.0
    horizon_s: float = 0.5

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            BadInput: One out of range.
        """
        ranges = {
            "speed": (0.0, 100.0, "m/s"),
            "acceleration": (0.0, 1e4, "m/s2"),
            "noise": (0.0, 1.0, "m"),
            "max_plausible_speed": (0.0, 1e3, "m/s"),
            "max_plausible_acceleration": (0.0, 1e4, "m/s2"),
            "horizon_s": (0.0, 60.0, "s"),
        }
        check_settings(self, ranges)


class Moving(Protocol):
    """Who moves near a robot: a person (`Threat`), or another robot."""

    def between(self, begin: float, end: float) -> tuple[np.ndarray, float]:
        """Return points (n, 3) and the radius [m] of balls that hold them meanwhile."""

    @property
    def fastest(self) -> float:
        """The highest speed of any of the points [m/s]."""


@dataclass(frozen=True)
class Threat:
    """A person's points that are near enough to matter, and how they move.

    Attributes:
        points: (n, 3) points of the person's surface [m].
        velocity: (n, 3) velocity of each [m/s], 0 for those of parts whose velocity is
            not known; None where none is.
        age: Age of the data [s]; None or NaN: not known, and no ball is large enough.
        settings: What a person is able to do.
        drift: (n, 3) mean velocity of each in the last fifth of a second [m/s]; None
            takes `velocity`.
        error: Bound on the errors of the velocities that are known [m/s].
        lost: Whether there are points whose velocity is not known.
        turn, stretch: The fastest turn of a part, and its growth by its length [1/s].
        thick: Largest radius of the parts, and covering radius of the points [m].
        everywhere: Returns the same for all points, near or not; for times later than
            `settings.horizon_s`.
        unknown: A part whose velocity is not known is no faster [m/s]: as fast as
            the settings say, or as any part was lately, which may be this one.
    """

    points: np.ndarray
    velocity: np.ndarray | None
    age: float | None
    settings: ThreatSettings
    drift: np.ndarray | None = None
    error: float = 0.0
    lost: bool = False
    turn: float = 0.0
    stretch: float = 0.0
    thick: float = 0.0
    everywhere: "Callable[[], Threat] | None" = None
    unknown: float = 0.0

    def between(self, begin: float, end: float) -> tuple[np.ndarray, float]:
        """Return points (n, 3) and the radius [m] of balls that hold the person.

        The balls around the points, grown by the points' covering radius, hold the
        person's whole surface at all times from `begin` to `end` seconds from now, if
        the points covered it; see the module. The radius is infinite where the times
        or the age are not known.
        """
        age = self._age
        known = math.isfinite(age + begin + end)
        begin, end = max(begin, 0.0), max(begin, end, 0.0)  # sums of times round
        if not (known and end < math.inf):
            return self.points, math.inf
        if end > self.settings.horizon_s and self.everywhere is not None:
            return self._all.between(begin, end)
        begin, end = begin + age, end + age
        unknown = self.settings.noise + self._unknown * end
        if self.velocity is None:
            return self.points, unknown
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        radius = self._gained(end) + half * self.fastest
        if self.lost:
            radius = max(radius, unknown)
        return self.points + middle * self.velocity, radius

    @property
    def is_dated(self) -> bool:
        """Whether the age of the data is known."""
        return self._age < math.inf

    @property
    def _age(self) -> float:
        """The age of the data [s]; infinite where it is not known."""
        age = self.age
        return age if age is not None and 0.0 <= age < math.inf else math.inf

    def _gained(self, t: float) -> float:
        """Return how far a part can be from where its velocity leads after t [m]."""
        s = self.settings
        grown = math.hypot(1.0, self.turn * t) + self.stretch * t - 1.0
        wrong = s.noise + self.error * t + grown * self.thick
        return wrong + 0.5 * s.acceleration * t * t

    @property
    def _unknown(self) -> float:
        return max(self.settings.speed, self.unknown)

    @cached_property
    def _all(self) -> "Threat":
        return self if self.everywhere is None else self.everywhere()

    def likely(self, *times: float) -> np.ndarray | None:
        """Return (n, 3) where its points will be at some times from now [s].

        As their mean velocities bring them: where they are likely to be, not where
        they can be. None where no velocities are known, or not the age.
        """
        drift = self.velocity if self.drift is None else self.drift
        if drift is None or not self.is_dated:
            return None
        return np.concatenate([self.points + (self._age + t) * drift for t in times])

    @cached_property
    def fastest(self) -> float:
        """The highest speed of any of the points [m/s]."""
        if self.velocity is None:
            return self._unknown
        squares = np.einsum("ij,ij->i", self.velocity, self.velocity)
        most = math.sqrt(squares.max(initial=0.0))
        return max(most, self._unknown) if self.lost else most


class Watcher:
    """Follows a person's capsules from frame to frame.

    Args:
        settings: What a person is able to do.
        covering: Covering radius of the points on the capsules [m].
        robot_speed: No point of the robot is faster [m/s].
    """

    def __init__(
        self,
        settings: ThreatSettings | None = None,
        covering: float = 0.03,
        robot_speed: float = 2.0,
    ) -> None:
        """Nobody has been seen."""
        self.settings = s = settings or ThreatSettings()
        self.covering, self.robot_speed = covering, robot_speed
        self._limits = np.array(
            [
                s.noise,
                s.acceleration,
                s.max_plausible_acceleration,
                s.max_plausible_speed,
            ]
        )
        best = 2.0 * math.sqrt(s.noise / s.acceleration) if s.acceleration else _DRIFT
        self._window = min(best, 1.0) if s.noise else 0.0  # best for a velocity [s]
        self._past: deque[tuple[float, np.ndarray]] = deque()
        self._count = np.zeros(0, np.int64)  # frames each part was followed for
        self._rates = np.zeros((2, 0, 2, 3))  # velocity now, and drift [m/s]
        self._slack = np.zeros(0)  # bound on the errors of the first [m/s]
        self._fastest = (-math.inf, 0.0)  # when a part was fastest, and its speed [m/s]

    def look(
        self,
        capsules: np.ndarray,
        points: np.ndarray,
        centers: np.ndarray,
        now: float,
        age: float | None = 0.0,
        margin: float = 0.25,
    ) -> Threat:
        """Return the threat of a frame.

        Args:
            capsules: (k, 7) person: a, b, radius [m]; the same parts in every frame.
            points: (n, 3) samples of their surface [m].
            centers: (m, 3) centres of the robot's moving spheres [m].
            now: Time of the capsules [s].
            age: Age of the capsules [s].
            margin: Largest radius of those spheres and the distance they keep [m].
        """
        ends = capsules[:, :6].reshape(-1, 2, 3).copy()
        self._follow(ends, now)
        self._measure(now)
        sure = self._count >= _CONFIRMED
        rates = np.where(sure[:, None, None], self._rates, 0.0)
        unknown = self._lately(rates[0], sure, now)
        parts = _Parts(ends, np.ascontiguousarray(capsules[:, 6]), rates, sure)
        room = np.empty((len(points), 3))
        far = margin + self._reach(parts, age or 0.0, unknown)
        near = room[: near_points(points, centers, far, room)]

        def everywhere() -> Threat:
            return replace(self._threat(parts, slack, points, age), unknown=unknown)

        slack = self._slack
        threat = self._threat(parts, slack, near, age)
        return replace(threat, everywhere=everywhere, unknown=unknown)

    def _lately(self, rates: np.ndarray, sure: np.ndarray, now: float) -> float:
        """Return how fast a part that was lost may be by now, as any was lately [m/s].

        The fastest of the last fifth of a second counts, faster by now by what its
        velocity may be wrong and an acceleration can add.
        """
        fastest = math.sqrt(np.einsum("kei,kei->ke", rates, rates).max(initial=0.0))
        fastest += self._slack[sure].max(initial=0.0)
        before, speed = self._fastest
        passed = now - before
        if not 0.0 <= passed <= _DRIFT or fastest >= speed:
            self._fastest, passed, speed = (now, fastest), 0.0, fastest
        return speed + self.settings.acceleration * passed

    def _follow(self, ends: np.ndarray, now: float) -> None:
        """Take a frame: which parts are those of the frame before?"""
        past = self._past
        longest = max(_DRIFT, self._window) + 1e-9
        passed = now - past[-1][0] if past else math.nan
        same = bool(past) and past[-1][1].shape == ends.shape
        if same and 0.0 < passed <= longest:
            count = np.empty(len(ends), np.int64)
            before = Tracks(past[-1][1], self._rates[0], self._slack, self._count)
            follow(ends, before, passed, self._limits, count)
            self._count = count
        else:
            past.clear()
            self._count = np.ones(len(ends), np.int64)
        past.append((now, ends))
        while len(past) > 2 and now - past[0][0] > longest:
            past.popleft()

    def _measure(self, now: float) -> None:
        """Take the velocities of all parts: the best bounded ones, and the drift."""
        s, past = self.settings, self._past
        last = len(past) - 1
        n = len(past[-1][1])
        self._rates, self._slack = np.zeros((2, n, 2, 3)), np.full(n, math.inf)
        if not last:
            return
        ages = [now - t for t, _ in past]
        errors = [
            2.0 * s.noise / w + 0.5 * s.acceleration * w if w > 0.0 else math.inf
            for w in ages
        ]
        for count in np.unique(self._count).tolist():
            if count < 2:
                continue
            first = max(0, last + 1 - count)
            i = min(range(last, first - 1, -1), key=errors.__getitem__)
            these = self._count == count
            moved = past[-1][1][these] - past[i][1][these]
            self._rates[0, these] = moved / ages[i]
            self._slack[these] = errors[i]
            # seen for less: it rested before
            moved = past[-1][1][these] - past[first][1][these]
            self._rates[1, these] = moved / max(ages[first], _DRIFT)

    def _reach(self, parts: "_Parts", age: float, unknown: float) -> float:
        """Return how near a part can come in `horizon_s`, at most [m]."""
        s = self.settings
        t = s.horizon_s + age
        sure, rates = parts.sure, parts.rates
        known = np.sqrt(np.einsum("rkei,rkei->rke", rates, rates).max(initial=0.0))
        slack = self._slack[sure].max(initial=0.0)
        moved = (known + slack + 0.5 * s.acceleration * t) * t
        if not sure.all():
            moved = max(moved, max(s.speed, unknown) * t)
        turn, stretch = parts.turns()
        grown = math.hypot(1.0, turn.max(initial=0.0) * t) - 1.0
        grown += stretch.max(initial=0.0) * t
        thick = self.covering + parts.radii.max(initial=0.0)
        return s.noise + moved + grown * thick + self.robot_speed * t

    def _threat(
        self, parts: "_Parts", slack: np.ndarray, points: np.ndarray, age: float | None
    ) -> Threat:
        if not parts.sure.any():
            return Threat(points, None, age, self.settings)
        points = np.ascontiguousarray(points)
        moving = np.empty((2, len(points), 3))
        nearest = np.empty(len(points), np.int64)
        velocities(points, parts.ends, parts.radii, parts.rates, nearest, moving)
        here = np.zeros(len(parts.ends), np.bool_)
        here[nearest] = True
        known = here & parts.sure
        turn, stretch = parts.turns()
        return Threat(
            points,
            moving[0],
            age,
            self.settings,
            moving[1],
            error=float(slack[known].max(initial=0.0)),
            lost=bool((here & ~parts.sure).any()),
            turn=float(turn[known].max(initial=0.0)),
            stretch=float(stretch[known].max(initial=0.0)),
            thick=self.covering + float(parts.radii[here].max(initial=0.0)),
        )


class _Parts(NamedTuple):
    """The capsules of a frame."""

    ends: np.ndarray  # (k, 2, 3) [m]
    radii: np.ndarray  # (k,) [m]
    rates: np.ndarray  # (2, k, 2, 3) velocity and drift, 0 where not known [m/s]
    sure: np.ndarray  # (k,) whether they are known

    def turns(self) -> tuple[np.ndarray, np.ndarray]:
        """Return how fast each turns and grows, (k,) and (k,) [1/s]."""
        along = self.ends[:, 1] - self.ends[:, 0]
        apart = self.rates[0, :, 1] - self.rates[0, :, 0]
        square = np.einsum("ki,ki->k", along, along)
        long = square > 1e-12  # as in the kernel: a ball does not turn
        grows = np.einsum("ki,ki->k", along, apart) / np.where(long, square, 1.0)
        across = apart - grows[:, None] * along
        turns = np.einsum("ki,ki->k", across, across) / np.where(long, square, 1.0)
        return np.sqrt(np.where(long, turns, 0.0)), np.where(long, np.abs(grows), 0.0)
