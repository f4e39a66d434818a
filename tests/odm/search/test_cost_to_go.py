"""The cost to go of a goal: Dijkstra's, by buckets and by a heap alike."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from wrappers import with_wrapper

import odm
from odm.search import _cost_to_go as cost_to_go

by_buckets = with_wrapper(cost_to_go.by_buckets)


def joined(rng, n, k):
    return rng.choice(n, k, replace=False), rng.uniform(0.01, 4.0, k)


@pytest.fixture
def parts(small_map):
    planner = odm.ReactivePlanner(small_map)
    return planner.memory.graph, planner.memory.search


def test_the_cost_to_go_is_that_of_dijkstra(small_map, parts, rng):
    graph, search = parts
    n = small_map.roadmap.n_nodes
    lengths = small_map.roadmap.to_sparse(np.ones(small_map.roadmap.n_edges, bool))
    for k in (1, 3, 18):
        node, length = joined(rng, n, k)
        h = np.zeros(n)
        cost_to_go.exact_cost(graph, node, length, k, search, h)
        want = np.min(length[:, None] + dijkstra(lengths, indices=node), axis=0)
        np.testing.assert_allclose(h, want, rtol=1e-9)
        assert (h <= want).all()  # never above the truth


def test_buckets_and_heap_give_the_same_bytes(small_map, parts, rng):
    graph, search = parts
    n = small_map.roadmap.n_nodes
    width = graph.adj_length.min()
    for k in (1, 5):
        node, length = joined(rng, n, k)
        one, two = np.full(n, np.inf), np.full(n, np.inf)
        cost_to_go.lower_costs(graph, node, length, search, one, 1.0)
        span = max(graph.adj_length.max(), np.ptp(length))
        by_buckets(graph, node, length, search, two, width, span)
        assert one.tobytes() == two.tobytes()


def test_a_tiny_edge_takes_the_heap_and_no_goal_is_nowhere(small_map, parts, rng):
    graph, search = parts
    n = small_map.roadmap.n_nodes
    short = graph._replace(adj_length=graph.adj_length.copy())
    short.adj_length[:2] = 1e-9
    node, length = joined(rng, n, 2)
    h, want = np.zeros(n), np.full(n, np.inf)
    cost_to_go.exact_cost(short, node, length, 2, search, h)
    cost_to_go.lower_costs(short, node, length, search, want, 1.0)
    np.testing.assert_allclose(h, want, rtol=1e-9)
    cost_to_go.exact_cost(graph, node, length, 0, search, h)
    assert np.isinf(h).all()


def test_more_motions_lower_the_cost_to_what_it_is_with_all(small_map, parts, rng):
    graph, search = parts
    n, nearer = small_map.roadmap.n_nodes, 0
    for k, known in ((2, 1), (6, 4), (18, 6)):
        node, length = joined(rng, n, k)
        h, want = np.zeros(n), np.zeros(n)
        cost_to_go.exact_cost(graph, node, length, known, search, h)
        before = h.copy()
        new, by = node[known:], length[known:]
        cost_to_go.lower_costs(graph, new, by, search, h, cost_to_go.ROUNDING)
        cost_to_go.exact_cost(graph, node, length, k, search, want)
        assert np.array_equal(h, want)
        nearer += (h < before).sum()
    assert nearer > n // 4
    far = np.full(1, 1e3)  # a motion that shortens nothing changes nothing
    cost_to_go.lower_costs(graph, node[:1], far, search, h, cost_to_go.ROUNDING)
    assert np.array_equal(h, want)
