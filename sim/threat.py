"""Where a person can be within a time: speed and separation in space and time.

ISO/TS 15066 counts the person's speed *toward the robot*, 1.6 m/s walking and 2 m/s for
an arm where it is not measured (ISO 13855). Here it is measured: each capsule's ends
are followed from frame to frame. After a time t a part is where its velocity has
brought it, give or take what an acceleration can add: p + v t and a ball of a t^2 / 2.
A person who rests, passes by or moves away slows the robot less than one who comes.
"""

import math
from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from roadmap.ranges import check_settings
from sim._kernels.threat import near_points, velocities

_DRIFT = 0.2  # [s] a hand that trembles at 5 Hz or faster gets nowhere in this time


@dataclass(frozen=True)
class ThreatSettings:
    """What a person is able to do.

    Attributes:
        speed: A part whose speed is not known moves no faster than this [m/s].
        acceleration: What a part adds to its measured velocity at most [m/s2]. A reach
            of 0.4 m in 0.8 s along a minimum-jerk curve takes 3.6 m/s2; a thrust with
            a peak of 2 m/s over 0.45 m takes 15, at which a robot hardly moves beside
            a person.
        far: Points farther from the robot's bounding box than this are no threat [m].
    """

    speed: float = 2.0
    acceleration: float = 4.0
    far: float = 1.2

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            BadInput: One out of range.
        """
        ranges = {
            "speed": (0.0, 100.0, "m/s"),
            "acceleration": (0.0, 1e4, "m/s2"),
            "far": (0.0, np.inf, "m"),
        }
        check_settings(self, ranges)


@dataclass(frozen=True)
class Threat:
    """A person's points that are near enough to matter, and how they move.

    Attributes:
        points: (n, 3) points of the person's surface [m].
        velocity: (n, 3) velocity of each [m/s]; None where it is not known.
        age: Age of the data [s].
        settings: What a person is able to do.
        drift: (n, 3) mean velocity of each in the last fifth of a second [m/s]; None
            takes `velocity`.
    """

    points: np.ndarray
    velocity: np.ndarray | None
    age: float
    settings: ThreatSettings
    drift: np.ndarray | None = None

    def between(self, begin: float, end: float) -> tuple[np.ndarray, float]:
        """Return points (n, 3) and the radius [m] of balls that hold the person.

        The balls around the points hold every point of the person at all times from
        `begin` to `end` seconds from now, if it was covered by the points.
        """
        begin, end = begin + self.age, end + self.age
        if self.velocity is None:
            return self.points, self.settings.speed * end
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        gained = 0.5 * self.settings.acceleration * end * end
        return self.points + middle * self.velocity, gained + half * self.fastest

    def likely(self, *times: float) -> np.ndarray | None:
        """Return (n, 3) where its points will be at some times from now [s].

        As their mean velocities bring them: where they are likely to be, not where
        they can be. None where no velocities are known.
        """
        drift = self.velocity if self.drift is None else self.drift
        if drift is None:
            return None
        return np.concatenate([self.points + (self.age + t) * drift for t in times])

    @cached_property
    def fastest(self) -> float:
        """The highest speed of any of the points [m/s]."""
        if self.velocity is None:
            return self.settings.speed
        squares = np.einsum("ij,ij->i", self.velocity, self.velocity)
        return math.sqrt(squares.max(initial=0.0))


class Watcher:
    """Follows a person's capsules from frame to frame.

    Args:
        settings: What a person is able to do.
    """

    def __init__(self, settings: ThreatSettings | None = None) -> None:
        """Nobody has been seen."""
        self.settings = settings or ThreatSettings()
        self._ends: np.ndarray | None = None
        self._time = 0.0
        self._past: deque[tuple[float, np.ndarray]] = deque()

    def look(
        self,
        capsules: np.ndarray,
        points: np.ndarray,
        centers: np.ndarray,
        now: float,
        age: float = 0.0,
    ) -> Threat:
        """Return the threat of a frame.

        Args:
            capsules: (k, 7) person: a, b, radius [m]; the same parts in every frame.
            points: (n, 3) samples of their surface [m].
            centers: (m, 3) centres of the robot's moving spheres [m].
            now: Time of the capsules [s].
            age: Age of the capsules [s].
        """
        ends = capsules[:, :6].reshape(-1, 2, 3)
        before, passed = self._ends, now - self._time
        self._ends, self._time = ends.copy(), now
        room = np.empty((3, len(points), 3))
        near = room[0, : near_points(points, centers, self.settings.far, room[0])]
        velocity = drift = None
        if before is not None and before.shape == ends.shape and passed > 0.0:
            since, old = self._old(now)
            since = min(since, now - _DRIFT)  # seen for less: it rested before
            velocity, drift = room[1, : len(near)], room[2, : len(near)]
            radii = np.ascontiguousarray(capsules[:, 6])
            velocities(near, ends, before, passed, radii, velocity)
            velocities(near, ends, old, now - since, radii, drift)
        else:
            self._past.clear()
        self._past.append((now, self._ends))
        return Threat(near, velocity, age, self.settings, drift)

    def _old(self, now: float) -> tuple[float, np.ndarray]:
        """Return the time and the ends of the oldest frame that counts."""
        past = self._past
        while len(past) > 1 and now - past[0][0] > _DRIFT + 1e-9:
            past.popleft()
        return past[0]
