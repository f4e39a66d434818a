"""Goals change under way: a better one that gets free, and one more on the list."""

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, ball_at, draw_valid, small_recipe

import odm
from roadmap.kinematics.forward import tool_pose

BETTER = np.array([1.2, -0.9, 0.4])


@pytest.fixture(scope="module")
def arm3():
    return odm.build_map(small_recipe(), threads=1)


@pytest.fixture
def planner(arm3):
    return odm.ReactivePlanner(arm3)


def test_a_better_goal_that_gets_free_is_taken_from_a_straight_way(planner):
    ball = ball_at(tool_pose(planner.robot, BETTER)[:3, 3], 0.05)
    planner.set_goals([BETTER, AWAY])
    q = HOME
    for _ in range(3):
        answer = planner.step(ball, q=q)
    assert answer.goal == 1
    # nothing is shorter than the rest of the way to the second goal
    q = answer.path[-1] + 0.5 * (answer.path[-2] - answer.path[-1])
    goals = [planner.step(NOBODY, q=q).goal for _ in range(60)]
    assert goals[-1] == 0


def straight_goal(planner, points):
    """Draw a second goal that a planner goes straight to, BETTER being blocked."""
    rng = np.random.default_rng(0)
    while True:
        worse = draw_valid(planner, rng)
        planner.reset()
        planner.set_goals([BETTER, worse])
        answers = [planner.step(points, q=HOME) for _ in range(6)]
        far = np.abs(worse - HOME).max() > 0.8
        if far and answers[-1].goal == 1 and len(answers[-1].path) == 2:
            return worse


def test_a_better_goal_is_seen_under_way_on_a_straight_motion(planner):
    """Its ends are no nodes: nothing but the robot itself leads to the other goal."""
    ball = ball_at(tool_pose(planner.robot, BETTER)[:3, 3], 0.05)
    worse = straight_goal(planner, ball)
    q, goals = HOME, []
    for _ in range(70):
        answer = planner.step(NOBODY if goals else ball, q=q)
        goals.append(answer.goal)
        if answer.goal == 0:
            break
        assert len(answer.path) == 2
        way = answer.path[1] - q
        q = q + way * min(1.0, 0.01 / np.abs(way).max())
    assert goals[-1] == 0 and goals[0] == 1
    assert np.abs(q - worse).max() > 0.05  # before it arrives


def test_where_goals_have_costs_their_order_is_no_rank(planner):
    worse = straight_goal(planner, ball_at(tool_pose(planner.robot, BETTER)[:3, 3]))
    planner.reset()
    planner.set_goals([BETTER, worse], costs=[50.0, 0.0])
    goals = [planner.step(NOBODY, q=HOME).goal for _ in range(60)]
    assert set(goals) == {1}


def test_new_costs_of_the_same_goals_count_on_a_straight_path_too(planner):
    worse = straight_goal(planner, ball_at(tool_pose(planner.robot, BETTER)[:3, 3]))
    planner.reset()
    for costs in ([0.0, 50.0], [50.0, 0.0], [0.0, 50.0]):
        planner.set_goals([BETTER, worse], costs=costs)
        for _ in range(60):
            answer = planner.step(NOBODY, q=HOME)
            planner.improve(8)
        assert answer.goal == int(np.argmin(costs))


def test_a_better_goal_beside_a_hand_is_taken_though_it_is_never_calm(planner):
    """It keeps clear of the frame's points, not of those grown by `calm`."""
    tool = tool_pose(planner.robot, BETTER)[:3, 3]
    blocked = ball_at(tool, 0.05)
    worse = straight_goal(planner, blocked)
    away = np.array([0.0, 0.0, 1.0])
    for far in np.arange(0.0, 0.5, 0.005):
        beside = ball_at(tool + far * away, 0.05)
        planner.step(beside, q=HOME)
        if planner.stands_clear(BETTER):
            break
    # the planner knows the ball there, and grown it does not let it pass
    calm = planner.settings.history_clearance
    assert calm > 0 and planner.settings.history_s > 0
    shifts = calm * np.vstack([np.eye(3), -np.eye(3)])
    planner.step(np.vstack([beside + shift for shift in shifts]), q=HOME)
    assert not planner.stands_clear(BETTER)
    planner.reset()
    planner.set_goals([BETTER, worse])
    goals = [planner.step(blocked, q=HOME).goal for _ in range(10)]
    assert goals[-1] == 1
    goals = [planner.step(beside, q=HOME).goal for _ in range(80)]
    assert goals[-1] == 0
    assert 1 in goals[:10]  # not at the first look: it might be a tremble


