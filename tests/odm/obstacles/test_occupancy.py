"""Points of a frame into cells, and by block, against the definition."""

import numpy as np
import pytest

from odm.close_test._sorted_clouds import FAR, lay_out
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._cloud import N_BAD, N_INSIDE, N_LISTED, N_OCCUPIED, N_OUTSIDE
from odm.obstacles.grid import WorkspaceGrid

GRID = WorkspaceGrid(np.array([-0.7, -0.41, -0.2]), 0.05, np.array([7, 4, 5]))
WRONG = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e300, 1e19, -1e19, 3e9, -3e9]


def drawn(rng, n):
    """Draw points (n, 3): inside, beside, on edges of cells, and not finite."""
    size = GRID.upper - GRID.origin
    points = GRID.origin + rng.uniform(-0.2, 1.2, (n, 3)) * size
    on_edge = rng.random((n, 3)) < 0.2
    edges = GRID.origin + GRID.h * rng.integers(-1, 4 * GRID.blocks + 2, (n, 3))
    points[on_edge] = edges[on_edge]
    # the last number before an edge, and the first after it
    beside = on_edge & (rng.random((n, 3)) < 0.5)
    ways = rng.choice([-np.inf, np.inf], (n, 3))
    points[beside] = np.nextafter(points, ways)[beside]
    wrong = rng.random((n, 3)) < 0.03
    points[wrong] = rng.choice(WRONG, int(wrong.sum()))
    return points


def cell_by_cell(points):
    """Return what `mark_points` writes: cells (n,), words, blocks in order, counts."""
    nx, ny, nz = (int(b) for b in GRID.blocks)
    where, words, blocks = [], np.zeros(nx * ny * nz, np.uint64), []
    counts = {N_INSIDE: 0, N_OUTSIDE: 0, N_BAD: 0}
    with np.errstate(over="ignore"):
        scaled = (points - GRID.origin) * (1.0 / GRID.h)
    for at in scaled:
        if not np.isfinite(at).all():
            counts[N_BAD] += 1
            where.append(-1)
        elif (at < 0).any() or (at >= [4 * nx, 4 * ny, 4 * nz]).any():
            counts[N_OUTSIDE] += 1
            where.append(-1)
        else:
            counts[N_INSIDE] += 1
            i, j, k = (int(v) for v in np.floor(at))
            block = (i // 4 * ny + j // 4) * nz + k // 4
            bit = 16 * (i % 4) + 4 * (j % 4) + k % 4
            where.append(64 * block + bit)
            words[block] |= np.uint64(1 << bit)
            if block not in blocks:
                blocks.append(block)
    return np.array(where, int), words, blocks, counts


@pytest.mark.parametrize(
    "n", [0, 1, 2, 3, 7, 8, 15, 17, 33, 127, 128, 129, 385, 1000, 20_000]
)
def test_points_mark_the_cells_they_are_in(rng, n):
    points, cloud = drawn(rng, n), GRID.new_cloud(n)
    occupancy.mark_points(points, cloud)
    where, words, blocks, counts = cell_by_cell(points)
    assert (cloud.where[:n] == where).all()
    assert (cloud.words == words).all()
    assert cloud.occupied[: cloud.counts[N_OCCUPIED]].tolist() == blocks
    assert (cloud.slot[blocks] == np.arange(len(blocks))).all()
    assert {k: int(cloud.counts[k]) for k in counts} == counts
    if n == 20_000:
        assert min(counts.values()) > 500


@pytest.mark.parametrize("n", [0, 1, 5, 300, 20_000])
def test_points_are_sorted_by_block_in_their_order(rng, n):
    points, cloud = drawn(rng, n), GRID.new_cloud(n)
    occupancy.mark_points(points, cloud)
    occupancy.sort_points(points, cloud)
    n_blocks = int(cloud.counts[N_OCCUPIED])
    assert cloud.start[0] == 0
    assert cloud.start[n_blocks] == cloud.counts[N_INSIDE]
    for k in range(n_blocks):
        part = slice(int(cloud.start[k]), int(cloud.start[k + 1]))
        mine = np.flatnonzero(cloud.where[:n] >> 6 == cloud.occupied[k])
        assert cloud.order[part].tolist() == mine.tolist()
        assert (cloud.xyz[part] == points[mine]).all()
        low, high = points[mine].min(axis=0), points[mine].max(axis=0)
        assert (cloud.box[k] == [*low, *high]).all()


@pytest.mark.parametrize("n", [0, 1, 300, 20_000])
def test_points_outside_are_laid_out_with_the_nearest_block(rng, n):
    points, cloud = drawn(rng, n), GRID.new_cloud(n)
    bad = lay_out(points, cloud)
    with np.errstate(over="ignore"):
        cells = (points - cloud.origin) * (1.0 / cloud.h)
    known = (np.abs(cells) < FAR).all(axis=1)
    assert bad == (~known).sum() == cloud.counts[N_BAD]
    assert cloud.counts[N_INSIDE] == known.sum()
    shape = np.array(GRID.blocks)
    nearest = np.clip(np.floor(cells[known] / 4.0), 0, shape - 1).astype(int)
    blocks = np.ravel_multi_index(nearest.T, shape)
    listed = cloud.occupied[: cloud.counts[N_LISTED]]
    assert sorted(listed.tolist()) == np.unique(blocks).tolist()
    ids = np.flatnonzero(known)
    for k, b in enumerate(listed):
        part = slice(int(cloud.start[k]), int(cloud.start[k + 1]))
        assert cloud.order[part].tolist() == ids[blocks == b].tolist()
        mine = points[cloud.order[part]]
        assert (cloud.xyz[part] == mine).all()
        assert (cloud.box[k] == [*mine.min(axis=0), *mine.max(axis=0)]).all()
