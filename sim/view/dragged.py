"""A person whose hand somebody drags: a human motion like any other."""

from collections.abc import Callable
from functools import partial

import numpy as np

from roadmap.geometry.gaps import moved_rods
from roadmap.transforms import pose_of
from sim.people.arm_path import Person, Round
from sim.people.human_motion import HumanMotion

SPEED = 1.0  # no point of the dragged person is faster [m/s]
TICK = 0.005  # the hand is moved on in steps of so long [s]
_THERE = 1e-4  # [m]


class DraggedPerson:
    """A motion that stops where its hand is taken, follows it, and goes on later.

    Taken, the person's own time stands still and the hand follows the place that it is
    dragged to; let go, it returns to where it was taken, and the motion goes on. No
    point is ever faster than `max_speed`. A scripted arm bends to follow, from its
    shoulder; other people are moved as a whole.

    Args:
        motion: The motion.
        hand: Returns where the hand is dragged to, (3,) in the base frame [m], or None.
    """

    def __init__(
        self, motion: HumanMotion, hand: Callable[[], np.ndarray | None]
    ) -> None:
        self.motion, self._hand = motion, hand
        self._now = self._lag = 0.0  # of the run, and of the motion behind it [s]
        self._offset = np.zeros(3)
        self._last = motion.capsules(0.0)

    def __getattr__(self, name: str) -> object:
        """Everything else is the motion's; where it has none, there is none."""
        found = getattr(self.motion, name)
        if name == "guess" and found is not None:
            return partial(self._guess, found)
        return found

    @property
    def max_speed(self) -> float:
        """No point of the surface has advanced faster than this [m/s]."""
        speed = self.motion.max_speed
        return max(speed, SPEED) if self._lag > 0 else speed

    def capsules(self, t: float) -> np.ndarray:
        """Return the person at time `t` [s] as (k, 7) capsules a, b, radius [m].

        Nobody who was never touched differs from the motion by a byte. Times are asked
        for in ascending order; one that is past is the present.
        """
        while self._now < t - 1e-9:
            goal = self._hand()
            if goal is None and not self._offset.any():
                self._now = t
                break
            step = min(TICK, t - self._now)
            self._now += step
            self._lag += step
            self._turn(goal, step)
        if not self._offset.any():
            self._last = self.motion.capsules(self._now - self._lag)
        return self._last

    def _guess(self, guess: Callable, t: float) -> np.ndarray:
        """Return where the person is, of motions that tell it apart."""
        return moved_rods(guess(self._now - self._lag), pose_of(self._offset))

    def _turn(self, goal: np.ndarray | None, seconds: float) -> None:
        base = self.motion.capsules(self._now - self._lag)
        wanted = np.zeros(3) if goal is None else goal - base[-1, 3:6]
        left = wanted - self._offset
        far = float(np.linalg.norm(left))
        share = 1.0 if far < _THERE else min(1.0, SPEED * seconds / far)
        for _ in range(12):  # a bent arm's elbow may be faster than its hand
            offset = self._offset + share * left
            if share == 1.0:
                offset = wanted
            rows = self._moved(base, offset)
            if _advance(self._last, rows) <= SPEED * seconds * (1 + 1e-9):
                self._offset, self._last = offset, rows
                return
            share *= 0.5

    def _moved(self, base: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return the person with the hand at an offset (3,) from its place [m]."""
        if not offset.any():
            return base
        person = getattr(self.motion, "person", None)
        if isinstance(person, Person) and len(base) == 2:
            hand = Round(person, tuple(base[-1, 3:6] + offset), 1.0).home
            return person.capsules(hand)
        return moved_rods(base, pose_of(offset))


def _advance(before: np.ndarray, after: np.ndarray) -> float:
    """Return how far the ends of the axes moved at most [m]."""
    ends = (after - before)[:, :6].reshape(-1, 3)
    return float(np.linalg.norm(ends, axis=1).max(initial=0.0))
