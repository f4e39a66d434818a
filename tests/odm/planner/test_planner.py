"""The planner's frame: go on, go a new way, hold and say why."""

import numpy as np
import pytest
from naive_cells import smallest_gap
from small import AWAY, HOME, NOBODY, POST, ball_at, wrapped

import odm


def follow(planner, q, path, reach=0.05):
    """Return the configuration a little farther along a path."""
    for a, b in zip(path, path[1:], strict=False):
        leg = np.linalg.norm(b - a)
        if leg > reach:
            return a + (b - a) * reach / leg
        reach -= leg
    return path[-1].copy()


def test_a_robot_on_its_path_goes_on_until_it_arrives(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    points, q = odm.sample_capsules(POST, 0.03), HOME.copy()
    first = planner.step(points, q=q)
    assert first.status == "replanned"
    for _ in range(400):
        answer = planner.step(points, q=q)
        assert answer.status == "following"
        assert answer.goal == 0
        if np.allclose(q, AWAY):
            break
        q = follow(planner, q, answer.path)
    assert np.allclose(wrapped(small_map, q - AWAY), 0)


def test_a_blocked_path_is_replaced_and_a_cleared_one_is_freed_in_the_same_frame(
    small_map,
):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    straight = planner.step(NOBODY, q=HOME)
    assert len(straight.path) == 2
    planner.reset()
    wall = np.array(
        [
            [0.0, y, z]
            for y in np.arange(-0.5, 0.5, 0.05)
            for z in np.arange(0.1, 1.6, 0.05)
        ]
    )
    held = planner.step(wall, q=HOME)
    assert held.status == "holding"
    assert planner.step(NOBODY, q=HOME).status == "replanned"


def test_a_free_path_is_not_given_up_for_a_hair(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    q, changes = HOME.copy(), 0
    post = POST.copy()
    planner.step(odm.sample_capsules(post, 0.03), q=q)
    for _ in range(100):
        shake = post.copy()
        shake[:, :6] += np.tile(rng.normal(scale=0.01, size=3), 2)
        answer = planner.step(odm.sample_capsules(shake, 0.03), q=q)
        changes += answer.status == "replanned"
    assert changes <= 5


@pytest.mark.parametrize(("more", "kept"), [(-0.02, False), (0.02, True)])
def test_a_free_path_is_given_up_for_one_shorter_by_the_margin(small_map, more, kept):
    post, weights = odm.sample_capsules(POST, 0.03), small_map.roadmap.weights

    def length(path):
        return np.linalg.norm(np.diff(path, axis=0) * weights, axis=1).sum()

    detour = length(answer_around(small_map, post).path)
    gain = 1.0 - length(np.array([HOME, AWAY])) / detour
    assert 0.1 < gain < 0.9
    settings = odm.PlannerSettings(hysteresis=gain + more)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    before = planner.step(post, q=HOME)
    answers = []
    for k in range(100):
        answers.append(planner.step(NOBODY, q=HOME))
        assert k > 0 or np.array_equal(answers[0].path, before.path)
        if k % 8 == 0:
            planner.improve(1)  # a search, and nothing else
    assert np.array_equal(answers[-1].path, before.path) == kept
    assert kept or len(answers[-1].path) == 2


def answer_around(cell_map, points):
    planner = odm.ReactivePlanner(cell_map)
    planner.set_goals([AWAY])
    return planner.step(points, q=HOME)


def test_the_first_reachable_goal_wins_and_costs_change_that(small_map, planner):
    near, far = np.array([0.9, 0.4, 0.0]), AWAY
    planner.set_goals([far, near])
    assert planner.step(NOBODY, q=HOME).goal == 0
    planner.set_goals([far, near], costs=[0.0, 0.0])
    assert planner.step(NOBODY, q=HOME).goal == 1
    planner.set_goals([far, near], costs=[0.0, 10.0])
    assert planner.step(NOBODY, q=HOME).goal == 0
    # the first goal walled in: the second is taken
    planner.set_goals([far, near])
    tip = ball_at([-0.55, 0.0, 0.2], 0.1)
    answer = planner.step(tip, q=HOME)
    assert answer.goal == 1


def test_improving_never_lengthens_and_is_remembered(small_map, planner, rng):
    cuts = shorter = 0
    for _ in range(25):
        q = HOME + rng.uniform(-0.2, 0.2, 3)
        planner.set_goals([AWAY + rng.uniform(-0.2, 0.2, 3)])
        points = odm.sample_capsules(POST + rng.uniform(-0.02, 0.02, 7), 0.03)
        before = planner.step(points, q=q)
        if before.status == "holding" or len(before.path) < 3:
            continue
        made = planner.improve(8)
        after = planner.step(points, q=q)
        cuts += made
        gain = length(before.path) - length(after.path)
        assert gain >= -1e-9
        shorter += gain > 1e-6
        for a, b in zip(after.path, after.path[1:], strict=False):
            assert planner.is_free(wrapped(small_map, a), wrapped(small_map, b))
    assert cuts > 0
    assert shorter > 0


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def test_scenery_of_the_place_is_heeded_by_paths_and_questions(small_map, planner):
    planner.set_goals([AWAY])
    box = odm.Box((0.1, 0.6, 0.3), np.eye(4)).moved(
        np.array([[1, 0, 0, 0.0], [0, 1, 0, 0.0], [0, 0, 1, 0.95], [0, 0, 0, 1.0]])
    )
    planner.set_static([box])
    assert planner.is_free(HOME, AWAY).failed == "scenery"
    answer = planner.step(NOBODY, q=HOME)
    points = odm.surface_of(box, 0.03).points
    for a, b in zip(answer.path, answer.path[1:], strict=False):
        assert smallest_gap(small_map, a, b - a, points, 100) >= 0.04 - 1e-9
    planner.set_static(NOBODY)
    assert planner.is_free(HOME, AWAY)


def test_is_free_names_the_test_that_failed(small_map, planner):
    robot = small_map.robot
    planner.step(ball_at([0.0, 0.0, 0.8]), q=HOME)
    assert planner.is_free(HOME, HOME)
    assert planner.is_free(HOME, np.array([9.0, 0, 0])).failed == "limits"
    low = np.array([robot.upper[0], robot.upper[1], 0.0])
    assert planner.is_free(low, low).failed in ("scenery", "self-collision")
    verdict = planner.is_free(HOME, AWAY)
    assert verdict.failed == "frame"
    assert "point" in verdict.reason
