"""What is remembered of paths: the one in use, and candidates that may better it."""

import numpy as np

from odm.frame.frame import Frame
from odm.search import _paths as kernels
from odm.search import _step as step
from odm.search._state import NO_ITEM, NO_WAY

_ROOM = 0.01  # [m] a robot beside its segment by less needs no test of its own


class PathInUse:
    """The path that the robot follows: vertices, the items between, and their proof.

    Each segment keeps the two ends of the motion that was certified. Whoever writes a
    segment certifies it; nothing else may be said about it.

    Args:
        frame: Its memory holds the path.

    Attributes:
        followed: Whether the frame before led along it.
        item, vertex, q: Of the segments and the corners; see `Way` of the search.
    """

    def __init__(self, frame: Frame) -> None:
        """There is none yet."""
        self.frame = frame
        memory = frame.memory
        self._way, self._proof, self._beside = memory.way, memory.proof, memory.beside
        self.vertex, self.item, self.q = self._way.vertex, self._way.ref, self._way.q
        self._count, self._numbers = self._way.count, memory.numbers
        self.followed = False
        self._room_key = b""  # end and begin of a segment, and
        self._has_room = False  # whether it is free with room around it

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
        return self._numbers.segment.item()

    @property
    def is_same(self) -> bool:
        """Whether the path that was taken last leads on as the one before did."""
        return self._numbers.same.item() != 0

    def items(self) -> np.ndarray:
        """Return a view of the items of its segments."""
        return self.item[: max(0, len(self) - 1)]

    def drop(self) -> None:
        """Forget it; the next frame looks for another one."""
        self._count[0] = 0

    def reset(self) -> None:
        """Forget it, and that the robot was on it."""
        self.drop()
        self.followed = False

    def forget_beside(self) -> None:
        """Forget what is known of a robot beside its segment."""
        self._room_key = b""
        self._beside.q[:] = np.nan

    def goals_changed(self, vertex: int, vertices: np.ndarray) -> None:
        """Find its goal, of that `vertex`, among the vertices of the new goals."""
        if len(self):
            same = np.flatnonzero(vertices == vertex)
            self._count[1] = same[0] if len(same) else -1

    def rest(self) -> np.ndarray:
        """Return a copy of its corners from the robot's segment on, (k, dof)."""
        begin = self._numbers.segment.item()
        return self.q[begin : self._count.item(0)].copy()

    def look_soon(self) -> None:
        """Let the next frame look for a better one, whatever its number."""
        self._numbers.look[0] = 1

    def judge(self, points: np.ndarray, q: np.ndarray) -> int:
        """Judge it by the frame's points; a code of `odm/search/_step.py`."""
        table = self.frame.memory.table
        code = step.judge(table, points, q, False)
        if code == step.BESIDE:
            self.certify_beside(q)
            code = step.judge(table, points, q, False)
        return code

    def certify_beside(self, q: np.ndarray) -> None:
        """Test the motions from q, beside its segment, to that segment's two ends.

        They are new, so that they are tested against all that stands still; the
        frame's points are asked where they are used. One test of the segment with room
        around it answers for all motions that stay within that room.

        Args:
            q: (dof,) inside its limits, as `judge` found it.
        """
        static = self.frame.static
        segment, beside = self._numbers.where.item(), self._beside
        beside.q[0] = q
        beside.q[1:] = self.q[segment + 1], self.q[segment]
        end, begin = beside.q[1:]
        along = end - begin
        key = beside.q[1:].tobytes()
        if key != self._room_key:
            self._room_key = key
            self._has_room = static.motion_free(begin, along, _ROOM)
        length2 = float(along @ along)
        share = float((q - begin) @ along) / length2 if length2 > 0.0 else 0.0
        off = np.abs(q - begin - min(max(share, 0.0), 1.0) * along)
        if self._has_room and off @ self._proof.motion <= _ROOM:
            beside.free[:] = 1
        else:
            beside.free[:] = static.motions_free(np.stack([q, q]), beside.q[1:] - q)

    def locate(self, q: np.ndarray) -> tuple[int, float]:
        """Return the segment that q is on, -1 for none, and the share of it behind q.

        Segments behind the robot are not looked at.
        """
        m = self.frame.memory
        at = kernels.locate_on_way(m.table, self._way, self.segment, q, m.own.out)
        return int(at), float(m.own.out[0])

    def rest_length(self, q: np.ndarray) -> float:
        """Return its weighted length from q, on the robot's segment, to the goal."""
        return step.rest_length(self.frame.memory.table, self._way, self.segment, q)

    def go_straight(self, vertex: int, q: np.ndarray) -> None:
        """Let it be the straight motion from `vertex`, at q, to where it ends.

        It ends at the very goal: q plus a difference may lie a rounding out of limits.
        """
        last = len(self) - 1
        self.vertex[:2] = vertex, self.vertex[last]
        self.q[0], self.q[1] = q, self.q[last].copy()
        self.item[0] = NO_ITEM
        self._count[0] = 2
        kernels.unwind(self._way, self.frame.robot.continuous)
        kernels.certify_whole(self._way, 0, self._proof)
        self._numbers.segment[0] = self._numbers.same[0] = 0

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
        begin, end = self._proof.begin[:before].copy(), self._proof.end[:before].copy()
        q_before, first_new = self.q[:before].copy(), old.index(-1)
        self._count[0] = n
        self.vertex[:n], self.q[:n], self.item[: n - 1] = vertex, q, item
        kernels.unwind(self._way, self.frame.robot.continuous)
        kernels.certify_whole(self._way, 0, self._proof)
        for k, was in enumerate(old):
            if was < 0:
                continue
            # behind new legs a continuous joint may be whole turns from where it was
            ahead = k > first_new
            here = self.q[k + 1] if ahead else self.q[k]
            there = q_before[was + 1] if ahead else q_before[was]
            turns = 2.0 * np.pi * np.round((here - there) / (2.0 * np.pi))
            turns *= self.frame.robot.continuous
            self._proof.begin[k], self._proof.end[k] = (
                begin[was] + turns,
                end[was] + turns,
            )

    def lead(
        self, goal: int, vertex: np.ndarray, q: np.ndarray, item: list[int]
    ) -> None:
        """Let it be another path, to a goal of that rank; see `write`."""
        self._count[0], self._count[1] = 0, goal
        self.write(vertex, q, item, [-1] * len(item))
        self._numbers.segment[0] = self._numbers.same[0] = 0

    def save(self) -> dict[str, np.ndarray]:
        """Return what is remembered beside its arrays."""
        return {"followed": np.array(self.followed)}

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Go on along a path whose arrays were loaded."""
        self._room_key, self.followed = b"", bool(saved["followed"])


class Candidates:
    """Cuts that polishing found, and paths of the past that bound a long search.

    Each is tested against the frame before it is used.
    """

    def __init__(self, frame: Frame) -> None:
        """Know none."""
        self._short, self._past = frame.memory.short, frame.memory.past

    def is_known(self, a: int, b: int) -> bool:
        """Return whether the motion from vertex a to b was tested already."""
        known = kernels.find_shortcut(self._short, a, b)
        return bool(known == NO_WAY or known >= 0)

    def add(self, a: int, b: int, item: int) -> None:
        """Remember the motion from vertex a to b by its item; -1: it is not free."""
        kernels.add_shortcut(self._short, a, b, item if item >= 0 else NO_WAY)

    @property
    def is_filling(self) -> bool:
        """Whether cuts should be forgotten before there is no room for more."""
        return bool(4 * self._short.count[0] >= len(self._short.key))

    def forget_cuts(self) -> None:
        """Forget the cuts: the items that they name are thrown away."""
        self._short.key[:] = -1
        self._short.count[0] = 0

    def forget_all(self) -> None:
        """Forget cuts and paths: they are another hand's."""
        self.forget_cuts()
        self._past.vertex[:] = -1
