"""Audit: is the pursued target the best one in reach? Not part of the timed frame."""

from dataclasses import dataclass

import numpy as np

from handover import Human
from handover.meet.constraints import ClearOf
from handover.meet.workspace import InteractionWorkspace, Target
from handover.targets.live_targets import with_arm_at_rest
from handover.targets.node_index import NodeIndex
from handover.targets.target_goals import TargetGoals
from odm import CellMap, Obstacles, ReactivePlanner
from odm.frame.freedom import is_valid

RANKED = 20  # targets that are tried, best first
_ATTEMPTS, _STEPS = 8, 100  # of the inverse kinematics, for each
_GOALS = 6  # configurations of one target that are tried
_SAME = 1e-6  # qualities that differ by less are one


@dataclass(frozen=True)
class Verdict:
    """What was found in one frame."""

    time_s: float  # of the frame [s]
    pursued: int | None  # cell of the target pursued, None: none
    quality: float  # its quality by the audit's own workspace; 0: it is none
    # cell of the best target that can be reached, None: none of `RANKED`
    top: int | None
    top_quality: float  # its quality
    rank: int  # how many better ones were tried and cannot be reached


class TargetAudit:
    """Searches for the best reachable target from scratch, with more work than a frame.

    It shares nothing with the live thread: its own workspace, in which nothing is
    removed, inverse kinematics from many starts, and a planner that has not seen
    what was before and searches from scratch to each target alone. As for that thread,
    a node near a target that the person can take from is a way to be there.

    Args:
        meet: A workspace of its own.
        cell_map: The map.
        index: Nodes of its roadmap by pose of the tool.
        from_rest: Whether the way of the hand counts from where the arm rests, as of
            the thread that is judged.
    """

    def __init__(
        self,
        meet: InteractionWorkspace,
        cell_map: CellMap,
        index: NodeIndex,
        from_rest: bool,
    ) -> None:
        self.meet, self._from_rest = meet, from_rest
        self.planner = ReactivePlanner(cell_map, always_replan=True)
        self._nodes = TargetGoals(self.planner, meet, index)
        self._T_base_world = np.linalg.inv(meet.settings.T_world_base)
        self._solved: dict[int, list[np.ndarray]] = {}

    def look(
        self,
        human: Human,
        obstacles: Obstacles,
        q: np.ndarray,
        pursued: int | None,
        time_s: float,
    ) -> Verdict:
        """Judge one frame: person in the world, capsules in the base, q (dof,).

        `pursued` is the cell of the target it is at or on the way to.
        """
        side = self.meet.settings.side
        self.meet.update(with_arm_at_rest(human, side) if self._from_rest else human)
        rated = self.meet.rated([pursued])[0] if pursued is not None else None
        quality = 0.0 if rated is None else rated.quality
        T_world_base = self.meet.settings.T_world_base
        scene = ClearOf.of_scene(self.planner, T_world_base)
        ranked = self.meet.best_takeable(RANKED, scene)
        for rank, target in enumerate(ranked):
            if self._reaches(target, obstacles, q):
                found = target.key, target.quality, rank
                return Verdict(time_s, pursued, quality, *found)
        return Verdict(time_s, pursued, quality, None, 0.0, len(ranked))

    def _reaches(self, target: Target, obstacles: Obstacles, q: np.ndarray) -> bool:
        key, node = target.key, self._nodes.near_node(target)
        if key not in self._solved:
            T_base_tool = self._T_base_world @ target.T_world_tool
            self._solved[key] = self._solutions(T_base_tool)
        goals = self._solved[key] + ([] if node is None else [node.q])
        if not goals:
            return False
        planner = self.planner
        planner.reset()
        planner.set_goals(goals)
        answer = planner.step(obstacles, q=q)
        return answer.status != "holding"

    def _solutions(self, T_base_tool: np.ndarray) -> list[np.ndarray]:
        seed = self.meet.reach.witness(T_base_tool)
        found = self.planner.robot.ik(
            T_base_tool,
            seed,
            attempts=_ATTEMPTS,
            steps=_STEPS,
            position_tolerance=1e-4,
            rotation_tolerance=1e-3,
        )
        static = self.planner.static
        good = [one.q for one in found if is_valid(static, one.q)]
        return good[:_GOALS]


def shares(verdicts: list[Verdict], margin: float) -> dict:
    """Return how often the best reachable target was pursued, as plain data.

    Of the frames judged in which any target can be reached: "top": that one is pursued,
    or another of the same quality, as grasps often have it; "within_margin": one not
    worse by more than the margin (the top one too); "worse": one that is; "none": no
    target is pursued. `out_of_reach` counts the frames in which none of the targets
    tried can be reached, or there is none.
    """
    some = [v for v in verdicts if v.top is not None]

    def within(much: float) -> int:
        return sum(
            v.pursued is not None
            and (v.pursued == v.top or v.quality >= v.top_quality - much)
            for v in some
        )

    top, near = within(_SAME), within(margin)
    none = sum(v.pursued is None for v in some)
    n = max(1, len(some))
    return {
        "judged": len(verdicts),
        "out_of_reach": len(verdicts) - len(some),
        "top": round(top / n, 4),
        "within_margin": round(near / n, 4),
        "worse": round((len(some) - near - none) / n, 4),
        "none": round(none / n, 4),
        "first_ranked_reachable": round(sum(v.rank == 0 for v in some) / n, 4),
    }
