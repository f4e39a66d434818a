"""Forward kinematics of a Robot, and bounds on how far its points can move."""

import numpy as np

from roadmap.arrays import writable
from roadmap.errors import BadConfiguration
from roadmap.kinematics import _forward as kernels
from roadmap.kinematics.joint_tree import JointTree, check_robot
from roadmap.transforms import pose_of_flat


def body_frames(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return T_base_body of every body, (n_bodies, 4, 4) [m]."""
    return pose_of_flat(_flat_frames(robot, q))


def tool_pose(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return T_base_tool, (4, 4) [m], at q (dof,) [rad or m].

    Raises:
        BadConfiguration: Wrong length or not finite.
    """
    flat = _flat_frames(robot, checked(robot, q))[robot.tip_body]
    return pose_of_flat(flat) @ robot.T_body_tip


def sphere_centers(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return the centres of the cover's spheres in the base frame, (n, 3) [m]."""
    out = np.empty((len(robot.spheres), 3))
    flat = _flat_frames(robot, q)
    kernels.place_points(flat, robot.sphere_body, robot.spheres, out)
    return out


def cover_balls(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return the cover's spheres in the base frame, (n, 4): centre and radius [m]."""
    balls = np.array(robot.spheres)
    kernels.place_points(
        _flat_frames(robot, q), robot.sphere_body, robot.spheres, balls
    )
    return balls


def turns(robot: JointTree) -> bool:
    """Return whether any of its joints turns without end."""
    return True in robot.continuous.tolist()  # of few, a fifth of what `any` takes


def difference(robot: JointTree, q_from: np.ndarray, q_to: np.ndarray) -> np.ndarray:
    """Return `q_to - q_from`, (..., dof); continuous joints by the shorter turn."""
    dq = np.asarray(q_to, float) - np.asarray(q_from, float)
    if not turns(robot):
        return dq
    whole = np.round(dq / (2 * np.pi))
    return np.where(robot.continuous, dq - 2 * np.pi * whole, dq)


def unwrapped(robot: JointTree, path: np.ndarray) -> np.ndarray:
    """Return corners (k, dof), each by the shorter turn from the one before."""
    with np.errstate(invalid="ignore"):  # after what is infinite nothing is known
        legs = difference(robot, path[:-1], path[1:])
        return np.concatenate([path[:1], path[0] + np.cumsum(legs, axis=0)])


def wrapped(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return q (..., dof) with its continuous joints in [-pi, pi), copied.

    Those that are there already stay as they are, to the last bit.
    """
    if not turns(robot):
        return np.array(q, float)
    whole = np.floor((q + np.pi) / (2 * np.pi))
    return np.where(robot.continuous, q - 2 * np.pi * whole, q)


def motion_per_joint(
    tree_i: np.ndarray, tree_f: np.ndarray, reach: np.ndarray, dof: int
) -> np.ndarray:
    """Return (dof,) how far a joint moves any point at most, per rad or m.

    Arguments as `motion_per_point`.
    """
    moved = motion_per_point(tree_i, tree_f, reach, dof)
    return moved.max(axis=0, initial=0.0)


def motion_per_point(
    tree_i: np.ndarray, tree_f: np.ndarray, reach: np.ndarray, dof: int
) -> np.ndarray:
    """Return (n, dof) how far a joint moves each point at most [m per rad or m].

    The tree is as in `Robot`, and `reach` (n, n_bodies) the distances of points from
    the joints' axes.
    """
    moved = np.zeros((len(reach), dof))
    for joint in range(dof):
        bodies = tree_i[:, 1] == joint
        factor = np.abs(tree_f[bodies, 15])
        moved[:, joint] = (reach[:, bodies] * factor).sum(axis=1)
    return moved


def _flat_frames(robot: JointTree, q: np.ndarray) -> np.ndarray:
    frames = np.empty((len(robot.tree_i), 12))
    q = writable(q)
    kernels.body_frames(robot.tree_i, robot.tree_f, q, frames)
    return frames


def checked(robot: JointTree, q: np.ndarray) -> np.ndarray:
    """Return `q` as a (dof,) float array, or raise BadConfiguration."""
    check_robot(robot)
    try:
        q = np.ascontiguousarray(q, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadConfiguration(f"q must be {robot.dof} numbers, not {q!r}") from error
    if q.shape != (robot.dof,):
        raise BadConfiguration(
            f"q has the shape {q.shape}, but {robot.name} has {robot.dof} joints: "
            f"{', '.join(robot.joint_names)}"
        )
    if not np.isfinite(q).all():
        raise BadConfiguration(f"q holds NaN or infinity: {q.tolist()}")
    return q
