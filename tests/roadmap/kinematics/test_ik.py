"""Inverse kinematics: solutions reach the pose, keep the limits, come in order."""

import numpy as np
import pytest

from roadmap import tool_pose
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics.forward import difference
from roadmap.kinematics.inverse import solve


def test_solutions_reach_the_pose_within_limits(panda, gantry, rng):
    solved = 0
    for _ in range(60):
        T = tool_pose(panda, rng.uniform(panda.lower, panda.upper))
        solutions = panda.ik(T)
        solved += len(solutions) > 0
        for s in solutions:
            reached = tool_pose(panda, s.q)
            assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) <= 1e-6
            assert np.abs(reached - T).max() < 2e-6
            assert s.position_error <= 1e-6 and s.rotation_error <= 1e-6
            assert (s.q >= panda.lower).all() and (s.q <= panda.upper).all()
    assert solved >= 57


def test_the_nearest_to_the_seed_comes_first(panda, rng):
    q = rng.uniform(panda.lower, panda.upper)
    seed = np.clip(q + 0.05, panda.lower, panda.upper)
    solutions = panda.ik(tool_pose(panda, q), q_seed=seed)
    ways = [np.linalg.norm(s.q - seed) for s in solutions]
    assert ways == sorted(ways) and ways[0] < 0.3
    assert len(solutions) > 1


def test_solutions_are_distinct_and_repeatable(panda, rng):
    T = tool_pose(panda, rng.uniform(panda.lower, panda.upper))
    first, second = panda.ik(T), panda.ik(T)
    assert [s.q.tobytes() for s in first] == [s.q.tobytes() for s in second]
    for i, a in enumerate(first):
        for b in first[:i]:
            assert np.abs(a.q - b.q).max() >= 1e-3
    assert not first[0].q.flags.writeable


def test_prismatic_continuous_and_mimic_joints_are_solved(gantry, rng):
    for _ in range(20):
        q = rng.uniform(gantry.lower, gantry.upper)
        solutions = solve(gantry, tool_pose(gantry, q), q_seed=q + 0.05)
        assert solutions
        assert np.abs(difference(gantry, solutions[0].q, q)).max() < 1e-4
        assert (np.abs([s.q[1] for s in solutions]) <= np.pi).all()


def test_a_pose_out_of_reach_has_no_solution(panda):
    T = tool_pose(panda, np.zeros(7))
    T[:3, 3] = 3.0, 0.0, 0.5
    assert panda.ik(T) == []


def test_a_seed_outside_the_limits_is_only_a_start(panda, rng):
    T = tool_pose(panda, rng.uniform(panda.lower, panda.upper))
    for s in panda.ik(T, q_seed=np.full(7, 9.0)):
        assert (s.q <= panda.upper).all()


def bent(**changes):
    T = np.eye(4)
    for place, value in changes.items():
        T[int(place[1]), int(place[2])] = value
    return T


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (np.eye(3), r"\(4, 4\)"),
        ("home", "numbers"),
        (bent(_03=np.nan), "NaN"),
        (bent(_00=1.1), "rigid"),
        (bent(_00=-1.0), "mirroring"),
        (bent(_30=0.5), "last row"),
    ],
)
def test_a_bad_pose_is_refused_in_one_sentence(panda, pose, words):
    with pytest.raises(BadInput, match=words):
        panda.ik(pose)


def test_a_bad_seed_is_refused(panda):
    with pytest.raises(BadConfiguration):
        panda.ik(np.eye(4), q_seed=np.zeros(3))
