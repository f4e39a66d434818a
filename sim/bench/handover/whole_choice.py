"""All of H, as Algorithms 1 to 3 of [Huaman2014] are written: no order, no short cut.

What the planner's choice is compared with, and what the paper's tables count. Every
grasp is tested wherever it is asked for, in the set's order.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans.choose import Pair, handover_poses, steps_of
from handover.plans.limb import limb_of
from handover.plans.mover import Mover
from handover.plans.prune import ExecutableGrasps, Grasper
from handover.plans.settings import PlanSettings
from handover.scenes.scene import PlacedAgent, Scene

Key = tuple[int, int, tuple[float, ...]]  # grasps of receiver and giver, place, turn


@dataclass(frozen=True)
class Whole:
    """H of a pair of arms, and what was counted on the way.

    Attributes:
        step: The first step of the search in which H is not empty, "" for none.
        giver, receiver: Grasps left at the start and at the goal.
        poses: Hand-over poses in H.
        tuples: What tells a tuple from others -> the receiver's dexterity at the goal.
    """

    step: str
    giver: int
    receiver: int
    poses: int
    tuples: dict[Key, float]

    def best(self, without: set[Key] = frozenset()) -> float:
        """Return the largest dexterity of the receiver at the goal, 0 for none."""
        left = [value for key, value in self.tuples.items() if key not in without]
        return max(left, default=0.0)


def key_of(receiver: int, giver: int, T_world_handover: np.ndarray) -> Key:
    """Return what tells a tuple of H from all others."""
    return receiver, giver, tuple(np.round(T_world_handover[:3], 9).ravel().tolist())


def pair_of(scene: Scene, arms: tuple[str, str], sets: Mapping[str, GraspSet]) -> Pair:
    """Return the arms (giver's, receiver's) of a scene; sets: hand's name -> grasps."""
    one, other = (
        limb_of(scene.giver.agent, arms[0]),
        limb_of(scene.receiver.agent, arms[1]),
    )
    return Pair(
        Mover(scene, scene.giver, one, scene.receiver, other),
        Mover(scene, scene.receiver, other, scene.giver, one),
        sets[one.spec.name],
        sets[other.spec.name],
    )


def prune_grasps(
    mover: Mover,
    grasps: GraspSet,
    T_world_object: np.ndarray,
    use: np.ndarray | None = None,
) -> ExecutableGrasps:
    """Return the grasps that an arm can execute on an object at a pose (4, 4) [m].

    All is as it was put for the mover; `use` (k,) are the grasps looked at, else all.
    """
    use = np.arange(len(grasps)) if use is None else use
    return Grasper(mover, grasps).look(T_world_object, use, lambda: None).all()


def whole_choice(
    scene: Scene, pair: Pair, settings: PlanSettings, until: str = ""
) -> list[Whole]:
    """Return H of two arms, as [Huaman2014] makes it, widened step by step.

    Args:
        scene: The scene.
        pair: Both arms.
        settings: How far it is widened.
        until: The last step; the first in which H is not empty, if left.

    Returns:
        One for each step, the last one is that of `until`.
    """
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
    wholes = []
    for step, places, turns in steps_of(pair, settings):
        found: dict[Key, float] = {}
        for grasp, dexterity in zip(goals.grasp, goals.dexterity, strict=True):
            for T in handover_poses(scene, pair, grasp, places, turns):
                receiver.put_other(waits["giver"])
                receiver.hold(np.linalg.inv(pair.of_receiver.T_object_palm[grasp]))
                held = prune_grasps(receiver, pair.of_receiver, T, np.array([grasp]))
                if len(held):
                    for g in _given(pair, starts, T, held.q[0]):
                        found[key_of(int(grasp), g, T)] = float(dexterity)
        poses = len({(key[0], key[2]) for key in found})
        wholes.append(Whole(step, len(starts), len(goals), poses, found))
        if step == until or (found and not until):
            break
    return wholes


def best_of(wholes: list[Whole], without: set[Key]) -> float:
    """Return what is to be chosen: the best of the first step that has any left."""
    for whole in wholes:
        best = whole.best(without)
        if best > 0.0:
            return best
    return 0.0


def _given(
    pair: Pair, starts: ExecutableGrasps, T: np.ndarray, q_receiver: np.ndarray
) -> list[int]:
    giver = pair.giver
    giver.put_other(q_receiver)
    giver.put_object(T)
    giver.let_touch()
    found = prune_grasps(giver, pair.of_giver, T, np.sort(starts.grasp))
    return found.grasp.tolist()


def _waiting(placed: PlacedAgent, joints: tuple[str, ...]) -> np.ndarray:
    return np.array([placed.joints[name] for name in joints])
