"""Parts of a person that a tracker shows no more: kept for a while, where they were.

Nobody is gone because a tracker lost them: most often the robot itself is in between.
A part that is missing is kept where it was seen last, and may have come as far as it
can by now: what `threat` says of radii that grow. Which parts are missing is found by
their names and places: each that is seen is taken for the nearest of its name that was
there, the others for the nearest of another name. As many as are fewer than before are
missing then.
"""

import math
from typing import NamedTuple

import numpy as np

from roadmap.errors import BadInput

_OTHER_NAME = 1e3  # [m] a part of the same name is nearer than any of another one


class AllParts(NamedTuple):
    """A person's parts, those that are not seen now included.

    Attributes:
        capsules: (n, 7) where each is seen, or was seen last [m].
        names: (n,) what each is.
        may_be: (n, 7) the same, those that are missing as wide as they may have come
            by now: for `Watcher.look` [m].
        missing: (n,) which are not seen; None: all are.
    """

    capsules: np.ndarray
    names: np.ndarray
    may_be: np.ndarray
    missing: np.ndarray | None


class MissingParts:
    """Keeps the parts of a person that are not seen any more.

    Args:
        kept_s: How long after it was seen last a part is kept [s]; 0: not at all.
        speed: How fast each may move meanwhile [m/s].

    Raises:
        BadInput: A time or a speed that is negative or not finite.
    """

    def __init__(self, kept_s: float = 2.0, speed: float = 2.0) -> None:
        if not (0.0 <= kept_s < math.inf and 0.0 <= speed < math.inf):
            raise BadInput(
                f"kept_s is {kept_s} and speed {speed}; give seconds and m/s, each 0 "
                "or more"
            )
        self.kept_s, self.speed = kept_s, speed
        self._capsules = np.zeros((0, 7))
        self._names = np.zeros(0, np.int64)
        self._seen_s = np.zeros(0)  # when each was seen last [s]

    def complete(self, capsules: np.ndarray, names: np.ndarray, now: float) -> AllParts:
        """Return all parts: those that are seen, and those that are missing.

        Parts that were there in the frame before keep their order. A frame that is not
        finite is told as it is, and not remembered: a planner holds at it.

        Args:
            capsules: (k, 7) the parts that are seen: two ends and a radius [m].
            names: (k,) what each is, a number, such as `handover.Part`.
            now: When they were seen [s]; a clock that was set back makes none older.

        Raises:
            BadInput: Not (k, 7) capsules, or not as many names.
        """
        if capsules.ndim != 2 or capsules.shape[1] != 7 or len(names) != len(capsules):
            raise BadInput(
                f"there are capsules of shape {capsules.shape} and {len(names)} names; "
                "give (k, 7) and a name for each, (0, 7) and none for nobody"
            )
        if not (math.isfinite(now) and np.isfinite(capsules).all()):
            return AllParts(capsules, names, capsules, None)
        if np.array_equal(names, self._names):  # all that were there, in their order
            self._keep(capsules, self._names, now)
            return AllParts(capsules, names, capsules, None)
        before = np.minimum(self._seen_s, now)
        fresh = now - before < self.kept_s
        rows, known, since = self._capsules[fresh], self._names[fresh], before[fresh]
        of, new = _matched(rows, known, capsules, names)
        lost = np.flatnonzero(of < 0)[: max(0, len(rows) - len(names))]
        of[lost] = len(names) + np.arange(len(lost))  # behind those that are seen
        order = np.concatenate((of[of >= 0], new))
        seen_s = np.concatenate((np.full(len(names), now), since[lost]))[order]
        everything = np.concatenate((capsules, rows[lost]))[order]
        names = np.concatenate((names, known[lost]))[order]
        self._keep(everything, names, seen_s)
        if not len(lost):
            return AllParts(everything, names, everything, None)
        may_be = np.array(everything)
        may_be[:, 6] += self.speed * (now - seen_s)
        return AllParts(everything, names, may_be, order >= len(capsules))

    def _keep(
        self, capsules: np.ndarray, names: np.ndarray, since: np.ndarray | float
    ) -> None:
        self._capsules, self._names = np.array(capsules), np.array(names)
        self._seen_s = np.full(len(names), since)


def _matched(
    before: np.ndarray, known: np.ndarray, now: np.ndarray, names: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which part of now each of before is, -1: none, and which are new."""
    of = np.full(len(before), -1)
    gap = np.linalg.norm(_middles(before)[:, None] - _middles(now)[None], axis=2)
    gap += np.where(known[:, None] == names[None], 0.0, _OTHER_NAME)
    for _ in range(min(gap.shape)):
        i, j = np.unravel_index(gap.argmin(), gap.shape)
        of[i], gap[i], gap[:, j] = j, np.inf, np.inf
    return of, np.setdiff1d(np.arange(len(now)), of)


def _middles(rods: np.ndarray) -> np.ndarray:
    """Return the middles (k, 3) of capsules (k, 7) [m]."""
    return 0.5 * (rods[:, :3] + rods[:, 3:6])
