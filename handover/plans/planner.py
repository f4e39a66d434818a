"""plan_handover: from a scene to arm, grasps, pose and proved, timed motions."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans.choose import Pair, Report, Tuple, arms_in_order, tuples
from handover.plans.grasps import grasps_for
from handover.plans.limb import limb_of
from handover.plans.motions import (
    Blocked,
    MotionPlanner,
    PlannedMotion,
    home_of,
    timed,
)
from handover.plans.mover import Mover, mount_pose
from handover.plans.settings import PlanSettings
from handover.scenes.scene import Scene
from roadmap.ranges import check_number

LONGEST = 3600.0  # [s] time limit


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
        alternatives: Other tuples of H, best first.
        report: What was pruned where and why, and which step found the tuple.
    """

    scene: Scene
    found: bool
    reason: str = ""
    chosen: Tuple | None = None
    grasps_giver: GraspSet | None = None
    grasps_receiver: GraspSet | None = None
    motions: tuple[PlannedMotion, ...] = ()
    alternatives: tuple[Tuple, ...] = ()
    report: Report = field(default_factory=Report)

    @property
    def arm(self) -> str | None:
        """The giver's arm."""
        return self.chosen.arm if self.chosen else None

    @property
    def arm_receiver(self) -> str | None:
        """The receiver's arm."""
        return self.chosen.arm_receiver if self.chosen else None

    @property
    def grasp_giver(self) -> int | None:
        """The giver's grasp."""
        return self.chosen.grasp_giver if self.chosen else None

    @property
    def grasp_receiver(self) -> int | None:
        """The receiver's grasp."""
        return self.chosen.grasp_receiver if self.chosen else None

    @property
    def T_world_handover(self) -> np.ndarray | None:
        """The object's pose when it changes hands."""
        return self.chosen.T_world_handover if self.chosen else None

    @property
    def q_giver(self) -> np.ndarray | None:
        """The giver's arm and hand then."""
        return self.chosen.q_giver if self.chosen else None

    @property
    def q_receiver(self) -> np.ndarray | None:
        """The receiver's arm and hand then."""
        return self.chosen.q_receiver if self.chosen else None

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self.motions[-1].end if self.motions else 0.0

    def __bool__(self) -> bool:
        """Return whether there is a plan."""
        return self.found


class _Clock:
    """Ends a plan when its time is over; it decides nothing else."""

    def __init__(self, limit_s: float) -> None:
        self.begun, self.limit_s = time.perf_counter(), limit_s

    @property
    def over(self) -> bool:
        return time.perf_counter() - self.begun >= self.limit_s

    @property
    def spent(self) -> float:
        return time.perf_counter() - self.begun


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
    check_number("time_limit_s [s]", time_limit_s, 0.0, LONGEST)
    settings, report = settings or PlanSettings(), Report()
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
        limb.spec.name: (grasps or {}).get(limb.spec.name)
        or grasps_for(scene.obj, limb.spec, folder)
        for some in limbs.values()
        for limb in some.values()
    }
    return _Search(scene, settings, report, limbs, sets, time_limit_s).run(motions)


