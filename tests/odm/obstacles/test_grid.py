"""The grid of cells: how many it may hold."""

import numpy as np
import pytest

from odm.obstacles.grid import LARGEST_GRID, WorkspaceGrid
from roadmap.errors import BadInput


def test_the_last_cell_of_the_largest_grid_has_a_number_of_32_bits():
    largest = WorkspaceGrid(np.zeros(3), 0.01, [LARGEST_GRID, 1, 1])
    assert (largest.n_blocks << 6) - 1 <= np.iinfo(np.int32).max
    assert ((largest.n_blocks + 2) << 6) - 1 > np.iinfo(np.int32).max


def test_a_larger_grid_is_refused_with_the_remedy():
    with pytest.raises(BadInput, match=r"33,554,431; give larger cells"):
        WorkspaceGrid(np.zeros(3), 0.001, [LARGEST_GRID + 1, 1, 1])
    with pytest.raises(BadInput, match="4,194,304"):  # whose product wraps round
        WorkspaceGrid(np.zeros(3), 0.001, [2**22, 2**22, 2**20])
