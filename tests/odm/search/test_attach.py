"""Near nodes, and what paths through them cost, as plain numpy has them."""

import numpy as np
import pytest

from odm.search import _attach as kernels


@pytest.mark.parametrize("n, k", [(1, 1), (7, 7), (200, 12), (3000, 160)])
def test_the_least_are_those_that_sorting_puts_first(rng, n, k):
    cost = rng.integers(0, 1 + n // 4, n).astype(float)  # with many ties
    cost[rng.random(n) < 0.1] = np.inf
    out = np.empty(k, np.int64)
    kernels.least(cost, out)
    assert np.array_equal(out, np.argsort(cost, kind="stable")[:k])


def test_none_are_the_least_of_none(rng):
    kernels.least(rng.random(3), np.empty(0, np.int64))


@pytest.mark.parametrize("n", [1, 40, 1300])
def test_lengths_to_some_nodes_are_those_to_all(rng, n):
    nodes, q = rng.uniform(-3.0, 3.0, (n, 5)), rng.uniform(-3.0, 3.0, 5)
    weights, continuous = rng.uniform(0.5, 2.0, 5), np.array([0, 1, 0, 1, 1]) == 1
    ids, every = rng.permutation(n)[:900], np.full(n, np.nan)
    some = np.empty(len(ids))
    kernels.distances(nodes.T.copy(), q, weights, continuous, every)
    kernels.lengths_to(nodes, ids, q, weights, continuous, some)
    assert some.tobytes() == every[ids].tobytes()
    d = nodes - q
    d -= 2.0 * np.pi * np.round(d / (2.0 * np.pi)) * continuous
    np.testing.assert_allclose(every, np.linalg.norm(d * weights, axis=1), rtol=1e-12)


@pytest.mark.parametrize("n", [3, 1300])
def test_landmarks_raise_a_bound_by_the_triangle_inequality(rng, n):
    costs, bound = rng.uniform(0.0, 9.0, (4, n)), rng.uniform(0.0, 4.0, n)
    want = np.maximum(bound, np.abs(costs - costs[:, 2:3]).max(axis=0))
    kernels.raise_by_landmarks(costs, 2, bound)
    np.testing.assert_allclose(bound, want, rtol=1e-11)
    assert (bound <= want).all()  # rounding never lifts it above the truth


def test_what_lies_beyond_a_node_counts_up_to_a_bound(rng):
    near, beyond = rng.random(30), rng.random(30) * 20.0
    beyond[::7], out = np.inf, np.empty(30)
    kernels.cost_through(near, beyond, 1.5, 10.0, out)
    assert np.array_equal(out, 1.5 * near + np.minimum(beyond, 10.0))
