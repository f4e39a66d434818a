"""Between frames: look for straight motions that shorten the path in use."""

from typing import TYPE_CHECKING

import numpy as np

from odm.answer import HOLDING
from odm.search import _paths as ways
from odm.search._state import NO_WAY

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

_WORTH = 0.02  # a cut must save this share of what it replaces


class Polisher:
    """Tests cuts from vertex to vertex of the way in use.

    The way itself is left alone, since the robot is on it; what is found is remembered
    with its cells, and the next search shortens its path by it.
    """

    def __init__(self, planner: "ReactivePlanner") -> None:
        """Keep the planner."""
        self.planner = planner

    def run(self, budget: int) -> tuple[int, int]:
        """Test at most `budget` cuts; return how many were found, and the rest."""
        planner = self.planner
        way, numbers = planner.memory.way, planner.memory.numbers
        if planner.last is None or planner.last.status == HOLDING or way.count[0] < 3:
            return 0, budget
        planner._sort()
        found = 0
        standing = planner.attacher.is_fresh(planner._q)
        first = int(numbers.segment[0]) + (0 if standing else 1)
        last = int(way.count[0]) - 1
        for gap in range(last - first, 1, -1):
            for i in range(first, last - gap + 1):
                if budget <= 0:
                    break
                tested, cut = self._try(i, i + gap, standing and i == first)
                budget -= tested
                found += cut
        if found:
            numbers.look[0] = 1
        return found, budget

    def _try(self, i: int, j: int, from_start: bool) -> tuple[int, int]:
        """Test the cut from vertex i to j once; returns (tests, cuts)."""
        planner = self.planner
        m = planner.memory
        way = m.way
        q_a = np.ascontiguousarray(planner._q if from_start else way.q[i])
        a = int(m.goals.count[1] if from_start else way.vertex[i])
        b = int(way.vertex[j])
        known = ways.find_shortcut(m.short, a, b)
        if known == NO_WAY or known >= 0 or not self._shorter(q_a, i, j):
            return 0, 0
        dq = planner._difference(q_a, way.q[j])
        if not planner.close_test.clear(q_a, dq, m.cloud):
            return 1, 0
        item = -1
        if planner.static.motion_free(q_a, dq):
            item = planner.attacher.sweep(q_a[None], dq[None])
        ways.add_shortcut(m.short, a, b, item if item >= 0 else NO_WAY)
        return 1, int(item >= 0)

    def _shorter(self, q_a: np.ndarray, i: int, j: int) -> bool:
        planner = self.planner
        way, weights = planner.memory.way, planner.cell_map.roadmap.weights
        legs = np.diff(np.concatenate([q_a[None], way.q[i + 1 : j + 1]]), axis=0)
        now = np.linalg.norm(legs * weights, axis=1).sum()
        cut = np.linalg.norm(planner._difference(q_a, way.q[j]) * weights)
        return bool(cut < (1.0 - _WORTH) * now)
