"""Slow twins of the cell kernels, written from the definitions and nothing else."""

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from roadmap.kinematics.forward import body_frames


def cells_near_ball(center, radius, origin, h, blocks) -> set[tuple[int, int, int]]:
    """Return the cells whose cube comes within `radius` of `center`."""
    # only the cells in a box around it, with two to spare on each side
    at = (np.asarray(center) - origin) / h
    first = np.maximum(0, np.floor(at - radius / h).astype(int) - 2)
    last = np.minimum(4 * np.asarray(blocks), np.ceil(at + radius / h).astype(int) + 2)
    away = []  # squared, along each axis, from the slices of cells across it
    for k in range(3):
        low = origin[k] + h * np.arange(first[k], last[k])
        away.append((np.clip(center[k], low, low + h) - center[k]) ** 2)
    far2 = away[0][:, None, None] + away[1][:, None] + away[2]
    return set(map(tuple, (np.argwhere(np.sqrt(far2) <= radius) + first).tolist()))


def centers(arm, robot, *places) -> np.ndarray:
    """Return the centres of an Arm's spheres at each of some q, (..., n, 3)."""
    frames = np.array([body_frames(robot, q) for q in places])[:, arm.body]
    turned = np.einsum("knij,nj->kni", frames[..., :3, :3], arm.spheres[:, :3])
    found = turned + frames[..., :3, 3]
    return found if len(places) > 1 else found[0]


def words_to_cells(ids, masks, blocks) -> set[tuple[int, int, int]]:
    """Unpack (block, mask) pairs to cells."""
    _, ny, nz = (int(v) for v in blocks)
    b = np.asarray(ids, np.int64)
    base = 4 * np.stack([b // (ny * nz), b // nz % ny, b % nz], axis=-1)
    k = np.arange(64)
    step = np.stack([k >> 4, k >> 2 & 3, k & 3], axis=-1)
    row, bit = np.nonzero(np.asarray(masks, np.uint64)[:, None] >> k.astype("u8") & 1)
    return set(map(tuple, (base[row] + step[bit]).tolist()))


@lru_cache(maxsize=8192)
def item_cells(cell_map, item) -> frozenset[tuple[int, int, int]]:
    """Return the cells in the list of an item (node, or n_nodes + edge)."""
    cells = cell_map.arm_cells.by_item
    part = slice(int(cells.ptr[item]), int(cells.ptr[item + 1]))
    return frozenset(
        words_to_cells(cells.block[part], cells.mask[part], cell_map.grid.blocks)
    )


@lru_cache(maxsize=8192)
def edge_cells(cell_map, edge) -> frozenset[tuple[int, int, int]]:
    """Return all cells an edge sweeps: its own list and those of its nodes."""
    a, b = cell_map.roadmap.edges[edge]
    own = item_cells(cell_map, cell_map.roadmap.n_nodes + edge)
    return own | item_cells(cell_map, a) | item_cells(cell_map, b)


def occupied_cells(cell_map, points) -> set[tuple[int, int, int]]:
    """Return the cells of points inside the grid."""
    cells = cell_map.grid.locate(points)
    return set(map(tuple, cells[(cells >= 0).all(axis=1)].tolist()))


def free_items(cell_map, points) -> tuple[np.ndarray, np.ndarray]:
    """Return which nodes (n,) and edges (m,) share no cell with the points."""
    occupied = occupied_cells(cell_map, points)
    n, m = cell_map.roadmap.n_nodes, cell_map.roadmap.n_edges
    nodes = np.array([not item_cells(cell_map, i) & occupied for i in range(n)])
    edges = np.array([not edge_cells(cell_map, e) & occupied for e in range(m)])
    return nodes, edges


def smallest_gap(cell_map, q_a, dq, points, n=400) -> float:
    """Return the least of |centre - point| - r over dense samples of a motion [m]."""
    if not len(points):
        return np.inf
    arm, nearest = cell_map.arm, cKDTree(points)
    at = centers(arm, cell_map.robot, *(q_a + t * dq for t in np.linspace(0, 1, n)))
    return (nearest.query(at)[0] - arm.spheres[:, 3]).min()
