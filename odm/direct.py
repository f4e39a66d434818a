"""The direct map's answer for a frame: all nodes and edges it invalidates."""

import numpy as np

from odm._kernels import direct
from odm.state import Memory


class DirectMap:
    """Counts of occupied blocks per item, kept up to date by what changed."""

    def __init__(self, memory: Memory, n_nodes: int, n_edges: int) -> None:
        """Keep the planner's memory; nothing is occupied."""
        self.memory = memory
        self.n_nodes, self.n_edges = n_nodes, n_edges
        self.hits = memory.direct.hits
        self.seen = memory.direct.seen
        self.pairs = self.hits.view(np.uint64)
        self.nodes_out = np.zeros(n_nodes, np.int64)
        self.edges_out = np.zeros(n_edges, np.int64)

    def clear(self) -> None:
        """Forget what was occupied: the next answer comes from scratch."""
        self.hits[:] = 0
        self.seen[:] = 0
        self.memory.direct.listed[-1] = 0

    def nodes(self) -> np.ndarray:
        """Return the ids of the invalid nodes, ascending: a view of own memory."""
        direct.refresh(self.memory.table)
        count = direct.list_hits(self.pairs, 0, self.n_nodes, self.nodes_out)
        return self.nodes_out[:count]

    def edges(self) -> np.ndarray:
        """Return the ids of the invalid edges, ascending: a view of own memory."""
        direct.refresh(self.memory.table)
        n, m = self.n_nodes, self.n_edges
        return self.edges_out[: direct.list_hits(self.pairs, n, m, self.edges_out)]
