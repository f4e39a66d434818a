"""Keeps a loop at the wall clock: never faster, and after a delay never in a burst."""

import time
from collections.abc import Callable

NAP = 0.05  # longest sleep, so that a signal is soon heeded at low rates too [s]


class Pacer:
    """Lets each turn of a loop begin one period after the one before.

    A turn that takes longer than the period makes the next one late. The lost time
    is not made up for: the schedule slips, and the delay is counted.

    Args:
        period: From turn to turn [s].
        clock: Returns the time [s].
        sleep: Waits for some seconds.

    Attributes:
        late: Turns that began late.
        slipped_s: By how much the simulation is behind the clock [s].
    """

    def __init__(
        self,
        period: float,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Begin the first turn now."""
        self.period, self.late, self.slipped_s = period, 0, 0.0
        self._clock, self._sleep = clock, sleep
        self.restart()

    def restart(self) -> None:
        """Begin a turn now, after a pause that is no delay."""
        self._next = self._clock() + self.period

    def wait(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Sleep until the next turn is due, or until `stop()`."""
        now = self._clock()
        if now > self._next:
            self.late += 1
            self.slipped_s += now - self._next
            self._next = now
        while now < self._next and not stop():
            self._sleep(min(self._next - now, NAP))
            now = self._clock()
        self._next += self.period
