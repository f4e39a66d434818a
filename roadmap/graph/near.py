"""Which nodes are near to which: a k-d tree that is asked in chunks."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from roadmap.builds.chunks import Chunk, Job, Workers

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_ASKED = 2048  # nodes of a chunk; the bytes do not depend on it


class NearSpec(NamedTuple):
    """Points, and how many nearest nodes to find for each.

    Attributes:
        points: (n, dof) weighted configurations.
        period: (dof,) of joints that turn without end, weighted; 0: of none.
        k: How many nearest nodes to find for each point, the point itself included.
    """

    points: np.ndarray
    period: np.ndarray
    k: int


class NearTree(NamedTuple):
    """k-d tree of those points, in which a job looks up their nearest nodes."""

    tree: "cKDTree"
    k: int


def near_nodes(spec: NearSpec, workers: Workers) -> np.ndarray:
    """Return the (n, k) nearest nodes of each node, the nearest first."""
    points, starts = spec.points, range(0, len(spec.points), _ASKED)
    parts = (Chunk(k, (np.ascontiguousarray(points[k : k + _ASKED]),)) for k in starts)
    job = Job(f"{__name__}:nearest", f"{__name__}:tree_of", spec, "near node", 1)
    return np.concatenate([near for (near,) in workers.map(job, parts)])


def tree_of(spec: NearSpec) -> NearTree:
    """Make the tree, in which some joints are periodic."""
    from scipy.spatial import cKDTree

    return NearTree(cKDTree(spec.points, boxsize=spec.period), spec.k)


def nearest(made: NearTree, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the (m, k) nearest nodes of points (m, dof)."""
    _, near = made.tree.query(points, k=made.k)
    return (near.reshape(len(points), made.k),)
