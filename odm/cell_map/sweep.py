"""Offline: the cells that nodes and edges sweep, into the lists of a layer."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from odm.cell_map import _sweep as sweep
from odm.cell_map.cell_map import ROUNDING, CellLists
from odm.close_test._arm import Arm
from odm.close_test.safety import Safety
from odm.obstacles.grid import WorkspaceGrid
from roadmap.errors import BuildRefused
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference
from roadmap.robot.robot import Robot

CHUNK = 256  # items of one unit of work; the bytes do not depend on it
_ENTRIES = 160  # first guess per item; a chunk that needs more is done again
Progress = Callable[[str, int, int], None]


def sweep_roadmap(
    robot: Robot,
    arm: Arm,
    roadmap: Roadmap,
    grid: WorkspaceGrid,
    safety: Safety,
    threads: int = 0,
    progress: Progress | None = None,
) -> CellLists:
    """Sweep all nodes, then all edges less their nodes; the same for any `threads`.

    Args:
        robot: Whose nodes and edges are swept.
        arm: Its moving spheres, from `arm_of`.
        roadmap: Nodes and edges.
        grid: Where; it must hold every swept cell.
        safety: Terms; a sphere is grown by rho + m + ROUNDING.
        threads: Worker threads; 0 means one per core.
        progress: Called with (stage, done, total).

    Raises:
        BuildRefused: A swept cell lies outside the grid.
    """
    radii = arm.spheres[:, 3] + safety.rho + safety.m + ROUNDING
    swept = swept_by(arm, radii, 0.5 * safety.mu, grid)
    block_type = np.uint16 if grid.n_blocks <= 65535 else np.uint32
    tell = progress or (lambda stage, done, total: None)

    def sweep_nodes(part: slice, *out: np.ndarray) -> int:
        return sweep.sweep_nodes(swept, roadmap.nodes[part], sweep.Lists(*out))

    with ThreadPoolExecutor(threads or None) as pool:
        nodes = _collect(pool, sweep_nodes, roadmap.n_nodes, block_type, tell, "nodes")
        ends = np.asarray(roadmap.edges, np.int64)
        dq = difference(robot, roadmap.nodes[ends[:, 0]], roadmap.nodes[ends[:, 1]])

        def sweep_edges(part: slice, *out: np.ndarray) -> int:
            q = roadmap.nodes[ends[part, 0]]
            lists = sweep.Lists(*out)
            return sweep.sweep_edges(swept, q, dq[part], ends[part], nodes, lists)

        edges = _collect(pool, sweep_edges, roadmap.n_edges, block_type, tell, "edges")
    ptr = np.concatenate([nodes[0], nodes[0][-1] + edges[0][1:]])
    block = np.concatenate([nodes[1], edges[1]])
    mask = np.concatenate([nodes[2], edges[2]])
    tell("both views", 0, 1)
    lists = both_views(ptr, block, mask, grid.n_blocks)
    tell("both views", 1, 1)
    return lists


def swept_by(
    arm: Arm, radii: np.ndarray, tolerance: float, grid: WorkspaceGrid
) -> sweep.Swept:
    """Return what compiled sweeps take.

    Args:
        arm: The robot.
        radii: (n,) of its spheres, grown [m].
        tolerance: Largest inflation of a piece of a motion [m].
        grid: Where.
    """
    return sweep.Swept(
        arm, radii, tolerance, sweep.Grid(grid.origin, grid.h, grid.blocks)
    )


def both_views(
    ptr: np.ndarray, block: np.ndarray, mask: np.ndarray, n_blocks: int
) -> CellLists:
    """Return the lists with their transpose."""
    t_ptr = np.zeros(n_blocks + 1, np.int64)
    t_item = np.empty(len(block), np.uint32)
    t_mask = np.empty(len(block), np.uint64)
    sweep.transpose_lists(ptr, block, mask, t_ptr, t_item, t_mask)
    return CellLists(ptr, block, mask, t_ptr, t_item, t_mask)


def _collect(
    pool: ThreadPoolExecutor,
    job: Callable[..., int],
    n: int,
    block_type: type,
    tell: Progress,
    stage: str,
) -> sweep.ItemCells:
    """Run `job` over chunks of n items; return ptr, blocks, masks in item order."""
    parts = [slice(k, min(k + CHUNK, n)) for k in range(0, n, CHUNK)]

    def run(part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        size = part.stop - part.start
        room = _ENTRIES * size
        while True:
            counts = np.empty(size, np.int64)
            blocks, masks = np.empty(room, block_type), np.empty(room, np.uint64)
            end = job(part, counts, blocks, masks)
            if end == -2:
                raise BuildRefused(
                    "the robot sweeps a cell outside the workspace grid, which is a "
                    "fault of the grid's bound; please report the recipe"
                )
            if end >= 0:
                return counts, blocks[:end].copy(), masks[:end].copy()
            room *= 2

    done, results = 0, []
    for part, result in zip(parts, pool.map(run, parts), strict=True):
        results.append(result)
        done = part.stop
        tell(stage, done, n)
    none: tuple[np.ndarray, ...] = (
        np.zeros(0, np.int64),
        np.zeros(0, block_type),
        np.zeros(0, np.uint64),
    )
    columns = list(zip(*(results or [none]), strict=True))
    counts, blocks, masks = (np.concatenate(c) for c in columns)
    ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return sweep.ItemCells(ptr, blocks, masks)
