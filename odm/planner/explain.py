"""Why the robot holds, and what would help; and what a motion is not free of."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from odm.answer import NOTHING, Blockers, Freedom
from odm.checks import check_numbers, outside_limits
from odm.planner.retreat import find_retreat
from odm.search import _step as step

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

_MOST_LISTED = 32


def start_trouble(planner: "ReactivePlanner", code: int) -> str | None:
    """Return what is wrong with the robot's own configuration, or None."""
    if code == step.NOT_FINITE:
        return "the robot's configuration holds NaN or infinity; check its encoders"
    if code == step.OUT_OF_LIMITS:
        what = outside_limits(planner.robot, planner._q, step.LIMIT_TOLERANCE)
        return f"the start is out of limits: {what}; move the joint back by hand"
    return None


class Reasons:
    """The explanation of one hold, made when it is asked for."""

    def __init__(self, planner: "ReactivePlanner", trouble: str | None) -> None:
        """Remember the frame; `trouble` is a reason known already."""
        self.planner = planner
        self.trouble = trouble
        self.frame = int(planner.memory.numbers.frame[0])
        self.q = planner._q.copy()

    def reason(self) -> tuple[str, Blockers]:
        """Return the reason and what stands behind it."""
        self.planner.memory.owner.check()
        if self._unable is not None:
            return self._unable, NOTHING
        if self._is_over:
            return "no free way was found (ask for the reason in the frame)", NOTHING
        return self._blocked()

    def retreat(self) -> np.ndarray | None:
        """Return a motion that gets away from the points, or None."""
        self.planner.memory.owner.check()
        if self._unable is not None or self._is_over:
            return None
        return find_retreat(self.planner, self.q)

    @property
    def _is_over(self) -> bool:
        return self.frame != self.planner.memory.numbers.frame[0]

    @cached_property
    def _unable(self) -> str | None:
        """Why it could not move in an empty world, either."""
        if self.trouble is not None:
            return self.trouble
        if len(self.planner.goals) == 0:
            return "no goal is set; call set_goals first"
        why = self.planner.static.why(self.q, np.zeros_like(self.q))
        if why is not None:
            return f"the start is not free: {why}; move the robot by hand"
        return None

    def _blocked(self) -> tuple[str, Blockers]:
        planner = self.planner
        keep = planner.keep
        gap, link, point = nearest(planner, self.q)
        if gap < keep:
            text = (
                f"the start is in contact: point {point} is {_cm(gap)} from {link}, "
                f"closer than {_cm(keep)}; move it {_cm(keep - gap)} away, or follow "
                "answer.retreat"
            )
            return text, self._around(self.q, link, point, None)
        rows = [nearest(planner, q) for q in planner.goals]
        blocked = [g for g, row in enumerate(rows) if row[0] < keep]
        if len(blocked) == len(rows):
            gap, link, point = rows[0]
            text = (
                f"goal 0 is blocked: point {point} would be {_cm(gap)} from {link} "
                f"there, closer than {_cm(keep)}; move it {_cm(keep - gap)} away"
            )
            more = len(rows) - 1
            text += f" (the other {more} goals are blocked too)" if more else ""
            text += ", or give another goal"
            return text, self._around(planner.goals[0], link, point, 0)
        g = next(k for k in range(len(rows)) if k not in blocked)
        at_goal = rows[g][0] < gap
        gap, link, point = rows[g] if at_goal else (gap, link, point)
        place = f"goal {g}" if at_goal else "the start"
        text = (
            f"no free way leads to goal {g}: what is free around {place} is cut off "
            f"(point {point} is {_cm(gap)} from {link} there); move it away, or give "
            "another goal"
        )
        where = planner.goals[g] if at_goal else self.q
        return text, self._around(where, link, point, g)

    def _around(
        self, q: np.ndarray, link: str | None, point: int, goal: int | None
    ) -> Blockers:
        """List the blocked edges at the nodes next to q, and the cells in their way."""
        planner = self.planner
        roadmap = planner.cell_map.roadmap
        planner.attacher._measure(q)
        near = np.argsort(planner.attacher.near, kind="stable")[:8]
        edges = [
            e
            for v in near
            for e in roadmap.adj_edge[roadmap.adj_ptr[v] : roadmap.adj_ptr[v + 1]]
        ]
        blocked, cells = [], set()
        for e in dict.fromkeys(edges):
            hit = self._cells_of(int(e))
            if hit:
                blocked.append(int(e))
                cells.update(hit)
            if len(blocked) >= _MOST_LISTED:
                break
        table = np.array(sorted(cells)[:_MOST_LISTED], np.int64).reshape(-1, 3)
        points = np.array([point] if point >= 0 else [], np.int64)
        return Blockers(np.array(blocked, np.int64), table, points, link, goal)

    def _cells_of(self, edge: int) -> set[tuple[int, int, int]]:
        planner = self.planner
        cells, n = planner.memory.graph, planner.cell_map.roadmap.n_nodes
        a, b = planner.cell_map.roadmap.edges[edge]
        found: set[tuple[int, int, int]] = set()
        for item in (n + edge, int(a), int(b)):
            part = slice(int(cells.ptr[item]), int(cells.ptr[item + 1]))
            blocks = cells.block[part]
            both = cells.mask[part] & planner.memory.cloud.words[blocks]
            for k in np.flatnonzero(both):
                found.update(_unpack(int(blocks[k]), int(both[k]), planner))
        return found


