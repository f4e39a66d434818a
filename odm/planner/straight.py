"""The straight way to the goal, for a robot that just found another one on its way."""

from typing import TYPE_CHECKING

import numpy as np

from odm.search import _paths as ways
from odm.search import _step as step
from odm.search._state import NO_ITEM

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

_WAIT = 8  # steps from a look that found it blocked to the next
_WORTH = 1.1  # times the straight length: a rest shorter than that stays


class Straightener:
    """Goes straight where that is free.

    From an attached start the search itself tries the straight motion, by its cells.
    On the way there are none for it: the close test decides.

    Args:
        planner: The planner whose way is changed.
    """

    def __init__(self, planner: "ReactivePlanner") -> None:
        """No look has found anything."""
        self.planner = planner
        self._next = 0  # step of the next look

    def reset(self) -> None:
        """Look again in the next frame: there are other goals, or another start."""
        self._next = 0

    def run(self) -> None:
        """Take the straight way for one that was just found, where it is free."""
        planner = self.planner
        m, way = planner.memory, planner.memory.way
        at = int(m.numbers.segment[0])
        last = int(way.count[0]) - 1
        now = int(m.numbers.step[0])
        if now < self._next or planner.attacher.is_fresh(planner._q):
            return
        q = planner._q.copy()
        dq = planner._difference(q, way.q[last])
        if step.rest_length(m.table, way, at, q) < _WORTH * self._length(dq):
            return
        free = planner.close_test.clear(q, dq, planner.calm_cloud())
        if not (free and planner.static.motion_free(q, dq)):
            self._next = now + _WAIT
            return
        way.vertex[:2] = m.goals.count[2], way.vertex[last]
        way.q[0], way.q[1] = q, q + dq
        way.ref[0] = NO_ITEM
        way.count[0] = 2
        ways.certify_whole(way, 0, m.proof)
        m.numbers.segment[0] = m.numbers.same[0] = 0

    def _length(self, dq: np.ndarray) -> float:
        return float(np.linalg.norm(dq * self.planner.cell_map.roadmap.weights))
