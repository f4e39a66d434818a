"""Ctrl-C ends a command: soon, with exit code 130, and nothing is left behind.

So do SIGTERM, which `timeout`, `kill` and service managers send, with code 143, and
SIGHUP, which a terminal that is closed sends, with code 129. They are heard as Ctrl-C
is, and called so below.

Python turns Ctrl-C into one KeyboardInterrupt, raised between two instructions of the
main thread. That alone does not end a program: an import, a `__del__` or a callback
from C swallows it, machine code runs for seconds before it is raised, and a pool waits
for its threads. So the signal is heard twice:

1. The handler raises KeyboardInterrupt once, and everything is left as it should be. It
   does not raise a second time, which would cut short the tidying up, unless Python
   is about to print that a `__del__`, a callback or an extension swallowed the first.
2. A thread wakes with the signal, whatever the main thread does. If the process is
   still there after `GRACE` seconds, or at a second signal, it ends the processes that
   work for it, removes what is unfinished and ends it.

A few functions must not be cut in two, `_WHOLE`: both wait for them, they take
milliseconds. While a loop is compiled, `_COMPILERS`, it is not raised either, but when
that is done. A command that makes use of what it has so far asks for `patience`; what
a library that is being imported swallows would last as long, so there that is done
first, too.

A program that was started with a signal ignored (nohup) keeps ignoring it; processes
that it starts hear signals as Python does. Before `listen` is called, in the first
hundredths of a second, Ctrl-C is Python's own. Nothing heavy is imported here, for the
same reason.
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
# the exit code by each signal, and whose it is where we may take it
_CODES = {signal.SIGINT: EXIT_CODE, signal.SIGTERM: 143, signal.SIGHUP: 129}
_PLAIN = dict.fromkeys(_CODES, signal.SIG_DFL) | {
    signal.SIGINT: signal.default_int_handler
}
SENTENCE = "odm: interrupted; nothing half-written was left behind"
GRACE = 1.0  # [s] for tidying up; with it the end comes within 2 s on a busy machine
_AGAIN = 0.02  # [s] between two tries where it could not be raised
_SECOND = 0.3  # [s] a signal that comes later than this is a second wish of the user

# (end of the file's name, function) that is never cut in two
_WHOLE = (
    ("numba/core/caching.py", "save"),  # index and machine code belong together
    ("<frozen importlib._bootstrap_external>", "_write_atomic"),
    ("roadmap/builds/unfinished.py", "put"),  # the old map goes, the new one comes
)
# where it is not raised: between a call that hands memory over and the line that notes
# its new owner, both would free it, and the process would crash; and what numba has
# begun to note of a loop stays half noted
_COMPILERS = ("/llvmlite/", "/numba/core/")
_IMPORTS = ("<frozen importlib._bootstrap>",)


class _Listener:
    """Hears Ctrl-C in this process, as some of `_CODES`; see the module."""

    def __init__(self, numbers: list[int]) -> None:
        self.noted = self.raising = self.quiet = False
        self.code = EXIT_CODE
        self.grace = GRACE
        self._raised = False
        # of each signal: taken by others, and what `_watch` left to them
        self.taken = dict.fromkeys(numbers, 0)
        self._passed_over = dict.fromkeys(numbers, 0)
        self._ending = threading.Lock()
        self._heard, written = os.pipe()
        os.set_blocking(written, False)
        for number in numbers:
            signal.signal(number, self._note)
        signal.set_wakeup_fd(written, warn_on_full_buffer=False)
        self._unraisable, sys.unraisablehook = sys.unraisablehook, self._ignored
        self._printed, sys.excepthook = sys.excepthook, self._told
        threading.Thread(target=self._watch, daemon=True, name="Ctrl-C").start()

    def _note(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt in the main thread, once."""
        if not self.noted:
            self.noted, self.code = True, _CODES[number]
            if self.quiet and number == signal.SIGINT:
                self.code = 0
        if not (self._raised or self._is_held_back(frame)):
            self._raised = True
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
            self._raised = False
        return swallowed

    def _watch(self) -> None:
        """End the process some time after the signal, unless it has ended by then."""
        main = threading.main_thread().ident
        number = None
        while number is None:
            number = self._meant(os.read(self._heard, 64))
        begun, sent = time.monotonic(), 0
        os.set_blocking(self._heard, False)
        while (passed := time.monotonic() - begun) < self.grace:
            time.sleep(_AGAIN)
            if not (self._raised or self._is_held_back(_current_frames().get(main))):
                sent += 1
                signal.pthread_kill(main, number)
            with suppress(BlockingIOError):
                sent -= len(os.read(self._heard, 64))
            if sent < 0 and passed > _SECOND:  # not one of ours
                break
            sent = max(sent, 0)
        self.end()

    def _meant(self, heard: bytes) -> int | None:
        """Return the signal in `heard` that nobody else has taken, or takes, if any.

        This thread may wake only when the other one has given Ctrl-C back.
        """
        for number, taken in self.taken.items():
            n = heard.count(number)
            if n and self._is_ours(number) and taken <= self._passed_over[number]:
                return number
            self._passed_over[number] += n
        return None

    def _is_ours(self, number: int) -> bool:
        """Return whether no one else, as the keyboard's screen, takes a signal now."""
        return signal.getsignal(number) == self._note

    def _is_held_back(self, frame: FrameType | None) -> bool:
        """Return whether a stack is where nothing is raised now."""
        slow = _COMPILERS if self.grace <= GRACE else _COMPILERS + _IMPORTS
        return _is_whole(frame) or any(
            place in code.co_filename for code in _codes(frame) for place in slow
        )

    def end(self) -> None:
        """End the process now; does not return."""
        if not self._ending.acquire(blocking=False):
            while True:  # another thread is at it
                time.sleep(1.0)
        with suppress(Exception):
            if threading.current_thread() is threading.main_thread():
                sys.stdout.flush()
        _end_processes()
        _remove_unfinished()
        told = "" if self.quiet else SENTENCE + "\n"
        shown = "\r\x1b[K\x1b[?25h" if os.isatty(2) else ""  # rich hides the cursor
        with suppress(OSError):
            os.write(2, f"{shown}{told}".encode())
        for _ in range(50):
            if not any(map(_is_whole, _current_frames().values())):
                break
            time.sleep(0.005)
        _remove_unfinished()  # what another thread has made meanwhile
        _exit(self.code)


