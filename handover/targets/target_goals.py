"""From targets to configurations: a roadmap node near it, or inverse kinematics."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from handover.meet.find import check_same_robot
from handover.meet.settings import FindSettings
from handover.meet.workspace import InteractionWorkspace, Target
from handover.targets.allowance import Allowance
from handover.targets.node_index import NodeIndex
from handover.targets.settings import LiveSettings
from odm.close_test.static import StaticTest
from odm.frame.freedom import check_valid, is_valid
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics.forward import difference
from roadmap.ranges import check_kind, settings_of

NODE, EXACT = "node", "exact"
_UNSOLVED = "inverse kinematics found no solution"


def goal_trouble(static: StaticTest, q: np.ndarray) -> str | None:
    """Return why q (dof,) can never be a goal in a place, None if it can."""
    try:
        check_valid(static, q, "it")
    except BadConfiguration as error:
        return str(error)
    return None


@dataclass(frozen=True, eq=False)
class Goal:
    """A configuration that serves a target."""

    key: int  # the target's cell
    q: np.ndarray  # (dof,) configuration [rad or m]
    # "node": a roadmap node near the target, attached already; "exact": found by
    # inverse kinematics
    kind: str
    node: int = -1  # number of the node; -1: none


class TargetGoals:
    """Finds configurations for targets, a little work at a time, and remembers them.

    The pose of a target is that of its cell, so what was found once stays true while
    the person moves.

    Args:
        planner: Its scenery counts.
        meet: The targets; those that fail are removed from it, until something else
            stands still.
        index: Nodes of the planner's roadmap by pose; None: made here.
        settings: How near a node must be, how many starts, see LiveSettings.

    Attributes:
        failed: Cell -> why the robot cannot get there.
        rest: (dof,) where the first start begins [rad or m]; None: at a near node.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        meet: InteractionWorkspace,
        index: NodeIndex | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        check_same_robot(meet.reach, planner.robot)
        nodes = planner.cell_map.roadmap.nodes
        index = NodeIndex(planner.robot, nodes) if index is None else index
        check_kind("index", index, NodeIndex, "give a NodeIndex of the map, or None")
        if len(index) != len(nodes):
            raise BadInput(
                f"the index holds {len(index)} nodes, the planner's roadmap "
                f"{len(nodes)}; make it of the same map"
            )
        self.planner, self.meet, self.index = planner, meet, index
        self.settings = settings_of(settings, LiveSettings)
        self.failed: dict[int, str] = {}
        self.rest: np.ndarray | None = None
        self._T_base_world = np.linalg.inv(meet.settings.T_world_base)
        self._exact: dict[int, list[Goal]] = {}
        self._near: dict[int, Goal | None] = {}
        self._lost: dict[int, Target] = {}  # those that failed
        self._refused: dict[int, list[np.ndarray]] = {}  # something stands there
        self._around = self._stands()
        self._waiting: dict[int, None] = {}  # to be looked at again, in order
        self._begun: dict[int, int] = {}  # starts of the inverse kinematics so far
        self._starts: dict[int, int] = {}  # ... and at most, where fewer have to do
        self._seeds: dict[int, np.ndarray] = {}  # nodes it starts from

    def near_node(self, target: Target) -> Goal | None:
        """Return a node near a target at which the person can take the object, too."""
        goal = self._node_of(target)
        return goal if goal is not None and self._is_taken(target, goal) else None

    def knows_node(self, key: int) -> bool:
        """Whether the nodes near a target were looked up, which is slow once."""
        return key in self._near

    def found(self, key: int) -> list[Goal]:
        """Return the configurations at a target that are known, in the order found."""
        return self._exact.get(key, [])

    def forget(self) -> None:
        """Forget what was found: the hand, the scenery or the clearance has changed."""
        self.meet.restore(list(self._lost.values()))
        known = self._exact, self._near, self._begun, self._starts, self._seeds
        for one in (*known, self.failed, self._lost, self._refused, self._waiting):
            one.clear()
        self._around = self._stands()

    def look_again(self, allowance: Allowance | None = None) -> None:
        """Look once more at a target where something stood in the way; once a frame.

        Nothing is done until other things stand still, the hand holds something else or
        the clearance has changed. What is free since then is known at once, and a
        target that had failed is back in the workspace.

        Args:
            allowance: What the frame may do; None: as much as this takes.
        """
        (static, things, extra), (a, b, c) = self._stands(), self._around
        if static is not a or things is not b or extra != c:
            self._around = static, things, extra
            self._waiting |= dict.fromkeys([*self.failed, *self._refused])
        if not self._waiting:
            return
        if allowance is not None and not allowance.grants(allowance.takes.solve):
            return
        key = next(iter(self._waiting))
        del self._waiting[key]
        for q in self._refused.pop(key, []):
            self._judge(key, q)
        if key in self.failed:
            self._near.pop(key, None)
            if self.found(key) or self._node_of(self._lost[key]) is not None:
                del self.failed[key]
                self.meet.restore([self._lost.pop(key)])

    def _stands(self) -> tuple[StaticTest, dict, float]:
        """Return what decides which configurations are free while nobody is about."""
        planner = self.planner
        return planner.static, planner.carrier.things, planner.static.extra

    @property
    def why_failed(self) -> str:
        """How many targets the robot cannot get to, and mostly why; "": none is known.

        Where a link would touch what stands still, that is told first.
        """
        causes = Counter(why.split(" at ")[0] for why in self.failed.values())
        if not causes:
            return ""
        worst = max(causes, key=lambda why: (why != _UNSOLVED, causes[why]))
        cause = worst.removeprefix("it is not free: ")
        cause = cause.removesuffix("; choose another one")
        return f"the robot gets to none of {len(self.failed)} looked at ({cause})"

    def is_open(self, key: int) -> bool:
        """Whether `work` on a target may still find something."""
        begun, few = self._begun.get(key, 0), len(self.found(key))
        return begun < self._most(key) and few < self.settings.configurations

    def _most(self, key: int) -> int:
        """Return how many starts of the inverse kinematics a target is worth."""
        return self._starts.get(key, self.settings.starts)

    def work(self, target: Target) -> Goal | None:
        """Do one start of the inverse kinematics for a target; return what is new.

        After the last one a target without a configuration has failed. If no node is
        near it, either, it is removed from the workspace [Vahrenkamp2016, Algorithm 2,
        line 9]; see `look_again`.
        """
        key = target.key
        if not self.is_open(key):
            return None
        T_base_tool = self._T_base_world @ target.T_world_tool
        begun = self._begun[key] = self._begun.get(key, 0) + 1
        if begun == 1 and self.index.is_remote(T_base_tool, self.settings.far):
            self._starts[key] = 1
        seed = self._seed(key, T_base_tool, begun - 1)
        why = _UNSOLVED
        if seed is not None:
            found = self.planner.robot.ik(
                T_base_tool,
                seed,
                attempts=1,
                steps=self.settings.steps,
                position_tolerance=FindSettings.position_tolerance,
                rotation_tolerance=FindSettings.rotation_tolerance,
            )
            for one in found:
                why = self._judge(key, one.q)
                if why is None:
                    return self.found(key)[-1]
        if begun == self._most(key) and not self.found(key):
            self.failed[key], self._lost[key] = why, target
            if self._node_of(target) is None:
                self.meet.remove(target)
        return None

    def _judge(self, key: int, q: np.ndarray) -> str | None:
        """Take a configuration at a target; return why it is none, None if it is."""
        why = goal_trouble(self.planner.static, q)
        if why is not None:
            self._refused.setdefault(key, []).append(q)
        elif not self._is_new(key, q):
            why = "it is known"
        else:
            self._exact.setdefault(key, []).append(Goal(key, q, EXACT))
        return why

    def _is_new(self, key: int, q: np.ndarray) -> bool:
        robot = self.planner.robot
        return all(
            np.abs(difference(robot, q, goal.q)).max() >= self.settings.apart
            for goal in self.found(key)
        )

    def _seed(
        self, key: int, T_base_tool: np.ndarray, number: int
    ) -> np.ndarray | None:
        before, after = self.settings.before, self.settings.after
        if self.rest is not None:
            if number == 0:
                return self.rest
            number -= 1  # the last near node is left out
        if number == before:
            return self.meet.reach.witness(T_base_tool)
        if key not in self._seeds:
            self._seeds[key] = self.index.nearest(T_base_tool, before + after)
        nodes, at = self._seeds[key], number - (number > before)
        return self.index.nodes[nodes[at]] if at < len(nodes) else None

    def _node_of(self, target: Target) -> Goal | None:
        key = target.key
        if key not in self._near:
            self._near[key] = None
            T_base_tool = self._T_base_world @ target.T_world_tool
            near = self.settings.node_tolerance_m, self.settings.node_tolerance_rad
            for node in self.index.within(T_base_tool, *near):
                q = self.index.nodes[node]
                if is_valid(self.planner.static, q):
                    self._near[key] = Goal(key, q, NODE, node)
                    break
        return self._near[key]

    def _is_taken(self, target: Target, goal: Goal) -> bool:
        """Whether the person can take the object as it is held at a goal."""
        meet = self.meet
        T_world_tool = meet.settings.T_world_base @ self.index.T_base_tool[goal.node]
        T_hand = T_world_tool @ meet.obj.T_tool_object @ meet.grasps[target.grasp]
        return len(meet.human.arm_ik(meet.settings.side, T_hand).q) > 0
