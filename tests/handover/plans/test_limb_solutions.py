"""The closed form of the agents' own arms: right answers, none missing, no others."""

import numpy as np
import pytest
from robot_asked import solutions

import handover
from handover.plans.limb import limb_of
from roadmap.kinematics.seven import seven_of

ARMS = [("crichton", "left"), ("drchubo", "left"), ("panda", "right")]


@pytest.fixture(scope="module", params=ARMS, ids=lambda arm: arm[0])
def limb(request):
    name, side = request.param
    return limb_of(handover.load_agent(name), side)


def drawn(limb, n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(*limb.chain.limits.T, (n, 7))


def test_every_solution_is_within_limits_and_reaches_the_pose(limb):
    low, high = limb.chain.limits.T
    for q in drawn(limb, 20):
        T = limb.chain.tool_pose(q)
        found = solutions(limb.seven, T, 12)
        assert (found >= low).all() and (found <= high).all()
        for one in found:
            assert np.abs(limb.chain.tool_pose(one) - T).max() < 1e-9


def test_the_configuration_behind_a_pose_is_found_again(limb):
    """The free angle is a grid: with it fine, a solution lies beside any posture."""
    for q in drawn(limb, 5, seed=3):
        found = solutions(limb.seven, limb.chain.tool_pose(q), 720)
        away = np.abs(found - q)
        assert np.minimum(away, 2.0 * np.pi - away).max(axis=1).min() < 0.1


def test_a_pose_out_of_reach_has_no_solution(limb):
    T = np.eye(4)
    T[:3, 3] = 3.0, 0.0, 0.0
    assert len(solutions(limb.seven, T)) == 0


def test_the_last_joint_of_panda_is_its_free_angle():
    arms = {name: limb_of(handover.load_agent(name), side) for name, side in ARMS}
    assert not arms["panda"].seven.round_wrist
    assert arms["crichton"].seven.round_wrist and arms["drchubo"].seven.round_wrist


def test_other_chains_have_no_closed_form():
    arrays = limb_of(handover.load_agent("crichton"), "left").chain.arrays
    bent = arrays.fixed.copy()
    bent[5, 9] += 0.01  # axes five and six no longer meet
    assert seven_of(arrays._replace(fixed=bent)) is None
    fewer = arrays._replace(kind=arrays.kind[:6])
    assert seven_of(fewer) is None
