"""What tests ask of a robot, and no part of a planner asks through Python."""

import numpy as np

from roadmap.geometry._self_collision import motion_apart, motion_clear
from roadmap.geometry.self_collision import FINEST, MARGIN, TOLERANCE, self_collision
from roadmap.kinematics import _forward as forward
from roadmap.kinematics._seven import MOST, Seven, solve_all
from roadmap.kinematics.forward import body_frames, checked, difference
from roadmap.kinematics.joint_tree import JointTree
from roadmap.kinematics.seven import free_angles, room
from roadmap.robot.robot import Robot
from roadmap.transforms import flat_pose


def motion_free(
    robot: Robot, q_a: np.ndarray, q_b: np.ndarray, margin: float = MARGIN
) -> tuple[bool, tuple[str, str] | None]:
    """Say if the straight motion between two configurations is proved free.

    Args:
        robot: The robot.
        q_a: (dof,) start [rad or m].
        q_b: (dof,) end; a continuous joint goes the short way.
        margin: Distance that links must keep all along [m], above 0.

    Returns:
        (True, None), or (False, (link, link)) with a pair that is not proved free.
    """
    q_a, q_b = checked(robot, q_a), checked(robot, q_b)
    tested = self_collision(robot)
    dq = difference(robot, q_a, q_b)
    asked = tested.model, q_a, dq, margin, TOLERANCE, FINEST, tested.scratch()
    if motion_apart(*asked):
        return True, None
    pair, _ = motion_clear(*asked)
    a, b = (robot.link_names[i] for i in tested.links[pair])
    return False, (a, b)


def jacobian(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return the (6, dof) Jacobian of the tool in the base frame: linear, angular."""
    poses = body_frames(robot, q)
    p_tool = (poses[robot.tip_body] @ robot.T_body_tip)[:3, 3]
    result = np.zeros((6, robot.dof))
    body = robot.tip_body
    while body > 0:
        parent, joint, kind = robot.tree_i[body]
        axis, scale = robot.tree_f[body, 12:15], robot.tree_f[body, 15]
        z = poses[body, :3, :3] @ axis  # the axis is fixed under its own rotation
        if kind == 1:
            arm = p_tool - poses[body, :3, 3]
            result[:3, joint] += scale * np.cross(z, arm)
            result[3:, joint] += scale * z
        elif kind == 2:
            result[:3, joint] += scale * z
        body = parent
    return result


def motion_bounds(robot: JointTree, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bound |p'| and |p''| of the cover's centres p while q moves along `dq`.

    Args:
        robot: The robot.
        dq: (dof,) joint displacement [rad or m].

    Returns:
        Two (n,) arrays [m]: the largest |dp/dt| and |d2p/dt2| for t in [0, 1].
    """
    n = len(robot.spheres)
    first, second = np.empty(n), np.empty(n)
    forward.motion_bounds(
        robot.tree_i,
        robot.tree_f,
        robot.sphere_reach,
        np.asarray(dq, float),
        np.empty((2, len(robot.tree_i))),
        first,
        second,
    )
    return first, second


def solutions(arm: Seven, T_base_tool: np.ndarray, steps: int = 24) -> np.ndarray:
    """Return joints (n, 7) within limits that bring the tool to a pose (4, 4) [m]."""
    found = np.empty((steps * MOST, 7))
    pose = flat_pose(np.asarray(T_base_tool, float))
    n = solve_all(arm, pose, free_angles(arm, steps), room(), found)
    return found[:n].copy()
