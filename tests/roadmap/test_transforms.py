"""Poses there and back, rotations about an axis, and what a joint does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from roadmap.errors import BadInput
from roadmap.transforms import (
    check_pose,
    flat_pose,
    inverse_pose,
    joint_motion,
    pose_of,
    pose_of_flat,
    rotation_about,
    rotation_rpy,
)


def test_a_pose_comes_back_from_its_row_and_from_its_inverse(rng):
    for _ in range(20):
        T = pose_of(rng.normal(size=3), rng.uniform(-3.0, 3.0, 3))
        assert np.array_equal(pose_of_flat(flat_pose(T)), T)
        assert np.allclose(inverse_pose(T) @ T, np.eye(4), atol=1e-12)


def is_rigid(T):
    """Say by the definition whether a pose is one."""
    R = T[:3, :3]
    off = np.abs(R @ R.T - np.eye(3)).max()
    last = np.abs(T[3] - [0, 0, 0, 1]).max()
    return bool(off < 1e-6 and np.linalg.det(R) > 0 and last <= 1e-9)


def test_a_pose_is_refused_where_it_is_no_rigid_motion(rng):
    rigid = 0
    for k in range(400):
        T = pose_of(rng.normal(size=3), rng.uniform(-3.0, 3.0, 3))
        i, j = rng.integers(4), rng.integers(4)
        T[i, j] += rng.choice([0.0, 1e-12, 2e-7, 1e-5, 0.1])
        i, j = rng.choice(3, 2, replace=False)
        T[i, :3] += rng.choice([0.0, 0.0, 2e-7, 1e-5]) * T[j, :3]  # skewed alone
        T[i, :3] *= rng.choice([1.0, 1.0, 1.0 + 1e-7, 1.0 + 1e-5])  # stretched alone
        if k % 5 == 0:
            T[:3, rng.integers(3)] *= -1.0  # mirrored
        if is_rigid(T):
            rigid += 1
            assert np.array_equal(check_pose(T, "T"), T)
        else:
            with pytest.raises(BadInput, match="T is not a rigid motion"):
                check_pose(T, "T")
        T[rng.integers(4), rng.integers(4)] = rng.choice([np.nan, np.inf, -np.inf])
        with pytest.raises(BadInput, match="T holds NaN or infinity"):
            check_pose(T, "T")
    assert 50 < rigid < 300
    with pytest.raises(BadInput, match="T is not a rigid motion"):
        check_pose(1e200 * np.eye(4), "T")  # its squares overflow


def test_a_rotation_about_an_axis_is_that_of_scipy(rng):
    for angle in (0.0, 0.3, -2.0, np.pi, 9.0):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        expected = Rotation.from_rotvec(angle * axis).as_matrix()
        assert np.allclose(rotation_about(axis, angle), expected, atol=1e-12)
    up = np.array([0.0, 0.0, 1.0])
    assert np.allclose(rotation_about(up, 0.4), rotation_rpy(0.0, 0.0, 0.4), atol=1e-15)


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "fixed"])
def test_a_joint_turns_slides_or_stays(kind):
    axis = np.array([0.0, 1.0, 0.0])
    T = joint_motion(kind, axis, 0.5)
    slides = kind == "prismatic"
    turned = np.eye(3) if slides or kind == "fixed" else rotation_about(axis, 0.5)
    assert np.array_equal(T[:3, :3], turned)
    assert T[:3, 3].tolist() == ([0.0, 0.5, 0.0] if slides else [0.0] * 3)
