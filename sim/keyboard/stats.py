"""Figures of a run so far, in memory that does not grow with it."""

import math

import numpy as np

from sim.loop.loop import Frame

_FIRST, _STEP, _BINS = 1e-7, math.log(1.02), 1024  # 0.1 us to a minute, 2 % each


class Histogram:
    """Percentiles of times so far, exact to 2 %."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)

    def add(self, seconds: float) -> None:
        """Count one time [s]."""
        at = int(math.log(max(seconds, _FIRST) / _FIRST) / _STEP)
        self._counts[min(at, _BINS - 1)] += 1

    def percentile(self, share: float) -> float | None:
        """Return the time that `share` in (0, 1] of all stay below [s]."""
        counts = self._counts.cumsum()
        if not counts[-1]:
            return None
        at = int(np.searchsorted(counts, share * counts[-1]))
        return _FIRST * math.exp((at + 0.5) * _STEP)


class Stats:
    """What the screen shows of all frames so far.

    Args:
        rate_hz: Frames per second of the simulation.

    Attributes:
        frames, trips, new_paths: Counts; a first path to a new place is no new one.
        latency: Of the planner's step, by the wall clock.
        smallest: Smallest separation [m], inf if nobody was there.
        last: The last frame, None before the first.
        hold_reason: Why it holds or held last; None if it never did.
        hold_start, hold_end: Frames of that hold; the end is None while it lasts.
    """

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz, self.frames, self.trips, self.new_paths = rate_hz, 0, 0, 0
        self.latency, self.smallest = Histogram(), math.inf
        self.last: Frame | None = None
        self.hold_reason: str | None = None
        self.hold_start = self.hold_end = self._replanned = -1

    def take(self, frame: Frame) -> None:
        """Count one frame; the reason of a hold is asked for in its first only."""
        before, self.last = self.last, frame
        self.frames += 1
        self.latency.add(frame.wall_s)
        self.smallest = min(self.smallest, frame.separation)
        arrived = before is not None and before.place != frame.place
        self.trips += arrived
        status = frame.answer.status
        if status == "replanned" and before is not None and not arrived:
            self.new_paths += 1
            self._replanned = self.frames
        self._hold(status == "holding", frame)

    @property
    def held(self) -> float | None:
        """How long it holds already [s], None if it does not."""
        if self.last is None or self.hold_end is not None:
            return None
        return (self.frames + 1 - self.hold_start) / self.rate_hz

    @property
    def last_hold(self) -> tuple[float, float] | None:
        """How long ago the last hold ended and how long it was [s]; None: none."""
        if self.hold_reason is None or self.hold_end is None:
            return None
        ago, long = self.frames + 1 - self.hold_end, self.hold_end - self.hold_start
        return ago / self.rate_hz, long / self.rate_hz

    @property
    def replanned(self) -> bool:
        """Whether a new path was taken in the last half second: one frame is unseen."""
        return 0 <= self.frames - self._replanned < 0.5 * self.rate_hz

    def explain(self) -> None:
        """Ask the last frame again: the reason of a long hold may have changed."""
        if self.held is not None and self.last.answer.reason:
            self.hold_reason = self.last.answer.reason

    def _hold(self, holding: bool, frame: Frame) -> None:
        was = self.hold_end is None
        if holding and not was:
            self.hold_start, self.hold_end = self.frames, None
            self.hold_reason = frame.answer.reason or "no reason was given"
        elif was and not holding:
            self.hold_end = self.frames
