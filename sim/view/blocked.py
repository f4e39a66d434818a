"""Occupied cells, and what they block of a roadmap: for the picture, by numpy alone."""

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.surfaces import sample_capsules
from roadmap.kinematics.forward import tool_pose

SPACING = 0.03  # of the samples on the person [m], as in the loop


def seen_points(capsules: np.ndarray, points: np.ndarray | None) -> np.ndarray:
    """Return (n, 3) points of all that is there [m]: samples, and a sensor's points."""
    samples = sample_capsules(capsules, SPACING) if len(capsules) else np.zeros((0, 3))
    return samples if points is None else np.vstack([samples, points])


def occupied_cells(grid: WorkspaceGrid, points: np.ndarray) -> np.ndarray:
    """Return the (n, 3) cells that hold a point, each once, in ascending order."""
    cells = grid.locate(points)
    cells = cells[cells[:, 0] >= 0]
    return np.unique(cells, axis=0)


def cell_centers(grid: WorkspaceGrid, cells: np.ndarray) -> np.ndarray:
    """Return the (n, 3) centres of cells [m]."""
    return grid.origin + grid.h * (cells + 0.5)


class RoadmapPicture:
    """The roadmap as lines between the places of the tool.

    Edges are straight in the joints' space; the picture joins their ends.

    Args:
        cell_map: The map.

    Attributes:
        segments: (m, 2, 3) ends of every edge [m].
    """

    def __init__(self, cell_map: CellMap) -> None:
        """Work out where the tool is at every node."""
        self._map = cell_map
        robot, roadmap = cell_map.robot, cell_map.roadmap
        p = np.array([tool_pose(robot, q)[:3, 3] for q in roadmap.nodes])
        self.segments = p[roadmap.edges].astype(np.float32)

    def blocked(self, cells: np.ndarray) -> np.ndarray:
        """Return (m,) whether an edge, or one of its nodes, sweeps one of the cells.

        The arm's layer alone: not what is carried.
        """
        grid, roadmap = self._map.grid, self._map.roadmap
        lists = self._map.arm_cells.by_block
        hit = np.zeros(roadmap.n_nodes + roadmap.n_edges, bool)
        high, low = cells >> 2, (cells & 3).astype(np.uint64)
        _, ny, nz = grid.blocks
        block = (high[:, 0] * ny + high[:, 1]) * nz + high[:, 2]
        four, two = np.uint64(4), np.uint64(2)
        bit = np.uint64(1) << ((low[:, 0] << four) | (low[:, 1] << two) | low[:, 2])
        for b in np.unique(block):
            word = np.bitwise_or.reduce(bit[block == b])
            rows = slice(lists.t_ptr[b], lists.t_ptr[b + 1])
            hit[lists.t_item[rows][(lists.t_mask[rows] & word) != 0]] = True
        nodes, edges = hit[: roadmap.n_nodes], hit[roadmap.n_nodes :]
        return edges | nodes[roadmap.edges].any(axis=1)
