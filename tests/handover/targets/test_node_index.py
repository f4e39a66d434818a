"""Nodes by the pose of the tool."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handover.targets.node_index import NodeIndex
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose


@pytest.fixture(scope="module")
def nodes(robot):
    return np.random.default_rng(4).uniform(robot.lower, robot.upper, (300, robot.dof))


@pytest.fixture(scope="module")
def index(robot, nodes):
    return NodeIndex(robot, nodes)


def angle(a, b):
    return Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()


def test_it_holds_the_pose_of_every_node(robot, nodes, index):
    for k in (0, 17, 299):
        np.testing.assert_array_equal(index.T_base_tool[k], tool_pose(robot, nodes[k]))


def test_a_node_is_nearest_to_its_own_pose(index):
    for k in range(0, 300, 23):
        assert index.nearest(index.T_base_tool[k], 3)[0] == k
        assert index.within(index.T_base_tool[k], 1e-6, 1e-6) == [k]


def test_nearest_weighs_angle_and_distance_as_told(robot, index, rng):
    for _ in range(20):
        T = tool_pose(robot, rng.uniform(robot.lower, robot.upper))
        away = np.linalg.norm(index.T_base_tool[:, :3, 3] - T[:3, 3], axis=1)
        turn = np.array([angle(node, T) for node in index.T_base_tool])
        # chords instead of angles: the same for small ones
        slow = np.hypot(away, 0.3 * 2.0 * np.sin(turn / 2.0))
        assert index.nearest(T)[0] == slow.argmin()


def test_off_is_distance_and_angle(index):
    T = index.T_base_tool[5].copy()
    T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec([0.0, 0.2, 0.0]).as_matrix()
    T[0, 3] += 0.03
    np.testing.assert_allclose(index.off(5, T), (0.03, 0.2), atol=1e-9)
    assert index.within(T, 0.031, 0.21)[0] == 5
    assert 5 not in index.within(T, 0.029, 0.21)
    assert 5 not in index.within(T, 0.031, 0.19)


@pytest.mark.parametrize("shape", [(0, 6), (5, 4), (6,)])
def test_nodes_of_another_robot_are_refused(robot, shape):
    with pytest.raises(BadInput, match="nodes have shape"):
        NodeIndex(robot, np.zeros(shape))
