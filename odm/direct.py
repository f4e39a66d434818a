"""The direct map's answer for a frame: all nodes and edges it invalidates."""

import numpy as np

from odm._kernels import direct
from odm._kernels.types import N_OCCUPIED, Cloud
from odm.cell_map import CellMap


class DirectMap:
    """Counts of occupied blocks per item, kept up to date by what changed."""

    def __init__(self, cell_map: CellMap) -> None:
        """Lay out the counts; nothing is occupied."""
        self.cells = cell_map.arm_cells
        self.n_nodes = cell_map.roadmap.n_nodes
        self.edges = cell_map.roadmap.edges
        n_items = self.n_nodes + len(self.edges)
        self.hits = np.zeros(n_items, np.int16)
        self.seen = np.zeros(cell_map.grid.n_blocks, np.uint64)
        self.listed = np.zeros(cell_map.grid.n_blocks + 1, np.int32)
        self.nodes_out = np.zeros(self.n_nodes, np.int32)
        self.edges_out = np.zeros(len(self.edges), np.int32)

    def clear(self) -> None:
        """Forget what was occupied: the next answer comes from scratch."""
        self.hits[:] = 0
        self.seen[:] = 0
        self.listed[-1] = 0

    def invalid(self, cloud: Cloud) -> tuple[np.ndarray, np.ndarray]:
        """Return (node ids, edge ids), ascending views of own memory."""
        direct.update_hits(
            self.cells.t_ptr, self.cells.t_item, self.cells.t_mask, cloud.occupied,
            cloud.counts[N_OCCUPIED], cloud.words, self.seen, self.hits, self.listed,
        )
        n, m = direct.invalid_items(
            self.hits, self.n_nodes, self.edges, self.nodes_out, self.edges_out
        )
        return self.nodes_out[:n], self.edges_out[:m]
