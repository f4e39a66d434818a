"""A round of hand movements, timed so that no point of the arm is too fast."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from roadmap.arrays import freeze, frozen
from roadmap.ranges import check_number
from sim.people.arm import HumanArm, facing_robot

SHOULDER = (0.85, 0.15, 0.50)  # p_base_shoulder of a right arm reaching to the robot
NEAR, FAR = 0.20, 0.93  # share of the arm's reach a hand keeps in front, and within
TREMBLE_HZ = 5.0
_HANGING = np.array([-0.25, -0.55, -0.80])  # where a right elbow hangs
MARGIN = 0.98  # share of the speed limit that is used: the fastest moment is sampled


@dataclass(frozen=True)
class Person:
    """Whose arm moves, where its shoulder is, and how fast it may get."""

    arm: HumanArm  # sizes of the arm
    # place of the right shoulder in the robot's base frame [m]
    p_base_shoulder: tuple[float, float, float] = SHOULDER
    # speed limit of the surface [m/s]; None takes the motion's own
    max_speed: float | None = None

    def capsules(self, p_shoulder_hand: np.ndarray) -> np.ndarray:
        """Return the (2, 7) capsules of the arm with its hand at a (3,) place [m]."""
        angles = _angles_to(self.arm, p_shoulder_hand)
        return self.arm.capsules(_facing_robot(tuple(self.p_base_shoulder)), angles)


@dataclass(frozen=True, eq=False)
class Leg:
    """The hand's path from one place to the next, then a rest."""

    # (3,) ends, and bulge of the path at its middle [m], all in the shoulder frame
    start: np.ndarray
    stop: np.ndarray
    bow: np.ndarray
    # time to move and time to stay [s]
    duration: float
    rest: float

    def at(self, t: float) -> np.ndarray:
        """Return the (3,) place of the hand `t` seconds after the start [m]."""
        s = minimum_jerk(min(t / self.duration, 1.0))
        return self.start + s * (self.stop - self.start) + 4 * s * (1 - s) * self.bow


@dataclass(frozen=True, eq=False)
class ScriptedMotion:
    """A closed round of legs without end; a `sim.people.human_motion.HumanMotion`."""

    name: str  # name of the motion
    max_speed: float  # no point of the surface advances faster than this [m/s]
    person: Person  # whose arm it is
    legs: tuple[Leg, ...]  # the round
    # (3,) amplitude of a 5 Hz sine laid over it [m], shoulder frame
    tremble: np.ndarray

    def __post_init__(self) -> None:
        times = [leg.duration + leg.rest for leg in self.legs]
        freeze(self, tremble=float)
        object.__setattr__(self, "_ends", frozen(np.cumsum(times), np.float64))

    @property
    def period(self) -> float:
        """Time after which the motion repeats [s]."""
        return float(self._ends[-1])

    def capsules(self, t: float) -> np.ndarray:
        """Return the arm at time `t` [s] as (2, 7) capsules a, b, radius [m]."""
        t = check_number("the time of a motion [s]", t, -1e12, 1e12) % self.period
        k = min(int(np.searchsorted(self._ends, t, side="right")), len(self.legs) - 1)
        hand = self.legs[k].at(t - (self._ends[k - 1] if k else 0.0))
        wave = np.sin(2 * np.pi * TREMBLE_HZ * t)
        return self.person.capsules(hand + wave * self.tremble)


