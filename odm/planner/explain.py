"""Why the robot holds, and what would help."""

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from odm.answer import NOTHING, Blockers
from odm.cell_map.lists import cells_of_item
from odm.checks import outside_limits
from odm.frame.frame import Frame
from odm.frame.freedom import in_cm
from odm.planner.attaching import Attacher
from odm.planner.retreat import Retreat
from odm.search import _step as step
from roadmap.kinematics._limits import LIMIT_TOLERANCE, MOST_TURNED
from roadmap.robot.robot import Robot

_MOST_LISTED = 32
_OWN = -0.03  # [m] a point so deep within the cover is in a link, where nobody is


def start_trouble(robot: Robot, q: np.ndarray, code: int) -> str | None:
    """Return what is wrong with the robot's own configuration, or None."""
    if code == step.NOT_FINITE:
        return "the robot's configuration holds NaN or infinity; check its encoders"
    if code == step.OUT_OF_LIMITS:
        what = outside_limits(robot, q, LIMIT_TOLERANCE)
        lost = np.abs(q).max() > MOST_TURNED
        remedy = "check its encoder" if lost else "move the joint back by hand"
        return f"the start is out of limits: {what}; {remedy}"
    return None


class _Place(NamedTuple):
    """Where the blockers of a hold are looked for, and what is known of them."""

    q: np.ndarray
    link: str | None
    point: int  # -1: a shape
    goal: int | None


