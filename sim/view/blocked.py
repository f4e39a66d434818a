"""Occupied cells, what they block of a roadmap, its edges as lines; by numpy alone."""

import json

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.surfaces import sample_capsules
from roadmap.kinematics.forward import tool_pose

SPACING = 0.03  # of the samples on the person [m], as in the loop
_MAGIC, _VERSION = 0x46546C67, 2  # "glTF"
_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # kinds of chunks
_FLOAT, _LINES = 5126, 1


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


def opacity_of(lines: int) -> float:
    """Return how opaque blocked edges are: through thousands the robot is seen."""
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
    points = np.ascontiguousarray(segments, np.float32).reshape(-1, 3)
    shade = [_linear(c / 255.0) for c in colour]
    told = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0}, "mode": _LINES, "material": 0}
                ]
            }
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorFactor": [*shade, opacity]},
                "alphaMode": "BLEND",
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": len(points),
                "type": "VEC3",
                "min": points.min(axis=0).tolist(),
                "max": points.max(axis=0).tolist(),
            }
        ],
        "bufferViews": [{"buffer": 0, "byteLength": points.nbytes}],
        "buffers": [{"byteLength": points.nbytes}],
    }
    head = json.dumps(told).encode()
    head += b" " * (-len(head) % 4)
    chunks = _chunk(_JSON, head) + _chunk(_BINARY, points.tobytes())
    return _words(_MAGIC, _VERSION, 12 + len(chunks)) + chunks


def _chunk(kind: int, data: bytes) -> bytes:
    return _words(len(data), kind) + data


def _words(*numbers: int) -> bytes:
    return np.array(numbers, "<u4").tobytes()


def _linear(c: float) -> float:
    """Return a share of light of a share in sRGB, as glTF has colours."""
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
