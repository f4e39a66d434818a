"""A* over the masks: as short as Dijkstra on the same free graph, and no longer."""

import numpy as np
from naive_cells import edge_cells, free_items, item_cells, occupied_cells
from scipy.sparse.csgraph import dijkstra
from small import draw_arm, draw_valid

import odm
from odm.planner.settings import PlannerSettings


def free_length(planner, points, a, b):
    nodes, edges = free_items(planner.cell_map, points)
    if not (nodes[a] and nodes[b]):
        return np.inf
    return dijkstra(planner.cell_map.roadmap.to_sparse(edges), indices=a)[b]


def blocked_straight(planner, q_a, q_b):
    """Let no straight motion hide the search."""
    planner.memory.goals.attached_ref[:] = -4  # NO_MOTION


def test_the_cost_from_node_to_node_is_that_of_dijkstra(small_map, rng):
    settings = PlannerSettings(start_connections=1, close_test_connections=0, search=0)
    planner = odm.ReactivePlanner(small_map, True, settings)
    found = 0
    for _ in range(60):
        a, b = rng.choice(small_map.roadmap.n_nodes, 2, replace=False)
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.reset()
        planner.set_goals([small_map.roadmap.nodes[b]])
        q = small_map.roadmap.nodes[a]
        planner.attacher.attach_start(q)
        blocked_straight(planner, q, planner.goals[0])
        answer = planner.step(points, q=q)
        want = free_length(planner, points, a, b)
        if answer.status == "holding":
            assert np.isinf(want)
            continue
        found += 1
        legs = np.diff(answer.path, axis=0)
        legs -= np.where(
            small_map.robot.continuous, 2 * np.pi * np.round(legs / (2 * np.pi)), 0
        )
        assert np.isclose(np.linalg.norm(legs, axis=1).sum(), want, atol=1e-9)
    assert found > 10


def test_a_free_goal_costs_the_best_way_over_its_attachments(small_map, planner, rng):
    found = 0
    for _ in range(40):
        q, goal = draw_valid(planner, rng), draw_valid(planner, rng)
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.reset()
        planner.set_goals([goal])
        planner.attacher.attach_start(q)
        blocked_straight(planner, q, goal)
        answer = planner.step(points, q=q)
        if answer.status == "holding" or answer.work.close_tests:
            continue
        found += 1
        m = planner.memory
        nodes, edges = free_items(small_map, points)
        occupied = occupied_cells(small_map, points)
        graph = small_map.roadmap.to_sparse(edges)
        best = np.inf
        for k in range(m.start_connections.count[0]):
            v = m.start_connections.node[k]
            if (
                not nodes[v]
                or pool_cells(planner, m.start_connections.ref[k]) & occupied
            ):
                continue
            reach = m.start_connections.length[k] + dijkstra(graph, indices=v)
            for a in range(m.goals.number[0]):
                w = m.goals.node[0, a]
                free = not pool_cells(planner, m.goals.ref[0, a]) & occupied
                if nodes[w] and free:
                    best = min(best, reach[w] + m.goals.length[0, a])
        assert np.isclose(length(planner, answer.path), best, atol=1e-9)
    assert found > 8


def pool_cells(planner, item):
    from naive_cells import words_to_cells

    pool = planner.memory.pool
    part = slice(pool.begin[item], pool.end[item])
    blocks = planner.cell_map.grid.blocks
    return words_to_cells(pool.block[part], pool.mask[part], blocks)


def length(planner, path):
    legs = [
        planner.frame.difference(a, b) for a, b in zip(path, path[1:], strict=False)
    ]
    return np.linalg.norm(legs, axis=1).sum()


def test_a_walled_in_goal_is_known_after_a_look_at_its_side(planner, small_map):
    robot = small_map.robot
    goal = np.zeros(robot.dof)
    q = np.array([1.2, 0.9, 0.0])
    planner.set_goals([goal])
    # a ring of points round the upright arm, well away from q
    turn = np.linspace(0, 2 * np.pi, 80)
    ring = [[0.14 * np.cos(a), 0.14 * np.sin(a), z] for a in turn for z in (0.5, 0.6)]
    answer = planner.step(np.array(ring), q=q)
    assert answer.status == "holding"
    assert "goal 0" in answer.reason


def test_every_node_and_edge_list_belongs_to_its_item(small_map, rng):
    # the lists of an edge hold nothing that its nodes hold
    n = small_map.roadmap.n_nodes
    for edge in rng.choice(small_map.roadmap.n_edges, 20, replace=False):
        a, b = small_map.roadmap.edges[edge]
        own = item_cells(small_map, n + edge)
        assert not own & item_cells(small_map, a)
        assert not own & item_cells(small_map, b)
        assert edge_cells(small_map, edge) >= own
