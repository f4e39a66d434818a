"""Ctrl-C ends a command: soon, with exit code 130, and nothing is left behind.

Python turns Ctrl-C into one KeyboardInterrupt, raised between two instructions of the
main thread. That alone does not end a program: an import, a `__del__` or a callback
from C swallows it, machine code runs for seconds before it is raised, and a pool waits
for its threads. So the signal is heard twice:

1. The handler raises KeyboardInterrupt once, and everything is left as it should be. It
   does not raise a second time, which would cut short the tidying up, unless Python
   is about to print that a `__del__`, a callback or an extension swallowed the first.
2. A thread wakes with the signal, whatever the main thread does. If the process is
   still there after `GRACE` seconds, it removes what is unfinished and ends it.

A few functions must not be cut in two, `_WHOLE`: both wait for them, they take
milliseconds. In llvmlite, `_OWNING`, it is not raised either. A command that makes use
of what it has so far asks for `patience`.

A program that was started with SIGINT ignored (nohup) keeps ignoring it. Before
`listen` is called, in the first hundredths of a second, Ctrl-C is Python's own. Nothing
heavy is imported here, for the same reason.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import _exit
from sys import _current_frames
from types import CodeType, FrameType

EXIT_CODE = 130
SENTENCE = "odm: interrupted; nothing half-written was left behind"
GRACE = 1.0  # [s] for tidying up; with it the end comes within 2 s on a busy machine
_AGAIN = 0.02  # [s] between two tries where it could not be raised
_SECOND = 0.3  # [s] a signal that comes later than this is a second wish of the user

# (end of the file's name, function) that is never cut in two
_WHOLE = (
    ("numba/core/caching.py", "save"),  # index and machine code belong together
    ("<frozen importlib._bootstrap_external>", "_write_atomic"),
    ("roadmap/unfinished.py", "put"),  # the old map goes, the new one comes
)
# where it is not raised: between a call that hands memory over and the line that notes
# its new owner, both would free it, and the process would crash
_OWNING = "/llvmlite/binding/"


class _Listener:
    """Hears Ctrl-C in this process; see the module."""

    def __init__(self) -> None:
        self.noted = self.raising = False
        self.grace = GRACE
        self._raised_at: float | None = None
        self._hurry = False
        self.taken = self._passed_over = 0  # by others; what `_watch` left to them
        self._ending = threading.Lock()
        self._heard, written = os.pipe()
        os.set_blocking(written, False)
        signal.signal(signal.SIGINT, self._note)
        signal.set_wakeup_fd(written, warn_on_full_buffer=False)
        self._unraisable, sys.unraisablehook = sys.unraisablehook, self._ignored
        self._printed, sys.excepthook = sys.excepthook, self._told
        threading.Thread(target=self._watch, daemon=True, name="Ctrl-C").start()

    def _note(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt in the main thread, once."""
        self.noted = True
        if self._raised_at is not None:
            self._hurry |= time.monotonic() - self._raised_at > _SECOND
        elif not _is_whole(frame) and not _is_owning(frame):
            self._raised_at = time.monotonic()
            if not self.raising:  # nothing was begun, or all is done
                self.end()
            raise KeyboardInterrupt

    def _ignored(self, what: object) -> None:
        """Stand for `sys.unraisablehook`: what a `__del__` or a callback swallowed."""
        if not self._is_swallowed(what.exc_type):
            self._unraisable(what)

    def _told(self, kind: type, error: BaseException, trace: object) -> None:
        """Stand for `sys.excepthook`: extensions print what they swallow."""
        if not self._is_swallowed(kind):
            self._printed(kind, error, trace)

    def _is_swallowed(self, kind: type) -> bool:
        """Have Ctrl-C raised once more where nobody saw it; `_watch` does."""
        swallowed = kind is KeyboardInterrupt and self.noted
        if swallowed:
            self._raised_at = None
        return swallowed

    def _watch(self) -> None:
        """End the process some time after the signal, unless it has ended by then."""
        main = threading.main_thread().ident
        while not self._is_meant(os.read(self._heard, 64)):
            pass
        begun = time.monotonic()
        while time.monotonic() - begun < self.grace and not self._hurry:
            time.sleep(_AGAIN)
            if self._raised_at is None:
                signal.pthread_kill(main, signal.SIGINT)
        self.end()

    def _is_meant(self, heard: bytes) -> bool:
        """Return whether signals hold a Ctrl-C that nobody else has taken, or takes.

        This thread may wake only when the other one has given Ctrl-C back.
        """
        n = heard.count(signal.SIGINT)
        if n and self._is_ours() and self.taken <= self._passed_over:
            return True
        self._passed_over += n
        return False

    def _is_ours(self) -> bool:
        """Return whether no one else, as the keyboard's screen, takes Ctrl-C now."""
        return signal.getsignal(signal.SIGINT) == self._note

    def end(self) -> None:
        """End the process now; does not return."""
        if not self._ending.acquire(blocking=False):
            while True:  # another thread is at it
                time.sleep(1.0)
        with suppress(Exception):
            if threading.current_thread() is threading.main_thread():
                sys.stdout.flush()
        _remove_unfinished()
        shown = "\r\x1b[K\x1b[?25h" if os.isatty(2) else ""  # rich hides the cursor
        with suppress(OSError):
            os.write(2, f"{shown}{SENTENCE}\n".encode())
        for _ in range(50):
            if not any(map(_is_whole, _current_frames().values())):
                break
            time.sleep(0.005)
        _remove_unfinished()  # what another thread has made meanwhile
        _exit(EXIT_CODE)


_listener: _Listener | None = None


def listen() -> None:
    """Hear Ctrl-C from now on; the first thing a command does, in its main thread.

    Until `interruptible` is entered nothing was begun, so that Ctrl-C ends the process
    at once. Where SIGINT is ignored, or somebody else's, it is left so.
    """
    global _listener
    plain = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if _listener is None and plain:
        _listener = _Listener()


def taken() -> None:
    """Say that another handler, as the keyboard's screen, took a Ctrl-C; in it."""
    if _listener is not None:
        _listener.taken += 1


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt in here, and end the process behind it."""
    listen()
    here = _listener
    if here is None:
        yield
        return
    here.raising = True
    try:
        yield
    finally:
        here.raising = False
        if here.noted:
            here.end()


def noted() -> bool:
    """Return whether Ctrl-C was pressed, even if a library swallowed the exception."""
    return _listener is not None and _listener.noted


@contextmanager
def patience(seconds: float) -> Iterator[None]:
    """Give what is done in here so long after Ctrl-C to make use of what it has.

    A second Ctrl-C does not wait for it.
    """
    here = _listener
    if here is None:
        yield
        return
    before, here.grace = here.grace, seconds
    try:
        yield
    finally:
        here.grace = before


def _remove_unfinished() -> None:
    with suppress(Exception):
        if files := sys.modules.get("roadmap.unfinished"):
            files.remove_all()


def _is_whole(frame: FrameType | None) -> bool:
    """Return whether a stack is inside a function that must not be cut in two."""
    return any(
        code.co_name == name and code.co_filename.endswith(file)
        for code in _codes(frame)
        for file, name in _WHOLE
    )


def _is_owning(frame: FrameType | None) -> bool:
    """Return whether a stack is inside llvmlite, see `_OWNING`."""
    return any(_OWNING in code.co_filename for code in _codes(frame))


def _codes(frame: FrameType | None) -> Iterator[CodeType]:
    while frame is not None:
        yield frame.f_code
        frame = frame.f_back
