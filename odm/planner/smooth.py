"""Between frames: shorten the time along the candidate path, by cutting and pulling.

A roadmap leads over its nodes, which lie where chance put them. A straight motion from
one point of the path to another may replace what lies between (Geraerts and Overmars
2007, shortcut), or a corner is pulled towards the straight line past it. What is gained
is counted in time: of the legs at the joints' speed, and of the corners, in which the
joints must change their speeds. Near a person who moves the robot is slowed. So new
legs keep more distance from points than they must, unless they save much time. They
keep their cells with them, so that later frames judge them as they judge an edge, and
are not where the obstacles have lately been.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from odm.frame.frame import Frame
from odm.planner import _smooth as smoothing
from odm.planner.attaching import Attacher
from odm.planner.path import CandidatePath
from odm.planner.saved_memory import Remembering
from odm.planner.settings import PlannerSettings, SmoothingSettings
from odm.search import _judge as judge
from odm.search import _recent as recent
from odm.search._state import NO_ITEM
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference
from roadmap.motion.blending import (
    BLEND_DEVIATION,
    TURN_A,
    TURN_J,
    blend_length,
    joint_motion_bounds,
)
from roadmap.robot.robot import Robot

MOST_CUTS = 200  # of a path that are looked at, the largest first
_GAIN_DEVIATION, _GAIN_LENGTH = 0.004, 10.0  # [m] allowed there, and of endless legs


@lru_cache(maxsize=2)  # a seventh of what it takes to make a planner
def corner_gain(robot: Robot, roadmap: Roadmap, corners: int = 128) -> float:
    """Return how much longer blends are than the sum over joints allows, as a rule.

    The median over so many corners of the roadmap: what a corner costs is weighed
    thousands of times between two frames, and its own bound would take longer.
    """
    gains = []
    step = max(1, roadmap.n_nodes // corners)
    for node in range(0, roadmap.n_nodes, step):
        near = roadmap.adj_node[roadmap.adj_ptr[node] : roadmap.adj_ptr[node + 1]]
        if len(near) < 2:
            continue
        q = roadmap.nodes[node].copy()
        legs = [difference(robot, q, roadmap.nodes[k]) for k in near[[0, -1]]]
        u, w = (leg / np.linalg.norm(leg) for leg in legs)
        far = BLEND_DEVIATION * float(joint_motion_bounds(robot) @ np.abs(w + u))
        if far > 0.0:
            d, _ = blend_length(robot, q, -u, w, _GAIN_LENGTH, _GAIN_DEVIATION)
            gains.append(d * far / _GAIN_DEVIATION)
    return float(np.median(gains)) if gains else 1.0


class Change(NamedTuple):
    """New legs for a part of the path.

    Attributes:
        i, j: Segments on which the new legs begin and end.
        from_vertex, to_vertex: Whether that is at the beginning of the segment, at
            vertex i or j. The last vertex is the beginning of no segment, but counts.
        corners: (k, dof) of the new legs, both ends with them.
    """

    i: int
    j: int
    from_vertex: bool
    to_vertex: bool
    corners: np.ndarray


class Smoother(Remembering):
    """Tests changes of the candidate path, in a fixed order."""

    REMEMBERED = ("_drawn", "_next", "_cut_of", "_cuts_seen")

    def __init__(
        self,
        frame: Frame,
        path: CandidatePath,
        attacher: Attacher,
        wanted: PlannerSettings,
    ) -> None:
        self.settings = settings = SmoothingSettings()
        self.frame, self.path, self.attacher = frame, path, attacher
        self.smoothing_clearance = wanted.smoothing_clearance
        self.history_clearance = wanted.wary_clearance
        robot, cell_map = frame.robot, frame.cell_map
        limits = [
            settings.speed_share * robot.max_velocity,
            robot.max_acceleration,
            robot.max_jerk,
            joint_motion_bounds(robot),
            cell_map.roadmap.weights,
        ]
        gain = corner_gain(robot, cell_map.roadmap, settings.corners)
        deviation = cell_map.safety.blending * gain
        rounding = np.array([deviation, BLEND_DEVIATION, TURN_A, TURN_J])
        continuous = frame.memory.robot_state.continuous
        self._terms = smoothing.Terms(np.stack(limits), rounding, continuous)
        self._scratch = smoothing.new_scratch(len(path.vertex), robot.dof)
        self.reset()

    def reset(self) -> None:
        """Begin the order of the changes again."""
        self._drawn = 0
        self._swept = False  # whether the last try looked at cells, which takes long
        self._next = 0  # frame of the next look for a straight motion
        # vertices of the path whose largest cuts are looked at, and how many were
        self._cut_of, self._cuts_seen = b"", 0

    def look_straight(self) -> None:
        """Look for a straight motion at once: there are other goals."""
        self._next = 0

    def go_straight(self, ahead: np.ndarray | None = None) -> int:
        """Test the straight motion to the goal, from where the path is to stay.

        Returns:
            1 where it is the rest of the candidate now, 0 where it is none, and -1
            where it was not worth a test.
        """
        path, now = self.path, self.frame.number
        last = len(path) - 1
        if now < self._next or last < 2 or not self._begin(ahead):
            return -1
        at, share = self._turn(ahead)
        if at >= last - 1:
            return -1
        q = path.q[at] + share * (path.q[at + 1] - path.q[at])
        corners = np.stack([q, q + self.frame.difference(q, path.q[last])])
        change = Change(at, last, share == 0.0, True, corners)
        weights = self.frame.cell_map.roadmap.weights
        rest = np.vstack([q[None], path.q[at + 1 : last + 1]])
        length = np.linalg.norm(np.diff(rest, axis=0) * weights, axis=1).sum()
        if length < self.settings.min_detour * np.linalg.norm(
            (corners[1] - q) * weights
        ):
            return -1
        self._next = now + self.settings.retry_frames
        return self._try(change)

    def cut(self, budget: int, ahead: np.ndarray | None = None) -> tuple[int, int]:
        """Replace by straight motions what that shortens most; see `_cuts`.

        A path over a roadmap is mostly shortened by a third at once. Each cut takes a
        test of the budget, and so does one whose cells were looked at in vain, and
        `cut_looks` that the frame does not leave free, which cost far less.

        Returns:
            How many changes were made, and what is left of the budget.
        """
        made, looks, last = 0, 0, len(self.path) - 1
        while budget > 0 and last >= 2 and self._begin(ahead):
            self._at, self._share = self._turn(ahead)
            if self._at >= last - 1:
                break
            vertices = self.path.vertex[self._at : last + 1].tobytes()
            if vertices != self._cut_of:
                self._cut_of, self._cuts_seen = vertices, 0
            done = 0
            for change in self._cuts(self._cuts_seen):
                self._cuts_seen, looks = self._cuts_seen + 1, looks + 1
                done = self._try(change, self.settings.min_saving)
                dear = self._swept or looks % self.settings.cut_looks == 0
                budget -= done or dear
                if done or budget <= 0:
                    break
            else:
                self._cuts_seen = MOST_CUTS  # no more of this path
                break
            made, last = made + done, len(self.path) - 1
        return made, budget

    def _cuts(self, first: int) -> Iterator[Change]:
        """Yield straight motions between places of the path, what saves most first.

        The places are its corners, and the middles of its segments, from where it is
        to stay. The `first` of them are left out, and all behind MOST_CUTS.
        """
        if first >= MOST_CUTS:
            return
        at, path, n = self._at, self.path, len(self.path)
        corners = path.q[at:n].copy()
        corners[0] += self._share * (corners[1] - corners[0])
        places = np.empty((2 * len(corners) - 1, corners.shape[1]))
        places[::2], places[1::2] = corners, 0.5 * (corners[:-1] + corners[1:])
        weights = self.frame.cell_map.roadmap.weights
        legs = np.linalg.norm(np.diff(places, axis=0) * weights, axis=1)
        along = np.r_[0.0, np.cumsum(legs)]
        a, b = np.triu_indices(len(places), 2)
        # joints without end turn the shorter way, as the answer's do
        dq = self.frame.difference(places[a], places[b])
        saved = along[b] - along[a] - np.linalg.norm(dq * weights, axis=1)
        order = np.argsort(-saved, kind="stable")[first:MOST_CUTS]
        for k in order[saved[order] > self.settings.min_cut * along[-1]].tolist():
            i, j = int(a[k]), int(b[k])
            begins = i % 2 == 0 and (i > 0 or self._share == 0.0)
            ends = at + i // 2, at + j // 2, begins, j % 2 == 0
            yield Change(*ends, np.stack([places[i], places[i] + dq[k]]))

    def _turn(self, ahead: np.ndarray | None) -> tuple[int, float]:
        """Return the segment and the share of it from which the robot can turn.

        One that moves is led to a corner a little ahead, which it can round.
        """
        at, state, q = self._at, self.frame.memory.robot_state, self.path.q
        if ((state.before if ahead is None else ahead) == state.q).all():  # it stands
            return at, self._share
        leg = np.abs(q[at + 1] - q[at]) / self.frame.robot.max_velocity
        share = self._share + self.settings.kept_s / max(float(leg.max()), 1e-9)
        return (at, share) if share < 1.0 else (at + 1, 0.0)

    def run(self, budget: int, ahead: np.ndarray | None = None) -> int:
        """Test at most `budget` new legs; return how many changes were made.

        The path up to `ahead` (dof,) stays; None: what the robot soon comes to.
        """
        made, located, looks = 0, False, self.settings.draws * budget
        while budget > 0 and looks > 0:
            # a change alters the segments: what stays is found again
            located = located or (len(self.path) > 2 and self._begin(ahead))
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
        rest = smoothing.Rest(self.path.q, self._at, len(self.path) - 1, self._share)
        self._drawn, found = smoothing.next_change(
            rest,
            self._terms,
            self._scratch,
            self._drawn,
            most,
            self.settings.min_saving,
        )
        if not found:
            return None
        corners = self._scratch.corners
        i, j, a, b, n = self._scratch.ints.tolist()
        return Change(i, j, bool(a), bool(b), corners[:n].copy())

    def _begin(self, ahead: np.ndarray | None) -> bool:
        """Find the first segment and the share of it that stay; False: none is left."""
        frame, path = self.frame, self.path
        if ahead is not None:
            self._at, self._share = path.locate(ahead)
            return self._at >= 0
        at = path.segment
        leg = path.q[at + 1] - path.q[at]
        off = frame.difference(path.q[at], frame.q)
        done = float(off @ leg) / max(float(leg @ leg), 1e-12)
        done, left = min(max(done, 0.0), 1.0), self.settings.kept_s
        while at < len(path) - 1:
            leg = path.q[at + 1] - path.q[at]
            time = float((np.abs(leg) / frame.robot.max_velocity).max())
            if (1.0 - done) * time > left:
                self._at, self._share = at, done + left / time
                return True
            left -= (1.0 - done) * time
            at, done = at + 1, 0.0
        return False

    def time(self, path: np.ndarray) -> float:
        """Return about how long a path (k, dof) takes [s], as it is counted here."""
        path = np.ascontiguousarray(path, np.float64)
        return smoothing.path_time(path, len(path), *self._terms[:2])

    def _try(self, change: Change, min_saving: float = -np.inf) -> int:
        """Test a change; make it where it is free; return how many were made.

        Not one that saves less than this share of the time for the rest of the path.
        """
        self._swept = False
        begin, dq = change.corners[:-1], np.diff(change.corners, axis=0)
        legs, table = list(zip(begin, dq, strict=True)), self.frame.memory.table
        # the quickest test first: most changes are blocked
        if not all(judge.close_free(table, q, leg) for q, leg in legs):
            return 0
        more, saves = self.smoothing_clearance, self._saves(change)
        if saves < min_saving:
            return 0
        if saves >= self.settings.min_saving_near:
            more = min(more, self.history_clearance)
        if not self._clear(legs, more):
            return 0
        if not all(self.frame.static.motion_free(q, leg) for q, leg in legs):
            return 0
        if len(self.path) + 3 >= len(self.path.vertex):
            return 0
        items = [NO_ITEM] * len(begin)
        if self._needs_cells():
            self._swept = True
            self.attacher.tidy()
            item = self.attacher.sweep(begin, dq)
            if item < 0:
                return 0
            items = list(range(item, item + len(begin)))
            if self.history_clearance and any(self.was_hit(leg) for leg in items):
                return 0
        self._make(change, items)
        return 1

    def _needs_cells(self) -> bool:
        """Whether new legs need their cells: they take longer than all else of it.

        Beside shapes alone the close test judges a leg as quickly. But cells tell
        whether it is where the obstacles have lately been.
        """
        if not self.attacher.can_wait_for_cells:
            return True
        table = self.frame.memory.table
        return bool(self.history_clearance and recent.is_history_left(table))

    def _clear(self, legs: list, more: float) -> bool:
        """Whether motions (q, dq) keep so much more distance than they must [m]."""
        return all(self.frame.motion_clear(q, leg, None, more) for q, leg in legs)

    def was_hit(self, item: int) -> bool:
        """Return whether a pool item has cells that lately were occupied, not now."""
        return bool(recent.was_hit(self.frame.memory.table, item))

    def _saves(self, change: Change) -> float:
        """Return the share of the time for the rest of the path that a change saves."""
        at = self._at
        rest = self.path.q[at : len(self.path)].copy()
        rest[0] += self._share * (rest[1] - rest[0])
        i, j = change.i - at, change.j - at
        left = rest[: i + (0 if change.from_vertex else 1)]
        changed = np.vstack([left, change.corners, rest[j + 1 :]])
        return 1.0 - self.time(changed) / self.time(rest)

    def _make(self, change: Change, new_items: list[int]) -> None:
        """Lay the new legs, with their pool items, into the path."""
        path = self.path
        n, i, j = len(path), change.i, change.j
        vertex, q = path.vertex[:n].copy(), path.q[:n].copy()
        items = path.items().tolist()
        new, n_legs = change.corners[1:-1], len(change.corners) - 1
        kept, first = list(range(i)), 0 if change.from_vertex else 1
        if not change.from_vertex:
            new, kept = np.vstack([change.corners[:1], new]), [*kept, i]
        if not change.to_vertex:
            new = np.vstack([new, change.corners[-1:]])
        later = range(j, n - 1)
        path.write(
            np.r_[
                vertex[: i + 1],
                [self.attacher.new_vertex() for _ in new],
                vertex[j if change.to_vertex else j + 1 :],
            ],
            np.vstack([q[: i + 1], new, q[j if change.to_vertex else j + 1 :]]),
            [*items[: i + first], *new_items, *items[j:]],
            [*kept, *[-1] * n_legs, *later],
        )
