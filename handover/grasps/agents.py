"""Agents that give or take: their arms, the hand on each, their postures."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from handover.grasps.hands import HandSpec, hand_spec
from handover.human.anthropometry import ARM_JOINTS
from handover.human.human import Human
from handover.human.postures import POSTURES
from roadmap.errors import BadInput, did_you_mean
from roadmap.robot.known import known_robot
from roadmap.transforms import pose_of


@dataclass(frozen=True)
class AgentArm:
    """One arm of an agent.

    Attributes:
        side: "left" or "right"; an agent of one arm has a "right" one.
        robot: Known name of the robot that moves this arm, and no other joint; or a
            URDF file.
        hand: Name of the hand at its end, or what is known of one of your own.
        tip: Link of the tool in a URDF file; None: that of the known robot.
    """

    side: str
    robot: str
    hand: str | HandSpec
    tip: str | None = None

    @property
    def spec(self) -> HandSpec:
        """What is known of the hand."""
        return self.hand if isinstance(self.hand, HandSpec) else hand_spec(self.hand)


@dataclass(frozen=True, eq=False)
class Posture:
    """How an agent stands.

    Attributes:
        T_floor_base: (4, 4) its base frame over the floor below it [m].
        joints: Where joints that no arm moves stand [rad].
    """

    T_floor_base: np.ndarray = field(default_factory=lambda: np.eye(4))
    joints: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Agent:
    """Who gives or takes.

    Attributes:
        name: Its name.
        arms: Its arms by side.
        postures: How it can stand, by name.
        rest: Where joints of its arms and hands stand while they wait [rad or m];
            others stand where the known robot has them, hands are open.
    """

    name: str
    arms: Mapping[str, AgentArm]
    postures: Mapping[str, Posture]
    rest: Mapping[str, float] = field(default_factory=dict)

    @property
    def source(self) -> str:
        """Known name or URDF file of its whole body."""
        return next(iter(self.arms.values())).robot

    def waiting(self, posture: str) -> dict[str, float]:
        """Return joints of arms, hands and body in a posture while it waits."""
        joints: dict[str, float] = {}
        for arm in self.arms.values():
            known = known_robot(arm.robot)
            joints |= known.locked if known else {}
        for arm in self.arms.values():
            joints |= arm.spec.preshapes[0]
        return {**joints, **self.rest, **self.posture(posture).joints}

    def posture(self, name: str) -> Posture:
        """Return a posture.

        Raises:
            BadInput: It has none of that name; lists them.
        """
        if not isinstance(name, str) or name not in self.postures:
            raise BadInput(
                f"{self.name} has no posture {name!r}; give one of "
                f"{', '.join(self.postures)}"
            )
        return self.postures[name]


def _arms(robot: str, hand: str) -> dict[str, AgentArm]:
    return {
        side: AgentArm(side, f"{robot}_{side}", f"{hand}_{side}")
        for side in ("left", "right")
    }


def _hubo_postures() -> dict[str, Posture]:
    """Return how DRC-Hubo stands: the numbers and their origin are in its URDF.

    Kneeling, its thighs are upright and the knees' axes 0.085 m above the floor: an
    estimate between 0.07 and 0.10. On the steps of a stool, each 0.20 m higher than the
    last: an estimate, a common kitchen stool of three steps.
    """
    stand = 0.330 + 0.330 + 0.137
    postures = {"standing": Posture(pose_of((0.0, 0.0, stand)))}
    for step in (1, 2, 3):
        postures[f"step_{step}"] = Posture(pose_of((0.0, 0.0, stand + 0.20 * step)))
    legs = {
        f"{side}_{joint}": 0.5 * np.pi - 1e-4
        for side in ("left", "right")
        for joint in ("knee", "ankle")
    }
    postures["kneeling"] = Posture(pose_of((0.0, 0.0, 0.330 + 0.085)), legs)
    return postures


# arms hang beside the column, elbows a little bent to the front
_HANGING = {1: 1.5708, 2: 1.45, 3: -1.5708, 4: 0.2}
# the maker's "ready" posture
_PANDA_READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


def _person_postures() -> dict[str, Posture]:
    """Return how a person of 1.75 m stands, sits and kneels: as `handover.Human`."""
    found = {}
    for name in ("standing", "sitting", "kneeling"):
        posture = POSTURES[name]
        T = Human(1.75, name, thickness="mean").T_world_pelvis.copy()
        # knees rest on the thighs' round ends, which are thicker than the shanks
        T[2, 3] += 0.029 if posture.support == "knees" else 0.001
        legs = zip(
            ("left", "right"), (posture.left_leg, posture.right_leg), strict=True
        )
        joints = {}
        for side, (hip, knee, sole) in legs:
            angles = {"hip": hip, "knee": -knee, "ankle": sole - 90.0}
            joints |= {f"{side}_{j}": np.radians(v) for j, v in angles.items()}
            for joint, angle in zip(ARM_JOINTS, posture.arm, strict=True):
                joints[f"{side}_{joint.replace(' ', '_')}"] = np.radians(angle)
        found[name] = Posture(T, joints)
    return found


_AGENTS = {
    agent.name: agent
    for agent in (
        Agent(
            "crichton",
            _arms("crichton", "sdh"),
            {"fixed": Posture(pose_of((0.0, 0.0, 0.001)))},
            {
                f"{side}_arm_{k}_joint": -value if (side, k) == ("right", 4) else value
                for side in ("left", "right")
                for k, value in _HANGING.items()
            },
        ),
        Agent("drchubo", _arms("drchubo", "hubo"), _hubo_postures()),
        Agent("person", _arms("person", "person"), _person_postures()),
        Agent(
            "panda",
            {"right": AgentArm("right", "panda", "panda")},
            # on a table 0.72 m high, as the one of Crichton's scenes
            {"fixed": Posture(pose_of((0.0, 0.0, 0.721)))},
            {f"panda_joint{k}": v for k, v in enumerate(_PANDA_READY, 1)},
        ),
    )
}


def agent_names() -> list[str]:
    """Return the names that `load_agent` knows."""
    return sorted(_AGENTS)


def load_agent(name: str) -> Agent:
    """Return an agent by name.

    Raises:
        BadInput: No agent has that name; lists them.
    """
    if str(name) in _AGENTS:
        return _AGENTS[str(name)]
    raise BadInput(
        f"there is no agent {name!r}; {did_you_mean(name, agent_names())} one of "
        f"{', '.join(agent_names())}"
    )
