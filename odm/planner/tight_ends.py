"""Ends that the cover refuses and the links do not: ways out of there, and in.

The spheres of the cover stick out of the links, so a start or a goal in a narrow place
may be refused although every link keeps its distance. There the links' own hulls decide
(`odm.frame.link_test`). They are too slow for a search, which therefore goes from a
place beside the start that the cover calls free to one beside the goal. The short
motions between these and the very ends are proved by the hulls, in each frame anew.
"""

import math
from typing import NamedTuple

import numpy as np

from odm.answer import HOLDING, REPLANNED, Answer
from odm.frame.frame import Frame
from odm.frame.link_test import LinkTest
from odm.planner.attaching import Attacher
from odm.planner.decision import Decision
from odm.planner.path import PathInUse
from odm.planner.settings import TightSettings

_SLOPE = 1e-3  # [rad or m] over which the slope is measured
_FAR = 0.1  # [m] more distance to spare is not told apart


class Whole(NamedTuple):
    """A path from the very start to the very goal."""

    status: str
    path: np.ndarray  # (k, dof) [rad or m]
    goal: int | None
    by_links: tuple[int, ...]  # its legs that the hulls proved


class TightEnds:
    """Stands in for a start and goals that the cover refuses by places beside them.

    Attributes:
        is_on: Whether there are any: then the search goes from or to other places than
            it was asked for.
        used: Whether such places are looked for.
    """

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
        self._looked = -math.inf  # frame in which such places were looked for last
        self._begin = np.full(frame.robot.dof, np.nan)  # the one beside the start
        self._goals = np.zeros((0, frame.robot.dof))  # those that were asked for
        self.is_on, self.used = False, True

    @property
    def goals(self) -> np.ndarray:
        """(g, dof) goals that were asked for [rad or m]."""
        return self._goals if self.is_on else self.attacher.goals

    def forget(self, goals_stay: bool = True) -> None:
        """Let the search begin and end where it is asked to again."""
        if self.is_on and goals_stay:
            self._place(self._goals)
        self._begin[:] = np.nan
        self._looked = -math.inf
        self.is_on = self.decision.is_tight = False

    def look(self, q: np.ndarray) -> bool:
        """Look for such places in a frame without a path from q; True: there are.

        There are none where the cover lets the robot stand there and at a goal.
        """
        frame, attacher, s = self.frame, self.attacher, self.settings
        soon = frame.number - self._looked < s.look_every
        if self.is_on or not self.used or soon or attacher.ends_free:
            return False
        self._looked = frame.number
        begin, asked = self._beside(q) if self._is_refused(q) else q, attacher.goals
        if begin is None or not len(asked):
            return False
        goals = asked.copy()
        if all(self._is_refused(goal) for goal in asked):
            for g, goal in enumerate(asked[: s.most_goals]):
                beside = self._beside(goal)
                goals[g] = goal if beside is None else beside
            if (goals == asked).all():
                return False
        if begin is not q:
            self._begin[:] = begin
        self._goals, self.is_on, self.decision.is_tight = asked, True, True
        self._place(goals)
        return True

    def begin(self, q: np.ndarray) -> np.ndarray | None:
        """Return where the search begins in this frame; None: all is as it was asked.

        The way there is free in this frame, and so are those from the places beside
        goals.
        """
        asked, placed = self._goals, self.attacher.goals.copy()
        for g in np.flatnonzero((asked != placed).any(axis=1)).tolist():
            usual = self._spare(asked[g]) > self.settings.spare
            if usual or not self._passes(placed[g], asked[g]):
                placed[g] = asked[g]
        self._place(placed)
        begin = self._begin_from(q)
        if begin is None or (begin is q and (placed == asked).all()):
            looked = self._looked
            self.forget()
            self._looked = looked
            return None
        return begin

    def _begin_from(self, q: np.ndarray) -> np.ndarray | None:
        """Return q, or the place beside it; None: there is none."""
        free, begin = not self._is_refused(q), self._begin
        if free and self.path.locate(q)[0] >= 0:
            begin[:] = np.nan
        elif np.isfinite(begin).all() and self._passes(q, begin):
            return begin.copy()
        if free:
            return q
        found = self._beside(q)
        begin[:] = np.nan if found is None else found
        return found

    def whole(self, answer: Answer, q: np.ndarray) -> Whole:
        """Return the path of an answer, which goes from `begin`, from q to the goal."""
        path, goal = answer.path, answer.goal
        holds = answer.status == HOLDING
        g = 0 if goal is None else goal
        to, straight = self._goals[g], self.frame.difference(q, self._goals[g])
        if len(path) <= 3 and np.abs(straight).max() < self.settings.near:
            if self._passes(q, to):
                status = REPLANNED if holds else answer.status
                return Whole(status, np.stack([q, q + straight]), g, (0,))
        if holds:
            return Whole(HOLDING, path, None, ())
        if not (path[0] == q).all():
            turns = np.round((path[0] - q) / (2.0 * np.pi))
            path = path - 2.0 * np.pi * turns * self.frame.robot.continuous
            path = np.vstack([q, path])
        if not (self.attacher.goals[g] == to).all():
            path = np.vstack([path, path[-1] + self.frame.difference(path[-1], to)])
        ends = dict.fromkeys((0, len(path) - 2))
        clear = self.frame.motion_clear
        legs = tuple(k for k in ends if not clear(path[k], path[k + 1] - path[k]))
        return Whole(answer.status, path, g, legs)

    # --- places -----------------------------------------------------------------

    def _place(self, goals: np.ndarray) -> None:
        """Let the search go to these goals."""
        if not np.array_equal(goals, self.attacher.goals):
            self.attacher.set_goals(goals, self.attacher.costs)
            self.decision.new_goals = True

    def _beside(self, q: np.ndarray) -> np.ndarray | None:
        """Return a place beside q that the cover calls free, with a free motion there.

        Up the slope of the cover's distance. None: there is none, or a link is too near
        at q itself.
        """
        robot, s = self.frame.robot, self.settings
        if not self.links.clear(q, np.zeros_like(q)):
            return None
        lower = np.where(robot.continuous, -np.inf, robot.lower)
        upper = np.where(robot.continuous, np.inf, robot.upper)
        at, best, step = q, self._spare(q), s.step
        for _ in range(s.rounds):
            tries = at + _SLOPE * np.eye(len(q))
            slope = np.array([self._spare(one) for one in tries]) - best
            length = float(np.linalg.norm(slope))
            if length == 0.0:
                return None
            while step > _SLOPE:
                to = np.clip(at + step / length * slope, lower, upper)
                spare = self._spare(to)
                if spare > best:
                    break
                step *= 0.5
            else:
                return None
            at, best = to, spare
            if not self._is_refused(at) and self._passes(q, at):
                return at
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

    def save(self) -> dict[str, np.ndarray]:
        """Return what is remembered of the places and of the very goals."""
        state = [self.is_on, self._looked]
        return {
            "state": np.array(state, float),
            "begin": self._begin.copy(),
            "goals": self._goals.copy(),
        }

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Take up what was saved, and the goals beside them that were loaded."""
        self.is_on, self._looked = bool(saved["state"][0]), float(saved["state"][1])
        self.decision.is_tight = self.is_on
        self._begin[:] = saved["begin"]
        self._goals = saved["goals"].copy()
