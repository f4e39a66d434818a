"""Starts and goals get a few motions at once, and the others when there is time."""

import numpy as np
from small import AWAY, HOME, NOBODY, draw_arm

import odm
from odm.planner.attaching import _START_AT_ONCE, GOAL_AT_ONCE
from odm.planner.settings import PlannerSettings
from odm.search import _cost_to_go as cost_to_go

PLAIN = PlannerSettings(search=0, history_s=0.0)


def finish(planner):
    """Call improve until nothing waits; return how often."""
    calls = 0
    while planner.attacher.waits:
        assert calls < 60
        planner.improve(4)
        calls += 1
    return calls


def motions(planner):
    """Return (q, dq) of all motions that start and goal are joined by."""
    m, nodes = planner.memory, planner.cell_map.roadmap.nodes
    k, n = int(m.start_connections.count[0]), int(m.goals.number[0])
    pairs = [(planner.frame.q, nodes[i]) for i in m.start_connections.node[:k]]
    pairs += [(nodes[i], m.goals.q[0]) for i in m.goals.node[0, :n]]
    return [(a.copy(), planner.frame.difference(a, b)) for a, b in pairs]


def test_few_motions_are_joined_at_once_and_all_between_frames(small_map):
    planner = odm.ReactivePlanner(small_map, settings=PLAIN)
    m = planner.memory
    planner.set_goals([AWAY])
    assert m.goals.number[0] <= GOAL_AT_ONCE
    planner.step(NOBODY, q=HOME)
    assert m.start_connections.count[0] <= _START_AT_ONCE
    # the straight motion has its cells at once: the toll on cells is what calms
    assert m.goals.attached_ref[0] >= 0
    assert planner.path.item[0] == m.goals.attached_ref[0]
    assert finish(planner) > 3
    assert m.goals.number[0] == planner.settings.goal_connections
    assert m.start_connections.count[0] == planner.settings.start_connections
    for q, dq in motions(planner):
        assert planner.static.motion_free(q, dq)
    goals, n = m.goals, int(m.goals.number[0])
    assert len(set(goals.node[0, :n].tolist())) == n
    assert np.array_equal(goals.at[0, goals.node[0, :n]], np.arange(n))
    h = np.zeros_like(goals.h[0])
    cost_to_go.exact_cost(m.graph, goals.node[0], goals.length[0], n, m.search, h)
    assert np.array_equal(h, goals.h[0]) and np.array_equal(h, m.robot_state.h_any)


def test_no_frame_that_has_a_path_waits_for_more_motions(small_map):
    planner = odm.ReactivePlanner(small_map, settings=PLAIN)
    planner.set_goals([AWAY])
    counts = []
    for _ in range(4):
        planner.step(NOBODY, q=HOME)
        counts.append(int(planner.memory.start_connections.count[0]))
    assert counts == [_START_AT_ONCE] * 4
    assert planner.memory.goals.attached_ref[0] >= 0
    finish(planner)
    assert planner.memory.start_connections.count[0] == 8


def test_what_more_motions_can_answer_is_answered_after_some_frames(small_map, rng):
    """Beside a planner that has all of its motions: the same frames have a path."""
    full = odm.ReactivePlanner(small_map, always_replan=True, settings=PLAIN)
    full.set_goals([AWAY])
    full.step(NOBODY, q=HOME)
    finish(full)
    solved = late = 0
    for _ in range(40):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        few = odm.ReactivePlanner(small_map, always_replan=True, settings=PLAIN)
        few.set_goals([AWAY])
        wanted = full.step(points, q=HOME).status
        said = [few.step(points, q=HOME).status for _ in range(6)]
        assert (wanted == "holding") == (said[-1] == "holding")
        solved += wanted != "holding"
        late += said[0] == "holding" and said[-1] != "holding"
    assert solved > 10
