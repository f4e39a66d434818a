"""The cost to go of a goal: Dijkstra's, by buckets and by a heap alike."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from wrappers import with_wrapper

import odm
from odm.search import _cost_to_go as cost_to_go

by_buckets = with_wrapper(cost_to_go.by_buckets)
by_heap = with_wrapper(cost_to_go.by_heap)


def joined(rng, n, k):
    return rng.choice(n, k, replace=False), rng.uniform(0.01, 4.0, k)


def lower(parts, node, length, h):
    graph, search = parts
    lengths = graph.adj_length
    ends = float(lengths.min()), float(lengths.max())
    cost_to_go.lower_costs(graph, node, length, search, h, *ends)


@pytest.fixture
def parts(small_map):
    planner = odm.ReactivePlanner(small_map)
    return planner.memory.graph, planner.memory.search


def test_the_cost_to_go_is_that_of_dijkstra(small_map, parts, rng):
    n = small_map.roadmap.n_nodes
    lengths = small_map.roadmap.to_sparse(np.ones(small_map.roadmap.n_edges, bool))
    for k in (1, 3, 18):
        node, length = joined(rng, n, k)
        h = np.full(n, np.inf)
        lower(parts, node, length, h)
        want = np.min(length[:, None] + dijkstra(lengths, indices=node), axis=0)
        np.testing.assert_allclose(h, want, rtol=1e-9)
        assert (h <= want).all()  # never above the truth


def test_buckets_and_heap_give_the_same_bytes(small_map, parts, rng):
    graph, search = parts
    n = small_map.roadmap.n_nodes
    per_length = cost_to_go.NARROWER / graph.adj_length.min()
    for k in (1, 5):
        node, length = joined(rng, n, k)
        one, two = np.full(n, np.inf), np.full(n, np.inf)
        by_heap(graph, node, length, search, one)
        by_buckets(graph, node, length, search, two, per_length, 1024)
        assert one.tobytes() == two.tobytes()
        assert np.isfinite(one).all()


@pytest.mark.parametrize("tiny", [1e-9, 0.0])
def test_a_tiny_edge_takes_the_heap_and_no_goal_is_nowhere(small_map, parts, rng, tiny):
    graph, search = parts
    n = small_map.roadmap.n_nodes
    short = graph._replace(adj_length=graph.adj_length.copy())
    short.adj_length[:2] = tiny
    node, length = joined(rng, n, 2)
    h, want = np.full(n, np.inf), np.full(n, np.inf)
    search.heap_e[: cost_to_go.MOST_BUCKETS] = -7
    lower((short, search), node, length, h)
    assert not (search.heap_e[: cost_to_go.MOST_BUCKETS] == -1).any()  # no buckets
    by_heap(short, node, length, search, want)
    np.testing.assert_allclose(h, want, rtol=1e-9)
    assert np.isfinite(h).all()
    h[:] = np.inf
    lower(parts, node[:0], length[:0], h)
    assert np.isinf(h).all()


def test_motions_of_very_different_lengths_count_alike(small_map, parts, rng):
    graph, search = parts
    n = small_map.roadmap.n_nodes
    node = rng.choice(n, 3, replace=False)
    for longest in (10.0, 1e3, 1e6):  # the last takes the heap
        length = np.array([0.5, 1.0, longest])
        h, want = np.full(n, np.inf), np.full(n, np.inf)
        lower(parts, node, length, h)
        by_heap(graph, node, length, search, want)
        assert h.tobytes() == want.tobytes()


def test_more_motions_lower_the_cost_to_what_it_is_with_all(small_map, parts, rng):
    n, nearer = small_map.roadmap.n_nodes, 0
    for k, known in ((2, 1), (6, 4), (18, 6)):
        node, length = joined(rng, n, k)
        h, want = np.full(n, np.inf), np.full(n, np.inf)
        lower(parts, node[:known], length[:known], h)
        before = h.copy()
        lower(parts, node[known:], length[known:], h)
        lower(parts, node, length, want)
        assert np.array_equal(h, want)
        nearer += (h < before).sum()
    assert nearer > n // 4
    far = np.full(1, 1e3)  # a motion that shortens nothing changes nothing
    lower(parts, node[:1], far, h)
    assert np.array_equal(h, want)
