"""Signs of life: bars in a terminal, plain lines where stderr is a file or pipe.

From the first second of a command on: imports, compiling and every stage of its work
are told with how far they are and about how long they will still take.
"""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from sim.terminal.compiling import Compiling

NARROW = 72  # columns of a terminal in which there is room for the words alone
FIRST_S, EVERY_S = 1.0, 2.0  # [s] the first plain line, and from one to the next
_TICK_S = 0.25
_ASKED = "roadmap.compiling.kernel_cache"  # what `Compiling` imports


class Pulse:
    """Says what a command does, from a thread of its own, until it is stopped."""

    def __init__(self, command: str) -> None:
        self.compiling = Compiling(command)
        self.bars: Bars | None = None
        self.doing = "starting: loading the planner"
        self._over = threading.Event()
        self._told = time.monotonic() - EVERY_S + FIRST_S
        self._last, self._since = "", 0.0
        self._thread = threading.Thread(target=self._beat, daemon=True, name="Pulse")
        self._terminal = _is_terminal()

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Say no more; waits for a line that is being written."""
        self._over.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _beat(self) -> None:
        looked, found = 0.0, None
        while not self._over.wait(_TICK_S):
            try:
                now = time.monotonic()
                # two threads that both import a package may wait for each other
                if now - looked > 4 * _TICK_S and _ASKED in sys.modules:
                    looked, found = now, self.compiling.progress()
                if self._terminal:
                    self._tell_terminal(found, now)
                elif now - self._told >= EVERY_S:
                    self._told = now
                    self._write(self._line(found))
            except Exception:  # a sign of life is worth no failure
                return

    def _tell_terminal(self, found: tuple | None, now: float) -> None:
        if self.bars is not None:
            self.bars.compile(found)
        elif now - self._told >= EVERY_S and not self._last:
            self._write(self._line(found))  # once: bars take over

    def _line(self, found: tuple | None) -> str:
        doing = self.bars.line() if self.bars is not None else self.doing
        if found is not None:
            done, total, left_s = found
            doing += (
                f"; compiling, once: {done} of {total} loops, about "
                f"{time_text(left_s)} left"
            )
        return doing

    def _write(self, text: str) -> None:
        now = time.monotonic()
        if text != self._last:
            self._last, self._since = text, now
        elif not self._terminal:
            text += f" ({time_text(now - self._since)})"  # still at it
        if not self._over.is_set():
            print(text, file=sys.stderr, flush=True)


_pulse: Pulse | None = None


@contextmanager
def pulse(command: str) -> Iterator[Pulse]:
    """Give signs of life while a command runs; one within another gives none."""
    global _pulse
    if _pulse is not None:
        yield _pulse
        return
    _pulse = Pulse(command)
    _pulse.start()
    try:
        yield _pulse
    finally:
        _pulse.stop()
        _pulse = None


def now_compiling(command: str) -> None:
    """Tell from here on how far the loops of this entry of the table are."""
    if _pulse is not None:
        _pulse.compiling = Compiling(command)


def silence() -> None:
    """Say no more in this command: its screen is somebody else's."""
    if _pulse is not None:
        _pulse.stop()


def _is_terminal() -> bool:
    try:
        return sys.stderr.isatty()
    except ValueError:  # it is closed
        return False


class Bars:
    """Progress bars on stderr, one for each stage; use it as `with Bars() as tell:`.

    In a file or pipe the `Pulse` of the command writes lines of the same instead.

    Args:
        waiting: Said until the first stage begins.
    """

    def __init__(self, waiting: str = "preparing") -> None:
        self._waiting, self._stage = waiting, (waiting, 0, 0)
        self._begun = self._since = time.monotonic()
        self._tasks: dict = {}
        self._bars = self._first = self._compile = None
        if _is_terminal():
            self._bars = _rich_bars()

    def __enter__(self) -> "Bars":
        if _pulse is not None:
            _pulse.bars = self
        if self._bars is not None:
            self._bars.start()
            self._first = self._bars.add_task(self._waiting, total=None)
        return self

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage is; what every `progress=` argument wants.

        A stage of which less is done than before has begun again.
        """
        self._since = time.monotonic()
        again = stage == self._stage[0] and done < self._stage[1]
        if again or stage != self._stage[0]:
            self._begun = self._since
        self._stage = stage, done, total
        if self._bars is None:
            return
        if self._first is not None:
            self._bars.remove_task(self._first)
            self._first = None
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=total)
        elif again:
            self._bars.reset(self._tasks[stage])
        self._bars.update(self._tasks[stage], completed=done, total=total)

    def compile(self, found: tuple[int, int, float] | None) -> None:
        """Show how much is compiled: (loops done, of how many, seconds left)."""
        if self._bars is None or (found is None and self._compile is None):
            return
        if found is None:
            self._bars.remove_task(self._compile)
            self._compile = None
            return
        done, total, left_s = found
        if self._compile is None:
            self._compile = self._bars.add_task("compiling", total=total)
        self._bars.update(self._compile, completed=done, total=total, left_s=left_s)

    def line(self) -> str:
        """Return how far the present stage is, as one line."""
        stage, done, total = self._stage
        if total <= 1:
            return stage
        text = f"{stage}: {done:,} of {total:,}"
        passed = self._since - self._begun  # when so much was done, not now
        if 0 < done < total and passed > 1.0:
            left = passed * (total - done) / done - (time.monotonic() - self._since)
            text += f", about {time_text(left)} left" if left > 0.0 else ""
        return text

    def __exit__(self, *_: object) -> None:
        if _pulse is not None:
            _pulse.doing, _pulse.bars = self._stage[0], None
        if self._bars is None:
            return
        for task in (self._first, self._compile):
            if task is not None:
                self._bars.remove_task(task)
        self._bars.stop()


def _rich_bars() -> object:
    from rich import progress
    from rich.console import Console
    from rich.table import Column
    from rich.text import Text

    console = Console(stderr=True)
    narrow = console.width < NARROW

    class Times(progress.ProgressColumn):
        """How long a stage took, and about how long it will still take."""

        def render(self, task: progress.Task) -> Text:
            """Return both as words."""
            left = task.fields.get("left_s", task.time_remaining)
            passed = task.finished_time if task.finished else task.elapsed
            left = None if task.finished else left
            if narrow and left is not None:
                return Text(f"{time_text(left)} left")
            return Text(times_text(passed, left))

    bar = [] if narrow else [progress.BarColumn(bar_width=20)]
    words = "{task.description}:" if narrow else "{task.description:<22}"
    # where there is no room for all, the words take two lines, not the numbers
    stage = progress.TextColumn(words, table_column=Column(no_wrap=not narrow))
    count = progress.MofNCompleteColumn(table_column=Column(no_wrap=True))
    times = Times(Column(no_wrap=True))
    return progress.Progress(stage, *bar, count, times, console=console)


def times_text(passed: float | None, left: float | None) -> str:
    """Return how long a stage took so far and will still take, each by its word.

    Args:
        passed: Since it began [s]; None: it did not.
        left: About so long is left [s]; None: nobody knows, or it is over.
    """
    if passed is None:
        return ""
    if left is None:
        return time_text(passed)
    return f"{time_text(passed)}, about {time_text(left)} left"


def time_text(seconds: float) -> str:
    """Return a time for people: 45 s, or 2 min 10 s."""
    seconds = max(1, round(seconds))
    if seconds < 90:
        return f"{seconds} s"
    return f"{seconds // 60} min {seconds % 60:02d} s"
