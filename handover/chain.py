"""Chain: the joints between a base and a tool, all that reachability needs."""

import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from roadmap.arrays import brief, freeze
from roadmap.errors import BadInput
from roadmap.geometry.self_collision import self_collision
from roadmap.kinematics import _chain as kernels
from roadmap.kinematics._chain import ChainArrays
from roadmap.kinematics.joint_tree import PRISMATIC
from roadmap.kinematics.tool_chain import tool_chain
from roadmap.ranges import check_kind
from roadmap.robot.robot import Robot
from roadmap.transforms import pose_of_flat

_ARRAYS = ("fixed", "kind", "scale", "limits", "endless", "length")


@dataclass(frozen=True, eq=False)
class Chain:
    """Joints in a row, in metres or in units of an arm's length.

    Attributes:
        name: What it is a chain of.
        joint_names: (dof,) names of its joints, the order of `q`.
        fixed, kind, scale, limits, endless: see `ChainArrays`; every joint turns
            about, or slides along, the z axis of its frame.
        unit: "m", or "arm length" where the map is scaled to a person.
        frame: The frame that poses are given in, for people: "base", "shoulder".
        robot: Where given, its self-collision is looked at.
        rows: (dof,) index of each joint in the robot's `q`; empty: the same.
        rest: The robot's whole `q`, for the joints that do not move the tool.
        collision_hash: SHA-256 of what self-collision was tested with, or "".
        length: (1,) length that counts as much as 1 rad in the dexterity: half the
            way from the first joint to the tool, stretched out.
    """

    name: str
    joint_names: tuple[str, ...]
    fixed: np.ndarray
    kind: np.ndarray
    scale: np.ndarray
    limits: np.ndarray
    endless: np.ndarray
    unit: str = "m"
    frame: str = "base"
    robot: Robot | None = None
    rows: tuple[int, ...] = ()
    rest: tuple[float, ...] = ()
    collision_hash: str = ""
    length: np.ndarray = field(default=None)

    __repr__ = brief

    def __post_init__(self) -> None:
        """Check and freeze the arrays.

        Raises:
            BadInput: Arrays that do not belong together, or a limit that is none.
        """
        freeze(self, fixed=float, kind=np.int32, scale=float)
        freeze(self, limits=float, endless=float)
        n, dof = len(self.kind), len(self.joint_names)
        shapes = {
            "fixed": (n + 1, 12),
            "kind": (n, 2),
            "scale": (n, 2),
            "limits": (dof, 2),
            "endless": (dof,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape or n == 0:
                raise BadInput(
                    f"{name} of the chain {self.name!r} has the shape "
                    f"{getattr(self, name).shape}; give {shape}, at least one joint"
                )
        if not all(np.isfinite(getattr(self, name)).all() for name in shapes):
            raise BadInput(f"the chain {self.name!r} holds NaN or infinity")
        if (self.limits[:, 0] >= self.limits[:, 1]).any():
            j = int((self.limits[:, 0] >= self.limits[:, 1]).argmax())
            raise BadInput(
                f"joint {self.joint_names[j]!r} of the chain {self.name!r} has the "
                f"limits {self.limits[j].tolist()}; the lower must be below the upper"
            )
        if self.length is None:
            object.__setattr__(self, "length", np.array([0.5 * self._stretch()]))
        freeze(self, length=float)

    def _stretch(self) -> float:
        """Return a bound on the distance of the tool from the first joint."""
        spans = np.linalg.norm(self.fixed[1:, 9:], axis=1).sum()
        slides = self.kind[:, 0] == PRISMATIC
        far = np.abs(self.limits[self.kind[:, 1]]).max(axis=1)
        far = far * np.abs(self.scale[:, 0])
        total = spans + (far + np.abs(self.scale[:, 1]))[slides].sum()
        return total if total > 0 else 1.0

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @cached_property
    def arrays(self) -> ChainArrays:
        """The arrays for the kernels."""
        return ChainArrays(*(getattr(self, name) for name in _ARRAYS))

    def tool_pose(self, q: np.ndarray) -> np.ndarray:
        """Return T_base_tool, (4, 4), of a configuration (dof,)."""
        frames = np.empty((len(self.kind) + 1, 12))
        kernels.forward(self.arrays, np.ascontiguousarray(q, float), frames)
        return pose_of_flat(frames[-1])

    def full(self, q: np.ndarray) -> np.ndarray:
        """Return the robot's configuration for one of the chain."""
        whole = np.array(self.rest or q, float)
        whole[list(self.rows) or slice(None)] = q
        return whole

    def fingerprint(self) -> str:
        """Return a SHA-256 over everything a reach map depends on."""
        digest = hashlib.sha256()
        names = [self.joint_names, self.unit, self.collision_hash]
        digest.update(json.dumps(names).encode())
        for name in _ARRAYS:
            # rounded: kinematics read on another machine may differ in the last digit
            digest.update(np.round(getattr(self, name), 9).astype(float).tobytes())
        return digest.hexdigest()


def chain_of(robot: Robot, self_collisions: bool = True) -> Chain:
    """Return the chain from a robot's base to its tool.

    Args:
        robot: The robot.
        self_collisions: Look at its self-collision when a map is built.

    Raises:
        BadInput: No joint moves the tool.
    """
    check_kind("a robot", robot, Robot, "give what roadmap.load_robot returns")
    chain, rows = tool_chain(robot)
    return Chain(
        name=robot.name,
        joint_names=tuple(robot.joint_names[j] for j in rows),
        fixed=chain.fixed,
        kind=chain.kind,
        scale=chain.scale,
        limits=np.stack([robot.lower, robot.upper], axis=1)[rows],
        endless=robot.continuous[rows],
        robot=robot if self_collisions else None,
        rows=tuple(rows),
        rest=tuple(np.clip(0.0, robot.lower, robot.upper).tolist()),
        collision_hash=_collision_hash(robot) if self_collisions else "",
    )


def _collision_hash(robot: Robot) -> str:
    digest = hashlib.sha256()
    m = self_collision(robot).model  # rods and the like only make its tests quicker
    for array in (m.tree_i, m.tree_f, m.pairs, m.reach, m.balls, m.points):
        digest.update(np.round(array, 9).tobytes())
    return digest.hexdigest()
