"""Chains to fill reach maps with: a person-like arm, written by hand for the tests."""

import numpy as np
from scipy.spatial.transform import Rotation

from handover import Chain
from handover.reach.reach_recall import random_poses
from roadmap.transforms import pose_of

# parts of the arm's length: MMM's 0.188, 0.145 and half of 0.108 of the height
UPPER, FORE, GRIP = 0.188 / 0.387, 0.145 / 0.387, 0.054 / 0.387
# name, axis in the arm's own frame (it hangs along -z, x to the front), degrees
JOINTS = (
    ("flexion", (0, -1, 0), (-60, 167)),
    ("abduction", (1, 0, 0), (-40, 170)),
    ("turn", (0, 0, 1), (-70, 90)),
    ("elbow", (0, -1, 0), (0, 143)),
    ("forearm", (0, 0, 1), (-76, 82)),
    ("wrist", (0, -1, 0), (-75, 76)),
    ("deviation", (1, 0, 0), (-22, 36)),
)

# where the robot of the workspaces stands in the world
BASE = pose_of([0.1, -0.2, 0.8], [0.0, 0.0, 0.4])


def person_arm() -> Chain:
    """Return an arm of seven joints in units of its length, in the shoulder's frame."""
    fixed, last = [], np.eye(4)
    for name, axis, _ in JOINTS:
        T = np.eye(4)
        if name == "elbow":
            T[2, 3] = -UPPER
        if name == "wrist":
            T[2, 3] = -FORE
        turn = np.eye(4)
        turn[:3, :3] = Rotation.align_vectors([axis], [(0, 0, 1)])[0].as_matrix()
        fixed.append(flat(last @ T @ turn))
        last = turn.T
    tool = np.eye(4)
    tool[2, 3] = -GRIP
    fixed.append(flat(last @ tool))
    return Chain(
        name="person",
        joint_names=tuple(name for name, _, _ in JOINTS),
        fixed=np.array(fixed),
        kind=np.array([(1, k) for k in range(7)]),
        scale=np.tile([1.0, 0.0], (7, 1)),
        limits=np.radians([limits for _, _, limits in JOINTS]),
        endless=np.zeros(7),
        unit="arm length",
        frame="shoulder",
    )


def person_pose(q) -> np.ndarray:
    """Return T_shoulder_grip by a product of scipy's rotations."""
    T = np.eye(4)
    for (name, axis, _), angle in zip(JOINTS, q, strict=True):
        if name in ("elbow", "wrist"):
            T = T @ offset(-UPPER if name == "elbow" else -FORE)
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
        T = T @ turn
    return T @ offset(-GRIP)


def offset(z) -> np.ndarray:
    T = np.eye(4)
    T[2, 3] = z
    return T


def flat(T) -> np.ndarray:
    return np.concatenate([T[:3, :3].ravel(), T[:3, 3]])


def slow_dexterity(chain, q, J):
    """Singular values of Jacobians (..., 6, n), columns weighted by the limits."""
    low, high = chain.limits.T
    with np.errstate(divide="ignore"):
        slope = (high - low) ** 2 * (2 * q - low - high)
        slope = np.abs(slope / (4 * (high - q) ** 2 * (q - low) ** 2))
    weights = np.where(chain.endless > 0, 1.0, 1 / np.sqrt(1 + slope))
    lengths = np.ones((6, 1))
    lengths[:3] = chain.length
    J = J / lengths * weights[..., None, :]
    return np.prod(np.linalg.svd(J, compute_uv=False), axis=-1)


def naive_cell(grid, T):
    """The cell of a pose (4, 4) by numpy."""
    index = np.floor((T[:3, 3] - grid.origin) / grid.cell).astype(int)
    if (index < 0).any() or (index >= grid.shape).any():
        return -1
    position = np.ravel_multi_index(index, grid.shape)
    return position * grid.rotations.n_cells + grid.rotations.cell_of(T[:3, :3])


def some_poses(reach, n, rng):
    flat = random_poses(reach.grid.box + [[-0.1], [0.1]], n, rng)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = flat[:, :9].reshape(-1, 3, 3), flat[:, 9:]
    return poses
