"""Parts of a person that a tracker shows no more: kept for a while, where they were.

Nobody is gone because a tracker lost them: most often the robot itself is in between.
A part that is missing is kept where it was seen last, and may have come as far as it
can by now: what `threat` says of radii that grow.

Which parts are missing follows from names and places. A part that is seen can be one
that was there if that can have come so far since; the nearest of its name is taken, or
else the nearest of any name, since trackers exchange names. Parts that were there and
are none of those that are seen now are missing: they were lost, or have jumped.
"""

import math
import sys
from typing import NamedTuple

import numpy as np

from roadmap.arrays import as_floats, shown
from roadmap.errors import BadInput
from roadmap.ranges import check_number, check_seconds

_JUMP = 0.1  # [m] a part that comes farther at once than it can has jumped
_OTHER_NAME = 1e3  # [m] a part of the same name is nearer than any of another one


class AllParts(NamedTuple):
    """A person's parts, those that are not seen now included.

    Attributes:
        capsules: (n, 7) where each is seen, or was seen last [m].
        names: (n,) what each is.
        may_be: (n, 7) the same, those that are missing as wide as they may have come
            by now: for `Watcher.look` [m].
        missing: (n,) which are not seen; None: all are.
        seen_s: (n,) when each was seen last [s].
    """

    capsules: np.ndarray
    names: np.ndarray
    may_be: np.ndarray
    missing: np.ndarray | None
    seen_s: np.ndarray


class MissingParts:
    """Keeps the parts of a person that are not seen any more.

    Args:
        kept_s: How long after it was seen last a part is kept [s]; 0: not at all.
        speed: How fast each may move meanwhile [m/s].
        noise: Bound on the error of a measured place [m]. A part that comes farther
            than that speed, twice the noise and 10 cm lead has jumped.
        most: So many may be missing at once: a tracker whose parts jump in every frame
            is none.

    Raises:
        BadInput: A time, a speed or a noise that is negative or not finite, or a number
            of parts that is no whole one.
    """

    def __init__(
        self,
        kept_s: float = 2.0,
        speed: float = 2.0,
        noise: float = 0.0,
        most: int = 200,
    ) -> None:
        self.kept_s = check_number("kept_s [s]", kept_s, 0.0, 1e9)
        self.speed = check_number("speed [m/s]", speed, 0.0, 1e3)
        self.most = check_number("most", most, 0, sys.maxsize, whole=True)
        self._jump = _JUMP + 2.0 * check_number("noise [m]", noise, 0.0, 1e3)
        nobody, none = np.zeros((0, 7)), np.zeros(0)
        self._parts = AllParts(nobody, none, nobody, None, none)

    def complete(self, capsules: np.ndarray, names: np.ndarray, now: float) -> AllParts:
        """Return all parts: those that are seen, and those that are missing.

        Parts that were there in the frame before keep their order. A frame that is not
        finite is told as it is, and not remembered: a planner holds at it. So it does
        where more than `most` are missing, of which NaN is told.

        Args:
            capsules: (k, 7) the parts that are seen: two ends and a radius [m].
            names: (k,) what each is: whole numbers, such as `handover.Part`, or words.
            now: When they were seen [s]; a clock that was set back makes none older.

        Raises:
            BadInput: Not (k, 7) capsules, not as many names, or a `now` that is none.
        """
        parts = self.find(capsules, names, now)
        self.keep(parts)
        return parts

    def find(self, capsules: np.ndarray, names: np.ndarray, now: float) -> AllParts:
        """Return what `complete` does, and remember nothing yet: see `keep`."""
        capsules, names = as_floats("the person's capsules", capsules), _names_of(names)
        if capsules.shape != (len(names), 7):
            raise BadInput(
                f"there are capsules of shape {capsules.shape} and {len(names)} names; "
                "give (k, 7) and a name for each, (0, 7) and none for nobody"
            )
        now = check_seconds("now", now)
        seen_s = np.full(len(names), now)
        as_seen = AllParts(capsules, names, capsules, None, seen_s)
        last, ends = self._parts, capsules[:, :6]
        if not (math.isfinite(now) and np.isfinite(capsules).all()):
            return as_seen
        before = np.minimum(last.seen_s, now)
        far = self.speed * (now - before) + self._jump  # that each can have come
        if last.missing is None and np.array_equal(names, last.names):
            moved = _middles(ends - last.capsules[:, :6])
            if (np.einsum("ij,ij->i", moved, moved) <= far * far).all():
                return as_seen  # all that were there, in their order
        fresh = now - before < self.kept_s
        rows, known, since = last.capsules[fresh], last.names[fresh], before[fresh]
        of, new = _matched(rows, known, far[fresh], capsules, names)
        lost = np.flatnonzero(of < 0)
        of[lost] = len(names) + np.arange(len(lost))  # behind those that are seen
        order = np.concatenate((of, new))
        if not len(lost):
            capsules, names = capsules[order], names[order]
            return AllParts(capsules, names, capsules, None, seen_s)
        seen_s = np.concatenate((seen_s, since[lost]))[order]
        everything = np.concatenate((capsules, rows[lost]))[order]
        names = np.concatenate((names, known[lost]))[order]
        if len(lost) > self.most:
            everything[:] = np.nan
        may_be = np.array(everything)
        may_be[:, 6] += self.speed * (now - seen_s)
        return AllParts(everything, names, may_be, order >= len(capsules), seen_s)

    def keep(self, parts: AllParts) -> None:
        """Remember what `find` told of a frame."""
        told = np.isfinite(parts.capsules).all() and np.isfinite(parts.seen_s).all()
        if told:  # copies: a loop may write its arrays anew
            capsules, names = np.array(parts.capsules), np.array(parts.names)
            self._parts = parts._replace(capsules=capsules, names=names)


def _names_of(names: object) -> np.ndarray:
    """Return what parts are called as an array (k,), of numbers or of words."""
    try:
        found = np.asarray(names)
    except ValueError:
        found = np.zeros((0, 0))  # ragged
    sound = found.dtype.kind in "biufU" or found.size == 0
    if found.ndim != 1 or not sound:
        raise BadInput(
            f"names are {shown(names)}; give a list with a whole number or a word for "
            "each capsule"
        )
    return found


def _matched(
    before: np.ndarray,
    known: np.ndarray,
    far: np.ndarray,
    now: np.ndarray,
    names: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return which part of now each of before is, -1: none, and which are new.

    None is farther than `far` (n,) [m] from where it was.
    """
    of = np.full(len(before), -1)
    gap = np.linalg.norm(_middles(before)[:, None] - _middles(now)[None], axis=2)
    gap[gap > far[:, None]] = np.inf
    alike = known.dtype.kind == names.dtype.kind and known[:, None] == names[None]
    gap += np.where(alike, 0.0, _OTHER_NAME)
    while gap.size:
        i, j = np.unravel_index(gap.argmin(), gap.shape)
        if not gap[i, j] < np.inf:
            break
        of[i], gap[i], gap[:, j] = j, np.inf, np.inf
    return of, np.setdiff1d(np.arange(len(now)), of)


def _middles(rods: np.ndarray) -> np.ndarray:
    """Return the middles (k, 3) of capsules (k, 7), or of how far their ends move."""
    return 0.5 * (rods[:, :3] + rods[:, 3:6])
