"""The clearance overhead: how much farther than m an obstacle blocks a motion."""

from dataclasses import dataclass

import numpy as np

from odm._groups import new
from odm.audit import _clearance as kernels
from odm.audit._audit import Audited, Solids
from odm.audit.audit import Auditor
from odm.audit.audit_library import as_frames_sample, draw_arms, library_of
from odm.cell_map.cell_map import ROUNDING, CellMap
from odm.cell_map.chunk_work import at_rest, swept_cells
from odm.cell_map.sweep import swept_by
from odm.close_test._arm import Clearance, make_work
from odm.close_test.close_test import NO_SOLIDS
from odm.exact.distances import gather
from odm.obstacles._solids import Solids as ShapeRows
from roadmap.errors import BadInput
from roadmap.robot.robot import Robot
from roadmap.transforms import flat_pose

_STILL = 65  # configurations that stand for an edge without motion bound
TERMS = ("cover", "rho", "cells", "mu")


@dataclass(frozen=True)
class ClearanceOverhead:
    """Extra distance by term and in all: (mean, median, 95 %) [m].

    How it is measured. The two-capsule arm, sampled with covering radius rho, comes
    in on a straight line towards a random point of a random link. Noted is the exact
    distance of the solids, robot to arm, when a test first gives the motion up:

    * nodes: d0 solids come within m; d1 the cover's spheres come within m of the
      solid arm; d2 they come within m + rho of a sample (the close test); d3 a sample
      enters a swept cell. cover = d1 - d0, rho = d2 - d1, cells = d3 - d2.
    * edges: distances are the smallest over the edge. mu = distance by the cells of
      the map less that by the cells of still configurations, closely spaced.

    `by_cells` is d3 - m (nodes) and `by_close_test` is d2 - m, `edge_by_cells` and
    `edge_by_close_test` the same on edges. `by_shapes` and `edge_by_shapes` are of the
    close test of the arm as capsules, exactly as far as it is; `by_shape_cells` and
    `edge_by_shape_cells` of the cells of those samples that a frame makes of them. m
    itself is no overhead and is listed apart.

    Attributes:
        terms: Term -> (mean, median, 95 %) [m].
        by_cells, by_close_test: The whole overhead on nodes [m].
        edge_by_cells, edge_by_close_test: The whole overhead on edges [m].
        by_shapes, edge_by_shapes: The whole overhead where obstacles are shapes [m].
        by_shape_cells, edge_by_shape_cells: The same where cells alone are asked [m].
        m: Clearance [m].
        lines, edge_lines: Approaches that counted.
    """

    terms: dict[str, tuple[float, float, float]]
    by_cells: tuple[float, float, float]
    by_close_test: tuple[float, float, float]
    edge_by_cells: tuple[float, float, float]
    edge_by_close_test: tuple[float, float, float]
    by_shapes: tuple[float, float, float]
    edge_by_shapes: tuple[float, float, float]
    by_shape_cells: tuple[float, float, float]
    edge_by_shape_cells: tuple[float, float, float]
    m: float
    lines: int
    edge_lines: int

    def as_dict(self) -> dict:
        """Return everything as plain JSON data."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def clearance_overhead(
    cell_map: CellMap, n: int = 1000, seed: int = 0, n_edges: int = 200
) -> ClearanceOverhead:
    """Measure the clearance overhead of a map; `ClearanceOverhead` says how.

    By n approaches to nodes and n_edges to edges, which take longer; a map without
    edges is refused.
    """
    if cell_map.roadmap.n_edges == 0:
        raise BadInput(
            f"the map {cell_map.recipe.name} has no edges to measure a clearance of; "
            "build it with more nodes or neighbors"
        )
    safety = cell_map.safety
    arms = draw_arms(40, safety.rho, np.random.default_rng([seed, 1]))
    cells, close = (Auditor(cell_map, seed, c, specimens=arms) for c in (False, True))
    as_frames = library_of(as_frames_sample(arms, cell_map))
    most = max(np.diff(part.point_ptr).max() for part in (cells.library, as_frames))
    cloud = cell_map.grid.new_cloud(int(most))
    robot = cell_map.robot
    work = make_work(cell_map.arm, robot.dof)
    rng = np.random.default_rng([seed, 2])
    audited = Audited(cells.asked, cell_map.arm, cloud, work, NO_SOLIDS)
    pairs = cells.draw(0, n)._replace(
        motion=-1 - rng.integers(0, cell_map.roadmap.n_nodes, n)
    )
    nodes = np.empty((n, 6))
    arm, tolerance = cell_map.arm, cell_map.motion_tolerance
    bare = arm.spheres[:, 3] + safety.m
    clearance = Clearance(arm, cell_map.swept_radii(), bare, tolerance, work)
    shapes = new(ShapeRows, {"shapes": 4, "faces": 0})
    kept = safety.m, safety.rho
    asks = kernels.Close(close.asked, clearance, shapes, *kept, as_frames)
    kernels.node_overheads(
        audited, cells.solids, _ball_solids(robot), cells.library, pairs, asks, nodes
    )
    pairs = cells.draw(1, n_edges)._replace(
        motion=rng.integers(0, cell_map.roadmap.n_edges, n_edges)
    )
    words = np.array([_still_words(cell_map, cells, e) for e in pairs.motion])
    edges = np.empty((n_edges, 5))
    still = kernels.StillCells(words, _STILL)
    kernels.edge_overheads(
        audited, asks, cells.solids, cells.library, pairs, still, edges
    )
    return _summary(nodes, edges, safety.m)


def _summary(nodes: np.ndarray, edges: np.ndarray, m: float) -> ClearanceOverhead:
    nodes = nodes[np.isfinite(nodes).all(axis=1)]
    edges = edges[np.isfinite(edges).all(axis=1)]
    d0, d1, d2, d3, shapes, shape_cells = nodes.T
    close, still, cells, edge_shapes, edge_shape_cells = edges.T
    steps = (d1 - d0, d2 - d1, d3 - d2, cells - still)
    return ClearanceOverhead(
        terms={name: _stats(s) for name, s in zip(TERMS, steps, strict=True)},
        by_cells=_stats(d3 - m),
        by_close_test=_stats(d2 - m),
        edge_by_cells=_stats(cells - m),
        edge_by_close_test=_stats(close - m),
        by_shapes=_stats(shapes - m),
        edge_by_shapes=_stats(edge_shapes - m),
        by_shape_cells=_stats(shape_cells - m),
        edge_by_shape_cells=_stats(edge_shape_cells - m),
        m=m,
        lines=len(nodes),
        edge_lines=len(edges),
    )


def _stats(values):
    if len(values) == 0:
        return (float("nan"),) * 3
    low, high = np.quantile(values, [0.5, 0.95])
    return float(values.mean()), float(low), float(high)


def _ball_solids(robot: Robot) -> Solids:
    """Return the cover's moving spheres in the form of solids."""
    moving = np.flatnonzero(robot.moving)
    parts = [(np.zeros((1, 3)), r, 0.0, 0.0) for r in robot.spheres[moving, 3]]
    poses = np.tile(np.eye(4), (len(moving), 1, 1))
    poses[:, :3, 3] = robot.spheres[moving, :3]
    return Solids(
        parts=gather(parts, np.zeros(len(parts))),
        body=np.asarray(robot.sphere_body[moving], np.int64),
        pose=flat_pose(poses),
        used=np.ones(len(parts), bool),
        targets=np.empty((0, 6)),
        target_part=np.empty(0, np.int64),
    )


def _still_words(cell_map: CellMap, auditor: Auditor, edge: int) -> np.ndarray:
    """Return the cells of closely spaced still configurations of an edge."""
    asked, arm, grid = auditor.asked, cell_map.arm, cell_map.grid
    safety = cell_map.safety
    t = np.linspace(0.0, 1.0, _STILL)[:, None]
    q = asked.nodes[asked.edges[edge, 0]] + t * asked.dq[edge]
    radii = arm.spheres[:, 3] + safety.rho + safety.m + ROUNDING
    swept = swept_by(arm, radii, 0.5 * safety.mu, grid)
    _, blocks, masks = swept_cells(swept, *at_rest(swept, q))
    words = np.zeros(grid.n_blocks, np.uint64)
    np.bitwise_or.at(words, blocks, masks)
    return words
