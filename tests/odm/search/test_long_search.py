"""Searches long enough to look at past ways and to settle all items at once."""

import numpy as np
from scipy.sparse.csgraph import dijkstra
from wrappers import with_wrapper

import odm
from odm.planner.settings import PlannerSettings
from odm.search._astar import (
    ALL,
    BOUND_BY_LAST_AFTER,
    FROM_GOAL,
    GREED,
    GREEDIER_EVERY,
    GREEDY_AFTER,
    LARGE,
    NONE,
    UNDECIDED,
    from_goal,
)
from odm.search._invalidation import MANY_TESTS
from odm.search._state import EDGE_BASE
from roadmap.kinematics.forward import tool_pose

from_goal = with_wrapper(from_goal)

NO_MOTION = -4
SETTINGS = PlannerSettings(start_connections=1, close_test_connections=0)


def standing_at_nodes(wide_map, a, b):
    """Return a planner that stands at node a and wants to node b, not straight."""
    planner = odm.ReactivePlanner(wide_map, True, SETTINGS)
    planner.set_goals([wide_map.roadmap.nodes[b]])
    planner.attacher.attach_start(wide_map.roadmap.nodes[a])
    planner.attacher.join_start()
    planner.memory.goals.attached_ref[:] = NO_MOTION
    return planner


def bar(shift):
    """Return a bar through the arm's plane of work, over its base (1, 7)."""
    return np.array([[shift, -0.3, 0.72, shift, 0.3, 0.72, 0.05]])


def ends(wide_map, rng, count):
    """Return pairs of nodes with the tool on both sides of the bar."""
    robot, nodes = wide_map.robot, wide_map.roadmap.nodes
    tools = np.array([tool_pose(robot, q)[:3, 3] for q in nodes])
    left, right = np.flatnonzero(tools[:, 0] < -0.4), np.flatnonzero(tools[:, 0] > 0.4)
    return [(rng.choice(left), rng.choice(right)) for _ in range(count)]


def test_long_searches_find_what_dijkstra_finds_and_forget_nothing(wide_map, rng):
    closed, settled, bounded = 0, 0, 0
    for a, b in ends(wide_map, rng, 6):
        planner = standing_at_nodes(wide_map, a, b)
        for k in range(20):
            points = odm.sample_capsules(bar(0.01 * k - 0.1), 0.03)
            answer = planner.step(points, q=wide_map.roadmap.nodes[a])
            stats = planner.memory.stats
            popped, counted = stats.popped.item(), stats.counted.item()
            # one that has never searched before finds the same, byte by byte
            fresh = standing_at_nodes(wide_map, a, b)
            other = fresh.step(points, q=wide_map.roadmap.nodes[a])
            assert answer.path.tobytes() == other.path.tobytes()
            want = np.inf
            if not np.isin([a, b], fresh.invalid_nodes()).any():
                free = np.ones(wide_map.roadmap.n_edges, bool)
                free[fresh.invalid_edges()] = False
                graph = wide_map.roadmap.to_sparse(free)
                want = dijkstra(graph, indices=a)[b]
            found = np.inf
            if len(answer.path):
                legs = np.diff(answer.path, axis=0)
                found = np.linalg.norm(legs, axis=1).sum()
            assert np.isclose(found, want, atol=1e-9)
            closed = max(closed, popped)
            settled += counted
            bounded += int(popped > BOUND_BY_LAST_AFTER and k > 0)
    assert closed > 5 * BOUND_BY_LAST_AFTER
    assert bounded > 20
    assert settled > 0


def test_settling_all_items_at_once_changes_no_answer(wide_map, rng):
    settled = 0
    for a, b in ends(wide_map, rng, 6):
        slow, quick = (standing_at_nodes(wide_map, a, b) for _ in range(2))
        for k in range(10):
            points = odm.sample_capsules(bar(0.02 * k - 0.1), 0.03)
            q = wide_map.roadmap.nodes[a]
            quick.direct.edges()  # keeps the direct map fresh: it is taken up early
            paths = [planner.step(points, q=q).path for planner in (slow, quick)]
            assert paths[0].tobytes() == paths[1].tobytes()
            stats = quick.memory.stats
            settled += int(stats.counted[0] and stats.edge_tests[0] < MANY_TESTS)
    assert settled > 5


