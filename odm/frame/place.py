"""Scenery of a place: points that never move, and the items they close for good."""

from collections.abc import Iterable

import numpy as np

from odm.checks import as_floats
from odm.close_test.static import StaticTest
from odm.obstacles.surfaces import Surface, require_covering, surface_of
from odm.search import _attach as kernels
from odm.search._state import Graph
from roadmap.errors import BadInput
from roadmap.graph.roadmap import Roadmap
from roadmap.kinematics.forward import difference


def place_points(points_or_shapes: object, rho: float) -> np.ndarray:
    """Return (n, 3) surface points of points, a shape, surfaces or a list of them."""
    if isinstance(points_or_shapes, np.ndarray):
        points = as_floats("scenery points", points_or_shapes)
        if points.ndim != 2 or points.shape[1] != 3:
            raise BadInput(f"scenery points have shape {points.shape}; give (n, 3)")
        bad = len(points) - int(np.isfinite(points).all(axis=1).sum())
        if bad:
            raise BadInput(f"{bad} scenery points are NaN or infinite; remove them")
        return points
    parts = points_or_shapes
    if isinstance(parts, Surface) or not isinstance(parts, Iterable):
        parts = [parts]
    found = [np.zeros((0, 3))]
    for part in parts:
        surface = part if isinstance(part, Surface) else surface_of(part, rho)
        require_covering(surface, rho)
        found.append(surface.points)
    return np.concatenate(found)


def items_in_place(graph: Graph, static: StaticTest, roadmap: Roadmap) -> np.ndarray:
    """Return which nodes and edges touch the place's scenery: cells, then closely.

    Args:
        graph: Their cell lists.
        static: The robot, with what it may carry, and the scenery.
        roadmap: Nodes and edges.

    Returns:
        (n_nodes + n_edges,) True where an item is to be closed.
    """
    hit = np.zeros(len(graph.closed), np.bool_)
    words = static.place_cloud.words
    kernels.items_hit(graph.ptr, graph.block, graph.mask, words, hit)
    n, still = roadmap.n_nodes, np.zeros(static.robot.dof)
    ends = roadmap.edges
    # an edge's list leaves out the cells of its nodes, so theirs count for it too
    hit[n:] |= hit[ends[:, 0]] | hit[ends[:, 1]]
    dq = difference(static.robot, roadmap.nodes[ends[:, 0]], roadmap.nodes[ends[:, 1]])
    for item in np.flatnonzero(hit):
        start = roadmap.nodes[item if item < n else ends[item - n, 0]]
        motion = still if item < n else dq[item - n]
        hit[item] = not static.clear_of_place(start, motion)
    return hit
