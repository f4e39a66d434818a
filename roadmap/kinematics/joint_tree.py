"""What forward and inverse kinematics need of a robot: its tree of joints."""

from typing import Protocol

import numpy as np

from roadmap.ranges import check_kind

PARENT, JOINT, KIND = 0, 1, 2  # columns of tree_i
FIXED, REVOLUTE, PRISMATIC = 0, 1, 2  # tree_i[:, KIND]


class JointTree(Protocol):
    """A tree of joints with a tool, read only; `roadmap.Robot` is one."""

    def __hash__(self) -> int:
        """Hash: the key of caches that are kept for each robot."""

    @property
    def name(self) -> str:
        """The robot's name."""

    @property
    def dof(self) -> int:
        """Number of moving joints."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the moving joints, (dof,)."""

    @property
    def lower(self) -> np.ndarray:
        """(dof,) lower limits [rad or m]."""

    @property
    def upper(self) -> np.ndarray:
        """(dof,) upper limits [rad or m]."""

    @property
    def continuous(self) -> np.ndarray:
        """(dof,) bool: joints that turn without end."""

    @property
    def tree_i(self) -> np.ndarray:
        """(n_bodies, 3) parent, joint and kind of each body."""

    @property
    def tree_f(self) -> np.ndarray:
        """(n_bodies, 17) frame, axis, multiplier and offset of each body [m, rad]."""

    @property
    def tip_body(self) -> int:
        """The body that the tool is on."""

    @property
    def T_body_tip(self) -> np.ndarray:
        """(4, 4) pose of the tool in its body's frame [m]."""

    @property
    def spheres(self) -> np.ndarray:
        """(n, 4) the cover: centre in the body's frame, radius [m]."""

    @property
    def sphere_body(self) -> np.ndarray:
        """(n,) body of each sphere."""

    @property
    def sphere_reach(self) -> np.ndarray:
        """(n, n_bodies) largest distance of its centre from a joint's axis [m]."""


def check_robot(robot: object, has: str = "tree_i") -> None:
    """Refuse what is no robot, such as a name: it lacks an attribute that one has."""
    if not hasattr(robot, has):
        remedy = "give what roadmap.load_robot returns, or the robot of a map"
        check_kind("a robot", robot, (), remedy)