def _unpack(
    block: int, word: int, planner: "ReactivePlanner"
) -> list[tuple[int, int, int]]:
    _, ny, nz = (int(v) for v in planner.cell_map.grid.blocks)
    bx, by, bz = block // (ny * nz), block // nz % ny, block % nz
    bits = [k for k in range(64) if word >> k & 1]
    return [(4 * bx + (k >> 4), 4 * by + (k >> 2 & 3), 4 * bz + (k & 3)) for k in bits]


def nearest(planner: "ReactivePlanner", q: np.ndarray) -> tuple[float, str | None, int]:
    """Return (distance [m], link, point) of the nearest point of the frame at q."""
    gap = planner._nearest(np.ascontiguousarray(q))
    sphere, point = planner.close_test.blocked_by
    if sphere < 0:
        return float("inf"), None, -1
    return gap, link_of(planner, sphere), point


def link_of(planner: "ReactivePlanner", sphere: int) -> str:
    """Return the link that a sphere of the moving arm belongs to."""
    return planner.static.link_of(sphere)


def is_free(
    planner: "ReactivePlanner",
    q_a: np.ndarray,
    q_b: np.ndarray,
    phase: str | None = None,
) -> Freedom:
    """Test a straight motion; see ReactivePlanner.is_free."""
    robot = planner.robot
    ends = []
    for name, q in (("q_a", q_a), ("q_b", q_b)):
        q = check_numbers(robot, q, name)
        trouble = outside_limits(robot, q, 0.0)
        if trouble is not None:
            return Freedom(False, "limits", f"{name}: {trouble}")
        ends.append(q)
    dq = planner._difference(ends[0], ends[1])
    why = planner.static.why(ends[0], dq)
    if why is not None:
        itself = planner.static.touches_itself(ends[0], dq) is not None
        return Freedom(False, "self-collision" if itself else "scenery", why)
    if planner.trouble is not None:
        text = f"the last frame could not be used: {planner.trouble}"
        return Freedom(False, "frame", text)
    if phase is not None:
        hit = planner.last_phase(phase, planner.points, planner.classes).hit(
            planner.cover(), ends[0], dq
        )
        if hit is None:
            return Freedom(True)
        text = f"{link_of(planner, hit[0])} would come too near to point {hit[1]}"
        return Freedom(False, "frame", f"{text} by {_cm(hit[2])}")
    planner._sort()
    test = planner.close_test
    if test.clear(ends[0], dq, planner.memory.cloud):
        return Freedom(True)
    sphere, point = test.blocked_by
    t = test.blocked_at
    text = (
        f"{link_of(planner, sphere)} would come within "
        f"{_cm(planner.keep)} of point "
        f"{point} at {t:.0%} of the motion"
    )
    return Freedom(False, "frame", text)


def _cm(length: float) -> str:
    return f"{100 * length:.1f} cm"
