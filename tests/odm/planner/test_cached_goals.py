"""Goals that stay attached: to set one again costs little and changes no answer."""

import numpy as np
import pytest
from carrying import BALLS
from small import AWAY, HOME, NOBODY, ball_at, draw_valid, small_recipe

import odm
from odm import PlannerSettings
from roadmap.errors import BadConfiguration
from roadmap.kinematics.forward import tool_pose

KEPT = PlannerSettings(cached_goals=4)
BETTER = np.array([1.2, -0.9, 0.4])


@pytest.fixture(scope="module")
def arm3():
    return odm.build_map(small_recipe(), threads=1)


@pytest.fixture
def planner(arm3):
    return odm.ReactivePlanner(arm3, settings=KEPT)


@pytest.fixture
def attached(planner, monkeypatch):
    """The goals that were really attached, in order."""
    done, attach = [], planner.attacher._attach_goal
    monkeypatch.setattr(
        planner.attacher,
        "_attach_goal",
        lambda g, q, *few: (done.append(q.tobytes()), attach(g, q))[1],
    )
    return done


def motions(planner, g):
    """Return nodes, lengths and swept blocks of the motions to the goal at rank g."""
    m = planner.memory
    k = int(m.goals.number[g])
    items = m.goals.ref[g, :k]
    spans = [(m.pool.begin[i], m.pool.end[i]) for i in items]
    swept = [(m.pool.block[a:b].tolist(), m.pool.mask[a:b].tolist()) for a, b in spans]
    assert (m.goals.at[g, m.goals.node[g, :k]] == np.arange(k)).all()
    assert (m.goals.at[g] >= 0).sum() == k
    return m.goals.node[g, :k].tolist(), m.goals.length[g, :k].tolist(), swept


def test_a_goal_that_was_set_before_is_not_attached_again(planner, attached):
    planner.set_goals([AWAY])
    before, cost = motions(planner, 0), planner.memory.goals.h[0].copy()
    planner.set_goals([BETTER])
    planner.set_goals([BETTER, AWAY])
    assert attached == [AWAY.tobytes(), BETTER.tobytes()]
    assert motions(planner, 1) == before
    np.testing.assert_array_equal(planner.memory.goals.h[1], cost)


def test_a_goal_that_is_prepared_costs_nothing_when_it_is_set(planner, attached):
    planner.set_goals([AWAY])
    planner.step(NOBODY, q=HOME)
    assert not planner.is_prepared(BETTER)
    assert planner.prepare_goal(BETTER) and planner.prepare_goal(list(BETTER))
    assert planner.is_prepared(BETTER) and len(attached) == 2
    answer = planner.step(NOBODY, q=HOME)
    assert answer.goal == 0 and len(planner.goals) == 1  # only prepared, not a goal
    np.testing.assert_allclose(answer.path[-1], AWAY)
    planner.set_goals([BETTER, AWAY])
    assert len(attached) == 2
    ends = [planner.step(NOBODY, q=HOME).path[-1] for _ in range(40)]
    np.testing.assert_allclose(ends[-1], BETTER)


def test_answers_are_those_of_a_planner_that_attaches_anew(arm3, planner):
    planner.step(NOBODY, q=HOME)
    planner.prepare_goal(BETTER)
    planner.set_goals([AWAY])
    planner.set_goals([BETTER, AWAY])
    fresh = odm.ReactivePlanner(arm3)
    fresh.step(NOBODY, q=HOME)
    fresh.set_goals([BETTER, AWAY])
    ball = ball_at(tool_pose(fresh.robot, BETTER)[:3, 3], 0.05)
    for points in (NOBODY, ball):
        planner.reset(), fresh.reset()
        a, b = planner.step(points, q=HOME), fresh.step(points, q=HOME)
        assert (a.status, a.goal) == (b.status, b.goal)
        np.testing.assert_allclose(a.path, b.path, atol=1e-12)


def test_the_one_not_used_longest_makes_room(planner):
    rng = np.random.default_rng(3)
    goals = [draw_valid(planner, rng) for _ in range(5)]
    for q in goals[:4]:
        assert planner.prepare_goal(q)
    planner.set_goals([goals[0]])  # used again
    assert planner.prepare_goal(goals[4])
    assert [planner.is_prepared(q) for q in goals] == [True, False, True, True, True]


def test_what_is_kept_survives_when_old_motions_are_thrown_away(planner):
    rng = np.random.default_rng(4)
    planner.set_goals([AWAY])
    planner.prepare_goal(BETTER)
    planner.set_goals([BETTER])
    before = motions(planner, 0)
    planner.set_goals([AWAY])
    for _ in range(40):
        planner.attacher.attach_start(draw_valid(planner, rng))
        planner.attacher.sweep_cells(100)  # as `improve` does
    used = planner.memory.pool.used.copy()
    # as if it were full
    planner.memory.shortcuts.count[0] = len(planner.memory.shortcuts.key)
    planner.attacher.tidy()
    assert planner.memory.pool.used[0] < used[0]
    planner.set_goals([BETTER])
    assert motions(planner, 0) == before


def test_other_scenery_makes_it_attach_again(planner, attached):
    planner.prepare_goal(AWAY)
    planner.set_goals([BETTER])
    planner.set_static(ball_at((0.0, 0.9, 1.2), 0.05))
    assert not planner.is_prepared(AWAY)
    planner.set_goals([AWAY])
    assert attached.count(AWAY.tobytes()) == 2


def test_another_hand_makes_it_attach_again(carrying_map):
    planner = odm.ReactivePlanner(carrying_map, settings=KEPT)
    planner.prepare_goal(AWAY)
    planner.attach(BALLS)
    assert not planner.is_prepared(AWAY)


def test_without_room_nothing_is_kept(arm3):
    planner = odm.ReactivePlanner(arm3)
    planner.set_goals([AWAY])
    assert not planner.prepare_goal(BETTER) and not planner.is_prepared(BETTER)
    assert not planner.is_prepared(AWAY)


def test_what_is_no_goal_is_not_prepared(planner):
    with pytest.raises(BadConfiguration, match="limits"):
        planner.prepare_goal([0.0, 99.0, 0.0])
    with pytest.raises(BadConfiguration, match="shape"):
        planner.prepare_goal([0.0, 1.0])


def test_stands_clear_says_what_is_free_says_of_the_points(planner):
    rng = np.random.default_rng(5)
    said = []
    for _ in range(60):
        q, other = draw_valid(planner, rng), draw_valid(planner, rng)
        place = tool_pose(planner.robot, other)[:3, 3]
        planner.step(ball_at(place, 0.1), q=HOME)
        said.append(planner.stands_clear(q))
        assert said[-1] == planner.is_free(q, q).free
    assert True in said and False in said
    planner.step(np.array([[np.nan, 0.0, 0.0]]), q=HOME)
    assert not planner.stands_clear(HOME)
