"""The page beside `odm run`: what it hears of the loop, and the clock's pace."""

import sys
import time
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.planner.planner import ReactivePlanner
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


class LivePage(AbstractContextManager):
    """The page beside a run, with all that stands around it; a context manager.

    `where` are port, host and token as of `Viewer`, None: as by default. `options` are
    further ones of `Viewer`.
    """

    def __init__(
        self, cell_map: CellMap, planner: ReactivePlanner, where: tuple, **options: Any
    ) -> None:
        port, host, token = where
        self.viewer = Viewer(
            cell_map,
            host=host or LOCAL,
            port=PORT if port is None else port,
            token=token,
            standing=scene_of(planner),
            **options,
        )
        self._pace = Pace()
        print(f"watch at {self.viewer.address}", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        self.viewer.close()


class Watched(LivePage):
    """A loop, not begun, that is watched.

    Its person can be dragged where it goes between work places.
    """

    def __init__(self, loop: Loop, cell_map: CellMap, *where: object) -> None:
        self._loop = loop
        self._live = getattr(loop, "live", None)  # of runs to hand-over targets
        drag = self._live is None and loop.motion is not None
        beside = "nobody" if loop.motion is None else f"motion {loop.motion.name}"
        label = f"{loop.robot.name}, {beside}"
        shown = {"rate_hz": loop.settings.rate_hz, "label": label, "drag": drag}
        super().__init__(cell_map, loop.planner, where, **shown)
        if drag:
            loop.motion = DraggedPerson(loop.motion, self.viewer.hand)
        self._targets: dict[object, np.ndarray] = {}

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
