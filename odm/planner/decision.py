"""What a frame comes to: go on, take a new path, or hold; and what is joined for it.

A robot finds a path only from a configuration that was joined to the roadmap, by
motions to near nodes. That costs milliseconds, so it is done where `JOIN` says so.
"""

import numpy as np

from odm.frame.frame import Frame
from odm.planner.attaching import Attacher
from odm.planner.hysteresis import Hysteresis
from odm.planner.path import PathInUse
from odm.search import _step as step

NEW_GOALS = "new goals"  # and the robot stands
LINGERS = "lingers"  # the robot has stood for a while
NOT_JOINED = "not joined"  # the frame cannot be answered: q is new
NO_PATH = "no path"  # none of what q is joined to leads on
BETTER_GOAL = "better goal"  # a goal of better rank keeps clear, the path is free
STANDS, MOVES, JUMPED = "stands", "moves on", "jumped"  # since the frame before
NOTHING, FEW, MANY = "nothing", "a few nodes", "many nodes"  # what q is joined to

# (what the frame comes to, the robot, what q is joined to) -> what q is joined to now,
# after which the frame is answered again; where there is no row nothing is done
JOIN = {
    (NEW_GOALS, STANDS, NOTHING): FEW,
    (NEW_GOALS, STANDS, FEW): FEW,
    (LINGERS, STANDS, NOTHING): MANY,
    (LINGERS, STANDS, FEW): MANY,
    (NOT_JOINED, STANDS, NOTHING): FEW,
    (NOT_JOINED, MOVES, NOTHING): FEW,
    (NOT_JOINED, JUMPED, NOTHING): FEW,
    (NO_PATH, STANDS, NOTHING): MANY,
    (NO_PATH, STANDS, FEW): MANY,
    (NO_PATH, MOVES, NOTHING): FEW,
    (NO_PATH, JUMPED, NOTHING): FEW,
    (BETTER_GOAL, STANDS, NOTHING): MANY,
    (BETTER_GOAL, MOVES, NOTHING): FEW,
    (BETTER_GOAL, JUMPED, NOTHING): FEW,
}

_STAYS = 3  # frames at the same place,
_LINGERS = 12  # and with a path that it could follow
_PASSES = 0.2  # [rad or m] a robot is no farther from where it was a frame before


class Decision:
    """Decides what a frame comes to.

    Args:
        frame: The present frame.
        path: The path in use.
        attacher: Joins a configuration to the roadmap.
        hysteresis: Chooses between paths.
    """

    def __init__(
        self,
        frame: Frame,
        path: PathInUse,
        attacher: Attacher,
        hysteresis: Hysteresis,
    ) -> None:
        """No frame was seen."""
        self.frame, self.path = frame, path
        self.attacher, self.hysteresis = attacher, hysteresis
        self._numbers = frame.memory.numbers
        self.new_goals = False
        self._here = b""  # configuration of the last frame, and of the one before it
        self._before = b""
        self._stood = 0  # frames without a move

    def decide(self, points: np.ndarray, q: np.ndarray) -> int:
        """Answer a frame that can be used; a code of `odm/search/_step.py`."""
        here = q.tobytes()  # compared much faster than arrays
        self._before, self._here = self._here, here
        same = here == self._before
        attacher, always = self.attacher, self.hysteresis.always_replan
        numbers = self._numbers
        due = not always and numbers.step.item() % step.IMPROVE_EVERY == 0
        # looks in a row that found a better path
        found = numbers.better.item() if due else 0
        if self.new_goals:
            self.new_goals, self._stood = False, 0
            if same:
                self._join(NEW_GOALS, q)
        else:
            self._stood = self._stood + 1 if same else 0
            stays = _LINGERS if self.path.followed else _STAYS
            if attacher.quick and self._stood >= stays:
                self._join(LINGERS, q)
        code = self.hysteresis.step(points, q)
        if code == step.NOT_ATTACHED and self._join(NOT_JOINED, q):
            code = self.hysteresis.step(points, q)
        if code == step.NO_PATH and len(attacher.goals) and self._join(NO_PATH, q):
            code = self.hysteresis.step(points, q)
        if due and code == step.FOLLOWING and self._may_do_better(q):
            self._join(BETTER_GOAL, q)
            code = self.hysteresis.better(points, q, found)
        return code

    def _join(self, case: str, q: np.ndarray) -> bool:
        """Join q to the roadmap as `JOIN` says; return whether it was."""
        attacher = self.attacher
        joined = NOTHING
        if attacher.is_at(q):
            joined = FEW if attacher.quick else MANY
        what = None if joined == MANY else JOIN.get((case, self._robot(q), joined))
        if what is None or not np.isfinite(q).all():
            return False
        attacher.attach_start(q, quick=what == FEW)
        return True

    def _robot(self, q: np.ndarray) -> str:
        """Return what the robot did since the frame before."""
        if self._here == self._before:
            return STANDS
        if not self._before:
            return JUMPED
        moved = np.abs(self.frame.difference(np.frombuffer(self._before), q)).max()
        return MOVES if moved < _PASSES else JUMPED

    def _may_do_better(self, q: np.ndarray) -> bool:
        """Return whether a better goal than that of the path in use keeps clear now.

        Then it is worth to join the robot to the roadmap anew: the ends of a straight
        motion are no nodes, and from them no path to another goal is ever found. Where
        q is joined already, and no obstacle history is kept, every look finds it.
        """
        attacher, frame = self.attacher, self.frame
        if attacher.is_at(q) and not self.hysteresis.settings.memory_s:
            return False
        if attacher.costs is not None:  # then no goal is better by its rank
            return False
        still = np.zeros_like(q)
        better = attacher.goals[: max(self.path.goal, 0)]
        return any(frame.motion_clear(goal, still) for goal in better)

    def save(self) -> dict[str, np.ndarray]:
        """Return what is remembered of the frame before."""
        return {
            "here": np.frombuffer(self._here, np.uint8),
            "counts": np.array([self._stood, self.new_goals], np.int64),
        }

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Remember what `save` returned."""
        self._here = saved["here"].tobytes()
        self._stood, self.new_goals = int(saved["counts"][0]), bool(saved["counts"][1])
