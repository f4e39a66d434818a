"""What forward and inverse kinematics need of a robot: its tree of joints."""

from typing import Protocol

import numpy as np


class JointTree(Protocol):
    """A tree of joints with a tool; `roadmap.Robot` is one, see its attributes."""

    name: str
    joint_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    continuous: np.ndarray
    tree_i: np.ndarray
    tree_f: np.ndarray
    tip_body: int
    T_body_tip: np.ndarray
    spheres: np.ndarray
    sphere_body: np.ndarray
    sphere_reach: np.ndarray

    @property
    def dof(self) -> int:
        """Number of moving joints."""
