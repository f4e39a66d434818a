"""Ends that the cover refuses and the links do not: ways out of there, and in.

The spheres of the cover stick out of the links, so a start or a goal in a narrow place
may be refused although every link keeps its distance. There the links' own hulls decide
(`odm.frame.link_test`). They are too slow for a search, which therefore goes from a
place beside the start that the cover calls free to one beside the goal. The short
motions between these and the very ends are proved by the hulls, in each frame anew.
"""

from typing import NamedTuple

import numpy as np

from odm.answer import HOLDING, REPLANNED, Answer
from odm.frame.frame import Frame
from odm.frame.link_test import LinkTest
from odm.planner.attaching import Attacher
from odm.planner.decision import Decision
from odm.planner.path import PathInUse
from odm.planner.saved_memory import Remembering
from odm.planner.settings import TightSettings

_SLOPE = 1e-3  # [rad or m] over which the slope is measured
_FAR = 0.1  # [m] more distance to spare is not told apart


class Whole(NamedTuple):
    """A path from the very start to the very goal."""

    status: str
    path: np.ndarray  # (k, dof) [rad or m]
    goal: int | None
    by_links: tuple[int, ...]  # its legs that the hulls proved


class TightEnds(Remembering):
    """Stands in for a start and goals that the cover refuses by places beside them.

    Attributes:
        is_on: Whether there are any: then the search goes from or to other places than
            it was asked for.
        used: Whether such places are looked for.
        held_in: The last frame that held for want of a path.
    """

    REMEMBERED = (
        "is_on", "held_in", "_begin", "_goals", "_beside",
        "_asked", "_end", "_tried", "_at", "_step", "_rounds",
    )  # fmt: skip

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        attacher: Attacher,
        decision: Decision,
        links: LinkTest,
    ) -> None:
        self.frame, self.path, self.attacher = frame, path, attacher
        self.decision, self.links = decision, links
        self.settings = TightSettings()
        dof = frame.robot.dof
        self._begin = np.full(dof, np.nan)  # the place beside the start, if any
        self._goals = np.zeros((0, dof))  # those that were asked for
        # goals of the next frame, of which the last answer's reason knows nothing yet
        self._beside = np.zeros((0, dof))
        self.is_on, self.used, self.held_in = False, True, -1
        # the climb beside an end: which one of what was asked, and how far it has come
        self._asked, self._end, self._tried = b"", 0, 0
        self._at, self._step, self._rounds = np.full(dof, np.nan), 0.0, 0

    @property
    def goals(self) -> np.ndarray:
        """(g, dof) goals that were asked for [rad or m]."""
        return self._goals if self.is_on else self.attacher.goals

    def forget(self, goals_stay: bool = True) -> None:
        """Let the search begin and end where it is asked to again."""
        if self.is_on and goals_stay:
            self._place(self._goals)
        self._begin[:] = np.nan
        self._asked, self._beside = b"", self._beside[:0]
        self.is_on = self.decision.is_tight = False

    def look(self, budget: int) -> bool:
        """Go on looking for such places after a frame without a path; True: found.

        There are none where the cover lets the robot stand there and at a goal. The
        budget counts steps.
        """
        frame, attacher, s = self.frame, self.attacher, self.settings
        held = self.used and not self.is_on and self.held_in == frame.number
        if not held or not len(attacher.goals) or attacher.ends_free:
            return False
        ends = [frame.q, *attacher.goals[: s.most_goals]]
        asked = frame.q.tobytes() + attacher.goals.tobytes()
        again = frame.number - self._tried >= s.retry_every
        if asked != self._asked or (self._end == len(ends) and again):
            self._asked, self._tried = asked, frame.number
            self._begin[:] = np.nan
            self._climb_from(0)
        refused = [self._is_refused(q) for q in ends]
        while budget > 0 and self._end < len(ends):
            leaves = refused[0] and np.isnan(self._begin).any()
            if not leaves and not all(refused[1:]):
                return self._use(attacher.goals)
            if self._end == 0 and not leaves:
                self._climb_from(1)
            budget -= 1
            beside = self._climb(ends[self._end])
            if beside is None and not self._step:
                self._climb_from(len(ends) if leaves else self._end + 1)
            elif beside is not None and leaves:
                self._begin[:] = beside
            elif beside is not None:
                goals = attacher.goals.copy()
                goals[self._end - 1] = beside
                return self._use(goals)
        return False

    def _use(self, goals: np.ndarray) -> bool:
        """Let the search end at these goals from the next frame on."""
        for q in goals:  # joined here, where there is time, the frame finds it so
            self.attacher.prepare(q)
        self._goals, self._beside, self._asked = self.attacher.goals, goals, b""
        self.is_on = self.decision.is_tight = True
        return True

    def begin(self, q: np.ndarray) -> np.ndarray | None:
        """Return where the search begins in this frame; None: all is as it was asked.

        The way there is free in this frame, and so are those from the places beside
        goals.
        """
        asked, placed = self._goals, self.attacher.goals.copy()
        if len(self._beside):
            placed, self._beside = self._beside, self._beside[:0]
        for g in np.flatnonzero((asked != placed).any(axis=1)).tolist():
            usual = self._spare(asked[g]) > self.settings.spare
            if usual or not self._passes(placed[g], asked[g]):
                placed[g] = asked[g]
        self._place(placed)
        begin = self._begin_from(q, placed[(asked != placed).any(axis=1)])
        if begin is None or (begin is q and (placed == asked).all()):
            self.forget()
            return None
        return begin

    def _begin_from(self, q: np.ndarray, beside_goals: np.ndarray) -> np.ndarray | None:
        """Return q, or a place beside it; None: there is none."""
        s, free = self.settings, not self._is_refused(q)
        if not (free and self.path.locate(q)[0] >= 0):
            # a robot on its way into a goal is beside that goal's place, or near it
            near = [g for g in self._goals[: s.most_goals] if self._is_near(q, g)]
            for place in (self._begin, *beside_goals, *near):
                # a climb leads no farther, and by the hulls a long motion takes 0.1 s
                apart = np.linalg.norm(self.frame.difference(q, place))
                if apart <= s.rounds * s.step and self._passes(q, place):
                    return place.copy()
        self._begin[:] = np.nan
        return q if free else None

    def whole(self, answer: Answer, q: np.ndarray) -> Whole:
        """Return the path of an answer, which goes from `begin`, from q to the goal."""
        path, status = answer.path, answer.status
        g = 0 if answer.goal is None else answer.goal
        goal = self._goals[g]
        if len(path) <= 3 and self._is_near(q, goal) and self._passes(q, goal):
            path = np.stack([q, self._turned(q, goal)])
            status = REPLANNED if status == HOLDING else status
        elif status == HOLDING:
            return Whole(HOLDING, path, None, ())
        else:
            if not (path[0] == q).all():
                path = np.vstack([q, path + (self._turned(q, path[0]) - path[0])])
            if not (self.attacher.goals[g] == goal).all():
                path = np.vstack([path, self._turned(path[-1], goal)])
        ends = dict.fromkeys((0, len(path) - 2))
        clear = self.frame.motion_clear
        legs = tuple(k for k in ends if not clear(path[k], path[k + 1] - path[k]))
        return Whole(status, path, g, legs)

    def _is_near(self, q: np.ndarray, goal: np.ndarray) -> bool:
        apart = np.abs(self.frame.difference(q, goal)).max()
        return bool(apart < self.settings.near)

    def _turned(self, q: np.ndarray, to: np.ndarray) -> np.ndarray:
        """Return `to` with its continuous joints the short way from q."""
        turns = np.round((to - q) / (2.0 * np.pi)) * self.frame.robot.continuous
        return to - 2.0 * np.pi * turns

    # --- places -----------------------------------------------------------------

    def _place(self, goals: np.ndarray) -> None:
        """Let the search go to these goals."""
        if not np.array_equal(goals, self.attacher.goals):
            self.attacher.set_goals(goals, self.attacher.costs)
            self.decision.new_goals = True

    def _climb_from(self, end: int) -> None:
        """Begin the climb beside the start, 0, or beside goal `end` - 1."""
        self._end, self._step, self._rounds = end, self.settings.step, 0
        self._at[:] = np.nan

    def _climb(self, q: np.ndarray) -> np.ndarray | None:
        """Go one step up the slope of the cover's distance; return a place beside q.

        The cover calls it free, and the motion there is. None: not yet, or never, where
        the step is 0: also where a link is too near at q itself.
        """
        robot, s = self.frame.robot, self.settings
        step, self._step = self._step, 0.0
        if np.isnan(self._at).any():
            if not self.links.clear(q, np.zeros_like(q)):
                return None
            self._at[:] = q
        self._rounds += 1
        best, tries = self._spare(self._at), self._at + _SLOPE * np.eye(len(q))
        slope = np.array([self._spare(one) for one in tries]) - best
        length = float(np.linalg.norm(slope))
        if length == 0.0 or self._rounds > s.rounds:
            return None
        free = robot.continuous
        lower = np.where(free, -np.inf, robot.lower)
        upper = np.where(free, np.inf, robot.upper)
        while step > _SLOPE:
            to = np.clip(self._at + step / length * slope, lower, upper)
            if self._spare(to) > best:
                self._at[:], self._step = to, step
                passes = not self._is_refused(to) and self._passes(q, to)
                return to if passes else None
            step *= 0.5
        return None

    def _spare(self, q: np.ndarray) -> float:
        """Return how much farther the cover is at q than it must be, at most [m]."""
        keep = self.frame.keep
        return self.frame.separation(q, most=keep + _FAR) - keep

    def _is_refused(self, q: np.ndarray) -> bool:
        return not self.frame.motion_clear(q, np.zeros_like(q))

    def _passes(self, q: np.ndarray, to: np.ndarray) -> bool:
        """Whether a motion is free: of the frame by the cover, or else by the hulls."""
        dq = self.frame.difference(q, to)
        if not self.frame.static.motion_free(q, dq):
            return False
        return self.frame.motion_clear(q, dq) or self.links.clear(q, dq)

    # --- memory -----------------------------------------------------------------

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Take up what was saved; the goals to search for were loaded."""
        super().load(saved)
        self.decision.is_tight = self.is_on
