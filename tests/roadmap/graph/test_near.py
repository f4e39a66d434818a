"""Near nodes, looked for in chunks: those of a plain search, endless joints too."""

import numpy as np

from roadmap.builds.chunks import Threads
from roadmap.graph import near
from roadmap.graph.near import NearSpec, near_nodes


def test_the_nearest_are_found_across_the_end_of_a_turn(monkeypatch):
    monkeypatch.setattr(near, "_ASKED", 7)  # several chunks
    rng = np.random.default_rng(3)
    period = np.array([2 * np.pi, 0.0, 3.0])
    points = rng.uniform(0.0, [2 * np.pi, 5.0, 3.0], (60, 3))
    gap = np.abs(points[:, None] - points[None])
    round_it = np.where(period > 0, period - gap, np.inf)
    far = np.linalg.norm(np.minimum(gap, round_it), axis=2)
    found = near_nodes(NearSpec(points, period, 6), Threads(2))
    assert np.array_equal(found, np.argsort(far, axis=1)[:, :6])
    alone = near_nodes(NearSpec(points, period, 1), Threads(1))
    assert np.array_equal(alone[:, 0], np.arange(60))
