"""The grid of cells: how many it may hold."""

import numpy as np
import pytest

from odm.obstacles.grid import LARGEST_GRID, WorkspaceGrid, bounding_ball
from roadmap import load_robot
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


def test_a_robot_without_geometry_that_moves_is_refused(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(
        """<robot name="bare"><link name="base"><collision><geometry>
        <sphere radius="0.1"/></geometry></collision></link><link name="arm"/>
        <joint name="a" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/>
        </joint></robot>""",
        encoding="utf-8",
    )
    with pytest.raises(BadInput, match="no link of bare that a joint moves has"):
        bounding_ball(load_robot(path))
