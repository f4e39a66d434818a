"""Starts and goals get a few motions at once, and the others when there is time."""

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, draw_arm, draw_valid

import odm
from odm.answer import HOLDING
from odm.planner.settings import AttachSettings, PlannerSettings
from odm.search import _cost_to_go as cost_to_go
from odm.search._state import NO_ITEM
from roadmap.kinematics.forward import difference, tool_pose

ATTACH = AttachSettings()
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
    assert m.goals.number[0] <= ATTACH.goal_at_once
    planner.step(NOBODY, q=HOME)
    assert m.start_connections.count[0] == 0  # the straight motion is free
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
    h, lengths = np.full_like(goals.h[0], np.inf), m.graph.adj_length
    ends = float(lengths.min()), float(lengths.max())
    joins = goals.node[0, :n], goals.length[0, :n]
    cost_to_go.lower_costs(m.graph, *joins, m.search, h, *ends)
    assert np.array_equal(h, goals.h[0]) and np.array_equal(h, m.robot_state.h_any)


def test_no_frame_that_has_a_path_waits_for_more_motions(small_map):
    planner = odm.ReactivePlanner(small_map, settings=PLAIN)
    planner.set_goals([AWAY])
    counts = []
    for _ in range(4):
        planner.step(NOBODY, q=HOME)
        counts.append(int(planner.memory.start_connections.count[0]))
    assert counts == [0] * 4  # the straight motion serves
    assert planner.memory.goals.attached_ref[0] >= 0
    finish(planner)
    assert planner.memory.start_connections.count[0] == 8


@pytest.mark.parametrize("kind", ["shapes", "points"])
def test_a_start_whose_straight_motion_is_blocked_gets_its_cells_later(small_map, kind):
    """The frame is answered by the close test of its motions."""
    planner = odm.ReactivePlanner(small_map, settings=PLAIN)
    planner.set_goals([AWAY])
    m, middle = planner.memory, tool_pose(small_map.robot, 0.5 * (HOME + AWAY))[:3, 3]
    away = odm.Obstacles(spheres=np.array([[0.0, 0.0, 9.0, 0.1]]))
    ball = odm.Obstacles(spheres=np.array([[*middle, 0.03]]))
    if kind == "points":
        away, ball = np.array([[0.0, 0.0, 9.0]]), middle[None]
    assert planner.step(away, q=HOME).stage == "straight"
    assert m.start_connections.count[0] == 0
    answer = planner.step(ball, q=HOME)  # in this very frame
    assert answer.stage == "roadmap"
    count = int(m.start_connections.count[0])
    assert 0 < count <= ATTACH.start_at_once and planner.attacher.is_bare
    assert (m.start_connections.ref[:count] == NO_ITEM).all()
    assert planner.path.item[0] == NO_ITEM
    finish(planner)
    count = int(m.start_connections.count[0])
    assert count == planner.settings.start_connections
    assert (m.start_connections.ref[:count] >= 0).all()
    assert not planner.attacher.is_bare
    for k, (q, dq) in enumerate(motions(planner)[:count]):
        items = m.start_connections.ref[k], planner.attacher.sweep(q[None], dq[None])
        mine, again = (cells_of(m.pool, item) for item in items)
        assert np.array_equal(mine[0], again[0])
        assert np.array_equal(mine[1], again[1])
    assert planner.step(ball, q=HOME).status != "holding"