class Reasons:
    """The explanation of one hold, made when it is asked for.

    Args:
        frame: The present frame; in a later one no reason is found any more.
        attacher: The goals.
        retreat: Finds a motion out of the way.
        trouble: A reason known already.
        searched: Tells how far a search beyond the roadmap has come.
        waiting: Tells for how many frames more a path that is free now has to be so;
            0: there is none, or none that has to.
    """

    def __init__(
        self,
        frame: Frame,
        attacher: Attacher,
        retreat: Retreat,
        trouble: str | None,
        searched: Callable[[], str],
        waiting: Callable[[], int],
    ) -> None:
        self.frame, self.attacher, self.trouble = frame, attacher, trouble
        self._searched, self._waiting = searched, waiting
        self._retreat = retreat
        self.epoch = frame.epoch
        # from where a path was looked for, and where the robot is
        self.q, self.q_robot = frame.q.copy(), frame.q_taken.copy()

    @property
    def reason(self) -> str:
        """One sentence."""
        return self._told[0]

    @cached_property
    def blockers(self) -> Blockers:
        """What stands behind the reason."""
        _, place = self._told
        if place is None or self._is_over:
            return NOTHING
        self.frame.memory.owner.check()
        return self._around(place)

    @cached_property
    def _told(self) -> tuple[str, _Place | None]:
        self.frame.memory.owner.check()
        if self._unable is not None:
            return self._unable, None
        if self._is_over:
            return "no free path was found (ask for the reason in the frame)", None
        return self._blocked()

    @cached_property
    def retreat(self) -> np.ndarray | None:
        """A motion that gets away from the points, or None."""
        self.frame.memory.owner.check()
        if self._unable is not None or self._is_over:
            return None
        return self._retreat.back_off(self.q_robot)

    @property
    def _is_over(self) -> bool:
        return self.epoch != self.frame.epoch

    @cached_property
    def _unable(self) -> str | None:
        """Why it could not move in an empty world, either."""
        if self.trouble is not None:
            return self.trouble
        if len(self.attacher.goals) == 0:
            return "no goal is set; call set_goals first"
        why = self.frame.static.why(self.q, np.zeros_like(self.q))
        if why is not None:
            return f"the start is not free: {why}; move the robot by hand"
        return None

    def _blocked(self) -> tuple[str, _Place | None]:
        frame, goals = self.frame, self.attacher.goals
        gap, keep, link, what, point = frame.nearest(self.q)
        if gap < keep:
            text = (
                f"the start is in contact: {what} is {_too_near(gap, keep, link)}; "
                f"move it {_more(keep - gap)} away, or let the robot get out of its "
                f"way (answer.retreat){self._denser(gap, point)}"
            )
            if point >= 0 and gap < _OWN:
                text += (
                    "; so deep inside, it is rather of the robot's own picture: check "
                    "pose and time of the camera, and its self filter (SeenSettings)"
                )
            return text, _Place(self.q, link, point, None)
        refused = self._goals_refused()
        if refused is not None:
            return refused, None
        rows = [frame.nearest(q) for q in goals]
        blocked = [g for g, row in enumerate(rows) if row.gap < row.keep]
        if len(blocked) == len(rows):
            gap, keep, link, what, point = rows[0]
            text = (
                f"goal 0 is blocked: {what} would be "
                f"{_too_near(gap, keep, f'{link} there')}; move it "
                f"{_more(keep - gap)} away"
            )
            more = len(rows) - 1
            text += f" (the other {more} goals are blocked too)" if more else ""
            text += f", or give another goal{self._denser(gap, point)}"
            return text, _Place(goals[0], link, point, 0)
        g = next(k for k in range(len(rows)) if k not in blocked)
        at_goal = rows[g].gap - rows[g].keep < gap - keep
        if at_goal:
            gap, _, link, what, point = rows[g]
        place = f"goal {g}" if at_goal else "the start"
        left = self._waiting()
        lead, when = f"no free path to goal {g} was found", ""
        if left:
            lead, when = f"no path to goal {g} stays free", " at times"
        text = (
            f"{lead}: on the roadmap what is free around {place} is cut off{when} "
            f"({what} is {in_cm(gap)} from the cover of {link} there); move it away, "
            "or give another goal"
        )
        if what is None:
            text = (
                f"no free path to goal {g} was found past what stands still; take "
                "something away, or give another goal"
            )
        if left:
            text += (
                f"; a path that is free now is taken when it stays so for {left} more "
                "frames (PlannerSettings.persistence_frames)"
            )
        searched = "" if left else self._searched()
        text += f"; {searched}" if searched else ""
        where = goals[g] if at_goal else self.q
        return text, _Place(where, link, point, g)

    def _denser(self, gap: float, point: int) -> str:
        """Say how dense points would have to be for `gap` [m] to do; or nothing."""
        told = self.frame.sampled != (None, None) or point < 0
        spare = np.floor(1000.0 * (gap - self.frame.keep_from_shapes)) / 1000.0
        if told or spare <= 0.0:
            return ""
        return (
            f"; {in_cm(self.frame.rho)} of it are kept for what lies between points: "
            f"if no place of a surface is more than {in_cm(spare)} from one, say so "
            "(covering_radius)"
        )

    def _goals_refused(self) -> str | None:
        """Say why no goal can be reached in this place, whatever moves; or None."""
        goals = self.attacher.goals
        whys = []
        for q in goals:
            whys.append(self.frame.static.why(q, np.zeros_like(q)))
            if whys[-1] is None:
                return None
        text = f"goal 0 is not free: {whys[0]}"
        if len(goals) > 1:
            text += f" (the other {len(goals) - 1} goals are not free either)"
        return text + "; take that away, or give another goal"

    def _around(self, place: _Place) -> Blockers:
        """List blocked edges at the nodes next to it, and the cells in their way."""
        roadmap = self.frame.cell_map.roadmap
        near = self.attacher.nearest(place.q, 8)
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
        points = np.array([place.point] if place.point >= 0 else [], np.int64)
        found = np.array(blocked, np.int64)
        return Blockers(found, table, points, place.link, place.goal)

    def _cells_of(self, edge: int) -> set[tuple[int, int, int]]:
        memory, roadmap = self.frame.memory, self.frame.cell_map.roadmap
        graph, n = memory.graph, roadmap.n_nodes
        lists = graph.start, graph.step, graph.code, graph.half, graph.full
        a, b = roadmap.edges[edge]
        found: set[tuple[int, int, int]] = set()
        for item in (n + edge, int(a), int(b)):
            blocks, masks = cells_of_item(*lists, item)
            both = masks & memory.cloud.words[blocks]
            for k in np.flatnonzero(both):
                found.update(_unpack(int(blocks[k]), int(both[k]), self.frame))
        return found


def _more(length: float) -> str:
    """Return how far something must be moved [m]: rounded up, never 0.0 cm."""
    return in_cm(max(np.ceil(1000.0 * length), 1.0) / 1000.0)


def _too_near(gap: float, keep: float, link: str) -> str:
    """Return how near to a link's cover something is that is nearer than `keep` [m]."""
    if gap < 0.0:
        return f"{_more(-gap)} inside the cover of {link}, not {in_cm(keep)} outside"
    return f"{_less(gap, keep)} from the cover of {link}, closer than {in_cm(keep)}"


def _less(gap: float, keep: float) -> str:
    """Return a gap [m] below the one to keep [m] so that it reads as less, too."""
    text = in_cm(gap)
    return in_cm(round(keep, 3) - 0.001) if text == in_cm(keep) else text


def _unpack(block: int, word: int, frame: Frame) -> list[tuple[int, int, int]]:
    _, ny, nz = (int(v) for v in frame.cell_map.grid.blocks)
    bx, by, bz = block // (ny * nz), block // nz % ny, block % nz
    bits = [k for k in range(64) if word >> k & 1]
    return [(4 * bx + (k >> 4), 4 * by + (k >> 2 & 3), 4 * bz + (k & 3)) for k in bits]
