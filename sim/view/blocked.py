"""Occupied cells, what they block of a roadmap, and its edges as lines of a page."""

import numpy as np
import trimesh

from odm.cell_map.cell_map import CellMap
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.surfaces import sample_capsules
from roadmap.kinematics.forward import tool_pose

SPACING = 0.03  # of the samples on the person [m], as in the loop
_LINES = 1  # a mode of glTF


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

    Attributes:
        segments: (m, 2, 3) ends of every edge [m].
    """

    def __init__(self, cell_map: CellMap) -> None:
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


def thickness_of(lines: int) -> float:
    """Return how thick so many blocked edges are [px].

    Below 1 a line is drawn fainter, so that the robot is seen through thousands.
    """
    return max(0.05, min(0.8, 300 / max(1, lines)))


def line_file(
    segments: np.ndarray, colour: tuple[int, int, int], opacity: float
) -> bytes:
    """Return a binary glTF of line segments, one pixel wide and drawn in one call.

    Lines of a width are drawn as several triangles each: of 73 000 edges a processor
    that draws itself makes one picture in seconds (docs/decisions/0068). `segments` (n,
    2, 3) are in metres, `colour` 0 to 255, sRGB; with an opacity below 1 what lies
    behind many of them is seen, too.
    """
    shade = [_linear(c / 255.0) for c in colour]
    look = {"pbrMetallicRoughness": {"baseColorFactor": [*shade, opacity]}}

    def as_lines(tree: dict) -> None:
        tree["materials"] = [look | {"alphaMode": "BLEND"}]
        (drawn,) = tree["meshes"][0]["primitives"]
        drawn |= {"mode": _LINES, "material": 0}

    cloud = trimesh.PointCloud(segments.reshape(-1, 3))
    return cloud.scene().export(file_type="glb", tree_postprocessor=as_lines)


def _linear(c: float) -> float:
    """Return a share of light of a share in sRGB, as glTF has colours."""
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
