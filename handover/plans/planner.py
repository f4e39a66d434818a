"""plan_handover: from a scene to arm, grasps, pose and proved, timed motions."""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans.choose import HandoverChoice, Pair, Report, arms_in_order, tuples
from handover.plans.grasps import grasps_for
from handover.plans.limb import limb_of
from handover.plans.motions import MotionPlanner, PlannedMotion, home_of, timed
from handover.plans.mover import Mover, has_hollows, mount_pose
from handover.plans.paths import Blocked, Clock, OutOfTime
from handover.plans.settings import PlanSettings
from handover.scenes.scene import Scene
from roadmap.ranges import check_kind, check_number, settings_of

LONGEST = 3600.0  # [s] time limit


def _of_chosen(name: str) -> property:
    """Return a property of a plan: what its tuple says, None where there is none."""
    return property(lambda plan: plan.chosen and getattr(plan.chosen, name))


@dataclass(frozen=True, eq=False)
class HandoverPlan:
    """A hand-over, or why there is none.

    Attributes:
        scene: What was planned.
        found: Whether there is a plan; else `reason` says which step ended it.
        reason: "" or a sentence.
        arm, arm_receiver: Sides of the arms.
        grasp_giver, grasp_receiver: Numbers in `grasps_giver`, `grasps_receiver`.
        grasps_giver, grasps_receiver: The sets.
        T_world_handover: (4, 4) the object when it changes hands [m].
        q_giver, q_receiver: (dof,) arms and hands then.
        chosen: The tuple of H.
        motions: In order of time; each begins where the last one of its agent ended.
        report: What was pruned where and why, and which step found the tuple.
        others: Looks for the `alternatives`.
    """

    scene: Scene
    found: bool
    reason: str = ""
    chosen: HandoverChoice | None = None
    grasps_giver: GraspSet | None = None
    grasps_receiver: GraspSet | None = None
    motions: tuple[PlannedMotion, ...] = ()
    report: Report = field(default_factory=Report)
    others: Callable[[], tuple[HandoverChoice, ...]] = tuple

    @property
    def alternatives(self) -> tuple[HandoverChoice, ...]:
        """Other tuples of H, best first; they are looked for when first asked for."""
        return self.others()

    arm, arm_receiver = _of_chosen("arm"), _of_chosen("arm_receiver")
    grasp_giver = _of_chosen("grasp_giver")
    grasp_receiver = _of_chosen("grasp_receiver")
    T_world_handover = _of_chosen("T_world_handover")
    q_giver, q_receiver = _of_chosen("q_giver"), _of_chosen("q_receiver")

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.motions[-1].end if self.motions else 0.0

    def __bool__(self) -> bool:
        return self.found


def plan_handover(
    scene: Scene,
    time_limit_s: float = 2.0,
    *,
    settings: PlanSettings | None = None,
    grasps: Mapping[str, GraspSet] | None = None,
    folder: Path | None = None,
    motions: bool = True,
) -> HandoverPlan:
    """Plan a hand-over, as [Huaman2014], with every motion proved.

    Args:
        scene: Agents, object, start, goal, furniture.
        time_limit_s: When to give up [s]. A plan that is found in time does not
            depend on it.
        settings: See PlanSettings.
        grasps: Hand -> grasps of the object; those left out are taken from `folder`.
        folder: Where grasp sets are stored; one that is missing is made, once.
        motions: False: only the tuple is chosen.

    Returns:
        The plan; where there is none, `found` is False and `reason` says which step
        ended it and what would change it.

    Raises:
        BadInput: A time limit that is none.
    """
    check_kind("a scene", scene, Scene, "give what handover.load_scene returns")
    check_number("time_limit_s [s]", time_limit_s, 0.0, LONGEST)
    settings, report = settings_of(settings, PlanSettings), Report()
    if time_limit_s == 0.0:
        return HandoverPlan(
            scene,
            False,
            "the time limit of 0 s ended the plan before the first step, the choice of "
            "an arm; give some seconds",
            report=report,
        )
    limbs = {
        who: {side: limb_of(placed.agent, side) for side in placed.arms}
        for who, placed in (("giver", scene.giver), ("receiver", scene.receiver))
    }
    sets = {
        limb.spec: (grasps or {}).get(limb.spec.name)
        or grasps_for(scene.obj, limb.spec, folder)
        for some in limbs.values()
        for limb in some.values()
    }
    return _Search(scene, settings, report, limbs, sets, time_limit_s).run(motions)


