"""The page beside `odm run`: what it hears of the loop, and the clock's pace."""

import sys
import time

import numpy as np

from sim.draw.surroundings import scene_of
from sim.loop.loop import Frame, Loop
from sim.loop.target_rows import TARGETS_EVERY, target_rows
from sim.view.dragged import DraggedPerson
from sim.view.gate import LOCAL, PORT
from sim.view.sources import place_targets
from sim.view.viewer import Viewer

_LATE_S = 0.1


class Pace:
    """Lets a run wait until the clock has come as far."""

    def __init__(self) -> None:
        self._begun: float | None = None

    def wait(self, due: float) -> None:
        """Wait until a time since the beginning [s]."""
        now = time.perf_counter()
        if self._begun is None or now - self._begun - due > _LATE_S:
            self._begun = now - due  # what was lost is not made up for
        time.sleep(max(0.0, self._begun + due - now))


class Watched:
    """A loop, not begun, that is watched; a context manager.

    Its person can be dragged where it goes between work places. Port, host and token as
    of `Viewer`.
    """

    def __init__(
        self,
        loop: Loop,
        cell_map: object,
        port: int | None = None,
        host: str | None = None,
        token: str | None = None,
    ) -> None:
        self._loop = loop
        self._live = getattr(loop, "live", None)  # of runs to hand-over targets
        drag = self._live is None and loop.motion is not None
        rate = loop.settings.rate_hz
        name = "nobody" if loop.motion is None else loop.motion.name
        label = f"{loop.robot.name} beside {name}"
        self.viewer = Viewer(
            cell_map,
            host=host or LOCAL,
            port=PORT if port is None else port,
            token=token,
            rate_hz=rate,
            label=label,
            drag=drag,
            standing=scene_of(loop.planner),
        )
        if drag:
            loop.motion = DraggedPerson(loop.motion, self.viewer.hand)
        self._targets: dict[object, np.ndarray] = {}
        self._pace = Pace()
        print(f"watch at {self.viewer.address}", file=sys.stderr, flush=True)

    def __enter__(self) -> "Watched":
        return self

    def __exit__(self, *_: object) -> None:
        self.viewer.close()

    def hear(self, frame: Frame) -> None:
        """Show a frame, and wait until the clock has come as far."""
        self.viewer.show(frame, targets=self._targets_of(frame))
        self._pace.wait(frame.index / self._loop.settings.rate_hz)

    def _targets_of(self, frame: Frame) -> np.ndarray:
        if self._live is None:
            if frame.place not in self._targets:
                places = place_targets(self._loop.robot, self._loop.places, frame.place)
                self._targets[frame.place] = places
            return self._targets[frame.place]
        if frame.index % TARGETS_EVERY == 0 or None not in self._targets:
            self._targets[None] = target_rows(self._live)
        return self._targets[None]
