"""Offline: the cells that nodes and edges sweep, into the lists of a layer."""

from collections.abc import Iterable, Iterator

import numpy as np

from odm._groups import block_type
from odm.cell_map import _sweep as sweep
from odm.cell_map.cell_map import ROUNDING
from odm.cell_map.chunk_work import at_rest, sweep_job
from odm.cell_map.lists import CellLists, packed_lists
from odm.close_test._arm import Arm
from odm.close_test.safety import Safety
from odm.obstacles.grid import WorkspaceGrid
from roadmap.builds.chunks import Chunk, Progress, Threads, Workers
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference
from roadmap.robot.robot import Robot

CHUNK = 1024  # items of one unit of work; the bytes do not depend on it


def sweep_roadmap(
    robot: Robot,
    arm: Arm,
    roadmap: Roadmap,
    grid: WorkspaceGrid,
    safety: Safety,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> CellLists:
    """Sweep all nodes, then all edges less their nodes; the same for any workers.

    Args:
        robot: Whose nodes and edges are swept.
        arm: Its moving spheres, from `arm_of`.
        roadmap: Nodes and edges.
        grid: Where; it must hold every swept cell.
        safety: Terms; a sphere is grown by rho + m + ROUNDING.
        workers: Who does the chunks; threads of this process when None.
        progress: Called with (stage, done, total).

    Raises:
        BuildRefused: A swept cell lies outside the grid.
    """
    radii = arm.spheres[:, 3] + safety.rho + safety.m + ROUNDING
    swept = swept_by(arm, radii, 0.5 * safety.mu, grid)
    workers = workers or Threads()
    tell = progress or (lambda stage, done, total: None)
    n, m = roadmap.n_nodes, roadmap.n_edges
    starts = range(0, n, CHUNK)
    parts = (Chunk(k, at_rest(swept, roadmap.nodes[k : k + CHUNK])) for k in starts)
    found = workers.map(sweep_job(swept, "node"), parts)
    nodes = _collected(found, grid, n, tell, "cells of nodes")
    parts = _edge_chunks(robot, roadmap, nodes)
    found = workers.map(sweep_job(swept, "edge"), parts)
    edges = _collected(found, grid, m, tell, "cells of edges")
    ptr = np.concatenate([nodes[0], nodes[0][-1] + edges[0][1:]])
    block = np.concatenate([nodes[1], edges[1]])
    mask = np.concatenate([nodes[2], edges[2]])
    tell("packing cells", 0, 1)
    lists = packed_lists(ptr, block, mask, grid.n_blocks)
    tell("packing cells", 1, 1)
    return lists


def swept_by(
    arm: Arm, radii: np.ndarray, tolerance: float, grid: WorkspaceGrid
) -> sweep.Swept:
    """Return what compiled sweeps take.

    `radii` (n,) are of the arm's spheres, grown [m]; no piece of a motion is inflated
    by more than `tolerance` [m].
    """
    return sweep.Swept(
        arm, radii, tolerance, sweep.Grid(grid.origin, grid.h, grid.blocks)
    )


def _edge_chunks(
    robot: Robot, roadmap: Roadmap, nodes: sweep.ItemCells
) -> Iterator[Chunk]:
    """Yield motions with the cells of their nodes, as far as a chunk needs them."""
    for k in range(0, roadmap.n_edges, CHUNK):
        ends = np.asarray(roadmap.edges[k : k + CHUNK], np.int64)
        q = roadmap.nodes[ends[:, 0]]
        dq = difference(robot, q, roadmap.nodes[ends[:, 1]])
        used, rows = np.unique(ends, return_inverse=True)
        counts = nodes.ptr[used + 1] - nodes.ptr[used]
        ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        at = np.arange(ptr[-1]) + np.repeat(nodes.ptr[used] - ptr[:-1], counts)
        lists = (ptr, nodes.block[at], nodes.mask[at])
        yield Chunk(k, (q, dq, rows.reshape(-1, 2).astype(np.int64), *lists))


def _collected(
    found: Iterable[tuple[np.ndarray, ...]],
    grid: WorkspaceGrid,
    n: int,
    tell: Progress,
    stage: str,
) -> sweep.ItemCells:
    """Return ptr, blocks, masks in item order of what came of all chunks."""
    done, results = 0, []
    for result in found:
        results.append(result)
        done += len(result[0])
        tell(stage, done, n)
    none: tuple[np.ndarray, ...] = (
        np.zeros(0, np.int64),
        np.zeros(0, block_type(grid.n_blocks)),
        np.zeros(0, np.uint64),
    )
    columns = list(zip(*(results or [none]), strict=True))
    counts, blocks, masks = (np.concatenate(c) for c in columns)
    ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return sweep.ItemCells(ptr, blocks, masks)
