"""The direct map's answer for a frame: all nodes and edges it invalidates."""

import numpy as np

from odm.search import _invalidation as direct
from odm.search.state import Memory


class DirectMap:
    """Counts of occupied blocks per item, kept up to date by what changed."""

    def __init__(self, memory: Memory, n_nodes: int, n_edges: int) -> None:
        """Keep the planner's memory; nothing is occupied."""
        self.memory = memory
        self.n_nodes, self.n_edges = n_nodes, n_edges
        self.nodes_out = np.zeros(n_nodes, np.int64)
        self.edges_out = np.zeros(n_edges, np.int64)

    def clear(self) -> None:
        """Forget what was occupied: the next answer comes from scratch."""
        self.memory.owner.check()
        counted = self.memory.direct
        for array in (counted.hits, counted.seen, counted.bits):
            array[:] = 0
        counted.listed[-1] = 0
        counted.frame[0] = -100

    def nodes(self) -> np.ndarray:
        """Return the ids of the invalid nodes, ascending: a view of own memory."""
        return self._list(0, self.nodes_out)

    def edges(self) -> np.ndarray:
        """Return the ids of the invalid edges, ascending: a view of own memory."""
        return self._list(self.n_nodes, self.edges_out)

    def _list(self, first: int, out: np.ndarray) -> np.ndarray:
        self.memory.owner.check()
        direct.refresh(self.memory.table)
        return out[: direct.list_bits(self.memory.direct.bits, first, len(out), out)]
