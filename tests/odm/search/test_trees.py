"""Kernels of the search beyond the roadmap against slow twins from the definitions."""

import networkx as nx
import numpy as np
from wrappers import with_wrapper

from odm._groups import new
from odm.search import _connect as kernels
from odm.search._state import Trees

halton = with_wrapper(kernels.halton)
drop = with_wrapper(kernels.drop)
lay_out = with_wrapper(kernels.lay_out)


def radical_inverse(index, base):
    digits = []
    while index:
        index, digit = divmod(index, base)
        digits.append(digit)
    return sum(d / base ** (k + 1) for k, d in enumerate(digits))


def test_samples_are_the_halton_sequence():
    for base in (2, 3, 17):
        for index in (0, 1, 2, 7, 100, 12345):
            want = radical_inverse(index, base)
            assert np.isclose(halton(index, base), want)


def grown(rng, n):
    """Return trees of n branches each, at random; branch i is at (i, i)."""
    trees = new(Trees, {"branches": n, "route": 8, "dof": 2})
    trees.count[:] = n
    for side in range(2):
        trees.q[side] = np.arange(n)[:, None]
        trees.seen[side] = np.arange(n)
        for i in range(n):
            root = i == 0 or rng.random() < 0.1
            trees.parent[side, i] = -1 - i if root else rng.integers(i)
    return trees


def test_what_grew_from_a_dropped_branch_goes_with_it(rng):
    for _ in range(50):
        n = int(rng.integers(1, 40))
        trees = grown(rng, n)
        side, branch = int(rng.integers(2)), int(rng.integers(n))
        parent = trees.parent[side].copy()
        graph = nx.DiGraph()
        graph.add_nodes_from(range(n))
        graph.add_edges_from((int(p), i) for i, p in enumerate(parent) if p >= 0)
        gone = nx.descendants(graph, branch) | {branch}
        other = trees.parent[1 - side].copy()
        drop(trees, side, branch)
        kept = [i for i in range(n) if i not in gone]
        assert trees.count[side] == len(kept) and trees.count[1 - side] == n
        assert np.array_equal(trees.parent[1 - side], other)
        assert trees.q[side, : len(kept), 0].tolist() == kept
        assert trees.seen[side, : len(kept)].tolist() == kept
        for new_i, i in enumerate(kept):
            want = parent[i] if parent[i] < 0 else kept.index(parent[i])
            assert trees.parent[side, new_i] == want


def test_a_cut_is_laid_between_the_corners_that_stay(rng):
    for _ in range(50):
        trees = new(Trees, {"branches": 1, "route": 40, "dof": 2})
        n = int(rng.integers(3, 20))
        route = rng.normal(size=(n, 2))
        trees.route[:n], trees.corners[0] = route, n
        i, j = np.sort(rng.choice(n - 1, 2, replace=False))
        a, b = rng.normal(size=(2, 2))
        lay_out(trees, i, j, a, b)
        want = np.vstack([route[: i + 1], a, b, route[j + 1 :]])
        assert trees.corners[0] == len(want)
        assert np.array_equal(trees.route[: len(want)], want)
