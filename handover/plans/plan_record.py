"""A plan as plain data, by the writer of `handover.scenes.plan_file`."""

import numpy as np

from handover.plans.choose import HandoverChoice
from handover.plans.motions import PlannedMotion
from handover.plans.planner import HandoverPlan
from handover.scenes.plan_file import Hold, TimedMotion, hand_links, plan_record
from roadmap.errors import BadInput
from roadmap.motion.motion import Motion

_RATE_HZ = 20.0
_NEVER = 1e-7  # [s] times nearer than this are one


def record_of(plan: HandoverPlan) -> dict:
    """Return a plan as plain data, see `docs/plans.md`.

    Between its times all joints go straight: every corner of a path is a time.
    """
    if not plan.found or not plan.motions:
        raise BadInput(
            f"there is nothing to write: {plan.reason or 'motions were not planned'}"
        )
    motions = [_timed(motion) for motion in plan.motions]
    report = plan.report
    return plan_record(
        plan.scene,
        motions,
        _holds(plan),
        chosen=tuple_facts(plan.chosen),
        alternatives=[tuple_facts(other) for other in plan.alternatives],
        grasps={"giver": plan.grasps_giver.hash, "receiver": plan.grasps_receiver.hash},
        report=report_facts(plan),
        step=report.step,
    )


def tuple_facts(chosen: HandoverChoice) -> dict:
    """Return a tuple of H as plain data."""
    return {
        "arm": chosen.arm,
        "arm_receiver": chosen.arm_receiver,
        "grasp_giver": int(chosen.grasp_giver),
        "grasp_receiver": int(chosen.grasp_receiver),
        "T_world_handover": chosen.T_world_handover.tolist(),
        "q_giver": chosen.q_giver.tolist(),
        "q_receiver": chosen.q_receiver.tolist(),
        "dexterity": float(chosen.dexterity),
        "dexterity_giver": float(chosen.dexterity_giver),
        "step": chosen.step,
    }


def report_facts(plan: HandoverPlan) -> dict:
    """Return what was pruned where and why, without the seconds that it took."""
    report = plan.report
    return {
        "arm": report.arm,
        "grasps": {
            where: {"of": total, "left": left, "refused": dict(refused)}
            for where, (total, left, refused) in report.grasps.items()
        },
        "poses": {"looked at": report.poses[0], "receiver can take": report.poses[1]},
        "tuples": report.tuples,
        "step": report.step,
        "failed": list(report.failed),
    }


def _timed(motion: PlannedMotion) -> TimedMotion:
    times = _times(motion.motion)
    rows = motion.motion.sample(times).q
    return TimedMotion(
        motion.name, motion.who, motion.joints, motion.begin + times, rows
    )


def _times(motion: Motion) -> np.ndarray:
    """Return times [s] of even samples, and those at which corners are passed."""
    end = motion.duration
    corners = [_when(motion, piece.end) for piece in motion.path.pieces[:-1]]
    even = np.arange(0.0, end, 1.0 / _RATE_HZ)
    times = np.unique(np.r_[even, corners, end])
    # a corner's own time is kept, not the even one beside it
    fixed = np.isin(times, np.r_[0.0, corners, end])
    near = np.diff(times) < 1e-4
    drop = np.r_[False, near & ~fixed[1:]] | np.r_[near & ~fixed[:-1], False]
    return times[~drop]


def _when(motion: Motion, s: float) -> float:
    low, high = 0.0, motion.duration
    while high - low > _NEVER:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if motion.place(middle) < s else (low, middle)
    return high


def _holds(plan: HandoverPlan) -> list[Hold]:
    """Return who holds the object when: the table, the giver, both, the receiver."""
    scene, chosen = plan.scene, plan.chosen
    at = {(m.who, m.name): m for m in plan.motions}
    picked, taken = at["giver", "pick"].end, at["receiver", "take"].end
    released, placed = at["giver", "release"].begin, at["receiver", "place"].end
    held = {
        who: np.linalg.inv(grasps.T_object_palm[g])
        for who, grasps, g in (
            ("giver", plan.grasps_giver, chosen.grasp_giver),
            ("receiver", plan.grasps_receiver, chosen.grasp_receiver),
        )
    }
    holds = [Hold("world", "", scene.T_world_start, 0.0, picked)]
    for who, side, begin, end in (
        ("giver", chosen.arm, picked, released),
        ("receiver", chosen.arm_receiver, taken, None if scene.goal_held else placed),
    ):
        agent = getattr(scene, who)
        spec = agent.agent.arms[side].spec
        T = spec.T_link_palm @ held[who]
        links = hand_links(agent, side)
        holds.append(Hold(who, spec.palm, T, begin, end, links))
    if not scene.goal_held:
        holds.append(Hold("world", "", scene.T_world_goal, placed, None))
    return holds