def test_a_long_search_of_a_large_map_is_content_with_a_little_longer(wide_map, rng):
    """The same searches, once as if the map were large."""
    shorter = longer = 0
    for a, b in ends(wide_map, rng, 6):
        for k in range(0, 20, 4):
            points = odm.sample_capsules(bar(0.01 * k - 0.1), 0.03)
            said = []
            for large in (LARGE, 0):
                planner = standing_at_nodes(wide_map, a, b)
                planner.memory.rules.large[0] = large
                answer = planner.step(points, q=wide_map.roadmap.nodes[a])
                legs = np.diff(answer.path, axis=0)
                length = np.linalg.norm(legs, axis=1).sum()
                said.append((len(answer.path) > 0, length, answer.work.popped))
            (found, least, all_), (found_too, length, some) = said
            assert found == found_too
            assert least <= length + 1e-9 and length <= GREED * least + 1e-9
            if all_ <= GREEDY_AFTER:
                assert (length, some) == (least, all_)
            shorter += some < all_
            longer += length > least + 1e-9
    assert shorter > 2 and longer > 0


def searched_from_goal(planner, weight, most=ALL):
    """Return what a search from the goal's side says, and the length of its path."""
    m = planner.memory
    entry, length = from_goal(m.table, m.start_connections, 0, most, weight), np.inf
    if entry < 0:
        return entry, length, np.zeros(0, int)
    s, roadmap = m.search, planner.cell_map.roadmap
    length, v, edges = s.e_g[entry], int(m.goals.node[0, 0]), []
    entry = s.e_from[entry]  # a motion of no length leads into the goal
    while s.e_from[entry] >= 0:
        edges.append(EDGE_BASE - s.e_ref[entry])
        both = roadmap.edges[edges[-1]].tolist()
        assert s.e_node[entry] == v
        v = both[int(both[0] == v)]
        entry = s.e_from[entry]
    assert v == s.e_node[entry] == m.start_connections.node[0]
    edges = np.array(edges, int)
    assert abs(length - roadmap.lengths[edges].sum()) < 1e-9
    return entry, length, edges


def test_a_search_from_the_goal_finds_what_dijkstra_finds_or_a_little_longer(
    wide_map, rng
):
    """As it is done where the cells block all motions into a goal."""
    roadmap, found, longer, early = wide_map.roadmap, 0, 0, 0
    nodes = roadmap.nodes
    for a, b in ends(wide_map, rng, 12):
        planner = standing_at_nodes(wide_map, a, b)
        for k in range(0, 20, 4):
            planner.step(odm.sample_capsules(bar(0.01 * k - 0.1), 0.03), q=nodes[a])
            if planner.memory.stats.runs.item() == 0:
                continue
            free = np.ones(roadmap.n_edges, bool)
            free[planner.invalid_edges()] = False
            planner.memory.stats.counted[:] = 1  # else it gives up after many tests
            want = dijkstra(roadmap.to_sparse(free), indices=a)[b]
            _, least, edges = searched_from_goal(planner, 1.0)
            assert np.isclose(least, want, atol=1e-9) and free[edges].all()
            _, length, edges = searched_from_goal(planner, GREED)
            most = GREED ** (1 + FROM_GOAL // GREEDIER_EVERY) * want
            assert free[edges].all() and want <= length + 1e-9 and length <= most
            longer += length > want + 1e-9
            found += 1
            some = searched_from_goal(planner, 1.0, most=2)[0]
            early += some == UNDECIDED
            around = roadmap.adj_edge[roadmap.adj_ptr[b] : roadmap.adj_ptr[b + 1]]
            frame = planner.memory.numbers.frame.item()
            planner.memory.search.memo[roadmap.n_nodes + around] = 2 * frame + 1
            assert searched_from_goal(planner, 1.0)[0] == NONE
    assert found > 10 and longer > 3 and early > 10
