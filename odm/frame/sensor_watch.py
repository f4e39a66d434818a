"""Whether a frame's obstacle data can be used at all; if not, the robot holds.

Values are judged here, not shapes: NaN, age, order, and where the points are. Numbers
in a wrong unit look like an empty room, since all of them lie outside the grid. A
person who stands there does, too, so two things tell them apart (decision 0029):

* most points are farther away than anything in a robot's cell ever is, or
* all points are outside, though so short a time ago some were deeper inside than anyone
  gets out of the grid in that time. A person who has had that time may have left.
"""

import math
from typing import Protocol

import numpy as np

from odm.obstacles._cloud import N_BAD, N_INSIDE, N_OUTSIDE
from odm.obstacles.unit import not_finite, too_far_off
from roadmap.errors import BadInput
from roadmap.ranges import is_real, told

_LEAVES = 4.0  # [m/s] nobody gets out of the grid faster
_JITTER = 0.05  # [m] that measured points may jump


class Shown(Protocol):
    """A frame that tells numbers about its points, which are asked for seldom."""

    def beyond(self, limit: float) -> tuple[int, int]:
        """Return how many points there are, and are farther off than `limit` [m]."""

    def median_distance(self) -> float:
        """Return the median of the points' largest coordinates [m]."""

    def depth_kept(self) -> float:
        """Return how far the innermost of the points kept last is in the grid [m]."""

    def keep_points(self) -> None:
        """Keep this frame's points for `depth_kept` until others are kept."""


class SensorWatch:
    """Judges whether a frame's obstacle data can be used, by what came before.

    Args:
        max_age_s: Older obstacle data cannot be used [s].
        max_range_m: Where most points are farther off, their unit is wrong [m].

    Attributes:
        newest: (stamp, now) of the newest data [s]; None: no stamp was given yet.
        seen_inside: Stamp of the last such frame with points in the grid [s], which
            the frame has kept.
    """

    def __init__(self, max_age_s: float, max_range_m: float) -> None:
        self.max_age_s, self.max_range_m = max_age_s, max_range_m
        self.reset()

    def reset(self) -> None:
        """Forget all frames: a clock may have been set back."""
        self.newest: tuple[float, float | None] | None = None
        self.seen_inside: float | None = None

    def save(self) -> dict[str, np.ndarray]:
        """Return the newest stamp, and that of the last points inside the grid."""
        stamp, now = self.newest or (np.nan, np.nan)
        times = [stamp, now, self.seen_inside]
        return {"times": np.array([np.nan if t is None else t for t in times])}

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Remember what was saved."""
        stamp, now, seen = saved["times"].tolist()
        known = None if math.isnan(now) else now
        self.newest = None if math.isnan(stamp) else (stamp, known)
        self.seen_inside = None if math.isnan(seen) else seen

    def unfit(
        self, counts: np.ndarray, shown: Shown, stamp: float | None, now: float | None
    ) -> str | None:
        """Return why this frame's obstacle data cannot be used at all, or None.

        `counts` are of the cloud in which its points were just marked, `shown` tells
        more about them; both times as in `ReactivePlanner.step` [s], and checked.
        """
        bad = counts.item(N_BAD)
        if bad:
            return not_finite(bad)
        if stamp is not None or now is not None:
            before = self.newest
            # mostly it is like this; a NaN is not
            fine = stamp is not None and now is not None
            fine = fine and 0.0 <= now - stamp <= self.max_age_s
            if not fine or (before is not None and not stamp >= before[0]):
                text = self._untimely(stamp, now)
                if text is not None:
                    return text
            if stamp is not None:
                self.newest = (stamp, now)
        inside, outside = counts.item(N_INSIDE), counts.item(N_OUTSIDE)
        if outside > inside:
            text = self._misplaced(inside, shown, stamp)
            if text is not None:
                return text
        if inside and stamp is not None:
            self.seen_inside = stamp
            shown.keep_points()
        return None

    def _untimely(self, stamp: float | None, now: float | None) -> str | None:
        for name, value in (("stamp", stamp), ("now", now)):
            if value is not None and not math.isfinite(value):
                return (
                    f"the {name} of the obstacle data is {value}, so their age is not "
                    "known; check the clock"
                )
        if stamp is None:
            return None
        if now is not None:
            age, limit = now - stamp, self.max_age_s
            if not age <= limit:
                return (
                    f"the obstacle data are {1e3 * age:.0f} ms old, more than the "
                    f"{1e3 * limit:.0f} ms allowed; check the sensor or its clock"
                )
            if age < 0.0:
                return (
                    f"the obstacle data are stamped {-1e3 * age:.0f} ms in the future; "
                    "use one clock for stamp and now"
                )
        before = self.newest
        if before is not None and stamp < before[0]:
            known = now is not None and before[1] is not None
            if not known or now >= before[1]:
                return (
                    f"the obstacle data are {1e3 * (before[0] - stamp):.0f} ms older "
                    "than those of the frame before; drop frames that arrive out of "
                    "order, or call reset where a clock was set back"
                )
            self.seen_inside = None
        return None

    def _misplaced(self, inside: int, shown: Shown, stamp: float | None) -> str | None:
        """Return what is wrong with a frame that is mostly outside, or None."""
        limit = self.max_range_m
        n, n_beyond = shown.beyond(limit)
        text = too_far_off(n, n_beyond, limit, shown.median_distance)
        if text is not None:
            return text
        before = self.seen_inside
        if inside or stamp is None or before is None:
            return None
        passed, depth = stamp - before, shown.depth_kept()
        if depth <= _LEAVES * max(passed, 0.0) + _JITTER:
            self.seen_inside = None  # from now on they may be anywhere
            return None
        return (
            f"all {n} obstacle points lie outside the grid, though "
            f"{1e3 * passed:.0f} ms before some were {100 * depth:.0f} cm inside it, "
            "and nobody leaves that fast; check the unit and the frame of the points, "
            "and whether the sensor lost someone"
        )


def checked_times(
    stamp: float | None, now: float | None
) -> tuple[float | None, float | None]:
    """Return times as compiled loops take them: numbers of any type as floats.

    BadInput for what is no number. To numba a whole number is another type.
    """
    if stamp is now is None:
        return None, None  # as in most frames
    if not all(time is None or is_real(time) for time in (stamp, now)):
        raise BadInput(
            f"stamp is {told(stamp)} and now is {told(now)}; give seconds as numbers"
        )
    return None if stamp is None else float(stamp), None if now is None else float(now)