class Round:
    """Collects the legs of a motion; places are given in the robot's base frame.

    Args:
        person: Whose arm it is.
        home: (x, y, z) place of the hand at the start and at the end [m].
        speed: Limit for elbow and hand [m/s].

    Attributes:
        home: (3,) place of the hand at the start, shoulder frame [m].
        legs: The legs so far.
    """

    def __init__(self, person: Person, home: tuple, speed: float) -> None:
        self.person, self.speed = person, speed
        self.home = self._hand = self._reachable(home)
        self.legs: list[Leg] = []

    def move(
        self, place: tuple, rest: float, share: float = 1.0, bow: tuple = (0, 0, 0)
    ) -> None:
        """Add a leg to `place` at `share` of the limit, then `rest` seconds.

        A place out of reach is pulled to the nearest one that is not; `bow` (base
        frame) shrinks until the whole path is within reach.
        """
        bow = np.array(bow, float) * [-1, -1, 1]
        self._add(self._reachable(place), bow, rest, share)

    def close(self, rest: float, share: float = 1.0) -> None:
        """Add the leg back home; the rest is stretched to whole trembles.

        Where all places are too far from the robot they are one, and the hand stays.
        """
        self._add(self.home, np.zeros(3), rest, share)
        if not self.legs:
            self.legs.append(Leg(self.home, self.home, np.zeros(3), 1.0, rest))
        period = sum(leg.duration + leg.rest for leg in self.legs)
        last = self.legs[-1]
        missing = -period % (1 / TREMBLE_HZ)
        self.legs[-1] = replace(last, rest=last.rest + missing)

    def motion(
        self, name: str, limit: float, tremble: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> ScriptedMotion:
        """Return the legs so far as a motion; see ScriptedMotion."""
        legs = tuple(self.legs)
        return ScriptedMotion(name, limit, self.person, legs, np.array(tremble))

    def _reachable(self, p_base_hand: tuple) -> np.ndarray:
        """Return the place in the shoulder frame, in front of and near the shoulder.

        The places allowed are a convex set, so that every straight path is, too.
        """
        p = (np.array(p_base_hand, float) - self.person.p_base_shoulder) * [-1, -1, 1]
        near, far = NEAR * self.person.arm.reach, FAR * self.person.arm.reach
        p[0] = min(max(p[0], near), far)
        side = np.linalg.norm(p[1:])
        p[1:] *= min(1.0, np.sqrt(far**2 - p[0] ** 2) / max(side, 1e-9))
        return p

    def _add(self, stop: np.ndarray, bow: np.ndarray, rest: float, share: float):
        start, self._hand = self._hand, stop
        if np.linalg.norm(stop - start) < 1e-6:
            return
        while np.any(bow) and not self._within_reach(Leg(start, stop, bow, 1.0, 0.0)):
            bow = 0.7 * bow if np.linalg.norm(bow) > 0.01 else np.zeros(3)
        fastest = self._fastest(Leg(start, stop, bow, 1.0, 0.0))
        duration = fastest / (MARGIN * share * self.speed)
        self.legs.append(Leg(start, stop, bow, duration, rest))

    def _within_reach(self, leg: Leg) -> bool:
        hands = np.array([leg.at(t) for t in np.linspace(0, 1, 33)])
        reach = self.person.arm.reach
        far = np.linalg.norm(hands, axis=1).max()
        return bool(hands[:, 0].min() > 0.99 * NEAR * reach and far < FAR * reach)

    def _fastest(self, leg: Leg) -> float:
        """Return the largest speed of elbow and hand if the leg takes one second."""
        arm = tuple(map(tuple, (self.person.arm.lengths, self.person.arm.radii)))
        path = tuple(map(tuple, (leg.start, leg.stop, leg.bow)))
        return _fastest(arm, tuple(self.person.p_base_shoulder), path)


@lru_cache(maxsize=4096)  # the same person is made again for each run
def _fastest(arm: tuple, p_base_shoulder: tuple, path: tuple) -> float:
    person = Person(HumanArm(*map(np.array, arm)), p_base_shoulder)
    leg = Leg(*map(np.array, path), 1.0, 0.0)
    times = np.linspace(0.0, 1.0, 161)
    ends = np.array([person.capsules(leg.at(t))[:, 3:6] for t in times])
    return float(np.linalg.norm(np.diff(ends, axis=0), axis=2).max() * 160)


@lru_cache(maxsize=64)
def _facing_robot(p_base_shoulder: tuple[float, float, float]) -> np.ndarray:
    return frozen(facing_robot(np.array(p_base_shoulder)), np.float64)


def minimum_jerk(u: float) -> float:
    """Return the minimum-jerk curve from (0, 0) to (1, 1) at `u` in [0, 1]."""
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def _angles_to(arm: HumanArm, hand: np.ndarray) -> np.ndarray:
    """Return the (4,) angles that bring the hand there, elbow down and outward."""
    # plain floats, in numpy's order, are ten times as quick as arrays of three
    upper, full = arm.lengths.tolist()
    fore = full - arm.radii[1].item()
    distance = math.sqrt(hand.dot(hand))
    u = hand / distance
    along = _HANGING.dot(u).item()
    n = _HANGING - along * u
    size = math.sqrt(n.dot(n))
    c = (upper**2 + distance**2 - fore**2) / (2 * upper * distance)
    c = min(max(c, -1.0), 1.0)
    s = math.sqrt(1 - c * c)
    # along the upper arm, and along the forearm
    a = [c * i + s * (j / size) for i, j in zip(u.tolist(), n.tolist(), strict=True)]
    f = [(i - upper * j) / fore for i, j in zip(hand.tolist(), a, strict=True)]
    sa, ca = a[1], np.hypot(a[0], a[2]).item()
    sf, cf = a[0] / ca, -a[2] / ca
    # the forearm seen from the raised, not yet rotated upper arm
    x, z = cf * f[0] + sf * f[2], cf * f[2] - sf * f[0]
    y, z = ca * f[1] + sa * z, ca * z - sa * f[1]
    turns = (sf, cf), (sa, ca), (y, x), (np.hypot(x, y).item(), -z)
    return np.array([math.atan2(*turn) for turn in turns])
