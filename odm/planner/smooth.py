"""Between frames: shorten the time along the path in use, by cutting and pulling.

A roadmap leads over its nodes, which lie where chance put them. A straight motion from
one point of the path to another may replace what lies between (Geraerts and Overmars
2007, shortcut), or a corner is pulled towards the straight line past it. What is gained
is counted in time: of the legs at the joints' speed, and of the corners, in which the
joints must change their speeds. Near who moves a robot is slowed, so that new legs keep
more distance from points than they must, unless they save much. They keep their cells
with them, so that later frames judge them as they judge an edge.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from odm.answer import HOLDING
from odm.planner import _smooth as smoothing
from odm.search import _paths as ways
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference
from roadmap.motion.blending import STRAY, TURN_A, TURN_J, blend_length, joint_sway
from roadmap.robot.robot import Robot

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

_WORTH = 0.01  # a change must save this share of the whole rest
_PACE = 0.5  # share of the joints' speed limits that is likely used
_LEAD_S = 0.05  # what the robot reaches in this time at full speed stays [s]
_GAIN_NODES = 128  # corners of the roadmap that are looked at
_GAIN_STRAY, _GAIN_ROOM = 0.004, 10.0  # [m] allowed there, and of endless legs
_MUCH = 0.3  # a change that comes nearer to points than is comfortable must save more
_DRAWS = 40  # changes looked at for each one that is tested


def corner_gain(robot: Robot, roadmap: Roadmap) -> float:
    """Return how much longer blends are than the sum over joints allows, as a rule.

    The median over corners of the roadmap: what a corner costs is weighed thousands of
    times between two frames, and its own bound would take longer than that.
    """
    gains = []
    step = max(1, roadmap.n_nodes // _GAIN_NODES)
    for node in range(0, roadmap.n_nodes, step):
        near = roadmap.adj_node[roadmap.adj_ptr[node] : roadmap.adj_ptr[node + 1]]
        if len(near) < 2:
            continue
        q = roadmap.nodes[node].copy()
        legs = [difference(robot, q, roadmap.nodes[k]) for k in near[[0, -1]]]
        u, w = (leg / np.linalg.norm(leg) for leg in legs)
        far = STRAY * float(joint_sway(robot) @ np.abs(w + u))
        if far > 0.0:
            d, _ = blend_length(robot, q, -u, w, _GAIN_ROOM, _GAIN_STRAY)
            gains.append(d * far / _GAIN_STRAY)
    return float(np.median(gains)) if gains else 1.0


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
        self._robot = np.stack(
            [
                _PACE * robot.max_velocity,
                robot.max_acceleration,
                robot.max_jerk,
                joint_sway(robot),
                planner.cell_map.roadmap.weights,
            ]
        )
        own, way = planner.memory.own, planner.memory.way
        cell_map = planner.cell_map
        stray = cell_map.safety.blending * corner_gain(robot, cell_map.roadmap)
        self._rounding = np.array([stray, STRAY, TURN_A, TURN_J])
        self._terms = smoothing.Terms(self._robot, self._rounding, own.continuous)
        self._scratch = smoothing.new_scratch(len(way.vertex), robot.dof)
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
        made, located, looks = 0, False, _DRAWS * budget
        while budget > 0 and looks > 0:
            # a change alters the segments: what stays is found again
            located = located or (way.count[0] > 2 and self._begin(ahead))
            if not located:
                break
            begun = self._drawn
            change = self._draw(looks)
            if change is None:
                break
            looks -= self._drawn - begun
            budget -= len(change.corners) - 1
            changed = self._try(change)
            made, located = made + changed, not changed
        return made

    def _draw(self, most: int) -> Change | None:
        """Return the next change that is worth a test, of at most so many."""
        way = self.planner.memory.way
        rest = smoothing.Rest(way.q, self._at, int(way.count[0]) - 1, self._share)
        self._drawn, found = smoothing.next_change(
            rest, self._terms, self._scratch, self._drawn, most, _WORTH
        )
        if not found:
            return None
        _, corners, ints = self._scratch
        i, j, a, b, n = ints.tolist()
        return Change(i, j, bool(a), bool(b), corners[:n].copy())

    def _begin(self, ahead: np.ndarray | None) -> bool:
        """Find the first segment and the share of it that stay; False: none is left."""
        planner = self.planner
        m, robot = planner.memory, planner.robot
        at = int(m.numbers.segment[0])
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

    def time(self, path: np.ndarray) -> float:
        """Return about how long a path (k, dof) takes [s], as it is counted here."""
        path = np.ascontiguousarray(path, np.float64)
        return smoothing.path_time(path, len(path), self._robot, self._rounding)

    def _try(self, change: Change) -> int:
        """Test a change; make it where it is free; return how many were made."""
        planner = self.planner
        m = planner.memory
        begin, dq = change.corners[:-1], np.diff(change.corners, axis=0)
        legs = list(zip(begin, dq, strict=True))
        wide = self._clear(legs, planner.settings.comfort)
        if not wide and (self._saves(change) < _MUCH or not self._clear(legs, 0.0)):
            return 0
        if not all(planner.static.motion_free(q, leg) for q, leg in legs):
            return 0
        planner.attacher.tidy()
        item = planner.attacher.sweep(begin, dq)
        if item < 0 or m.way.count[0] + 3 >= len(m.way.vertex):
            return 0
        self._make(change, item)
        return 1

    def _clear(self, legs: list, more: float) -> bool:
        """Whether motions (q, dq) keep so much more distance than they must [m]."""
        planner = self.planner
        cloud, test = planner.calm_cloud(), planner.close_test.grown(more)
        return all(test.clear(q, leg, cloud) for q, leg in legs)

    def _saves(self, change: Change) -> float:
        """Return the share of the time for the rest of the way that a change saves."""
        way, at = self.planner.memory.way, self._at
        rest = way.q[at : int(way.count[0])].copy()
        rest[0] += self._share * (rest[1] - rest[0])
        i, j = change.i - at, change.j - at
        left = rest[: i + (0 if change.from_vertex else 1)]
        changed = np.vstack([left, change.corners, rest[j + 1 :]])
        return 1.0 - self.time(changed) / self.time(rest)

    def _make(self, change: Change, item: int) -> None:
        """Lay the new legs, whose cells begin at pool item `item`, into the way."""
        way, attacher = self.planner.memory.way, self.planner.attacher
        n, i, j = int(way.count[0]), change.i, change.j
        vertex, q, ref = way.vertex[:n].copy(), way.q[:n].copy(), way.ref[:n].copy()
        proof = self.planner.memory.proof
        begin, end = proof.begin[:n].copy(), proof.end[:n].copy()
        new = change.corners[1:-1]
        left, right = slice(0, i + 1), slice(j if change.to_vertex else j + 1, n)
        refs = [*ref[:i], *range(item, item + len(change.corners) - 1)]
        old = [*range(i), *[-1] * (len(change.corners) - 1)]  # segments they are of
        if not change.from_vertex:
            new = np.vstack([change.corners[:1], new])
            refs.insert(i, ref[i])
            old.insert(i, i)
        if not change.to_vertex:
            new = np.vstack([new, change.corners[-1:]])
        refs += ref[j : n - 1].tolist()
        old += range(j, n - 1)
        numbers = [attacher.new_vertex() for _ in new]
        vertex = np.r_[vertex[left], numbers, vertex[right]]
        n = len(vertex)
        way.count[0] = n
        way.vertex[:n], way.q[:n] = vertex, np.vstack([q[left], new, q[right]])
        way.ref[: n - 1] = refs
        ways.unwind(way, self.planner.robot.continuous)
        ways.certify_whole(way, 0, proof)
        for k, was in enumerate(old):
            if was < 0:
                continue
            # behind new legs a continuous joint may be whole turns from where it was
            here = way.q[k] if was <= i else way.q[k + 1]
            there = q[was] if was <= i else q[was + 1]
            turns = 2.0 * np.pi * np.round((here - there) / (2.0 * np.pi))
            turns *= self.planner.robot.continuous
            proof.begin[k], proof.end[k] = begin[was] + turns, end[was] + turns
