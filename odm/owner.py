"""A planner belongs to one thread, is never copied, and never used half changed.

A planner's compiled loops write to arrays that a table of addresses names. Two threads
would write to the same arrays; a copy would keep the addresses of the original's. What
Ctrl-C cuts in two, such as `set_base`, leaves two truths in it: nobody may ask it then.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import get_ident, main_thread
from typing import NoReturn

from roadmap.errors import BadInput


class Owner:
    """The thread that may ask a planner: at first the one that made it.

    Attributes:
        thread: Its number, as `threading.get_ident` tells it; None: a change was cut
            short, and nobody may.
        cut: The call that was cut short, or None.
    """

    __slots__ = ("cut", "thread")

    def __init__(self) -> None:
        self.thread: int | None = get_ident()
        self.cut: str | None = None

    def check(self) -> None:
        """Refuse to serve another thread, or anybody after a change was cut short."""
        if self.cut is not None:
            raise BadInput(
                f"{self.cut} of this planner was cut short, so what it knows may not "
                "fit together; make another one: ReactivePlanner(cell_map)"
            )
        if get_ident() != self.thread:
            main = " (the main thread)" if self.thread == main_thread().ident else ""
            raise BadInput(
                f"the planner belongs to thread {self.thread}{main}, but thread "
                f"{get_ident()} asks it; ask there, make a planner of this thread's "
                "own by ReactivePlanner(cell_map), or call planner.take_over() here "
                "while no call of it runs"
            )

    def take_over(self) -> None:
        """Belong to this thread from now on."""
        if self.cut is None:
            self.thread = get_ident()

    @contextmanager
    def changing(self, call: str) -> Iterator[None]:
        """Serve nobody any more where Ctrl-C ends this; checks the thread first."""
        self.check()
        try:
            yield
        except (KeyboardInterrupt, SystemExit, MemoryError):
            self.cut, self.thread = call, None
            raise


def refuse_copy() -> NoReturn:
    """Refuse to copy or pickle a planner, and say what to do instead."""
    raise BadInput(
        "a planner cannot be copied or pickled, since its memory is known by its "
        "addresses; make another planner on the same map: ReactivePlanner(cell_map), "
        "then set_goals (a map that was loaded pickles by its folder)"
    )
