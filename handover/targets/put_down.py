"""Where an object may be put down: places tried in turn, and what is below them."""

import numpy as np

from odm.obstacles.scenery import BOX, PLANE, Scenery
from roadmap.geometry.gaps import moved_rods

UNREACHED = "no grasp with which it is held reaches it"
BLOCKED = "no certified motion leads there"
BESET = "the person is in the way"
_BELOW = 0.02  # [m] a surface so far below an object's lowest point carries it
_LEVEL = 1e-3  # a surface whose normal is off the vertical by less is level


class Places:
    """The places where an object may be put down, tried in turn.

    Its own place comes first, then those that are farthest from the person; none of
    these in which the person is.

    Args:
        n: How many there are; the first is its own.

    Attributes:
        now: Which of them it is put down in; None: it waits.
    """

    def __init__(self, n: int) -> None:
        self.n, self.now = n, None
        self._left: dict[int, str] = {}  # since it waited last
        self._why: dict[int, str] = {}  # why each was left last

    def begin_next(self, gaps: np.ndarray, keep: float) -> int | None:
        """Go on to the best place that was not tried yet; None: there is none.

        `gaps` (n,) is how far the person is from the object in each [m]; who is nearer
        than `keep` is in it.
        """
        for k in np.flatnonzero(gaps <= keep).tolist():
            if k > 0 and k not in self._left:
                self._left[k] = self._why[k] = BESET
        open_ = [k for k in range(self.n) if k not in self._left]
        self.now = min(open_, key=lambda k: (k > 0, -gaps[k]), default=None)
        return self.now

    def leave(self, why: str) -> None:
        """Have found that the object cannot be put down there now."""
        self._left[self.now] = self._why[self.now] = why
        self.now = None

    def forget(self) -> None:
        """Try all of them again that are within reach."""
        self._left = {k: why for k, why in self._left.items() if why == UNREACHED}

    @property
    def unreached(self) -> bool:
        """Whether none of them is within reach."""
        return list(self._left.values()) == [UNREACHED] * self.n

    @property
    def beset(self) -> bool:
        """Whether the person was in the way to most of those within reach."""
        whys = [why for why in self._why.values() if why != UNREACHED]
        return 2 * whys.count(BESET) > len(whys)


def carries(
    scenery: Scenery, rods: np.ndarray, T_base_object: np.ndarray
) -> int | None:
    """Return which solid of the scenery an object stands on; None: none that is known.

    Args:
        scenery: What stands still around the robot.
        rods: (k, 7) the object's capsules, object frame [m].
        T_base_object: (4, 4) where it stands [m].

    Returns:
        The index of a half-space or a box whose level top is at most 2 cm below the
        object, and all below it.
    """
    rods = moved_rods(rods, T_base_object)
    ends = np.vstack([rods[:, :3], rods[:, 3:6]])
    radii = np.tile(rods[:, 6], 2)[:, None]
    low, high = (ends - radii).min(axis=0), (ends + radii).max(axis=0)
    for k, row in enumerate(scenery.solids):
        top = _top_of(row, low[:2], high[:2])
        if top is not None and -1e-9 <= low[2] - top <= _BELOW:
            return k
    return None


def _top_of(row: np.ndarray, low: np.ndarray, high: np.ndarray) -> float | None:
    """Return the height of a level top [m] that is below all of a rectangle (2,), (2,).

    None: the solid has none.
    """
    if row[0] == PLANE:
        return float(row[4]) if row[3] > 1.0 - _LEVEL else None
    if row[0] != BOX:
        return None
    R, half = row[4:13].reshape(3, 3), row[13:16]
    up = int(np.abs(R[2]).argmax())  # the axis of the box that points up
    if abs(R[2, up]) < 1.0 - _LEVEL:
        return None
    corners = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
    inside = np.abs((corners - row[1:3]) @ R[:2]) <= half
    if not np.delete(inside, up, axis=1).all():
        return None
    return float(row[3] + half[up])