def test_a_new_path_is_bettered_before_its_motions_get_their_cells(small_map):
    """Each takes as long as several tests of the path; then they share a budget."""
    planner = odm.ReactivePlanner(small_map, settings=PLAIN)
    planner.set_goals([AWAY])
    middle = tool_pose(small_map.robot, 0.5 * (HOME + AWAY))[:3, 3]
    ball = odm.Obstacles(spheres=np.array([[*middle, 0.03]]))
    assert planner.step(ball, q=HOME).stage == "roadmap"
    pool, m = planner.memory.pool, planner.memory
    calls = -(-ATTACH.path_first // 4)
    for _ in range(calls):
        assert planner.attacher.is_bare
        planner.improve(4)
    count = int(m.start_connections.count[0])
    assert planner.attacher.is_bare and (m.start_connections.ref[:count] < 0).all()
    planner.improve(4)
    assert (m.start_connections.ref[:count] >= 0).sum() == 2 and pool.used[0] > 0


def cells_of(pool, item):
    """Return blocks and masks of an item of the pool."""
    part = slice(pool.begin[item], pool.end[item])
    return pool.block[part].copy(), pool.mask[part].copy()


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


def refuse(monkeypatch, planner, refused):
    """Let the static test refuse motions from HOME while `refused`; return a count."""
    static, tested = planner.static, []
    test = static.motions_free

    def motions_free(q, dq, more=0.0):
        free, leaves = test(q, dq, more), (q == HOME).all(axis=1)
        tested.extend(np.round((q + dq)[leaves], 9).tolist())
        return free & ~leaves if refused else free

    monkeypatch.setattr(static, "motions_free", motions_free)
    return tested


def test_a_start_that_is_refused_tries_a_few_nodes_a_frame(small_map, monkeypatch):
    planner, refused = odm.ReactivePlanner(small_map, settings=PLAIN), [True]
    planner.set_goals([AWAY])
    tested = refuse(monkeypatch, planner, refused)
    counts, seen = [], []
    for _ in range(3):
        tested.clear()
        assert planner.step(NOBODY, q=HOME).status == HOLDING
        nodes = [q for q in map(tuple, tested) if q != tuple(np.round(AWAY, 9))]
        counts.append(len(nodes))
        seen += nodes
    assert counts == [
        ATTACH.start_rounds * ATTACH.start_at_once,
        ATTACH.start_at_once,
        ATTACH.start_at_once,
    ]
    assert len(seen) == len(set(seen))  # none is tested again in the same place
    refused.clear()
    assert planner.step(NOBODY, q=HOME).status != HOLDING
    assert planner.memory.start_connections.count[0] > 0


def test_nodes_that_a_moving_robot_was_refused_are_not_tried_again(
    small_map, monkeypatch
):
    planner = odm.ReactivePlanner(small_map, settings=PLAIN)
    planner.set_goals([AWAY])
    assert planner.step(NOBODY, q=HOME + 0.05).status != HOLDING
    tested = refuse(monkeypatch, planner, [True])
    nodes = set(map(tuple, np.round(small_map.roadmap.nodes, 9).tolist()))
    counts, seen = [], []
    for _ in range(3):
        tested.clear()
        assert planner.step(NOBODY, q=HOME).status == HOLDING
        seen += (now := [q for q in map(tuple, tested) if q in nodes])
        counts.append(len(now))
    assert 0 < counts[0] < counts[1]  # a few without cells, then more of them
    assert len(seen) == len(set(seen))


def test_a_robot_that_moves_leaves_by_no_motion_close_past_somebody(small_map):
    """Its motions have no cells that a search would be wary of."""
    settings = PlannerSettings(search=0)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    rng = np.random.default_rng(0)
    frame, starts = planner.frame, planner.memory.start_connections
    nodes = small_map.roadmap.nodes
    planner.set_goals([AWAY])
    seen = []
    for _ in range(60):
        q = HOME + rng.uniform(-0.3, 0.3, 3)
        hand = tool_pose(planner.robot, q)[:3, 3] + rng.uniform(-0.2, 0.2, 3)
        planner.step(odm.Obstacles(capsules=np.r_[hand, hand, 0.04][None]), q=HOME)
        planner.attacher.attach_start(q, without_cells=True)
        ends = nodes[starts.node[: int(starts.count[0])]]
        legs = [frame.difference(q, end) for end in ends]
        wide = [frame.motion_clear(q, leg, None, 0.03) for leg in legs]
        seen.append((any(wide), all(wide)))
    assert (True, False) not in seen
    assert {(True, True), (False, False)} <= set(seen)


def test_how_far_nodes_are_is_known_of_the_place_attached_last(small_map, rng):
    roadmap, robot = small_map.roadmap, small_map.robot
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    nothing = np.zeros((0, 3))
    for _ in range(5):
        planner.set_goals([draw_valid(planner, rng)])
        q = draw_valid(planner, rng)
        planner.step(nothing, q=q)
        known = planner.memory.robot_state
        assert np.array_equal(known.q_attached, q)
        legs = difference(robot, np.repeat(q[None], roadmap.n_nodes, 0), roadmap.nodes)
        far = np.linalg.norm(legs * roadmap.weights, axis=1)
        assert known.from_attached == pytest.approx(far, rel=1e-12)
        fresh = odm.ReactivePlanner(small_map, always_replan=True)
        fresh.load_memory(planner.save_memory())
        loaded = fresh.memory.robot_state.from_attached
        assert loaded.tobytes() == known.from_attached.tobytes()
