"""Seven joints in closed form: all answers are right, and none is missing."""

import numpy as np
import pytest
from robot_asked import solutions

from roadmap.kinematics._chain import ChainArrays, forward
from roadmap.kinematics.joint_tree import REVOLUTE
from roadmap.kinematics.seven import seven_of
from roadmap.kinematics.tool_chain import tool_chain
from roadmap.transforms import flat_pose, pose_of

QUARTER = 0.5 * np.pi


def round_arm(off=0.0):
    """An arm with shoulder, elbow and wrist; its elbow is `off` [m] aside."""
    steps = [
        pose_of((0.0, 0.0, 0.2)),
        pose_of((0.0, 0.0, 0.0), (QUARTER, 0.0, 0.0)),
        pose_of((0.0, 0.0, 0.0), (-QUARTER, 0.0, 0.0)),
        pose_of((off, 0.0, 0.3), (QUARTER, 0.0, 0.0)),
        pose_of((-off, 0.3, 0.0), (-QUARTER, 0.0, 0.0)),
        pose_of((0.0, 0.0, 0.0), (QUARTER, 0.0, 0.0)),
        pose_of((0.0, 0.0, 0.0), (-QUARTER, 0.0, 0.0)),
        pose_of((0.0, 0.0, 0.15), (0.0, 0.0, 0.3)),
    ]
    scale = np.array([[1.0, 0.0]] * 6 + [[-1.0, 0.2]])
    return ChainArrays(
        fixed=np.array([flat_pose(T) for T in steps]),
        kind=np.array([[REVOLUTE, j] for j in range(7)], np.int32),
        scale=scale,
        limits=np.tile([-2.8, 2.6], (7, 1)),
        endless=np.zeros(7),
        length=np.array([1.0]),
    )


@pytest.fixture(params=["round", "round, elbow aside", "panda"])
def arm(request):
    if request.param == "panda":
        chain, _ = tool_chain(request.getfixturevalue("panda"))
    else:
        chain = round_arm(0.04 if "aside" in request.param else 0.0)
    seven = seven_of(chain)
    assert seven is not None and seven.round_wrist == request.param.startswith("round")
    return chain, seven


def tool(chain, q):
    frames, T = np.zeros((8, 12)), np.eye(4)
    forward(chain, np.ascontiguousarray(q), frames)
    T[:3, :3], T[:3, 3] = frames[-1, :9].reshape(3, 3), frames[-1, 9:]
    return T


def postures(chain, n):
    low, high = chain.limits.T
    return np.random.default_rng(5).uniform(low, high, (n, 7))


def test_every_solution_reaches_and_is_within_limits(arm):
    chain, seven = arm
    low, high = chain.limits.T
    count = 0
    for q in postures(chain, 20):
        T = tool(chain, q)
        for found in solutions(seven, T):
            assert np.abs(tool(chain, found) - T).max() < 1e-9
            assert (found >= low).all() and (found <= high).all()
            count += 1
    assert count > 100


def test_the_joints_that_a_pose_was_made_with_are_found(arm):
    chain, seven = arm
    for q in postures(chain, 20):
        every = solutions(seven, tool(chain, q), steps=1440)
        assert np.abs(every - q).max(axis=1).min() < 0.2


def test_out_of_reach_and_too_near_have_no_solution(arm):
    _, seven = arm
    far, near = pose_of((3.0, 0.0, 0.0)), np.eye(4)
    near[:3, 3] = seven.shoulder + seven.tool[9:] - seven.wrist  # W in S
    near[:3, :3] = seven.tool[:9].reshape(3, 3)
    assert len(solutions(seven, far)) == 0
    if seven.round_wrist:
        assert len(solutions(seven, near)) == 0
