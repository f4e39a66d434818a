"""The viewer's own process: `python -m sim.view.child`, started by `Viewer`."""

import os
import pickle
import socket
import sys
from os import _exit
from typing import TYPE_CHECKING

import numpy as np

from sim.view.mailbox import HAND, READY, Mailbox

if TYPE_CHECKING:
    from sim.view.page import Page


def main() -> None:
    """Read what to show from stdin, say that it is open, and draw until stdin ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the terminal is the loop's
    try:
        page = open_page(pickle.load(sys.stdin.buffer))
    except Exception as error:  # the loop's process tells the user
        os.write(1, f"{type(error).__name__}: {error}\n".encode())
        _exit(1)
    os.write(1, READY)
    os.nice(10)  # from here on the loop comes first
    parent = os.getppid()
    page.run(lambda: os.getppid() == parent and not _hung_up())
    _exit(0)  # viser's threads need not be waited for


def open_page(told: dict) -> "Page":
    """Return the page of what the loop's process told."""
    from roadmap.robot.robot import Robot
    from sim.view.page import Page, Show
    from sim.view.robot_shapes import robot_parts
    from sim.view.sources import Letters

    robot = Robot.from_store(*told["robot"])
    down, up = (Mailbox(fd, room) for fd, room in told["boxes"])
    packed = told["map"]

    def tell(place: np.ndarray | None) -> None:
        up.put(HAND.pack(place is not None, *(np.zeros(3) if place is None else place)))

    show = Show(
        Letters(down),
        robot,
        told["label"],
        told["sentences"],
        lambda: robot_parts(robot, told["source"], told["locked"]),
        None if packed is None else (lambda: pickle.loads(packed)),
        tell if told["drag"] else None,
        still=told["still"],
    )
    return Page(
        show, socket.socket(fileno=told["listener"]), told["host"], told["token"]
    )


def _hung_up() -> bool:
    """Return whether the loop's process closed our stdin."""
    import select

    ready, _, _ = select.select([0], [], [], 0)
    return bool(ready) and not os.read(0, 1)


if __name__ == "__main__":
    sys.exit(main())