class _Search:
    """One search for a plan."""

    def __init__(self, scene, settings, report, limbs, sets, limit_s) -> None:
        self.scene, self.settings, self.report = scene, settings, report
        self.limbs, self.sets = limbs, sets
        self.clock = _Clock(limit_s)
        self.reason = ""
        self.best_failure = -1

    def run(self, motions: bool) -> HandoverPlan:
        report = self.report
        givers = self._givers()
        receivers = self._receivers()
        trouble = self._checked(givers, receivers)
        if trouble:
            return self._failed(trouble)
        for giver in givers:
            for receiver in receivers:
                pair = self._pair(giver, receiver)
                trouble = self._start_blocked(pair)
                if trouble:
                    return self._failed(trouble)
                plan = self._with(pair, motions)
                if plan is not None:
                    return plan
                if self.clock.over:
                    return self._failed(
                        f"the time limit of {self.clock.limit_s:g} s ended the plan "
                        f"after {report.poses[0]} poses and {report.tuples} tuples; "
                        "give more time, or bring the agents nearer"
                    )
        return self._failed(self.reason)

    # --- which arms -----------------------------------------------------------------

    def _givers(self) -> list[str]:
        limbs = self.limbs["giver"]
        mounts = {s: mount_pose(self.scene.giver, limb) for s, limb in limbs.items()}
        order, self.report.arm = arms_in_order(
            limbs, mounts, self._middle(self.scene.T_world_start), self._size
        )
        return order

    def _receivers(self) -> list[str]:
        limbs = self.limbs["receiver"]
        mounts = {s: mount_pose(self.scene.receiver, x) for s, x in limbs.items()}
        order, self._goal_told = arms_in_order(
            limbs, mounts, self._middle(self.scene.T_world_goal), self._size
        )
        return order

    @property
    def _size(self) -> float:
        return self.scene.obj.radius + 0.05  # [m] a voxel

    def _middle(self, T: np.ndarray) -> np.ndarray:
        return T[:3, :3] @ self.scene.obj.center + T[:3, 3]

    def _checked(self, givers: list[str], receivers: list[str]) -> str:
        scene = self.scene
        if not givers:
            return (
                f"the choice of an arm ended the plan: {self.report.arm} of "
                f"{scene.giver.agent.name}; bring the {scene.obj.name} nearer by that"
            )
        if not receivers:
            return (
                f"the goal ended the plan: {self._goal_told} of "
                f"{scene.receiver.agent.name}; bring the goal nearer by that"
            )
        return ""

    def _pair(self, giver: str, receiver: str) -> Pair:
        scene = self.scene
        one, other = self.limbs["giver"][giver], self.limbs["receiver"][receiver]
        return Pair(
            Mover(scene, scene.giver, one, scene.receiver, other),
            Mover(scene, scene.receiver, other, scene.giver, one),
            self.sets[one.spec.name],
            self.sets[other.spec.name],
        )

    def _start_blocked(self, pair: Pair) -> str:
        for mover, placed in (
            (pair.giver, self.scene.giver),
            (pair.receiver, self.scene.receiver),
        ):
            trouble = mover.why(home_of(placed, mover.limb))
            if trouble:
                return (
                    f"the start ended the plan: {placed.agent.name} is in collision "
                    f"where it waits, {trouble}; give it another posture or place"
                )
        return ""

    # --- tuples and motions -----------------------------------------------------------

    def _with(self, pair: Pair, motions: bool) -> HandoverPlan | None:
        """Return a plan with these arms; None: there is none, `reason` says why."""
        report, settings, begun = self.report, self.settings, self.clock.spent
        planner = MotionPlanner(self.scene, pair, settings) if motions else None
        stream, seen = tuples(self.scene, pair, settings, report), []
        moving = 0.0
        for chosen in stream:
            seen.append(chosen)
            report.tuples += 1
            if len(seen) > settings.tries:
                break
            if self.clock.over:
                return None
            begun_motions = self.clock.spent
            try:
                pieces = planner.of(chosen) if planner else []
            except Blocked as blocked:
                moving += self.clock.spent - begun_motions
                report.failed.append(f"tuple {len(seen)}: {blocked}")
                report.refused.append(chosen)
                continue
            done = timed(pieces, pair, chosen)
            moving += self.clock.spent - begun_motions
            report.step = chosen.step
            report.seconds |= {
                "choosing": self.clock.spent - begun - moving,
                "motions": moving,
            }
            more = max(0, settings.tuples - len(seen))
            others = [t for t in seen if t is not chosen]
            if more:
                others += islice(self._same_step(stream, chosen.step), more)
            report.tuples = len(others) + 1
            report.seconds["alternatives"] = (
                self.clock.spent - begun - sum(report.seconds.values())
            )
            return HandoverPlan(
                self.scene, True, "", chosen, pair.of_giver, pair.of_receiver, done,
                tuple(others), report,
            )  # fmt: skip
        self._explain(pair, len(seen))
        return None

    def _same_step(self, stream, step: str):
        for found in stream:
            if found.step != step or self.clock.over:
                return
            yield found

    def _explain(self, pair: Pair, n: int) -> None:
        """Keep the reason of the attempt that came farthest."""
        scene, grasps = self.scene, self.report.grasps
        sides = pair.giver.limb.side, pair.receiver.limb.side
        at_goal = grasps.get(f"receiver {sides[1]}, goal")
        at_start = grasps.get(f"giver {sides[0]}, start")
        thing = scene.obj.name
        if n:
            last = self.report.failed[-1] if self.report.failed else "not looked at"
            far, reason = (
                3,
                f"the motions ended the plan: none for {n} tuples, {last}; ",
            )
            reason += "give more room, or settings with more tries or budget"
        elif at_goal and not at_goal[1]:
            far, reason = 0, "pruning at the goal ended the plan: of "
            reason += f"{at_goal[0]} grasps of the {thing} none is left for the "
            reason += f"receiver's {sides[1]} hand ({_counts(at_goal[2])}); move the "
            reason += "goal, or clear what is round it"
        elif at_start and not at_start[1]:
            far, reason = 1, "pruning at the start ended the plan: of "
            reason += f"{at_start[0]} grasps of the {thing} none is left for the "
            reason += f"giver's {sides[0]} hand ({_counts(at_start[2])}); move the "
            reason += "object, or clear what is round it"
        else:
            looked, taken = self.report.poses
            far, reason = 2, f"the hand-over pose ended the plan: {looked} poses were "
            reason += (
                f"looked at, the receiver can take {taken} of them, and the giver "
            )
            reason += "none of those; bring the agents nearer to each other"
        if far > self.best_failure:
            self.best_failure, self.reason = far, reason

    def _failed(self, reason: str) -> HandoverPlan:
        return HandoverPlan(self.scene, False, reason, report=self.report)


def _counts(refused: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {why}" for why, n in refused.items()) or "none were there"
