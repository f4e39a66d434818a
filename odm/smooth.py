"""Between frames: shorten the time along the path in use, by cutting and pulling.

A roadmap leads over its nodes, which lie where chance put them. A straight motion from
one point of the path to another may replace what lies between (Geraerts and Overmars
2007, shortcut), or a corner is pulled towards the straight line past it. What is gained
is counted in time: of the legs at the joints' speed, and of the corners, in which the
joints must change their speeds. New legs keep their cells with them, so that later
frames judge them as they judge an edge.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from odm._kernels import close, ways
from odm._kernels.types import N_SEGMENT
from odm.answer import HOLDING

if TYPE_CHECKING:
    from odm.planner import ReactivePlanner

_WORTH = 0.01  # a change must save this share of the whole rest
_PACE = 0.5  # share of the joints' speed limits that is likely used
_LEAD_S = 0.05  # what the robot reaches in this time at full speed stays [s]
_DRAWS = 12  # changes looked at for each one that is tested
# Roberts' R2 sequence in the plane: pairs of places, evenly spread and the same always
_R2 = np.array([0.7548776662466927, 0.5698402909980532])


class Change(NamedTuple):
    """New legs for a part of the way.

    Attributes:
        i, j: Segments on which the new legs begin and end.
        from_vertex, to_vertex: Whether that is at the beginning of the segment.
        corners: (k, dof) of the new legs, both ends with them.
    """

    i: int
    j: int
    from_vertex: bool
    to_vertex: bool
    corners: np.ndarray


class Smoother:
    """Tests changes of the way in use, in a fixed order.

    Args:
        planner: The planner whose way is changed.
    """

    def __init__(self, planner: "ReactivePlanner") -> None:
        """Begin the order of the changes."""
        self.planner = planner
        robot = planner.robot
        self._speed = _PACE * robot.max_velocity
        self._acceleration = robot.max_acceleration
        self.reset()

    def reset(self) -> None:
        """Begin the order of the changes again."""
        self._drawn = 0

    def run(self, budget: int, ahead: np.ndarray | None = None) -> int:
        """Test at most `budget` new legs; return how many changes were made.

        The way up to `ahead` (dof,) stays; None: what the robot soon comes to.
        """
        planner = self.planner
        way = planner.memory.way
        if planner.last is None or planner.last.status == HOLDING:
            return 0
        made, located = 0, False
        for _ in range(_DRAWS * budget):
            # a change alters the segments: what stays is found again
            located = located or (way.count[0] > 2 and self._begin(ahead))
            if budget <= 0 or not located:
                break
            change = self._draw()
            if change is not None:
                budget -= len(change.corners) - 1
                changed = self._try(change)
                made, located = made + changed, not changed
        return made

    def _draw(self) -> Change | None:
        """Return the next change if it is worth a test."""
        self._drawn += 1
        u, v = (0.5 + self._drawn * _R2) % 1.0
        rest = self._rest()
        change = self._cut(rest, u, v) if self._drawn % 2 else self._pull(rest, u, v)
        if change is None:
            return None
        at, _, corners = rest
        i, j = change.i - at, change.j - at
        tail = corners[j:] if change.to_vertex else corners[j + 1 :]
        new = np.concatenate([corners[: i + 1], change.corners, tail])
        before, after = self._time(corners), self._time(new)
        return change if after < (1.0 - _WORTH) * before else None

    def _begin(self, ahead: np.ndarray | None) -> bool:
        """Find the first segment and the share of it that stay; False: none is left."""
        planner = self.planner
        m, robot = planner.memory, planner.robot
        at = int(m.own.numbers[N_SEGMENT])
        if ahead is not None:
            at = int(ways.locate_on_way(m.table, m.way, at, ahead, m.own.out))
            self._at, self._share = at, float(m.own.out[0])
            return at >= 0
        leg = m.way.q[at + 1] - m.way.q[at]
        off = planner._difference(m.way.q[at], planner._q)
        done = float(off @ leg) / max(float(leg @ leg), 1e-12)
        done, left = min(max(done, 0.0), 1.0), _LEAD_S
        while at < int(m.way.count[0]) - 1:
            leg = m.way.q[at + 1] - m.way.q[at]
            time = float((np.abs(leg) / robot.max_velocity).max())
            if (1.0 - done) * time > left:
                self._at, self._share = at, done + left / time
                return True
            left -= (1.0 - done) * time
            at, done = at + 1, 0.0
        return False

    def _rest(self) -> tuple[int, float, np.ndarray]:
        """Return the first segment, the share of it that stays, and corners."""
        way = self.planner.memory.way
        return self._at, self._share, way.q[self._at : way.count[0]]

    def _cut(
        self, rest: tuple[int, float, np.ndarray], u: float, v: float
    ) -> Change | None:
        """Return a straight leg between two places of the way."""
        at, first, corners = rest
        legs = np.diff(corners, axis=0)
        lengths = np.linalg.norm(legs * self.planner.cell_map.roadmap.weights, axis=1)
        ends = np.cumsum(lengths)
        begin = first * lengths[0]
        a, b = begin + np.sort([u, v]) * (ends[-1] - begin)
        i, j = np.searchsorted(ends, [a, b], side="right")
        if i == j or j >= len(legs):
            return None
        q_a = corners[i + 1] - (ends[i] - a) / lengths[i] * legs[i]
        q_b = corners[j + 1] - (ends[j] - b) / lengths[j] * legs[j]
        return self._change(at + int(i), at + int(j), False, False, [q_a, q_b])

    def _pull(
        self, rest: tuple[int, float, np.ndarray], u: float, v: float
    ) -> Change | None:
        """Return two legs past a corner, nearer to the straight line."""
        at, first, corners = rest
        n = len(corners) - 2
        if n < 1:
            return None
        k = 1 + min(int(u * n), n - 1)
        behind, q_b = k > 1, corners[k + 1]
        q_a = corners[k - 1] if behind else _between(corners[0], corners[1], first)
        line = q_b - q_a
        share = float((corners[k] - q_a) @ line) / max(float(line @ line), 1e-12)
        foot = q_a + min(max(share, 0.0), 1.0) * line
        via = _between(corners[k], foot, v)
        return self._change(at + k - 1, at + k + 1, behind, True, [q_a, via, q_b])

    def _change(self, i: int, j: int, a: bool, b: bool, corners: list) -> Change | None:
        """Return the change with its legs the short way round."""
        planner = self.planner
        pairs = zip(corners, corners[1:], strict=False)
        legs = np.array([planner._difference(*pair) for pair in pairs])
        ends = corners[0] + np.cumsum(legs, axis=0)
        return Change(i, j, a, b, np.vstack([corners[:1], ends]))

    def _time(self, corners: np.ndarray) -> float:
        """Return the time that a path takes, about [s]."""
        legs = np.diff(corners, axis=0)
        times = (np.abs(legs) / self._speed).max(axis=1)
        moving = times > 1e-9
        speeds = legs[moving] / times[moving, None]
        turns = np.abs(np.diff(speeds, axis=0)) / self._acceleration
        return float(times.sum() + turns.max(axis=1, initial=0.0).sum())

    def _try(self, change: Change) -> int:
        """Test a change; make it where it is free; return how many were made."""
        planner = self.planner
        m = planner.memory
        begin, dq = change.corners[:-1], np.diff(change.corners, axis=0)
        cloud, tolerance = planner.calm_cloud(), planner.cell_map.motion_tolerance
        for q, leg in zip(begin, dq, strict=True):
            if not close.motion_clear(
                m.arm, planner.radii, q, leg, tolerance, cloud, False, m.work
            ) or not planner.static.motion_free(q, leg):
                return 0
        planner.attacher.tidy()
        item = planner.attacher.sweep(begin, dq)
        if item < 0 or m.way.count[0] + 3 >= len(m.way.vertex):
            return 0
        self._make(change, item)
        return 1

    def _make(self, change: Change, item: int) -> None:
        """Lay the new legs, whose cells begin at pool item `item`, into the way."""
        way, attacher = self.planner.memory.way, self.planner.attacher
        n, i, j = int(way.count[0]), change.i, change.j
        vertex, q, ref = way.vertex[:n].copy(), way.q[:n].copy(), way.ref[:n].copy()
        new = change.corners[1:-1]
        left, right = slice(0, i + 1), slice(j if change.to_vertex else j + 1, n)
        refs = [*ref[:i], *range(item, item + len(change.corners) - 1)]
        if not change.from_vertex:
            new = np.vstack([change.corners[:1], new])
            refs.insert(i, ref[i])
        if not change.to_vertex:
            new = np.vstack([new, change.corners[-1:]])
        refs += ref[j : n - 1].tolist()
        numbers = [attacher.new_vertex() for _ in new]
        vertex = np.r_[vertex[left], numbers, vertex[right]]
        n = len(vertex)
        way.count[0] = n
        way.vertex[:n], way.q[:n] = vertex, np.vstack([q[left], new, q[right]])
        way.ref[: n - 1] = refs
        ways.unwind(way, self.planner.robot.continuous)


def _between(q_a: np.ndarray, q_b: np.ndarray, share: float) -> np.ndarray:
    return q_a + share * (q_b - q_a)
