"""LiveTargets: in every frame, pursue the best target that the planner can reach.

A* replans toward the top-ranked target of the interaction workspace, while the person
moves.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from handover.human.human import Human
from handover.meet.constraints import ClearOf
from handover.meet.workspace import MOST_RANKED, InteractionWorkspace, Target
from handover.targets.allowance import Allowance
from handover.targets.node_index import NodeIndex
from handover.targets.settings import LiveSettings
from handover.targets.target_choice import TargetChoice
from handover.targets.target_goals import Goal, TargetGoals
from handover.targets.target_offers import TargetOffers
from odm.answer import Answer
from odm.checks import check_numbers
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.scenery import Scenery
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.ranges import check_kind, settings_of
from roadmap.robot.robot import Robot

THERE, UNDER_WAY, BLOCKED, NOBODY = "there", "on the way", "blocked", "no target"
WITHDRAWN = "withdrawn"
_ARRIVED = 1e-6  # largest joint difference at which a goal is reached


def with_arm_at_rest(human: Human, side: str) -> Human:
    """Return a person whose arm of a side hangs down; see `LiveSettings.from_rest`."""
    others = {k: v for k, v in human.arms.items() if k != side}
    return replace(human, arms=others)


@dataclass(frozen=True)
class Pursuit:
    """State of the pursuit in one frame.

    Attributes:
        state: "there", "on the way", "blocked" (there are targets, none can be reached
            now), "no target" or "withdrawn" (at its place of rest or on the way back).
        key: Cell of the target it is at or on the way to; None: none.
        kind: "node" or "exact", of its goal; empty: none.
        quality: Of that target now; 0: none.
        best: Quality of the best target of the frame; 0: there is none.
        targets: Targets looked at.
        goals: Goals the planner has.
        set_goals: Whether they changed in this frame.
        missing_m: Where there is no target: how much nearer the person must come [m].
        touched: Whether the person is within the robot's clearance: whatever its goals
            are, it stands or gets out of the way.
    """

    state: str
    key: int | None
    kind: str
    quality: float
    best: float
    targets: int
    goals: int
    set_goals: bool
    missing_m: float = 0.0
    touched: bool = False


class LiveTargets:
    """Lets a reactive planner pursue the best reachable target of a moving person.

    Call `step` where you would call the planner's own. Its goals are then the targets,
    best first; without any target the robot goes to its place of rest, and between
    `withdraw` and `resume`, too.

    Args:
        planner: The planner; its goals are set here only.
        meet: The interaction workspace of the planner's robot.
        rest: (dof,) where the robot waits while there is no target; None: where it is
            at the first step.
        index: Nodes of the planner's roadmap by pose of the tool; None: made here.
        settings: See LiveSettings.

    Attributes:
        pursuit: See Pursuit; of the last frame.
        goals: The planner's goals, best first; empty at rest.
        withdrawn: Whether it goes to its place of rest, or stays there, whatever
            targets there are.
        told_larger: How much larger the planner's `step` is told people are than they
            really are [m]; the spare distance shrinks by that.
        counts: "frames", "changes" of the target pursued, "set_goals", "attached".

    Raises:
        BadInput: The workspace is another robot's, or the index another map's, or
            `rest` is no configuration.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        meet: InteractionWorkspace,
        rest: np.ndarray | None = None,
        index: NodeIndex | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        s = self.settings = settings_of(settings, LiveSettings)
        check_kind("planner", planner, ReactivePlanner, "give an odm.ReactivePlanner")
        check_kind("meet", meet, InteractionWorkspace, "give an InteractionWorkspace")
        if rest is not None:
            rest = check_numbers(planner.robot, rest, "rest")
        self.planner, self.meet, self.rest = planner, meet, rest
        self.choice = TargetChoice(s.choice)
        self.finder = TargetGoals(planner, meet, index, s)
        self.goals: tuple[Goal, ...] = ()
        self.counts = Counter(frames=0, changes=0, set_goals=0, attached=0)
        self.pursuit = Pursuit(NOBODY, None, "", 0.0, 0.0, 0, 0, False)
        self.offers = TargetOffers(planner, self.finder)
        self.withdrawn = False
        self.told_larger = 0.0
        self._targets: dict[int, Target] = {}
        self._worth: dict[int, float] = {}
        self._chosen = self.settings.choices  # frames since the last ranking
        self._pursued: Goal | None = None
        self._last_key: int | None = None
        self._touched = False  # the person is within the clearance of the robot
        self._outdated = False  # the goals are of the person's other arm
        self._best = 0.0
        # of the last ranking, those at which the arm would be in what stands still
        self._in_the_way: set[int] = set()
        self._world: object = None  # whose base was compared with the workspace's
        self._things: dict | None = None  # the scene's, and their boxes
        self._stands = ClearOf(Scenery())
        self._blocked = 0  # frames without a target that can be reached

    def step(
        self,
        human: Human,
        points: np.ndarray | Obstacles,
        q: np.ndarray,
        **options: object,
    ) -> Answer:
        """Answer one frame: rank the targets, set the goals, plan.

        Args:
            human: The person now, world frame.
            points: (n, 3) points of all obstacles, the person too, base frame [m]; or
                `odm.Obstacles`, as of `human.obstacles()`.
            q: (dof,) present configuration [rad or m].
            options: Further arguments of `ReactivePlanner.step`.

        Raises:
            BadInput: `planner.set_base` puts the base elsewhere than the workspace has
                it, so that the person and the points are of two worlds.
        """
        if self.planner.world is not self._world:
            _check_base(self.planner.world.T_world_base, self.meet)
            self._world = self.planner.world
        self.look(human, q)
        answer = self.planner.step(points, q=q, **options)
        self.note(answer, q)
        return answer

    @property
    def targets(self) -> tuple[Target, ...]:
        """Targets of the last frame, best first; empty before the first one."""
        return tuple(self._targets.values())

    def look(
        self, human: Human, q: np.ndarray, allowance: Allowance | None = None
    ) -> None:
        """Rank the targets of a person and set the planner's goals, if they change.

        Goals are the same if their configurations are; their order ranks them, and
        they have no costs.

        Args:
            human: The person now, world frame.
            q: (dof,) present configuration [rad or m].
            allowance: What the frame may do of a ranking that goes on over several, and
                of goals joined ahead; None: as much as the settings say.

        Raises:
            BadInput: No person, no configuration, or an allowance that is none.
        """
        check_kind("human", human, Human, "give a handover.Human")
        if allowance is not None:
            check_kind("allowance", allowance, Allowance, "give an Allowance or None")
        if self.rest is None:
            self.rest = _within_limits(self.planner.robot, q)
        if self.settings.near_rest:
            self.finder.rest = self.rest
        self.counts["frames"] += 1
        busy = self.withdrawn or self._pursued is not None
        self._blocked = 0 if busy else self._blocked + 1
        self._changed = False
        self.finder.look_again(allowance)
        if self.withdrawn and (self.goals or not self.counts["set_goals"]):
            self._give_up_targets(allowance)
            return
        if not self._rank(human, allowance) or self.withdrawn:
            return
        targets = list(self._targets.values())
        known = self._known()
        self._worth = {t.key: t.quality for t in known}
        if self._touched:
            return  # whatever the goals are, it cannot leave
        pursued = None if self._pursued is None else self._pursued.key
        goals = self._choose(targets, known, pursued)
        self._outdated = False
        self._changed = [g.q.tobytes() for g in goals] != [
            g.q.tobytes() for g in self.goals
        ] or not self.counts["set_goals"]
        wanted = [g.q for g in goals] or [self.rest]
        if not self._changed or all(map(self.planner.is_prepared, wanted)):
            # else this frame has to join one of them
            if not self.offers.work(pursued, allowance):
                self._chosen -= 1  # it is done in another one, before the next ranking
            self.counts["attached"] = self.offers.attached
        if self._changed:
            self.counts["set_goals"] += 1
            goals = self._set_valid(goals)
            if allowance is not None:
                allowance.spend(allowance.takes.set_goals)
        self.goals = goals

    def _give_up_targets(self, allowance: Allowance | None) -> None:
        """Have the place of rest for a goal: a costly job, no other in this frame."""
        self._changed = True
        self.counts["set_goals"] += 1
        self.goals = self._set_valid(())
        if allowance is not None:
            allowance.spend(allowance.takes.set_goals)

    def withdraw(self) -> None:
        """Go to the place of rest from the next frame on, and stay there.

        The way is planned and tested as any other; targets are ranked meanwhile.
        """
        self.withdrawn = True

    def resume(self) -> None:
        """Pursue targets again from the next frame on; the one before, if it stands."""
        self.withdrawn = False

    def _rank(self, human: Human, allowance: Allowance | None) -> bool:
        """Rank the targets, or go on with that; return whether there is time to choose.

        A frame of a ranking over several does nothing else that is costly.
        """
        s, meet = self.settings, self.meet
        if not s.rank_budget:
            meet.update(self._as_judged(human))
            self._take_ranked(meet.best(self._depth()))
            return True
        if meet.is_ranking:
            budget = s.rank_budget
            if allowance is not None:
                budget = allowance.share(budget)
            if meet.go_on(budget):
                self._take_ranked(meet.ranked())
                self._chosen = 0
            return False
        # more of them while there is nothing to go to: each may find a configuration
        if self._chosen < s.choices * (1 if self._pursued is not None else s.idle):
            self._chosen += 1
            return True
        meet.update(self._as_judged(human))
        meet.begin(self._depth())
        if allowance is not None:
            allowance.spend(allowance.takes.rank)
        return False

    def _as_judged(self, human: Human) -> Human:
        """Return the person from whose arm the way of the hand counts."""
        if not self.settings.from_rest:
            return human
        return with_arm_at_rest(human, self.meet.settings.side)

    def _take_ranked(self, ranked: list[Target]) -> None:
        targets = self.meet.takeable(ranked, self._scene())
        self._in_the_way = {t.key for t in ranked} - {t.key for t in targets}
        self._best = targets[0].quality if targets else 0.0
        if self.settings.near_rest:
            targets = self._least_turned_first(targets)
        self._targets = {t.key: t for t in targets}

    def _scene(self) -> ClearOf:
        """Return what the planner's scene adds to the map, made anew as it changes."""
        things = self.planner.carrier.things
        if things is not self._things:
            T_world_base = self.meet.settings.T_world_base
            self._things = things
            self._stands = ClearOf.of_scene(self.planner, T_world_base)
        return self._stands

    def _least_turned_first(self, targets: list[Target]) -> list[Target]:
        """Return targets by quality; alike, those first that turn the tool least."""
        T_world_base = self.meet.settings.T_world_base
        R = (T_world_base @ tool_pose(self.planner.robot, self.rest))[:3, :3]
        alike = self.settings.alike

        def rank(target: Target) -> tuple[float, float]:
            # the trace of a rotation is 1 + 2 cos of its angle
            cosine = float(np.sum(R * target.T_world_tool[:3, :3]))
            return -round(target.quality, alike), -cosine

        return sorted(targets, key=rank)

    def _choose(
        self, targets: list[Target], known: list[Target], pursued: int | None
    ) -> tuple[Goal, ...]:
        """Return the goals of this frame, of the targets it has and those on offer."""
        offers, s = self.offers, self.settings
        spare = 0.0 if self._blocked > s.spare_frames else s.spare_m
        offers.spare_m = max(0.0, spare - self.told_larger)
        offers.begin(self._targets | {t.key: t for t in known})
        offers.renew(tuple(self._worth))
        keys = self.choice.decide(
            [(t.key, t.quality) for t in targets],
            self._worth,
            pursued,
            offers.offer,
            lambda key: offers.ready(key) is not None,
        )
        self._worth |= {t.key: t.quality for t in targets}
        return offers.goals(keys)

    def _set_valid(self, goals: tuple[Goal, ...]) -> tuple[Goal, ...]:
        """Set the planner's goals; leave out those that have become invalid."""
        try:
            self._set_goals(goals)
        except BadConfiguration:  # something else is in the hand, or stands about
            self.offers.forget()
            goals = tuple(g for g in goals if self._can_be(g.q))
            if goals or self._can_be(self.rest):
                self._set_goals(goals)
        return goals

    def _set_goals(self, goals: tuple[Goal, ...]) -> None:
        self.planner.set_goals([g.q for g in goals] or [self.rest])

    def _can_be(self, q: np.ndarray) -> bool:
        planner = self.planner
        return planner.static.why(q, np.zeros_like(q)) is None

    def note(self, answer: Answer, q: np.ndarray) -> None:
        """Update `pursuit` by the planner's answer to these goals."""
        at = answer.goal if self.goals and answer.goal is not None else None
        goal = self._pursued = None if at is None or at < 0 else self.goals[at]
        planner = self.planner
        self._touched = answer.status == "holding" and bool(
            planner.separation(q) < planner.keep
        )
        if goal is None:
            state = BLOCKED if self.goals or self._targets else NOBODY
            state = WITHDRAWN if self.withdrawn and not self.goals else state
            missing = 0.0 if self._targets else self.meet.missing_m
            found = (state, None, "", 0.0)
        else:
            left = self._last_key is not None and goal.key != self._last_key
            self.counts["changes"] += left  # the first choice leaves none
            self._last_key = goal.key
            off = np.abs(difference(self.planner.robot, q, goal.q)).max()
            there = off <= _ARRIVED and not self._outdated
            state = THERE if there else UNDER_WAY
            missing = 0.0
            found = (state, goal.key, goal.kind, self._worth.get(goal.key, 0.0))
        self.pursuit = Pursuit(
            *found,
            self._best,
            len(self._targets),
            len(self.goals),
            self._changed,
            missing,
            self._touched,
        )

    def expect(self, side: str) -> None:
        """Look for targets of the person's other arm: "left" or "right".

        All are ranked anew; what was found for the robot stays.
        """
        self.meet.expect(side)
        self._targets, self._chosen = {}, self.settings.choices * self.settings.idle
        self._outdated = True

    def put_off(self) -> None:
        """Try other targets first: the robot cannot get on to the one it pursues."""
        if self._pursued is not None:
            self.choice.put_off(self._pursued.key)
            self._pursued = None

    # --- inside ----------------------------------------------------------------

    def _depth(self) -> int:
        """Return how many targets to consider: more, the longer it is blocked.

        And as many more as the last ranking had that nobody can take.
        """
        ranked, choice, deepest = (
            self.settings.ranked,
            self.settings.choice,
            self.settings.deepest,
        )
        more = self._blocked // (choice.untried_frames * choice.goals)
        in_the_way = min(len(self._in_the_way), ranked * deepest)
        return min(ranked * min(1 + more, deepest) + in_the_way, MOST_RANKED)

    def _known(self) -> list[Target]:
        """Return the targets on offer with their quality now; those gone left out."""
        keys = [key for key in self.choice.keys if key not in self._in_the_way]
        away = [key for key in keys if key not in self._targets]
        rated = self.meet.rated(away) if away else []
        both = self._targets | {t.key: t for t in rated if t is not None}
        return [both[key] for key in keys if key in both]


def _check_base(T_world_base: np.ndarray, meet: InteractionWorkspace) -> None:
    """Refuse a planner's base (4, 4) that stands elsewhere than a workspace's."""
    here, there = T_world_base, meet.settings.T_world_base
    if np.array_equal(here, np.eye(4)) or np.allclose(here, there, rtol=0, atol=1e-6):
        return
    raise BadInput(
        f"the base stands at {np.round(here[:3, 3], 3)} m by planner.set_base and at "
        f"{np.round(there[:3, 3], 3)} m by the workspace, or is turned otherwise; give "
        "MeetSettings the same T_world_base, or call planner.set_base(np.eye(4)) and "
        "tell the planner all in the base's frame"
    )


def _within_limits(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return q (dof,), or what is nearest to it within the joints' limits."""
    lower = np.where(robot.continuous, -np.inf, robot.lower)
    upper = np.where(robot.continuous, np.inf, robot.upper)
    return np.clip(check_numbers(robot, q), lower, upper)
