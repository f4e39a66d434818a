"""The roadmap: configurations and straight motions between them, in CSR form."""

from dataclasses import dataclass, field

import numpy as np

from roadmap.arrays import brief, freeze, frozen

N_LANDMARKS = 16


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Nodes and edges; node i's neighbours stand at adj_ptr[i]:adj_ptr[i + 1].

    Attributes:
        nodes: (n, dof) configurations [rad or m].
        edges: (m, 2) node ids, the smaller first, sorted.
        lengths: (m,) weighted joint-space lengths.
        weights: (dof,) weight of each joint in lengths.
        landmarks: (n, k) distance of each node from k landmark nodes.
    """

    nodes: np.ndarray
    edges: np.ndarray
    lengths: np.ndarray
    weights: np.ndarray
    landmarks: np.ndarray
    adj_ptr: np.ndarray = field(init=False)
    adj_node: np.ndarray = field(init=False)
    adj_edge: np.ndarray = field(init=False)
    adj_length: np.ndarray = field(init=False)

    __repr__ = brief

    def __post_init__(self) -> None:
        freeze(self, nodes=float, lengths=float, weights=float, landmarks=float)
        freeze(self, edges=np.int32)
        both = np.concatenate([self.edges[:, 0], self.edges[:, 1]])
        other = np.concatenate([self.edges[:, 1], self.edges[:, 0]])
        ids = np.tile(np.arange(len(self.edges), dtype=np.int32), 2)
        order = np.argsort(both, kind="stable")
        counts = np.bincount(both, minlength=len(self.nodes))
        ptr = np.concatenate([[0], np.cumsum(counts)])
        laid = {
            "adj_ptr": frozen(ptr, np.int64),
            "adj_node": frozen(other[order], np.int32),
            "adj_edge": frozen(ids[order], np.int32),
            "adj_length": frozen(np.tile(self.lengths, 2)[order], float),
        }
        for name, array in laid.items():
            object.__setattr__(self, name, array)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @property
    def n_edges(self) -> int:
        """Number of edges."""
        return len(self.edges)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return what has to be stored."""
        names = ("nodes", "edges", "lengths", "weights", "landmarks")
        return {name: getattr(self, name) for name in names}

    def to_sparse(self, free: np.ndarray | None = None):  # noqa: ANN201 (scipy type)
        """Return the symmetric scipy CSR matrix of lengths, of `free` (m,) edges."""
        from scipy.sparse import coo_matrix

        keep = slice(None) if free is None else free
        a, b = self.edges[keep].T
        length = self.lengths[keep]
        rows, cols = np.concatenate([a, b]), np.concatenate([b, a])
        shape = (self.n_nodes, self.n_nodes)
        return coo_matrix((np.tile(length, 2), (rows, cols)), shape=shape).tocsr()


def choose_landmarks(graph, n: int) -> np.ndarray:  # noqa: ANN001 (scipy type)
    """Return distances (nodes, k) from k far-apart nodes of a connected graph.

    Distances to landmarks bound the distance between any two nodes from below by the
    triangle inequality, and go on doing so when edges are taken away: 'Computing the
    shortest path: A* search meets graph theory', Goldberg and Harrelson 2005.
    """
    from scipy.sparse.csgraph import dijkstra

    far = dijkstra(graph, indices=0)
    columns: list[np.ndarray] = []
    nearest = np.full(len(far), np.inf)
    for _ in range(min(n, len(far))):
        node = int(np.argmax(far if not columns else nearest))
        columns.append(dijkstra(graph, indices=node))
        nearest = np.minimum(nearest, columns[-1])
    return np.stack(columns, axis=1)
