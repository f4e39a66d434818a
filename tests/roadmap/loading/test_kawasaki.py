"""The Kawasaki FS003N against the published lengths of the RS003N, noted here again."""

import numpy as np
import pytest
from robot_asked import motion_free

from roadmap import load_robot, tool_pose
from roadmap.kinematics.forward import body_frames

# standard Denavit-Hartenberg: a [m], alpha [deg], d [m], offset of theta [deg]
DH = (
    (0.120, -90, 0.250, 0),
    (0.250, 0, 0.0, -90),
    (0.0, -90, 0.0, -90),
    (0.0, 90, 0.250, 0),
    (0.0, -90, 0.0, 0),
    (0.0, 0, 0.0715, 0),
)
LIMITS = ((-160, 160), (-60, 150), (-120, 150), (-360, 360), (-135, 135), (-360, 360))
SPEEDS = (360, 250, 225, 540, 225, 540)


@pytest.fixture(scope="module")
def kawasaki():
    return load_robot("kawasaki_fs003n", cover_excess=0.1)


def dh_pose(q):
    """Return the flange by the table, (4, 4)."""
    T = np.eye(4)
    for value, (a, alpha, d, offset) in zip(q, DH, strict=True):
        t, r = value + np.radians(offset), np.radians(alpha)
        c, s, ca, sa = np.cos(t), np.sin(t), np.cos(r), np.sin(r)
        T = T @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return T


def joint_points(robot, q):
    """Return the origin of each moving joint, (6, 3) [m]."""
    return body_frames(robot, q)[1:, :3, 3]


def test_at_zero_the_arm_points_straight_up(kawasaki):
    T = tool_pose(kawasaki, np.zeros(6))
    np.testing.assert_allclose(T[:3, 3], [0.120, 0, 0.8215], atol=1e-9)
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-9)


def test_the_flange_is_where_the_published_table_puts_it(kawasaki, rng):
    turn = np.linalg.inv(dh_pose(np.zeros(6))) @ tool_pose(kawasaki, np.zeros(6))
    np.testing.assert_allclose(turn[:3, 3], 0, atol=1e-9)
    for q in rng.uniform(kawasaki.lower, kawasaki.upper, (50, 6)):
        np.testing.assert_allclose(tool_pose(kawasaki, q), dh_pose(q) @ turn, atol=1e-8)


def test_the_links_have_the_published_lengths(kawasaki, rng):
    for q in rng.uniform(kawasaki.lower, kawasaki.upper, (20, 6)):
        _, j2, j3, _, j5, flange = joint_points(kawasaki, q)
        assert j2[2] == pytest.approx(0.250)
        assert np.hypot(j2[0], j2[1]) == pytest.approx(0.120)
        assert np.linalg.norm(j3 - j2) == pytest.approx(0.250)
        assert np.linalg.norm(j5 - j3) == pytest.approx(0.250)
        assert np.linalg.norm(flange - j5) == pytest.approx(0.0715)


def test_level_and_stretched_the_wrist_is_620_mm_from_the_first_axis(kawasaki):
    wrist = joint_points(kawasaki, np.array([0, np.pi / 2, 0, 0, 0, 0]))[4]
    np.testing.assert_allclose(wrist, [0.620, 0, 0.250], atol=1e-9)


def test_limits_and_speeds_are_the_catalogue_s(kawasaki):
    np.testing.assert_allclose(np.degrees([kawasaki.lower, kawasaki.upper]).T, LIMITS)
    np.testing.assert_allclose(np.degrees(kawasaki.max_velocity), SPEEDS)
    assert not kawasaki.continuous.any()


def test_the_estimated_shapes_leave_each_joint_alone_nearly_its_whole_range(kawasaki):
    ends = np.array([kawasaki.lower, kawasaki.upper])
    ends[1, 1:3], ends[:, 4] = [2.3, 2.3], [-2.0, 2.0]  # there boxes meet before
    for joint in range(6):
        q_a, q_b = np.zeros(6), np.zeros(6)
        q_a[joint], q_b[joint] = ends[:, joint]
        assert motion_free(kawasaki, q_a, q_b) == (True, None), joint