_listener: _Listener | None = None


def listen() -> None:
    """Hear Ctrl-C from now on; the first thing a command does, in its main thread.

    Until `interruptible` is entered nothing was begun, so that Ctrl-C ends the process
    at once. Where a signal is ignored, or somebody else's, it is left so.
    """
    global _listener
    if _listener is None:
        numbers = [n for n, mine in _PLAIN.items() if signal.getsignal(n) is mine]
        if numbers:
            _listener = _Listener(numbers)


def taken(number: int) -> None:
    """Say that another handler, as the keyboard's screen, took a signal; in it."""
    if _listener is not None and number in _listener.taken:
        _listener.taken[number] += 1


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


def exit_code() -> int:
    """Return the code of a command that was interrupted: 130, or that of the signal."""
    return EXIT_CODE if _listener is None else _listener.code


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


def ends_by_it() -> None:
    """Say that Ctrl-C is how the rest is meant to end: without a word, code 0."""
    if _listener is not None:
        _listener.quiet = True


def _end_processes() -> None:
    """End the processes that work for this one; a loop takes them seconds."""
    with suppress(Exception):
        if ours := sys.modules.get("odm.processes"):
            ours.end_all()
        elif others := sys.modules.get("multiprocessing"):
            for child in others.active_children():
                child.kill()


def _remove_unfinished() -> None:
    with suppress(Exception):
        if files := sys.modules.get("roadmap.builds.unfinished"):
            files.remove_all()


def _is_whole(frame: FrameType | None) -> bool:
    """Return whether a stack is inside a function that must not be cut in two."""
    return any(
        code.co_name == name and code.co_filename.endswith(file)
        for code in _codes(frame)
        for file, name in _WHOLE
    )


def _codes(frame: FrameType | None) -> Iterator[CodeType]:
    while frame is not None:
        yield frame.f_code
        frame = frame.f_back
