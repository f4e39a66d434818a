"""The workspace grid: cubes of side h, gathered in blocks of 4 x 4 x 4."""

from dataclasses import dataclass

import numpy as np

from odm._groups import new
from odm.obstacles._cloud import CHUNK, Cloud
from roadmap.arrays import freeze
from roadmap.errors import BadInput
from roadmap.kinematics.joint_tree import PRISMATIC
from roadmap.robot.robot import Robot

# cells have numbers of 32 bits, the sign among them, and a block has 64 cells
LARGEST_GRID = 2**25 - 1


@dataclass(frozen=True, eq=False)
class WorkspaceGrid:
    """Cells of side `h` from `origin` on, `blocks` (3,) blocks of 4 cells a side.

    Attributes:
        origin: (3,) lower corner in the base frame [m].
        h: Side of a cell [m].
        blocks: (3,) number of blocks along each axis.
    """

    origin: np.ndarray
    h: float
    blocks: np.ndarray

    def __post_init__(self) -> None:
        freeze(self, origin=float, blocks=np.int64)
        if np.prod(self.blocks, dtype=float) > LARGEST_GRID:
            sides = " x ".join(f"{n:,}" for n in self.blocks)
            raise BadInput(
                f"cells of {self.h:g} m make {sides} blocks, and a grid holds "
                f"{LARGEST_GRID:,}; give larger cells (`h` of the recipe's safety)"
            )

    @property
    def n_blocks(self) -> int:
        """Number of blocks in the grid."""
        return int(np.prod(self.blocks))

    @property
    def upper(self) -> np.ndarray:
        """(3,) upper corner in the base frame [m]."""
        return self.origin + 4 * self.h * self.blocks

    def locate(self, points: np.ndarray) -> np.ndarray:
        """Return the (n, 3) cells of points (n, 3) [m]; -1 where outside."""
        cells = np.floor((np.asarray(points, float) - self.origin) / self.h)
        inside = ((cells >= 0) & (cells < 4 * self.blocks)).all(axis=-1)
        return np.where(inside[..., None], cells, -1).astype(np.int64)

    def new_cloud(self, capacity: int) -> Cloud:
        """Return an empty Cloud on this grid for up to `capacity` points.

        Its arrays can be written, as those of a planner's memory: to numba a read-only
        one is another type, and all that takes a cloud would be compiled twice.
        """
        return new(
            Cloud,
            {"blocks": self.n_blocks, "points": capacity},
            origin=np.array(self.origin),
            h=self.h,
            corners=np.tile(self.origin, CHUNK),
            shape=np.array(self.blocks),
        )


def bounding_ball(robot: Robot) -> tuple[np.ndarray, float]:
    """Return centre and radius [m] that hold all moving spheres in all poses.

    From the first moving joint on, every body's origin stays within the summed
    lengths of the links before it; a slide adds its longest travel.
    """
    if not robot.moving.any():
        raise BadInput(
            f"no link of {robot.name} that a joint moves has geometry, so there is "
            "nothing to keep clear; give those links <collision> shapes, or name "
            "another tool (tip, --tip)"
        )
    centers, extents = [], []
    for i in np.flatnonzero(robot.moving):
        body = int(robot.sphere_body[i])
        far = float(np.linalg.norm(robot.spheres[i, :3])) + robot.spheres[i, 3]
        while robot.tree_i[body, 0] > 0:
            far += float(np.linalg.norm(robot.tree_f[body, 9:12])) + _slide(robot, body)
            body = int(robot.tree_i[body, 0])
        base = robot.tree_f[0]
        p = base[:9].reshape(3, 3) @ robot.tree_f[body, 9:12] + base[9:12]
        centers.append(p)
        extents.append(far + _slide(robot, body))
    centers, extents = np.array(centers), np.array(extents)
    middle = 0.5 * (centers.min(axis=0) + centers.max(axis=0))
    return middle, float((np.linalg.norm(centers - middle, axis=1) + extents).max())


def _slide(robot: Robot, body: int) -> float:
    parent, joint, kind = robot.tree_i[body]
    if kind != PRISMATIC:
        return 0.0
    scale, offset = robot.tree_f[body, 15:17]
    ends = scale * np.array([robot.lower[joint], robot.upper[joint]]) + offset
    return float(np.abs(ends).max())


def grid_for(robot: Robot, h: float, margin: float) -> WorkspaceGrid:
    """Return the smallest grid that holds the robot's spheres grown by `margin` [m]."""
    center, radius = bounding_ball(robot)
    reach = radius + margin + h
    n_blocks = int(np.ceil(2 * reach / (4 * h)))
    origin = center - 2 * h * n_blocks
    return WorkspaceGrid(origin, h, np.full(3, n_blocks))
