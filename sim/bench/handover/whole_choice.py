"""All of H, as Algorithms 1 to 3 of [Huaman2014] are written: no order, no short cut.

What the planner's choice is compared with, and what the paper's tables count. Every
grasp is tested wherever it is asked for, in the set's order.
"""

from dataclasses import dataclass

import numpy as np

from handover.plans.choose import Pair, handover_poses, steps_of
from handover.plans.prune import Executed, prune_grasps
from handover.plans.settings import PlanSettings
from handover.scenes.scene import PlacedAgent, Scene


@dataclass(frozen=True)
class Whole:
    """H of a pair of arms, and what was counted on the way.

    Attributes:
        step: The first step of the search in which H is not empty, "" for none.
        giver, receiver: Grasps left at the start and at the goal.
        poses: Hand-over poses of the step that are in H.
        tuples: (receiver's grasp, giver's grasp, number of the pose, receiver's
            dexterity at the goal, giver's at the hand-over) of each.
    """

    step: str
    giver: int
    receiver: int
    poses: int
    tuples: list[tuple[int, int, int, float, float]]

    @property
    def best(self) -> float:
        """The largest dexterity of the receiver at the goal."""
        return max(row[3] for row in self.tuples)


def whole_choice(scene: Scene, pair: Pair, settings: PlanSettings) -> Whole:
    """Return H of two arms, as [Huaman2014] makes it, widened step by step."""
    giver, receiver = pair.giver, pair.receiver
    waits = {
        "giver": _waiting(scene.giver, giver.limb.joints),
        "receiver": _waiting(scene.receiver, receiver.limb.joints),
    }
    receiver.put_other(waits["giver"])
    receiver.put_object(scene.T_world_goal)
    receiver.let_touch()
    goals = prune_grasps(receiver, pair.of_receiver, scene.T_world_goal)
    giver.put_other(waits["receiver"])
    giver.put_object(scene.T_world_start)
    giver.let_touch()
    starts = prune_grasps(giver, pair.of_giver, scene.T_world_start)
    for step, places, turns in steps_of(pair, settings):
        found, number, poses = [], 0, set()
        for grasp, dexterity in sorted(zip(goals.grasp, goals.dexterity, strict=True)):
            for T in handover_poses(scene, pair, grasp, places, turns):
                number += 1
                T_palm_object = np.linalg.inv(pair.of_receiver.T_object_palm[grasp])
                receiver.put_other(waits["giver"])
                receiver.hold(T_palm_object)
                held = prune_grasps(receiver, pair.of_receiver, T, np.array([grasp]))
                if not len(held):
                    continue
                for row in _given(pair, starts, T, held.q[0]):
                    found.append((int(grasp), row[0], number, float(dexterity), row[1]))
                    poses.add(number)
        if found:
            return Whole(step, len(starts), len(goals), len(poses), found)
    return Whole("", len(starts), len(goals), 0, [])


def _given(pair: Pair, starts: Executed, T: np.ndarray, q_receiver: np.ndarray):
    giver = pair.giver
    giver.put_other(q_receiver)
    giver.put_object(T)
    giver.let_touch()
    use = np.sort(starts.grasp)
    found = prune_grasps(giver, pair.of_giver, T, use)
    return list(zip(found.grasp.tolist(), found.dexterity.tolist(), strict=True))


def _waiting(placed: PlacedAgent, joints: tuple[str, ...]) -> np.ndarray:
    return np.array([placed.joints[name] for name in joints])
