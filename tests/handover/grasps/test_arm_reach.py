"""Which arm: only left, only right, the better of both, or none and why."""

import numpy as np
import pytest

from handover import chain_of, load_agent
from handover.grasps.arm_reach import ArmReach, build_arm_reach
from handover.plans import choose
from roadmap import load_robot
from roadmap.kinematics.forward import tool_pose


def grid(name, values):
    """Return voxels of 1 m along x from 0, with these entries."""
    average = np.array(values, float).reshape(-1, 1, 1)
    return ArmReach(name, np.zeros(3), 1.0, average)


BOTH = {"left": grid("left", [0, 1, 1, 2, 0]), "right": grid("right", [0, 0, 2, 1, 1])}


@pytest.mark.parametrize(
    ("x", "size", "arms", "told"),
    [
        (1.5, 0.0, ["left"], "only the left arm"),
        (1.5, 1.0, ["left", "right"], "only the left arm"),  # it may come to an end
        (4.5, 0.0, ["right"], "only the right arm"),
        (2.5, 0.0, ["right", "left"], "the right arm: manipulability"),
        (3.5, 0.0, ["left", "right"], "the left arm: manipulability"),
        (0.1, 0.0, [], "no arm reaches"),
        (0.1, 2.0, ["left"], "1.40 m, which is less than the thing is long"),
        (-3.0, 0.0, [], "the left one comes within 4.50 m"),
    ],
)
def test_the_outcomes_of_the_paper(x, size, arms, told, monkeypatch):
    found, text = in_order(BOTH, [x, 0.5, 0.5], monkeypatch, size)
    assert found == arms and told in text


def in_order(reaches, point, monkeypatch, size=0.0):
    """Return what `arms_in_order` makes of arms that reach like this."""
    monkeypatch.setattr(choose, "reach_of", lambda limb: reaches[limb])
    mounts = {side: np.eye(4) for side in reaches}
    return choose.arms_in_order({s: s for s in reaches}, mounts, np.array(point), size)


@pytest.fixture(scope="module")
def crichton():
    """Return Crichton's arms: side -> robot and reach."""
    robots = {
        side: load_robot(arm.robot, locked=arm.spec.preshapes[0], cover_excess=0.1)
        for side, arm in load_agent("crichton").arms.items()
    }
    return {
        side: (robot, build_arm_reach(chain_of(robot, False), side, samples=40_000))
        for side, robot in robots.items()
    }


def test_crichton_takes_with_the_arm_on_that_side(crichton, monkeypatch):
    reaches = {side: reach for side, (_, reach) in crichton.items()}
    assert in_order(reaches, [0.2, 0.9, 1.0], monkeypatch)[0][0] == "left"
    assert in_order(reaches, [0.2, -0.9, 1.0], monkeypatch)[0][0] == "right"
    arms, why = in_order(reaches, [2.0, 0.0, 1.0], monkeypatch)
    assert arms == [] and "no arm reaches (2.00, 0.00, 1.00) m" in why


def test_the_entry_is_the_average_over_the_voxel(crichton):
    robot, reach = crichton["left"]
    chain, rng = chain_of(robot, False), np.random.default_rng(1)
    low, high = chain.limits.T
    q = np.concatenate([rng.uniform(low, high, (20_000, 7)) for _ in range(2)])
    points = np.array([chain.tool_pose(one)[:3, 3] for one in q])
    at = np.floor((points - reach.origin) / reach.cell).astype(int)
    inside = (at == at[7]).all(axis=1)
    values = [_naive(robot, one) for one in q[inside]]
    middle = reach.origin + (at[7] + 0.5) * reach.cell
    assert reach.at(middle) == pytest.approx(np.mean(values), rel=1e-4)


def _naive(robot, q, step=1e-6):
    """Return the manipulability from differences of the tool's pose."""
    T = tool_pose(robot, q)
    columns = []
    for j in range(len(q)):
        moved = q.copy()
        moved[j] += step
        U = tool_pose(robot, moved)
        turn = (U[:3, :3] - T[:3, :3]) @ T[:3, :3].T / step
        angular = [turn[2, 1], turn[0, 2], turn[1, 0]]
        columns.append([*((U[:3, 3] - T[:3, 3]) / step), *angular])
    J = np.array(columns).T
    return np.sqrt(max(0.0, np.linalg.det(J @ J.T)))
