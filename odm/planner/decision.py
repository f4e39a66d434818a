"""The decision of a frame: follow, replan or hold; and when q is connected anew.

A robot finds a path only from a configuration that was joined to the roadmap, by
motions to near nodes. That costs milliseconds, so it is done where `JOIN` says so.
"""

import math

import numpy as np

from odm.frame.frame import Frame
from odm.planner.attaching import COSTS, Attacher
from odm.planner.path import PathInUse
from odm.planner.saved_memory import Remembering
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
    (NOT_JOINED, JUMPED, NOTHING): MANY,
    (NO_PATH, STANDS, NOTHING): MANY,
    (NO_PATH, STANDS, FEW): MANY,
    (NO_PATH, MOVES, NOTHING): FEW,
    (NO_PATH, JUMPED, NOTHING): FEW,
    (BETTER_GOAL, STANDS, NOTHING): MANY,
    (BETTER_GOAL, MOVES, NOTHING): FEW,
    (BETTER_GOAL, JUMPED, NOTHING): FEW,
}

# of a frame, beside which a close test takes so long that cells are swept in a frame
MANY_POINTS = 4000
_NO_TIME = math.nan
_SEGMENT, _PLANNED = step.SEGMENT, step.PLANNED  # which every frame asks for


class Decision(Remembering):
    """Decides what a frame comes to.

    The common frame is one compiled call (`odm/search/_step.py::respond`); what it
    cannot answer alone is decided here. After a path was blocked that was only just
    free, the next one must be there for `patience` frames.

    Attributes:
        new_goals: Goals were set since the last frame.
        only_seen: The last frame asked for no answer.
        is_tight: No frame may be answered as it is taken; see `tight_ends`.
    """

    REMEMBERED = ("new_goals", "_looked", "only_seen", "_joined_in")

    def __init__(
        self, frame: Frame, path: PathInUse, attacher: Attacher, patience: int
    ) -> None:
        self.frame, self.path, self.attacher = frame, path, attacher
        self._memory, self._numbers = frame.memory, frame.memory.numbers
        self.new_goals = self.only_seen = self._joins_first = False
        self._joined_in = -1  # frame that joined q, or goals, to the roadmap last
        self.is_tight = False
        self._patience, self._joining = patience, attacher.settings
        self._looked = -step.BETTER_EVERY  # frame after which `improve` looked last
        self._always = frame.memory.rules.always  # 1: search from scratch

    @property
    def joined(self) -> bool:
        """Whether the last frame that was taken joined q, or goals, to the roadmap."""
        return self._joined_in == self.frame.number

    @property
    def waits(self) -> bool:
        """Whether a path that is free only now has to wait for more frames."""
        return self._numbers.frames_to_persist.item() > 0

    @property
    def patience(self) -> int:
        """Frames in a row that a path must be free, after another was blocked."""
        return 0 if self._always.item() else self._patience

    def frames_to_wait(self, beyond: int) -> int:
        """Return in how many more frames a path that is free only now must be found.

        0: none is free, or none has to wait. `beyond` is the count of the search beyond
        the roadmap.
        """
        left = self._numbers.frames_to_persist.item(), beyond
        # as many as at first: this very frame had no path
        return min((n for n in left if 0 < n < self.patience), default=0)

    def see(self, q: np.ndarray, now: float | None) -> None:
        """Remember a frame that can be used and asks for no answer."""
        self.only_seen = True
        step.notice(self._memory.table, q, _NO_TIME if now is None else now)

    def begin(self) -> bool:
        """Begin a frame; return whether it may be answered as it is taken.

        Not where q may have to be joined to the roadmap first.
        """
        attacher, self.only_seen = self.attacher, False
        if attacher.is_stale:
            attacher.forget_all()
        elif attacher.owes == COSTS or (attacher.owes_start and not self.joined):
            attacher.pay()  # the start's cells wait while each frame joins it to more
        elif attacher.owes and self.path.followed and self.frame.n_given > MANY_POINTS:
            attacher.pay()  # cells only save tests: `improve` sweeps them, else
        first = self.new_goals or (attacher.without_cells and not self.path.followed)
        self._joins_first = first
        return not (first or self.is_tight)

    def decide(self, q: np.ndarray, now: float | None, said: int) -> int:
        """Answer a frame that can be used: what `respond` returns.

        `said`: what it returned where the frame was answered as it was taken.
        """
        now = _NO_TIME if now is None else now
        if said == step.NOT_ASKED:
            if self._joins_first:
                self._join_ahead(q)
            said = step.respond(self._memory.table, q, now)
        code = said % _SEGMENT
        if code <= _PLANNED:
            return said
        return self._decide(said, code, q, now)

    def _decide(self, said: int, code: int, q: np.ndarray, now: float) -> int:
        """Join q to what it needs, and answer again."""
        if code == step.OFF_PATH:
            said, code = self._beside(q, now)
        joined = code == step.NOT_ATTACHED and self._join(NOT_JOINED, q)
        if joined:
            said, code = self._again(q, now)
        if code == step.NO_PATH:
            again = not joined and self.attacher.lacks_start  # once a frame
            # what is joined to many nodes has no row
            if (again or not self.attacher.is_attached(q)) and self.may_lead_on():
                if self._join(NO_PATH, q) or (again and self._join_start()):
                    said, code = self._again(q, now)
        if code == step.BETTER:
            ago = self.frame.number - self._looked
            if ago <= step.BETTER_EVERY and self.robot == STANDS:
                return said + step.FOLLOWING - step.BETTER  # it is looked for between
            # then the robot's own motions may lead to it: the ends of a straight motion
            # are no nodes
            self._join(BETTER_GOAL, q)
            self._numbers.wish[0] = 1
            said = step.respond(self._memory.table, q, now)
        return said

    def _join_start(self) -> bool:
        """Join q by its first motions; return whether it has some now."""
        done = self.attacher.join_start()
        if done:
            self._joined_in = self.frame.number
        return done

    def join_more(self, most: int) -> bool:
        """Join start and goals of a frame without a path to `most` more nodes at most.

        Each takes up to a millisecond. False where none was: q was joined in this
        frame, the frame leaves no waiting node free, or neither end can be left.
        """
        attacher = self.attacher
        if self.joined or attacher.lacks_start or not attacher.lacks_nodes:
            return False
        if not self.may_lead_on() or not attacher.attach_free(most):
            return False
        self._joined_in = self.frame.number
        return True

    def again(self, now: float | None) -> int:
        """Answer the frame anew: what `respond` returns; `now` as in `decide`."""
        q, now = self._memory.robot_state.q, _NO_TIME if now is None else now
        return self._again(q, now)[0]

    def may_lead_on(self) -> bool:
        """Return whether other motions could help: the robot and a goal stand free."""
        return len(self.attacher.goals) > 0 and self.attacher.ends_free

    def _again(self, q: np.ndarray, now: float) -> tuple[int, int]:
        said = step.respond(self._memory.table, q, now)
        if said % step.SEGMENT == step.OFF_PATH:
            return self._beside(q, now)
        return said, said % step.SEGMENT

    def _beside(self, q: np.ndarray, now: float) -> tuple[int, int]:
        """Test the motions from q, beside its segment, and answer.

        Of the candidate first, then of the path in use, if that is not free.
        """
        for _ in range(2):
            waits = self._numbers.candidate.item() and not self._always.item()
            (self.attacher.candidate if waits else self.path).certify_off_path(q)
            said = step.respond(self._memory.table, q, now)
            if said % step.SEGMENT != step.OFF_PATH:
                break
        return said, said % step.SEGMENT

    def _join_ahead(self, q: np.ndarray) -> None:
        """Join q to the roadmap before the frame is answered."""
        stands = bool((q == self.frame.q).all())
        if self.new_goals:
            self.new_goals = False
            self._numbers.stood[0] = -1
            if stands:
                self._join(NEW_GOALS, q, STANDS)
        elif stands and self._numbers.stood.item() + 1 >= self._joining.rejoin_in:
            self._join(LINGERS, q, STANDS)

    def join_between(self) -> bool:
        """Join the robot anew between frames, where it lingers or a goal has cleared.

        Where it stands, a better path may leave by other nodes than those on its path.
        """
        q, self._looked = self.frame.q, self.frame.number
        idle = self._numbers.stood.item() >= self._joining.rejoin_idle_in
        if self.attacher.without_cells and idle:
            return self._join(LINGERS, q)
        if self.robot == STANDS and self.sees_better_goal():
            return self._join(BETTER_GOAL, q)
        return False

    def sees_better_goal(self) -> bool:
        """Return whether a goal of better rank keeps its distance from the points."""
        return bool(step.better_goal_stands_clear(self._memory.table))

    def _join(self, case: str, q: np.ndarray, robot: str | None = None) -> bool:
        """Join q to the roadmap as `JOIN` says; return whether it was."""
        attacher = self.attacher
        joined = NOTHING
        if attacher.is_at(q):
            joined = FEW if attacher.without_cells else MANY
        robot = robot or self.robot
        what = None if joined == MANY else JOIN.get((case, robot, joined))
        if what is None or not np.isfinite(q).all():
            return False
        attacher.attach_start(q, what == FEW, passes=robot == MOVES)
        self._joined_in = self.frame.number
        return True

    @property
    def robot(self) -> str:
        """What the robot did since the frame before."""
        robot = self._memory.robot_state
        if (robot.before == robot.q).all():
            return STANDS
        if not np.isfinite(robot.before).all():
            return JUMPED
        moved = np.abs(self.frame.difference(robot.before, robot.q)).max()
        return MOVES if moved < self._joining.jump else JUMPED
