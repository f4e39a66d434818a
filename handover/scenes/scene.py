"""Scene: both agents as they stand, the object, its start and goal, furniture."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from handover.grasps.agents import Agent
from handover.grasps.objects import GraspObject
from handover.scenes.agent_body import AgentBody, agent_body
from odm.obstacles.shapes import Shape
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.transforms import check_pose

# [m] between what stands and what carries it: an exact test sees no contact
GAP = 0.001


@dataclass(frozen=True, eq=False)
class PlacedAgent:
    """An agent where it stands.

    Attributes:
        agent: Who it is.
        T_world_base: (4, 4) pose of its base frame [m].
        joints: Every joint that can be set, of arms, hands, body: value [rad or m].
        arms: Sides of the arms that may take part; others stay where they are.
    """

    agent: Agent
    T_world_base: np.ndarray
    joints: Mapping[str, float]
    arms: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check the pose, complete and check the joints.

        Raises:
            BadInput: A pose that is not rigid, an unknown joint or arm, a value outside
                its limits.
        """
        name = self.agent.name
        T = check_pose(self.T_world_base, f"T_world_base of {name}")
        object.__setattr__(self, "T_world_base", frozen(T, np.float64))
        joints = self.body.checked(self.joints, name)
        object.__setattr__(self, "joints", MappingProxyType(joints))
        unknown = [side for side in self.arms if side not in self.agent.arms]
        if unknown or not self.arms:
            raise BadInput(
                f"{name} is to use the arms {list(self.arms)}; give at least one of "
                f"{', '.join(self.agent.arms)}"
            )

    @property
    def body(self) -> AgentBody:
        """Its links and solids."""
        return agent_body(self.agent.source)

    def values(self, names: Iterable[str]) -> np.ndarray:
        """Return the values of some joints, in order [rad or m]."""
        return np.array([self.joints[name] for name in names])

    def shapes(
        self, joints: Mapping[str, float] | None = None
    ) -> list[tuple[str, Shape]]:
        """Return its solids as (link, shape in the world frame).

        Args:
            joints: Values in place of its own; those left out stay.
        """
        joints = {**self.joints, **(joints or {})}
        return self.body.shapes(joints, self.T_world_base)

    def link_pose(
        self, link: str, joints: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """Return T_world_link, (4, 4) [m]; `joints` as in `shapes`."""
        joints = {**self.joints, **(joints or {})}
        return self.T_world_base @ self.body.frames(joints)[link]


@dataclass(frozen=True, eq=False)
class Fixture:
    """A piece of furniture: its name and its shape in the world frame [m]."""

    name: str
    shape: Shape


@dataclass(frozen=True, eq=False)
class Scene:
    """A hand-over to be planned. The world has z up, the floor is at 0.

    Attributes:
        name: What it is called.
        seed: What its random parts were drawn with.
        giver, receiver: Both agents, where they wait.
        obj: What is handed over.
        T_world_start, T_world_goal: (4, 4) poses of the object [m].
        scenery: Furniture and floor.
        goal_held: The receiver keeps the object at the goal, which does not carry it.
    """

    name: str
    seed: int
    giver: PlacedAgent
    receiver: PlacedAgent
    obj: GraspObject
    T_world_start: np.ndarray
    T_world_goal: np.ndarray
    scenery: tuple[Fixture, ...] = ()
    goal_held: bool = False

    def __post_init__(self) -> None:
        for name in ("T_world_start", "T_world_goal"):
            T = check_pose(getattr(self, name), name)
            object.__setattr__(self, name, frozen(T, np.float64))

    def object_shapes(self, T_world_object: np.ndarray) -> list[Shape]:
        """Return the object's parts at a pose (4, 4), world frame [m]."""
        return [part.moved(T_world_object) for part in self.obj.parts]


def stand(
    agent: Agent,
    T_world_floor: np.ndarray,
    posture: str,
    joints: Mapping[str, float] | None = None,
    arms: tuple[str, ...] | None = None,
) -> PlacedAgent:
    """Return an agent that waits in a posture on the floor at a pose (4, 4) [m].

    Args:
        agent: Who.
        T_world_floor: Where on the floor, and which way it faces (x).
        posture: Name of one of its postures.
        joints: Values in place of those of the posture.
        arms: Sides that may take part; all if left.

    Raises:
        BadInput: It has no such posture, joint or arm.
    """
    T = np.asarray(T_world_floor, float) @ agent.posture(posture).T_floor_base
    joints = {**agent.waiting(posture), **(joints or {})}
    return PlacedAgent(agent, T, joints, arms or tuple(agent.arms))
