"""Inverse kinematics: configurations that bring the tool to a pose."""

from dataclasses import dataclass

import numpy as np

from roadmap.arrays import frozen
from roadmap.kinematics.forward import checked, difference, tool_pose, wrapped
from roadmap.kinematics.joint_tree import JointTree
from roadmap.kinematics.tool_chain import ToolDescent
from roadmap.transforms import check_pose, flat_pose


@dataclass(frozen=True, eq=False)
class IkSolution:
    """A configuration within limits and the error of its tool pose.

    Attributes:
        q: (dof,) configuration [rad or m].
        position_error: Distance of the tool from the pose [m].
        rotation_error: Angle between tool and pose [rad].
    """

    q: np.ndarray
    position_error: float
    rotation_error: float


def solve(
    robot: JointTree,
    T_base_tool: np.ndarray,
    q_seed: np.ndarray | None = None,
    *,
    attempts: int = 20,
    steps: int = 200,
    position_tolerance: float = 1e-6,
    rotation_tolerance: float = 1e-6,
    seed: int = 0,
) -> list[IkSolution]:
    """Return distinct configurations that reach a tool pose, nearest to q_seed first.

    Damped least squares from q_seed, from the middle of the limits and from random
    configurations. Self-collision is not looked at. The same input gives the same
    list.

    Args:
        robot: The robot.
        T_base_tool: (4, 4) pose of the tool in the base frame [m].
        q_seed: (dof,) start and measure of nearness; default: the middle.
        attempts: Number of starts, at least 1.
        steps: Most steps from each start. A pose in reach takes about 5 from a near
            start; one out of reach takes all of them, some 60 us each.
        position_tolerance: Largest position error of a solution [m].
        rotation_tolerance: Largest rotation error of a solution [rad].
        seed: Seed of the random starts.

    Returns:
        Solutions within limits; empty when the pose is out of reach.

    Raises:
        BadInput: The pose is not a finite rigid transform.
        BadConfiguration: `q_seed` has the wrong length or is not finite.
    """
    T_base_tool = check_pose(T_base_tool, "the pose")
    limits = np.stack([robot.lower, robot.upper], axis=1)
    middle = limits.mean(axis=1)
    start = middle if q_seed is None else checked(robot, q_seed)
    attempts = max(attempts, 1)
    starts = [middle] if q_seed is None else [start, middle]
    if attempts > len(starts):
        rng = np.random.default_rng(seed)
        size = (max(attempts, 2), robot.dof)
        starts += list(rng.uniform(limits[:, 0], limits[:, 1], size))
    limits[robot.continuous] = -np.inf, np.inf
    target = flat_pose(T_base_tool)
    # a little further than asked, so that a solution stays one when checked
    descent = ToolDescent(robot, position_tolerance / 2, rotation_tolerance / 2, steps)
    found: list[IkSolution] = []
    for q in starts[:attempts]:
        q = np.clip(q, limits[:, 0], limits[:, 1])
        position, rotation = descent.run(target, q)
        if position <= position_tolerance and rotation <= rotation_tolerance:
            _add(robot, found, q, T_base_tool)
    if len(found) < 2:
        return found
    return sorted(found, key=lambda s: np.linalg.norm(difference(robot, start, s.q)))


def _add(
    robot: JointTree, found: list[IkSolution], q: np.ndarray, T: np.ndarray
) -> None:
    q = np.clip(wrapped(robot, q), robot.lower, robot.upper)
    if any(np.abs(difference(robot, s.q, q)).max() < 1e-3 for s in found):
        return
    reached = tool_pose(robot, q)
    R = T[:3, :3] @ reached[:3, :3].T
    skew = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    angle = np.arctan2(np.linalg.norm(skew) / 2, (np.trace(R) - 1) / 2)
    distance = np.linalg.norm(T[:3, 3] - reached[:3, 3])
    found.append(IkSolution(frozen(q, np.float64), float(distance), float(angle)))