class _Tried:
    """The tuples whose motions were looked for, and those that are put off."""

    def __init__(self, planner: MotionPlanner, report: Report) -> None:
        self.planner, self.report = planner, report
        self.seen: list[HandoverChoice] = []
        self._put_off: list[tuple[int, HandoverChoice]] = []
        # those with the grasp at hand
        self._fresh: list[tuple[int, HandoverChoice]] = []
        self._grasp = -1
        self._refused: set[int] = set()  # of tuples that are kept in the report
        self.seconds = 0.0

    def once(self, chosen: HandoverChoice, clock: Clock) -> tuple | None:
        """Look for a tuple's motions with a small budget.

        Tuples with another grasp of the receiver are less dexterous: before the first
        of them, what was put off gets more.
        """
        begun, found, settings = clock.spent, None, self.planner.settings
        try:
            if chosen.grasp_receiver != self._grasp:
                self._grasp = chosen.grasp_receiver
                middle = int((settings.first_budget * settings.budget) ** 0.5)
                found = self._first(self._fresh[:1], middle)
                self._fresh = []
            return found or self._first(
                [(len(self.seen), chosen)], settings.first_budget
            )
        finally:
            self.seconds += clock.spent - begun

    def again(self, budget: int) -> tuple | None:
        """Look for the motions of all that were put off."""
        return self._first(self._put_off, budget)

    def _first(self, those: list, budget: int) -> tuple | None:
        for number, chosen in list(those):
            try:
                found = self.planner.of(chosen, budget)
                self.report.refused[:] = [
                    t for t in self.report.refused if t is not chosen
                ]
                return found
            except Blocked as blocked:
                self.report.failed.append(f"tuple {number}: {blocked}")
                self.planner.tell_hopeless(chosen, self.report)
                if id(chosen) not in self._refused:
                    self._refused.add(id(chosen))
                    self.report.refused.append(chosen)
                if not (blocked.searched or blocked.more):
                    continue
                if (number, chosen) not in self._put_off:
                    self._put_off.append((number, chosen))
                    self._fresh += [(number, chosen)] * blocked.searched
        return None


class _Others:
    """The other tuples of H, made when they are asked for."""

    def __init__(
        self, stream, tried: _Tried, used: HandoverChoice, most: int, report
    ) -> None:
        self._stream, self._most, self._report = stream, most, report
        self._step, self._found = used.step, None
        index = [k for k, t in enumerate(tried.seen) if _same(t, used)]
        self._seen = [t for k, t in enumerate(tried.seen) if k not in index]

    def __call__(self) -> tuple[HandoverChoice, ...]:
        """Return them, best first."""
        if self._found is None:
            begun, others = time.perf_counter(), list(self._seen)
            for found in self._stream:
                if found.step != self._step or len(others) + 1 >= self._most:
                    break
                others.append(found)
            self._found = tuple(others)
            self._report.tuples = len(others) + 1
            self._report.seconds["alternatives"] = time.perf_counter() - begun
        return self._found


def _same(one: HandoverChoice, other: HandoverChoice) -> bool:
    return (
        one.grasp_giver == other.grasp_giver
        and one.grasp_receiver == other.grasp_receiver
        and one.T_world_handover is other.T_world_handover
    )


