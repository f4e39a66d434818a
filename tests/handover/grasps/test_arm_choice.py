"""Which arm: only left, only right, the better of both, or none and why."""

import numpy as np
import pytest

from handover import chain_of, load_agent
from handover.grasps.arm_choice import ArmReach, build_arm_reach, choose_arm
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose


def grid(name, values):
    """Return voxels of 1 m along x from 0, with these entries."""
    average = np.array(values, float).reshape(-1, 1, 1)
    return ArmReach(name, np.zeros(3), 1.0, average)


BOTH = {"left": grid("left", [0, 1, 1, 2, 0]), "right": grid("right", [0, 0, 2, 1, 1])}


@pytest.mark.parametrize(
    ("x", "arm", "told"),
    [
        (1.5, "left", "only left reaches"),
        (4.5, "right", "only right reaches"),
        (2.5, "right", "right has the most average manipulability"),
        (3.5, "left", "left has the most average manipulability"),
        (0.1, None, "no arm reaches"),
        (-3.0, None, "left comes within 4.50 m"),
    ],
)
def test_the_outcomes_of_the_paper(x, arm, told):
    choice = choose_arm(BOTH, [x, 0.5, 0.5])
    assert choice.arm == arm and told in choice.reason
    assert set(choice.entries) == {"left", "right"}


def test_a_point_that_is_none_is_refused():
    with pytest.raises(BadInput, match=r"finite \(3,\) point"):
        choose_arm(BOTH, [np.nan, 0, 0])
    with pytest.raises(BadInput, match="at least one arm"):
        choose_arm({}, [0, 0, 0])


@pytest.fixture(scope="module")
def crichton():
    """Return Crichton's arms: side -> robot and reach."""
    robots = {
        side: arm.load(cover_excess=0.1)
        for side, arm in load_agent("crichton").arms.items()
    }
    return {
        side: (robot, build_arm_reach(chain_of(robot, False), side, samples=40_000))
        for side, robot in robots.items()
    }


def test_crichton_takes_with_the_arm_on_that_side(crichton):
    reaches = {side: reach for side, (_, reach) in crichton.items()}
    assert choose_arm(reaches, [0.2, 0.9, 1.0]).arm == "left"
    assert choose_arm(reaches, [0.2, -0.9, 1.0]).arm == "right"
    far = choose_arm(reaches, [2.0, 0.0, 1.0])
    assert far.arm is None and "no arm reaches (2.00, 0.00, 1.00) m" in far.reason


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
