"""Which balls cover which: as a slow search over all pairs says, in order."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from odm.obstacles._surfaces import cover_lists


def rows_of(ptr, named):
    return [part.tolist() for part in np.split(named, ptr[1:-1])]


@pytest.mark.parametrize("n", [1, 2, 60])
def test_lists_name_all_that_lies_in_reach_in_order(rng, n):
    centers, reach = rng.uniform(0.0, 1.0, (n, 3)), 0.4
    radii = rng.uniform(0.0, 0.6, n)  # some larger than what is covered
    pairs = cKDTree(centers).query_pairs(reach, output_type="ndarray")
    pairs = rng.permuted(rng.permutation(pairs), axis=1)
    ptr, covers, back_ptr, covered_by = cover_lists(pairs, centers, radii, reach)
    apart = np.linalg.norm(centers[:, None] - centers, axis=2)
    slow = (apart + radii <= reach) | np.eye(n, dtype=bool)
    assert rows_of(ptr, covers) == [np.flatnonzero(row).tolist() for row in slow]
    assert rows_of(back_ptr, covered_by) == [
        np.flatnonzero(row).tolist() for row in slow.T
    ]
    assert n < 60 or n < slow.sum() < n * n