def test_a_goal_that_is_kept_keeps_its_straight_motions(planner):
    planner.set_goals([AWAY])
    for _ in range(5):  # it stays: the start is attached in full
        planner.step(NOBODY, q=HOME)
    assert planner.attacher.is_attached(HOME)
    swept = []
    sweep = planner.attacher.sweep
    planner.attacher.sweep = lambda q, dq: (swept.append(len(q)), sweep(q, dq))[1]
    ref = int(planner.memory.goals.attached_ref[0])
    planner.set_goals([BETTER, AWAY])
    assert int(planner.memory.goals.attached_ref[1]) == ref
    assert swept[-1] == 1  # the straight motion to the new one only


def test_answers_do_not_depend_on_what_was_kept(arm3):
    kept, fresh = odm.ReactivePlanner(arm3), odm.ReactivePlanner(arm3)
    kept.set_goals([AWAY])
    for _ in range(5):
        kept.step(NOBODY, q=HOME)
    kept.set_goals([BETTER, AWAY])
    kept.reset()
    fresh.set_goals([BETTER, AWAY])
    ball = ball_at(tool_pose(kept.robot, BETTER)[:3, 3], 0.05)
    for points in (NOBODY, ball):
        a, b = kept.step(points, q=HOME), fresh.step(points, q=HOME)
        assert (a.status == "holding") == (b.status == "holding")
        assert a.goal == b.goal
        np.testing.assert_allclose(a.path, b.path, atol=1e-12)
        kept.reset(), fresh.reset()


def test_a_start_that_no_motion_leaves_still_goes_straight_to_another_goal(planner):
    near = HOME + [0.1, -0.1, 0.2]
    late = HOME + 0.75 * (BETTER - HOME)
    ball = ball_at(tool_pose(planner.robot, late)[:3, 3], 0.02)
    planner.set_goals([BETTER, near])
    for _ in range(5):
        planner.step(NOBODY, q=HOME)
    planner.reset()
    planner.attacher.attach_start(HOME)
    # as where every motion is blocked for good
    planner.memory.start_connections.count[0] = 0
    answer = planner.step(ball, q=HOME)
    assert not planner.is_free(HOME, BETTER) and planner.is_free(HOME, near)
    assert answer.goal == 1


def test_the_straight_motion_to_a_goal_at_its_limits_ends_at_the_very_goal(planner):
    """An end that lies one rounding out of limits is a path that may not be driven."""
    rng, robot = np.random.default_rng(5), planner.robot
    planner.step(NOBODY, q=HOME)
    goal = BETTER
    while goal is BETTER or not planner.is_free(goal, goal):
        goal = np.array([robot.upper[0], *draw_valid(planner, rng)[1:]])
    planner.set_goals([goal])
    fixed, straight = ~robot.continuous, 0
    for _ in range(60):
        q = draw_valid(planner, rng)
        for _ in range(4):
            answer = planner.step(NOBODY, q=q)
            planner.improve(4)
        if answer.status != "holding":
            assert np.array_equal(answer.path[-1][fixed], goal[fixed])
            assert (np.abs(np.diff(answer.path, axis=0))[:, ~fixed] <= np.pi).all()
            straight += len(answer.path) == 2
    assert straight > 5


def test_at_its_goal_beside_a_better_one_without_a_path_it_follows(arm3):
    """No path to the goal where it stands is shorter than none at all."""
    settings = odm.PlannerSettings(confirmations=1, history_s=0.0, search=0)
    planner = odm.ReactivePlanner(arm3, settings=settings)
    halfway = tool_pose(planner.robot, 0.5 * (AWAY + BETTER))[:3, 3]
    planner.set_goals([BETTER])
    for radius in np.arange(0.05, 0.5, 0.01):
        between = ball_at(halfway, radius)
        planner.reset()
        held = planner.step(between, q=AWAY).status == "holding"
        if held and planner.stands_clear(BETTER) and planner.stands_clear(AWAY):
            break
    else:
        pytest.fail("no ball is between the two")
    planner.reset()
    planner.set_goals([BETTER, AWAY])
    near = AWAY + np.array([0.1, 0.0, 0.0])
    assert planner.step(between, q=near).goal == 1
    for _ in range(60):
        answer = planner.step(between, q=AWAY)
        assert (answer.goal, answer.status) == (1, "following")
        planner.improve(4)
