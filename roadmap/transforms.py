"""Poses as (4, 4) arrays, and rotations from angles.

Conventions of the whole project: SI units; `T_a_b` is the pose of frame b in frame a,
so neighbours cancel: T_world_tool = T_world_base @ T_base_tool. Rotations from roll,
pitch, yaw are URDF's: about the fixed x, then y, then z axis. Quaternions occur only
in `sim/`, as pybullet's (x, y, z, w). The planner works in the robot's base frame.
"""

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np

from roadmap.errors import BadInput

_FLAT = np.array([0, 1, 2, 4, 5, 6, 8, 9, 10, 3, 7, 11])  # of a pose's numbers
_PAIRS = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)  # of the rows of a rotation


def rotation_rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the (3, 3) rotation of URDF's roll, pitch, yaw [rad]."""
    angles = np.array([roll, pitch, yaw])
    cr, cp, cy = np.cos(angles).tolist()  # plain floats: ten times as quick
    sr, sp, sy = np.sin(angles).tolist()
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_of(
    position: Sequence[float] | np.ndarray,
    rpy: Sequence[float] | np.ndarray = (0, 0, 0),
) -> np.ndarray:
    """Return the (4, 4) pose of a position [m] and roll, pitch, yaw [rad]."""
    return pose_with(rotation_rpy(*rpy), position)


def pose_with(
    rotation: np.ndarray, position: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """Return the (4, 4) pose of a (3, 3) rotation and a position [m]."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def moved_points(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return points (..., 3) moved by a pose (4, 4) [m]."""
    return points @ T[:3, :3].T + T[:3, 3]


def rotation_to_z(z: np.ndarray) -> np.ndarray:
    """Return a (3, 3) rotation whose z axis is a unit vector (3,)."""
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def flat_pose(T: np.ndarray) -> np.ndarray:
    """Return poses (..., 4, 4) as (..., 12): rotation by rows, then origin [m]."""
    return T.reshape(*T.shape[:-2], 16).take(_FLAT, axis=-1)


def pose_of_flat(row: np.ndarray) -> np.ndarray:
    """Return the poses (..., 4, 4) of rows (..., 12), see `flat_pose` [m]."""
    T = np.zeros((*row.shape[:-1], 4, 4))
    T[..., :3, :3] = row[..., :9].reshape(*row.shape[:-1], 3, 3)
    T[..., :3, 3], T[..., 3, 3] = row[..., 9:], 1.0
    return T


def inverse_pose(T: np.ndarray) -> np.ndarray:
    """Return the inverse (4, 4) of a rigid motion (4, 4) [m]."""
    return pose_with(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def rotation_about(axis: np.ndarray, angle: float | np.ndarray) -> np.ndarray:
    """Return the rotations (..., 3, 3) about a unit vector (3,) by angles [rad]."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = (f(angle)[..., None, None] for f in (np.sin, np.cos))
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def joint_motion(kind: str, axis: np.ndarray, value: float | np.ndarray) -> np.ndarray:
    """Return the motions (..., 4, 4) [m] of a URDF's joint of a `kind` at values.

    `axis` (3,) has length 1, in the joint's frame; a fixed joint takes no value.
    """
    T = np.tile(np.eye(4), (*np.shape(value), 1, 1))
    if kind == "prismatic":
        T[..., :3, 3] = np.multiply.outer(value, axis)
    elif kind != "fixed":
        T[..., :3, :3] = rotation_about(axis, value)
    return T


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def check_pose(pose: np.ndarray, name: str) -> np.ndarray:
    """Return a rigid `pose` as float (4, 4); refuse anything else by its name."""
    try:
        pose = np.asarray(pose).astype(float, casting="same_kind", copy=False)
    except (TypeError, ValueError, OverflowError) as error:
        kind = type(pose).__name__
        raise BadInput(
            f"{name}, a {kind}, holds no real numbers; give a (4, 4) pose of numbers"
        ) from error
    if pose.shape != (4, 4):
        raise BadInput(f"{name} has shape {pose.shape}; give a (4, 4) pose")
    rows = pose.tolist()  # plain floats: a fifth of the time
    if not all(map(math.isfinite, chain(*rows))):
        raise BadInput(f"{name} holds NaN or infinity; give finite numbers")
    off = max(abs(_dot(rows[i], rows[j]) - (i == j)) for i, j in _PAIRS)
    (a, b, c, _), (d, e, f, _), z, last = rows
    normal = b * f - c * e, c * d - a * f, a * e - b * d
    rigid = off < 1e-6 and _dot(normal, z) > 0
    if not rigid or max(map(abs, (*last[:3], last[3] - 1.0))) > 1e-9:
        raise BadInput(
            f"{name} is not a rigid motion: its rotation is off by {off:.2g} (limit "
            "1e-6), its last row must be 0 0 0 1 and mirroring is not allowed"
        )
    return pose
