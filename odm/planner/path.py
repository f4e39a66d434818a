"""What is remembered of paths: the one in use, and candidates that may better it."""

import numpy as np

from odm.frame.frame import Frame
from odm.planner.saved_memory import Remembering
from odm.search import _paths as kernels
from odm.search import _step as step
from odm.search._state import EDITED, NO_ITEM, NO_MOTION, ROUNDED, WHOLE

_TUBE_RADIUS = 0.01  # [m] of the tube around a segment that one static test covers


class PathInUse(Remembering):
    """The path that the robot follows: vertices, the items between, and their proof.

    Each segment keeps the two ends of the motion that was certified. Whoever writes a
    segment certifies it; nothing else may be said about it.

    Attributes:
        followed: Whether the frame before led along it.
        item, vertex, q: Of the segments and the corners; see `Path` of the search.
    """

    REMEMBERED = ("followed",)

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        memory = frame.memory
        self._path, self._off_path = memory.path, memory.off_path
        self._certificates = memory.certificates
        self.vertex, self.item, self.q = self._path.vertex, self._path.ref, self._path.q
        self._count, self._numbers = self._path.count, memory.numbers
        self._segment = memory.numbers.segment
        self.followed = False
        self._tube_key = b""  # end and begin of a segment, and
        self._tube_is_free = False  # whether the tube around it is free

    def __len__(self) -> int:
        """Return the number of corners; 0 where there is no path."""
        return self._count.item(0)

    @property
    def goal(self) -> int:
        """Rank of the goal it leads to; -1 where that is no goal any more."""
        return self._count.item(1)

    @property
    def segment(self) -> int:
        """The segment that the robot was on in the last frame."""
        return self._segment.item()

    @property
    def is_same(self) -> bool:
        """Whether the path that was taken last leads on as the one before did."""
        return self._numbers.same.item() != 0

    def items(self) -> np.ndarray:
        """Return a view of the items of its segments."""
        return self.item[: max(0, len(self) - 1)]

    def drop(self) -> None:
        """Forget it, and what would better it; the next frame looks for another."""
        self._count[0] = 0
        self.withdraw()

    def withdraw(self) -> None:
        """Offer no candidate to the next frame."""
        step.drop_candidate(self.frame.memory.table)

    def reset(self) -> None:
        """Forget it, and that the robot was on it."""
        self.drop()
        self.followed = False

    def forget_behind(self) -> None:
        """Let it begin with the segment that the robot is on."""
        at, n = self.segment, len(self)
        if n:
            ends = self._certificates
            for rows in (self.vertex, self.q, self.item, ends.begin, ends.end):
                rows[: n - at] = rows[at:n]
            self._count[0], self._segment[0] = n - at, 0

    def forget_off_path(self) -> None:
        """Forget what is known of a robot off its segment."""
        self._tube_key = b""
        self._off_path.q[:] = np.nan

    def goals_changed(self, vertex: int, vertices: np.ndarray) -> None:
        """Find its goal, of that `vertex`, among the vertices of the new goals."""
        self.withdraw()
        if len(self):
            same = np.flatnonzero(vertices == vertex)
            self._count[1] = same[0] if len(same) else -1

    def take_cells(self, begin: int, end: int, item: int) -> None:
        """Let its segment between these vertices have cells, where it has none."""
        for k in np.flatnonzero(self.items() == NO_ITEM).tolist():
            if self.vertex[k] == begin and self.vertex[k + 1] == end:
                self.item[k] = item

    def certify_off_path(self, q: np.ndarray) -> None:
        """Test the motions from q, off its segment, to that segment's two ends.

        They are new, so that they are tested against all that stands still; against
        the frame's points where they are used. What stands still may be nearer than the
        clearance by its share for blending, of which a robot that rounds a corner has
        spent some (decision 0102); such a motion is good for going on alone. One test
        of a tube around the segment answers for all motions that stay inside the tube.

        Args:
            q: (dof,) inside its limits, as `judge` found it.
        """
        static = self.frame.static
        segment, off_path = self._numbers.where.item(), self._off_path
        off_path.q[0] = q
        off_path.q[1:] = self.q[segment + 1], self.q[segment]
        end, begin = off_path.q[1:]
        along = end - begin
        key = off_path.q[1:].tobytes()
        if key != self._tube_key:
            self._tube_key = key
            self._tube_is_free = static.motion_free(begin, along, _TUBE_RADIUS)
        length2 = float(along @ along)
        share = float((q - begin) @ along) / length2 if length2 > 0.0 else 0.0
        off = np.abs(q - begin - min(max(share, 0.0), 1.0) * along)
        if self._tube_is_free and off @ self._certificates.motion_bound <= _TUBE_RADIUS:
            off_path.free[:] = WHOLE
            return
        motions = np.stack([q, q]), off_path.q[1:] - q
        whole = static.motions_free(*motions)
        near = static.motions_free(*motions, nearer=static.safety.rounding)
        off_path.free[:] = np.where(whole, WHOLE, np.where(near, ROUNDED, 0))

    def locate(self, q: np.ndarray) -> tuple[int, float]:
        """Return the segment that q is on, -1 for none, and the share of it behind q.

        Segments behind the robot are left out.
        """
        m = self.frame.memory
        at = kernels.locate_on_path(
            m.table, self._path, self.segment, q, m.robot_state.fraction
        )
        return int(at), float(m.robot_state.fraction[0])

    def rest_length(self, q: np.ndarray) -> float:
        """Return its weighted length from q, on the robot's segment, to the goal."""
        return step.rest_length(self.frame.memory.table, self._path, self.segment, q)

    def write(
        self, vertex: np.ndarray, q: np.ndarray, item: list[int], old: list[int]
    ) -> None:
        """Let it lead over other corners, some of its segments as they are.

        Args:
            vertex: (k,) numbers of the corners.
            q: (k, dof) the corners [rad or m].
            item: Cells of the k - 1 segments, as numbers of the pool.
            old: Which segment each was; -1: a new motion, certified as a whole. Those
                before new ones stay where they are.
        """
        n, before = len(vertex), len(self)
        begin = self._certificates.begin[:before].copy()
        end = self._certificates.end[:before].copy()
        q_before, first_new = self.q[:before].copy(), old.index(-1)
        self._count[0] = n
        self.vertex[:n], self.q[:n], self.item[: n - 1] = vertex, q, item
        kernels.unwrap(self.q, n, self.frame.robot.continuous)
        kernels.certify_whole(self._path, 0, self._certificates)
        for k, was in enumerate(old):
            if was < 0:
                continue
            # behind new legs a continuous joint may be whole turns from where it was
            ahead = k > first_new
            here = self.q[k + 1] if ahead else self.q[k]
            there = q_before[was + 1] if ahead else q_before[was]
            turns = 2.0 * np.pi * np.round((here - there) / (2.0 * np.pi))
            turns *= self.frame.robot.continuous
            self._certificates.begin[k] = begin[was] + turns
            self._certificates.end[k] = end[was] + turns

    def lead(
        self, goal: int, vertex: np.ndarray, q: np.ndarray, item: list[int]
    ) -> None:
        """Let it be another path, to a goal of that rank, of new motions alone."""
        self.withdraw()
        n = self._count[0] = len(vertex)
        self._count[1] = goal
        self.vertex[:n], self.q[:n], self.item[: n - 1] = vertex, q, item
        kernels.unwrap(self.q, n, self.frame.robot.continuous)
        kernels.certify_whole(self._path, 0, self._certificates)
        self._numbers.segment[0] = self._numbers.same[0] = 0

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Go on along a path whose arrays were loaded."""
        super().load(saved)
        self._tube_key = b""


class CandidatePath(PathInUse):
    """A changed copy of the path in use, made between frames; the next frame tests it.

    At first it is the path in use, segment by segment; changes are made to it. Only a
    frame that finds it free makes it the path in use, which is kept until then.
    """

    def __init__(self, frame: Frame) -> None:
        super().__init__(frame)
        m = frame.memory
        self._path, self._certificates, self._count = (
            m.better,
            m.candidate_certificates,
            m.better.count,
        )
        self.vertex, self.item, self.q = self._path.vertex, self._path.ref, self._path.q
        self._segment = m.numbers.start

    def begin(self) -> None:
        """Begin with the path in use; a candidate that waits is changed further."""
        step.begin_candidate(self.frame.memory.table)

    def end(self) -> None:
        """Let it wait for the next frame where it was changed."""
        if not self._numbers.candidate.item():
            self.withdraw()

    def write(
        self, vertex: np.ndarray, q: np.ndarray, item: list[int], old: list[int]
    ) -> None:
        """As of the path in use; from now on it waits for a frame."""
        super().write(vertex, q, item, old)
        waits = self._numbers.candidate
        waits[0] = max(waits.item(), EDITED)


class Candidates:
    """Cuts that improving found, and paths of the past that bound a long search.

    Each is tested against the frame before it is used.
    """

    def __init__(self, frame: Frame) -> None:
        self._shortcuts = frame.memory.shortcuts
        self._earlier = frame.memory.earlier_paths

    def is_known(self, a: int, b: int) -> bool:
        """Return whether the motion from vertex a to b was tested already."""
        known = kernels.find_shortcut(self._shortcuts, a, b)
        return bool(known == NO_MOTION or known >= 0)

    def add(self, a: int, b: int, item: int) -> None:
        """Remember the motion from vertex a to b by its item; -1: it is not free."""
        kernels.add_shortcut(self._shortcuts, a, b, item if item >= 0 else NO_MOTION)

    @property
    def is_filling(self) -> bool:
        """Whether the table of cuts is so full that they should be forgotten."""
        return bool(4 * self._shortcuts.count[0] >= len(self._shortcuts.key))

    def forget_cuts(self) -> None:
        """Forget the cuts: the items that they name are thrown away."""
        self._shortcuts.key[:] = -1
        self._shortcuts.count[0] = 0

    def forget_all(self) -> None:
        """Forget cuts and paths: what the hand holds has changed."""
        self.forget_cuts()
        self._earlier.vertex[:] = -1
