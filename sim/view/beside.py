"""Beside a map without a run: an arm that is dragged through it."""

import time

import numpy as np

from odm.cell_map.cell_map import CellMap
from sim.loop.loop import exact_audit
from sim.people.human_motion import HumanMotion
from sim.view.dragged import DraggedPerson
from sim.view.moment import CONTACT, STILL, Moment
from sim.view.sources import Source


class _Asleep:
    """A motion of which only the beginning is shown."""

    def __init__(self, motion: HumanMotion) -> None:
        self._motion = motion

    def __getattr__(self, name: str) -> object:
        return getattr(self._motion, name)

    def capsules(self, t: float) -> np.ndarray:
        return self._motion.capsules(0.0)


class ArmBeside(Source):
    """The robot at a node of its roadmap, and an arm: one moment that changes."""

    lacks = frozenset({"points", "targets", "path", "before"})

    def __init__(self, cell_map: CellMap, motion: HumanMotion) -> None:
        robot, nodes = cell_map.robot, cell_map.roadmap.nodes
        middle = 0.5 * (robot.lower + robot.upper)
        self._q = nodes[int(np.linalg.norm(nodes - middle, axis=1).argmin())]
        self._place: np.ndarray | None = None
        self._person = DraggedPerson(_Asleep(motion), lambda: self._place)
        self._audit = exact_audit(robot)
        self._audited: tuple[object, float] = (None, np.inf)
        self._begun = time.perf_counter()

    def take(self, place: np.ndarray | None) -> None:
        """Drag the hand to a place (3,) [m], or let it go."""
        self._place = place

    def at(self, time_s: float) -> Moment:
        """Return what stands there now."""
        now = time.perf_counter() - self._begun
        capsules = self._person.capsules(now)
        if capsules is not self._audited[0]:
            self._audited = capsules, self._audit(self._q, capsules)
        gap = self._audited[1]
        return Moment(
            0.0, self._q, capsules, CONTACT if gap <= 0 else STILL, separation=gap
        )
