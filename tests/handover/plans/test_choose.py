"""Arm, grasps, pose: tested in turn, and yet what Algorithms 1 to 3 would choose."""

from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest
from robot_asked import solutions

import handover
from handover.plans import _prune as kernels
from handover.plans.choose import Report, tuples
from handover.plans.paths import OutOfTime
from handover.plans.settings import PlanSettings
from roadmap.kinematics._chain import dexterity, forward, jacobian
from sim.bench.handover.whole_choice import (
    best_of,
    key_of,
    pair_of,
    prune_grasps,
    whole_choice,
)

SETTINGS = PlanSettings(voxels=16, turns=5)


def dexterity_of(limb, q):
    n, chain = limb.n_arm, limb.chain.arrays
    frames, jac = np.zeros((len(chain.kind) + 1, 12)), np.zeros((6, n))
    q = np.ascontiguousarray(q[:n])
    forward(chain, q, frames)
    jacobian(chain, frames, jac)
    return dexterity(chain, q, jac, np.zeros((n, 7)), np.zeros((6, 6)))


@pytest.fixture(scope="module")
def scene():
    scene = handover.load_scene("kneeling", 1)
    giver = replace(scene.giver, arms=("left",))
    return replace(scene, giver=giver, receiver=replace(scene.receiver, arms=("left",)))


@pytest.fixture
def pair(scene, grasps):
    return pair_of(scene, ("left", "left"), grasps)


@pytest.fixture(scope="module")
def chosen(scene, grasps):
    """All tuples of the first step with any, in the planner's order; its report."""
    report, pair = Report(), pair_of(scene, ("left", "left"), grasps)
    found = tuples(scene, pair, SETTINGS, report)
    first = next(found)
    return [first, *takewhile(lambda t: t.step == first.step, found)], report


def test_time_is_looked_at_before_each_pose(scene, pair):
    """Arms without a closed form look at thousands of poses between two tuples."""
    report, looks = Report(), []

    def late():
        looks.append(report.poses[0])
        return len(looks) > 4

    with pytest.raises(OutOfTime, match="the choice of grasps and pose"):
        for _ in tuples(scene, pair, SETTINGS, report, late):
            pass
    assert looks == [0, 1, 2, 3, 4]


def test_h_is_that_of_the_algorithms_as_they_are_written(scene, pair, chosen):
    found, _ = chosen
    wholes = whole_choice(scene, pair, SETTINGS)
    ours = {
        key_of(t.grasp_receiver, t.grasp_giver, t.T_world_handover): t.dexterity
        for t in found
    }
    assert len(ours) > 10 and wholes[-1].step == found[0].step
    assert ours.keys() == wholes[-1].tuples.keys()
    assert all(abs(ours[k] - v) < 1e-12 for k, v in wholes[-1].tuples.items())
    assert found[0].dexterity == best_of(wholes, set())


def test_tuples_come_by_the_receivers_dexterity_at_the_goal(chosen):
    values = [t.dexterity for t in chosen[0]]
    assert len(set(values)) > 2 and values == sorted(values, reverse=True)


def test_what_was_refused_is_left_out_of_the_comparison(scene, pair, chosen):
    found, _ = chosen
    wholes = whole_choice(scene, pair, SETTINGS)
    gone = {
        key_of(t.grasp_receiver, t.grasp_giver, t.T_world_handover)
        for t in found
        if t.grasp_receiver == found[0].grasp_receiver
    }
    after = next(t for t in found if t.grasp_receiver != found[0].grasp_receiver)
    assert best_of(wholes, gone) == after.dexterity < best_of(wholes, set())


def test_the_first_tuple_tests_few_grasps_and_the_report_counts_all(scene, pair):
    report = Report()
    next(tuples(scene, pair, SETTINGS, report))
    untested = {w: (some.verdicts == kernels.UNKNOWN).sum() for w, some in
                report.looked.items()}  # fmt: skip
    assert all(untested.values())
    for (n, left, refused), grasps in zip(
        reversed(report.grasps.values()), (pair.of_giver, pair.of_receiver), strict=True
    ):
        assert n == len(grasps) == left + sum(refused.values())


def test_pruning_agrees_with_one_posture_at_a_time(scene, pair):
    """Every solution of a grasp, by the tests that prove motions, in numpy's order."""
    giver, grasps = pair.giver, pair.of_giver
    T = scene.T_world_start
    giver.put_object(T)
    giver.let_touch()
    left = prune_grasps(giver, grasps, T)
    found, limb = dict(zip(left.grasp.tolist(), left.q, strict=True)), giver.limb
    assert 0 < len(found) < len(grasps)
    for g in range(len(grasps)):
        T_mount_palm = np.linalg.inv(giver.T_mount) @ T @ grasps.T_object_palm[g]
        every = solutions(limb.seven, T_mount_palm, steps=12)
        value = [dexterity_of(limb, q) for q in every]
        best = None
        for k in np.argsort(value)[::-1]:
            hands = grasps.values[g], grasps.preshape[g]
            postures = [np.concatenate([every[k], fingers]) for fingers in hands]
            if all(giver.why(q)[1] is None for q in postures):
                best = value[k]
                break
        assert (best is not None) == (g in found)
        if best is not None:
            assert abs(dexterity_of(limb, found[g]) - best) < 1e-9


def test_pruning_tells_why(scene, pair):
    giver, grasps = pair.giver, pair.of_giver
    far = scene.T_world_start.copy()
    far[0, 3] += 5.0
    giver.put_object(far)
    left = prune_grasps(giver, grasps, far)
    assert not len(left) and left.refused == {"out of reach": len(grasps)}