class _Search:
    """One search for a plan."""

    def __init__(self, scene, settings, report, limbs, sets, limit_s) -> None:
        self.scene, self.settings, self.report = scene, settings, report
        self.limbs, self.sets = limbs, sets
        self.clock = Clock(limit_s)
        self.reason, self.late = "", ""
        self.best_failure, self.found = -1, False

    def run(self, motions: bool) -> HandoverPlan:
        scene, report = self.scene, self.report
        givers, report.arm = self._arms("giver", scene.T_world_start)
        receivers, goal_told = self._arms("receiver", scene.T_world_goal)
        if not givers:
            return self._failed(
                f"the choice of an arm ended the plan: {report.arm} of "
                f"{scene.giver.agent.name}; bring the {scene.obj.name} nearer by that"
            )
        if not receivers:
            return self._failed(
                f"the goal ended the plan: {goal_told} of "
                f"{scene.receiver.agent.name}; bring the goal nearer by that"
            )
        for giver in givers:
            for receiver in receivers:
                pair = self._pair(giver, receiver)
                trouble = self._start_blocked(pair)
                if trouble:
                    return self._failed(trouble)
                trouble = self._goal_blocked(pair)
                if trouble:
                    self._keep(0, trouble)
                    continue
                plan = self._with(pair, motions)
                if plan is not None:
                    return plan
                if self.clock.over:
                    return self._failed(
                        f"the time limit of {self.clock.limit_s:g} s ended the plan in "
                        f"{self.late or 'the choice of arms'}, after "
                        f"{report.poses[0]} poses and {report.tuples} tuples; give "
                        "more time, or bring the agents nearer"
                    )
        return self._failed(self.reason)

    # --- which arms -----------------------------------------------------------------

    def _arms(self, who: str, T_world_object: np.ndarray) -> tuple[list[str], str]:
        """Return an agent's arms that reach the object there, best first, and why."""
        placed, limbs, thing = getattr(self.scene, who), self.limbs[who], self.scene.obj
        mounts = {side: mount_pose(placed, limb) for side, limb in limbs.items()}
        middle = T_world_object[:3, :3] @ thing.center + T_world_object[:3, 3]
        return arms_in_order(limbs, mounts, middle, thing.radius + 0.05)  # [m] a voxel

    def _pair(self, giver: str, receiver: str) -> Pair:
        scene = self.scene
        one, other = self.limbs["giver"][giver], self.limbs["receiver"][receiver]
        return Pair(
            Mover(scene, scene.giver, one, scene.receiver, other),
            Mover(scene, scene.receiver, other, scene.giver, one),
            self.sets[one.spec],
            self.sets[other.spec],
        )

    def _start_blocked(self, pair: Pair) -> str:
        for mover, placed in (
            (pair.giver, self.scene.giver),
            (pair.receiver, self.scene.receiver),
        ):
            _, trouble = mover.why(home_of(placed, mover.limb))
            if trouble:
                return (
                    f"the start ended the plan: {placed.agent.name} is in collision "
                    f"where it waits, {trouble}; give it another posture or place"
                )
        return ""

    def _goal_blocked(self, pair: Pair) -> str:
        """Say what the object would touch at the goal, whoever's hand holds it."""
        thing, receiver = self.scene.obj.name, self.scene.receiver.agent.name
        trouble = pair.receiver.object_blocked(self.scene.T_world_goal)
        if trouble is None:
            return ""
        trouble = trouble.replace("object", f"the {thing}", 1)
        trouble = trouble.replace("own ", f"{receiver}'s ", 1)
        return (
            f"the goal ended the plan: there {trouble}, however it is held; move the "
            "goal away from that"
        )

    # --- tuples and motions -----------------------------------------------------------

    def _with(self, pair: Pair, motions: bool) -> HandoverPlan | None:
        """Return a plan with these arms; None: there is none, `reason` says why."""
        report, settings, begun = self.report, self.settings, self.clock.spent
        stream = tuples(self.scene, pair, settings, report, self._late)
        tried = _Tried(MotionPlanner(self.scene, pair, settings, self.clock), report)
        found, chosen = None, None
        try:
            for chosen in self._counted(stream, tried.seen):
                found = tried.once(chosen, self.clock) if motions else ([], chosen)
                if found:
                    break
            else:
                found = tried.again(settings.budget) if motions else None
        except OutOfTime as late:
            self.late = str(late)
            return None
        if found is None:
            self._explain(pair, len(tried.seen))
            return None
        moving = self.clock.spent
        self.found = True
        pieces, used = found
        done = timed(pieces, pair)
        tried.seconds += self.clock.spent - moving
        report.step = used.step
        report.seconds |= {
            "choosing": self.clock.spent - begun - tried.seconds,
            "motions": tried.seconds,
        }
        return HandoverPlan(
            self.scene, True, "", used, pair.of_giver, pair.of_receiver, done, report,
            _Others(stream, tried, used, settings.tuples, report),
        )  # fmt: skip

    def _late(self) -> bool:
        """Return whether the time is over; a plan's other tuples are not cut by it."""
        return not self.found and self.clock.over

    def _counted(
        self, stream: Iterator[HandoverChoice], seen: list
    ) -> Iterator[HandoverChoice]:
        for chosen in islice(stream, self.settings.tries):
            seen.append(chosen)
            self.report.tuples += 1
            if self.clock.over:
                raise OutOfTime("the choice of grasps and pose")
            yield chosen

    def _explain(self, pair: Pair, n: int) -> None:
        """Keep the reason of the attempt that came farthest."""
        scene, grasps = self.scene, self.report.grasps
        sides = pair.giver.limb.side, pair.receiver.limb.side
        at_goal = grasps.get(f"receiver {sides[1]}, goal")
        at_start = grasps.get(f"giver {sides[0]}, start")
        thing = scene.obj.name
        if n:
            last = self.report.failed[-1] if self.report.failed else "not looked at"
            far, reason = 3, (
                f"the motions ended the plan: none for {n} tuples, {last}; give more "
                "room, or settings with more tries or budget"
            )  # fmt: skip
        elif at_goal and not at_goal[1]:
            far, reason = 0, (
                f"pruning at the goal ended the plan: of {at_goal[0]} grasps of the "
                f"{thing} none is left for the receiver's {sides[1]} hand "
                f"({_counts(at_goal[2])}); move the goal, or clear what is round it"
            )  # fmt: skip
        elif at_start and not at_start[1]:
            far, reason = 1, (
                f"pruning at the start ended the plan: of {at_start[0]} grasps of the "
                f"{thing} none is left for the giver's {sides[0]} hand "
                f"({_counts(at_start[2])}); move the object, or clear what is round it"
            )  # fmt: skip
        else:
            looked, taken = self.report.poses
            far, reason = 2, (
                f"the hand-over pose ended the plan: {looked} poses were looked at, "
                f"the receiver can take {taken} of them, and the giver none of those; "
                "bring the agents nearer to each other"
            )  # fmt: skip
        self._keep(far, reason)

    def _keep(self, far: int, reason: str) -> None:
        """Keep why an attempt failed if none came farther."""
        if far > self.best_failure:
            self.best_failure, self.reason = far, reason

    def _failed(self, reason: str) -> HandoverPlan:
        hollow = [f.name for f in self.scene.scenery if has_hollows(f.shape)]
        if hollow:
            reason += (
                f"; {hollow[0]} counts as its hull: give it as convex parts where its "
                "hollows matter"
            )
        return HandoverPlan(self.scene, False, reason, report=self.report)


def _counts(refused: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {why}" for why, n in refused.items()) or "none were there"
