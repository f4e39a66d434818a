"""Signals as requests that a loop answers between two turns."""

import signal
from types import FrameType

from sim.terminal import interrupt

# what ended the run, and the exit code that tells the shell
ENDINGS = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129}


class Signals:
    """Notes signals while it is entered; use it as `with Signals() as signals:`.

    Attributes:
        ended: Name of the signal that asked to end, or None. The same wish a second
            time is not waited for: it raises KeyboardInterrupt.
        suspended: Whether Ctrl-Z asked to stop for now.
    """

    def __init__(self) -> None:
        self.ended: str | None = None
        self.suspended = False
        self._before: dict = {}

    def __enter__(self) -> "Signals":
        for name in ENDINGS:
            self._take(name, self._end)
        self._take("SIGTSTP", self._suspend)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def suspend(self) -> None:
        """Stop the process as Ctrl-Z does; returns when it is continued."""
        self.suspended = False
        handler = signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        signal.raise_signal(signal.SIGTSTP)
        signal.signal(signal.SIGTSTP, handler)

    def _take(self, name: str, handler: object) -> None:
        number = signal.Signals[name]
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
            self._before[number] = signal.signal(number, handler)

    def _end(self, number: int, frame: FrameType | None) -> None:
        interrupt.taken(number)
        if self.ended is not None:
            raise KeyboardInterrupt
        self.ended = signal.Signals(number).name

    def _suspend(self, number: int, frame: FrameType | None) -> None:
        self.suspended = True
