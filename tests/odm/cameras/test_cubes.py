"""Points stand for blocked cells: what comes near to a cube comes near to a point."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from odm.cameras import _cubes as cubes

H = 0.04
E = np.sqrt(3.0) * H / 4.0
ORIGIN = np.array([-0.2, 0.1, 0.3])
SHAPE = (10, 12, 72)  # two words along z
CHILD = np.array([(k >> 2, k >> 1 & 1, k & 1) for k in range(8)])


def packed(cells):
    """Return (nx, ny, nz) bool as bits (nx, ny, words)."""
    wide = np.zeros((*cells.shape[:2], 64 * -(-cells.shape[2] // 64)), bool)
    wide[:, :, : cells.shape[2]] = cells
    return np.packbits(wide, axis=2, bitorder="little").view(np.uint64)


def draw_blocked(rng):
    """Draw blobs of blocked cells, and free some eighths of some of them."""
    at = np.stack(np.indices(SHAPE), axis=-1)
    cells = np.zeros(SHAPE, bool)
    for _ in range(5):
        middle = rng.uniform([0, 0, 0], SHAPE)
        cells |= np.linalg.norm(at - middle, axis=-1) < rng.uniform(1.0, 4.5)
    cells |= rng.random(SHAPE) < 0.002
    eighths = np.full(SHAPE, 255, np.uint8)
    eighths[rng.random(SHAPE) < 0.3] = rng.integers(1, 256)
    return cells, eighths


def points_of(cells, eighths, beyond, dense=False):
    """Return the points, with cells at the border of the blocked set cut to eighths."""
    blocked, out = packed(cells), np.zeros((50000, 3))
    closed, inner = np.zeros_like(blocked), np.zeros_like(blocked)
    cubes.list_inner(blocked, closed)
    at_border = cells & ~unpacked(closed)
    mask = np.where(at_border, eighths, 255).astype(np.uint8)
    full = packed(cells & (mask == 255))
    cubes.list_inner(full, inner)
    state = hit = np.zeros(SHAPE, np.uint8)
    sets = (blocked, inner, closed, full, packed(beyond), state, hit, mask)
    n = cubes.write_points(cubes.Cells(*sets, ORIGIN, H), dense, out)
    assert n <= len(out)
    return out[:n], np.where(cells, mask, 0)


def unpacked(bits):
    flat = np.unpackbits(bits.view(np.uint8), axis=2, bitorder="little")
    return flat[:, :, : SHAPE[2]].astype(bool)


def blocked_boxes(mask):
    """Return lower corners (n, 3) of all blocked eighths."""
    cell = np.argwhere(mask > 0)
    found = [
        (cell[(mask[tuple(cell.T)] >> k) & 1 > 0] + 0.5 * CHILD[k]) for k in range(8)
    ]
    return ORIGIN + H * np.concatenate(found)


class Boxes:
    """Boxes by their lower corners, and how far places are from the nearest."""

    def __init__(self, low):
        self.low, self._middles = low, cKDTree(low + 0.25 * H)

    def distances(self, places, most):
        """Return how far places (n, 3) are from a box [m]; inf beyond `most`."""
        within = most + 0.25 * np.sqrt(3.0) * H + 1e-9
        near = self._middles.query_ball_point(places, within)
        at = np.repeat(np.arange(len(places)), list(map(len, near)))
        low, p = self.low[np.concatenate(near).astype(int)], places[at]
        gap = np.maximum(0.0, np.maximum(low - p, p - low - 0.5 * H))
        found = np.full(len(places), np.inf)
        np.minimum.at(found, at, np.linalg.norm(gap, axis=1))
        return found


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("dense", [False, True])
def test_a_ball_near_a_blocked_cube_has_a_point_within_reach(seed, dense):
    rng = np.random.default_rng(seed)
    cells, eighths = draw_blocked(rng)
    points, mask = points_of(cells, eighths, np.zeros(SHAPE, bool), dense)
    boxes, tree = Boxes(blocked_boxes(mask)), cKDTree(points)
    keep = E  # radius + m: the least for which centres of inner cells will do
    places = boxes.low[rng.integers(len(boxes.low), size=1500)]
    places = places + rng.uniform(-0.06, 0.06 + 0.5 * H, (1500, 3))
    checked = places[boxes.distances(places, keep) <= keep]
    assert (tree.query(checked)[0] <= keep + E + 1e-12).all()
    assert len(checked) > 300


@pytest.mark.parametrize("seed", range(4))
def test_every_point_is_in_a_blocked_cube_and_none_is_given_twice(seed):
    rng = np.random.default_rng(50 + seed)
    cells, eighths = draw_blocked(rng)
    beyond = np.zeros(SHAPE, bool)
    beyond[:, :3] = True
    points, mask = points_of(cells | beyond, eighths, beyond)
    mask = np.where(beyond, 0, mask)
    boxes = Boxes(blocked_boxes(mask))
    assert boxes.distances(points, 1e-12).max() <= 1e-12
    assert len(np.unique(points.round(9), axis=0)) == len(points)
    cell = np.floor((points - ORIGIN) / H).astype(int)
    assert not beyond[tuple(cell.T)].any()
    covered = np.zeros(SHAPE, bool)
    covered[tuple(cell.T)] = True
    assert (covered == (mask > 0)).all()


def test_cells_are_packed_as_they_are():
    rng = np.random.default_rng(1)
    state = rng.integers(0, 7, SHAPE).astype(np.uint8)
    state[:, :, 8:20] = 0
    unseen, blocked = (np.zeros((*SHAPE[:2], 2), np.uint64) for _ in range(2))
    cubes.pack(state.view(np.uint32), unseen, blocked)
    assert (unpacked(unseen) == (state == 0)).all()
    assert (unpacked(blocked) == (state >= 2)).all()
