"""Inverse kinematics in closed form of arms with seven turning joints.

It is there where the first three axes meet in one point, the shoulder, and axes five
and six in another, the wrist: Schunk's LWA4D, DRC-Hubo, people's arms, Franka's Panda.
The elbow may be offset. Where the last axis goes through the wrist, too, the free angle
is the elbow's swivel round the line from shoulder to wrist; else it is that of the last
joint, and two swivels belong to it. For each value there are eight solutions at most,
and all are found.
"""

import numpy as np

from roadmap.arrays import frozen
from roadmap.kinematics import _seven as kernels
from roadmap.kinematics._chain import ChainArrays
from roadmap.kinematics.joint_tree import REVOLUTE
from roadmap.transforms import flat_pose, pose_of_flat

_NEAR = 1e-6  # [m] axes that come so near meet


def seven_of(chain: ChainArrays) -> kernels.Seven | None:
    """Return an arm for the closed form; None: it is not of that kind."""
    kind = chain.kind
    if len(kind) != 7 or (kind[:, 0] != REVOLUTE).any():
        return None
    if kind[:, 1].tolist() != list(range(7)):
        return None
    T, axes, places = np.eye(4), [], []
    for row in chain.fixed[:-1]:
        T = T @ pose_of_flat(row)
        axes.append(T[:3, 2].copy())
        places.append(T[:3, 3].copy())
    T = T @ pose_of_flat(chain.fixed[-1])
    axes, places = np.array(axes), np.array(places)
    shoulder, off = _meeting(axes[:3], places[:3])
    wrist, off_wrist = _meeting(axes[4:6], places[4:6])
    if shoulder is None or wrist is None or max(off, off_wrist) > _NEAR:
        return None
    if abs(axes[3] @ axes[4]) > 1.0 - 1e-9 or abs(axes[5] @ axes[6]) > 1.0 - 1e-9:
        return None
    away = np.cross(axes[6], wrist - places[6])
    return kernels.Seven(
        axis=frozen(axes, float),
        place=frozen(places, float),
        shoulder=frozen(shoulder, float),
        wrist=frozen(wrist, float),
        tool=frozen(flat_pose(T), float),
        scale=frozen(chain.scale, float),
        limits=frozen(chain.limits, float),
        round_wrist=bool(np.linalg.norm(away) < _NEAR),
    )


def room() -> kernels.Room:
    """Return working memory for one thread."""
    return kernels.Room(
        R=np.zeros((8, 3, 3)),
        v=np.zeros((8, 3)),
        three=np.zeros((2, 2, 3)),
        q=np.zeros((8, 7)),
    )


def free_angles(arm: kernels.Seven, steps: int) -> np.ndarray:
    """Return (k,) values of the free angle, evenly over its range [rad]."""
    if arm.round_wrist:
        return 2.0 * np.pi * np.arange(steps) / steps
    low, high = np.sort(arm.limits[6] * arm.scale[6, 0] + arm.scale[6, 1])
    return np.linspace(low, high, steps)


def _meeting(axes: np.ndarray, places: np.ndarray) -> tuple[np.ndarray | None, float]:
    """Return the point nearest to all axes, and how far the farthest one is [m]."""
    across = [np.eye(3) - np.outer(a, a) for a in axes]
    A = sum(across)
    if np.linalg.cond(A) > 1e9 or any(
        abs(a @ b) > 1.0 - 1e-9 for a, b in zip(axes[:-1], axes[1:], strict=True)
    ):
        return None, np.inf
    b = sum(P @ x for P, x in zip(across, places, strict=True))
    point = np.linalg.solve(A, b)
    off = [np.linalg.norm(P @ (point - x)) for P, x in zip(across, places, strict=True)]
    return point, float(max(off))
