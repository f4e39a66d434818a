"""Configurations of targets that the planner is offered; one costly job a frame.

A target may have several configurations. One that keeps clear of the person now is
looked for among those known; what it takes to offer it, a start of the inverse
kinematics or joining it to the roadmap, costs up to some milliseconds and is done in
one frame each, before the frame that sets the goals.
"""

from enum import Enum

from handover.meet.workspace import Target
from handover.targets.allowance import Allowance
from handover.targets.settings import LiveSettings
from handover.targets.target_goals import EXACT, Goal, TargetGoals
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadConfiguration

_SOLVE, _PREPARE = "solve", "prepare"


class Offer(Enum):
    """What came of offering a target."""

    MADE = "it has a goal that can be set now"
    COMING = "it will have one, or be found to have none, some frames from now"
    NOT_NOW = "all configurations known are blocked in this frame, or there is none"


class TargetOffers:
    """Holds the goals of the targets on offer, and works towards more of them.

    Args:
        planner: Its last frame tells what keeps clear; its goals are prepared here.
        finder: Knows the configurations.
        settings: How much a frame does, see LiveSettings; None: the finder's.

    Attributes:
        spare_m: Distance to keep besides the clearance, of configurations offered from
            now on [m]; see LiveSettings.
        attached: Goals joined to the roadmap so far.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        finder: TargetGoals,
        settings: LiveSettings | None = None,
    ) -> None:
        self.planner, self.finder = planner, finder
        self.settings = settings or finder.settings
        self.spare_m = self.settings.spare_m
        self.attached = 0
        self._goals: dict[int, list[Goal]] = {}
        self._frame, self._attached_at = 0, -self.settings.connect_every
        self._joined: Goal | None = None  # the last one, where none is kept
        self._clear: dict[int, tuple[int, Goal | None]] = {}  # frame, what was found
        self.begin({})

    def begin(self, targets: dict[int, Target]) -> None:
        """Begin a frame with the targets in it and those on offer, by their cells."""
        self._frame += 1
        self._targets = targets
        self._job: tuple[str, int, Goal | None] | None = None
        self._tests, self._lookups = self.settings.tests, self.settings.lookups

    def offer(self, key: int) -> Offer:
        """Offer a target if that is cheap now; else reserve a job to make it so."""
        goal = self.ready(key)
        if goal is not None:
            self._goals[key] = [goal]
            return Offer.MADE
        return self._order(key)

    def ready(self, key: int) -> Goal | None:
        """Return a goal of a target that is clear and costs next to nothing, or None.

        The exact pose, joined already; else a node near it.
        """
        goal = self._clear_of(key)
        if goal is not None and self._is_joined(goal):
            return goal
        node = self._node(key)
        return node if node is not None and self._stands(node, self.spare_m) else None

    def renew(self, keys: tuple[int, ...]) -> None:
        """Look for another configuration of a target whose goals are all blocked."""
        for key in keys:
            before = self._goals.get(key, [])
            if any(self._stands(goal) for goal in before):
                continue
            goal = self._clear_of(key)
            if goal is not None and self._is_joined(goal):
                others = [g for g in before if g is not goal]
                self._goals[key] = [goal, *others][: self.settings.goals_each]
            else:
                self._order(key)

    def work(self, pursued: int | None, allowance: Allowance | None = None) -> bool:
        """Do this frame's job; False where one waits for another frame.

        It may be for the exact pose of the target whose cell is `pursued`. `allowance`
        is what the frame may do; None: any job.
        """
        before = self._goals.get(pursued, [])
        if pursued is not None and not any(goal.kind == EXACT for goal in before):
            goal = self._clear_of(pursued)
            if goal is not None and self._is_joined(goal):
                self._goals[pursued] = [goal, *before][: self.settings.goals_each]
            elif self._job is None:
                self._order(pursued)
        if self._job is None:
            return True
        what, key, goal = self._job
        if allowance is not None:
            takes = allowance.takes
            if not allowance.grants(takes.solve if what == _SOLVE else takes.prepare):
                return False
        if what == _SOLVE:
            if self.finder.work(self._targets[key]) is not None:
                self._clear.pop(key, None)
            return True
        self._attached_at, self._joined = self._frame, goal
        self.attached += 1
        try:
            self.planner.prepare_goal(goal.q)
        except BadConfiguration:  # something else is in the hand, or stands about
            self.forget()
        return True

    def goals(self, keys: tuple[int, ...]) -> tuple[Goal, ...]:
        """Return the goals of the cells `keys`, best first, no configuration twice.

        What was offered of other cells is dropped.
        """
        for key in keys:  # spares
            if key not in self._goals:
                goal = self.ready(key)
                self._goals[key] = [] if goal is None else [goal]
        self._goals = {key: self._goals[key] for key in keys}
        once = {g.q.tobytes(): g for key in reversed(keys) for g in self._goals[key]}
        return tuple(
            g for key in keys for g in self._goals[key] if once[g.q.tobytes()] is g
        )

    def forget(self) -> None:
        """Forget all: the hand, the scenery or the clearance has changed."""
        self.finder.forget()
        self._goals.clear()
        self._clear.clear()
        self._joined = self._job = None

    # --- inside ----------------------------------------------------------------

    def _order(self, key: int) -> Offer:
        """Reserve this frame's costly job for a target, unless it is taken."""
        goal = self._clear_of(key)
        if goal is not None:
            since = self._frame - self._attached_at
            if self._job is None and since >= self.settings.connect_every:
                self._job = _PREPARE, key, goal
            return Offer.COMING
        if key not in self._targets or not self.finder.is_open(key):
            return Offer.NOT_NOW
        if self._job is None:
            self._job = _SOLVE, key, None
        return Offer.COMING

    def _clear_of(self, key: int) -> Goal | None:
        """Return a configuration that keeps clear, one that is joined before others."""
        trusted = self.settings.trusted
        when, goal = self._clear.get(key, (-trusted, None))
        if when == self._frame or (goal is None and self._frame - when < trusted):
            return goal
        known = self.finder.found(key)
        if not known or self._tests < len(known):
            return None
        goal = None
        for one in sorted(known, key=lambda g: not self._is_joined(g)):
            if self._stands(one, self.spare_m):
                goal = one
                break
        self._clear[key] = self._frame, goal
        return goal

    def _stands(self, goal: Goal, spare_m: float = 0.0) -> bool:
        """Whether it keeps clear of the person, with so much to spare [m]."""
        self._tests -= 1
        return self.planner.stands_clear(goal.q, spare_m)

    def _is_joined(self, goal: Goal) -> bool:
        return goal is self._joined or self.planner.is_prepared(goal.q)

    def _node(self, key: int) -> Goal | None:
        target = self._targets.get(key)
        if target is None:
            return None
        if not self.finder.knows_node(key):
            if self._lookups <= 0:
                return None
            self._lookups -= 1
        return self.finder.near_node(target)
