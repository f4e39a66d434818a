"""A line of the tool is followed as a plain loop would, and its bound always holds."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import odm
from odm.approach.tool_line import Line, NearPoses, ToolKinematics
from odm.cell_map.build import robot_of
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.transforms import flat_pose, pose_of

LIMITS = (0.001, 0.01)  # [m], [rad]
STEP = 0.03  # [m]


@pytest.fixture(scope="module")
def robot():
    return robot_of(odm.load_recipe("panda"))


@pytest.fixture(scope="module")
def tool(robot):
    return ToolKinematics(robot)


def middle(robot):
    q = 0.5 * (robot.lower + robot.upper)
    return np.where(np.isfinite(q), q, 0.0)


def test_poses_of_a_line_turn_at_a_constant_rate(rng):
    for turn in (np.zeros(3), rng.normal(size=3), np.array([np.pi - 1e-9, 0.0, 0.0])):
        start = pose_of(rng.normal(size=3), rng.normal(size=3))
        end = start.copy()
        end[:3, 3] += rng.normal(size=3)
        end[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ start[:3, :3]
        line = Line.between(start, end)
        for s in (0.0, 0.3, 1.0):
            turned = Rotation.from_rotvec(s * turn).as_matrix() @ start[:3, :3]
            row = line.pose(s)
            np.testing.assert_allclose(row[:9], turned.ravel(), atol=1e-8)
            at = start[:3, 3] + s * (end[:3, 3] - start[:3, 3])
            np.testing.assert_allclose(row[9:], at, atol=1e-15)


def by_hand(tool, line, q, shares):
    """Follow a line leg by leg, each halved where it leaves the line too far."""
    span = shares[1] - shares[0]
    n = max(1, int(np.ceil(abs(span) * line.length / STEP - 1e-9)))
    goals = [shares[0] + span * k / n for k in range(n, 0, -1)]
    qs, ss, fits, ahead = [q], [shares[0]], 2.0, np.zeros_like(q)
    while goals:
        while abs(goals[-1] - ss[-1]) > 1.5 * fits:
            goals.append(0.5 * (goals[-1] + ss[-1]))
        s = goals[-1]
        new = qs[-1] + ahead * (s - ss[-1])
        reached, *_ = tool.reach(line.pose(s), new)
        errors = (np.inf, np.inf)
        if reached:
            errors = tool.leg_error(line, ss[-1], s, qs[-1], new)
        if errors[0] > LIMITS[0] or errors[1] > LIMITS[1]:
            if abs(s - ss[-1]) <= 1.5 * abs(span) / n / 16.0:
                return np.array(qs), np.array(ss), False
            fits = 0.5 * abs(s - ss[-1])
            continue
        ahead = difference(tool.robot, qs[-1], new) / (s - ss[-1])
        qs.append(new)
        ss.append(s)
        goals.pop()
    return np.array(qs), np.array(ss), True


def test_a_line_is_followed_as_by_hand(tool, robot, rng):
    ends = []
    for _ in range(40):
        q = middle(robot) + 0.3 * rng.uniform(-1, 1, robot.dof)
        q = np.clip(q, robot.lower, robot.upper)
        start = tool_pose(robot, q)
        end = start.copy()
        end[:3, 3] += rng.uniform(0.05, 0.5) * np.eye(3)[rng.integers(3)]
        shares = [(0.0, 1.0), (1.0, 0.0)][int(rng.integers(2))]
        line = Line.between(*((start, end) if shares[0] == 0.0 else (end, start)))
        found = tool.follow(line, q, shares, STEP, LIMITS)
        qs, s, arrived = by_hand(tool, line, q.copy(), shares)
        ends.append(arrived)
        assert (not found.stopped) == arrived
        np.testing.assert_allclose(found.s, s, atol=1e-12)
        np.testing.assert_allclose(found.q, qs, atol=1e-9)
        assert found.error_m <= LIMITS[0] and found.error_rad <= LIMITS[1]
    assert 5 < sum(ends) < 40  # some leave the reach


def test_what_is_halved_has_room(tool, robot):
    q = middle(robot)
    start = tool_pose(robot, q)
    end = start @ pose_of([0.1, 0.0, 0.0], [0.0, 0.0, 0.4])
    line = Line.between(start, end)
    once = tool.follow(line, q, (0.0, 1.0), 2.0, (0.1, 1.0))
    assert len(once.q) == 2  # one leg, were it not halved
    tight = tool.follow(line, q, (0.0, 1.0), 2.0, LIMITS)
    assert not tight.stopped and len(tight.q) > 4
    assert not tool.follow(line, q, (0.0, 1.0), 1e-4, LIMITS).stopped


@pytest.mark.parametrize("n", [1, 8, 128, 999, 3000])
def test_the_nearest_poses_are_those_a_sort_finds(n, rng):
    poses = [pose_of(rng.normal(size=3), rng.normal(size=3)) for _ in range(1000)]
    rows = flat_pose(np.array(poses))
    rows[100:200] = rows[0]  # equally near: the first of them come first
    weights = np.array([0.5 * 0.3**2] * 9 + [1.0] * 3)
    for target in (rows[0], rows[500] + 0.01):
        gaps = (rows * rows) @ weights + rows @ (-2.0 * weights * target)
        least = np.sort(gaps)[: min(n, 1000)]
        near = NearPoses(rows).nearest(target, n)
        assert len(near) == len(set(near.tolist())) == min(n, 1000)
        np.testing.assert_allclose(gaps[near], least, atol=1e-12)


def test_manipulability_is_that_of_the_jacobian(tool, robot, rng):
    for _ in range(20):
        q = rng.uniform(robot.lower, robot.upper)
        J = np.empty((6, robot.dof))
        for j, dq in enumerate(1e-6 * np.eye(robot.dof)):
            a, b = tool_pose(robot, q - dq), tool_pose(robot, q + dq)
            R = (b[:3, :3] - a[:3, :3]) @ a[:3, :3].T / 2e-6
            J[:3, j] = (b[:3, 3] - a[:3, 3]) / 2e-6
            J[3:, j] = R[2, 1], R[0, 2], R[1, 0]
        expected = np.sqrt(np.linalg.det(J @ J.T))
        assert tool.manipulability(q) == pytest.approx(expected, rel=1e-4, abs=1e-7)
