"""A planner belongs to one thread at a time, and cannot be copied.

A planner's compiled loops write to arrays that a table of addresses names. Two threads
would write to the same arrays; a copy would keep the addresses of the original's.
"""

from threading import get_ident, main_thread
from typing import NoReturn

from roadmap.errors import BadInput


class Owner:
    """The thread that may ask a planner: at first the one that made it.

    Attributes:
        thread: Its number, as `threading.get_ident` tells it.
    """

    __slots__ = ("thread",)

    def __init__(self) -> None:
        """Belong to this thread."""
        self.thread = get_ident()

    def check(self) -> None:
        """Refuse to serve another thread."""
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
        self.thread = get_ident()


def refuse_copy() -> NoReturn:
    """Refuse to copy or pickle a planner, and say what to do instead."""
    raise BadInput(
        "a planner cannot be copied or pickled, since its memory is known by its "
        "addresses; make another planner on the same map: ReactivePlanner(cell_map), "
        "then set_goals (a map that was loaded pickles by its folder)"
    )
