"""The picture of what a map covers counts what the planner counts."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.draw import style
from sim.draw.map_picture import node_counts, plot_map

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")


@pytest.fixture
def tiny_map():
    """Return a grid of 2 x 1 x 3 blocks, two nodes and an edge."""
    x, y, z = 1, 2, 3
    bit = np.uint64(1 << (16 * x + 4 * y + z))
    cells = SimpleNamespace(
        t_ptr=np.array([0, 2, 2, 2, 2, 2, 4]),
        t_item=np.array([0, 1, 1, 2], np.int32),
        t_mask=np.array([bit, bit | np.uint64(1), bit, bit], np.uint64),
    )
    grid = SimpleNamespace(blocks=np.array([2, 1, 3]), n_blocks=6)
    roadmap = SimpleNamespace(n_nodes=2)
    return SimpleNamespace(
        arm_cells=SimpleNamespace(by_block=cells), grid=grid, roadmap=roadmap
    )


def test_each_cell_counts_the_nodes_that_sweep_it_and_no_edges(tiny_map):
    counts = node_counts(tiny_map)
    expected = np.zeros((8, 4, 12), int)
    expected[1, 2, 3] = 2
    expected[0, 0, 0] = 1
    expected[4 + 1, 2, 8 + 3] = 1
    np.testing.assert_array_equal(counts, expected)


def test_the_coverage_plot_is_written(tiny_map, crane, tmp_path, monkeypatch):
    tiny_map.robot, tiny_map.grid.origin, tiny_map.grid.h = crane, np.zeros(3), 0.1
    tiny_map.recipe = SimpleNamespace(name="tiny")
    titles, save = [], style.save

    def kept(figure, *told, **more):
        titles.append(figure.get_suptitle())
        return save(figure, *told, **more)

    monkeypatch.setattr(style, "save", kept)
    path = plot_map(tiny_map, tmp_path / "cover.png")
    assert "map tiny of crane: how many of its 2 nodes" in titles[0]
    with Image.open(path) as image:
        assert image.size[0] > image.size[1]
