"""The paper's obstacle: a human arm of two cylinders, as cells and as points."""

from dataclasses import dataclass

import numpy as np

from odm import Box, Cylinder
from odm.exact.distances import ExactObstacles, obstacles_of
from odm.obstacles.grid import WorkspaceGrid
from odm.obstacles.surfaces import sample_cylinders
from sim.bench.frames import Pair
from sim.bench.paper import _paper_edges as kernels


@dataclass(frozen=True, eq=False)
class CylinderPair(Pair):
    """A pair whose arm is of cylinders with the axes and radii of the capsules."""

    spacing: float = 0.03

    def points(self) -> list[np.ndarray]:
        """Return the sampled surface of the arm in every frame, (n, 3) each [m]."""
        return [sample_cylinders(rods, self.spacing) for rods in self.capsules]

    @classmethod
    def of(cls, pair: Pair, spacing: float) -> "CylinderPair":
        """Return the pair with cylinders, sampled with a covering radius [m]."""
        return cls(pair.q_start, pair.q_goal, pair.capsules, pair.motion, spacing)


def cylinders(rods: np.ndarray) -> list[Cylinder]:
    """Return rods (k, 7) as closed cylinders."""
    return [Cylinder.between(r[:3], r[3:6], r[6]) for r in rods]


class Region:
    """The cells of the whole arm, by region expansion on a map's cells.

    Args:
        grid: The cells.
    """

    def __init__(self, grid: WorkspaceGrid) -> None:
        """Take the lattice; cells outside the grid are found, too."""
        self.grid = grid
        self.box = obstacles_of([Box(np.full(3, grid.h))]).convexes
        self.tests = np.zeros(1, np.int64)
        self._seen = np.zeros((0, 0, 0), np.uint8)

    def prepare(self, rods: np.ndarray) -> tuple:
        """Return what `expand` takes for rods (k, 7): no part of what is timed."""
        h, solids = self.grid.h, obstacles_of(cylinders(rods))
        far = rods[:, 6].max() + 2.0 * h
        ends = rods[:, :6].reshape(-1, 3)
        first = np.floor((ends.min(axis=0) - far - self.grid.origin) / h)
        last = np.ceil((ends.max(axis=0) + far - self.grid.origin) / h)
        low = self.grid.origin + first * h
        shape = (last - first).astype(np.int64)
        middle = 0.5 * (rods[:, :3] + rods[:, 3:6])
        start = np.floor((middle - low) / h).astype(np.int64)
        seen = np.zeros(shape, np.uint8)
        stack = np.zeros((seen.size, 3), np.int64)
        return solids, start, low, seen, stack

    def expand(self, job: tuple) -> int:
        """Mark the cells of the arm; return their number."""
        solids, start, low, seen, stack = job
        return int(
            kernels.expand_region(
                self.box, solids.convexes, solids.frames, start, low, self.grid.h,
                seen, stack, self.tests,
            )
        )  # fmt: skip

    def centers(self, job: tuple) -> np.ndarray:
        """Return the centres (n, 3) of the cells that `expand` marked [m]."""
        _, _, low, seen, _ = job
        return low + (np.argwhere(seen) + 0.5) * self.grid.h


def cells_of(points: np.ndarray, grid: WorkspaceGrid) -> np.ndarray:
    """Return the cells (n, 3) that hold at least one of the points, each once."""
    return np.unique(np.floor((points - grid.origin) / grid.h).astype(np.int64), axis=0)


def centers_of(cells: np.ndarray, grid: WorkspaceGrid) -> np.ndarray:
    """Return the centres (n, 3) of cells [m]."""
    return grid.origin + (cells + 0.5) * grid.h


def paper_points(rods: np.ndarray, apart: float) -> np.ndarray:
    """Return points whose neighbours are about `apart` [m], as on a square lattice."""
    return sample_cylinders(rods, apart / np.sqrt(2.0))


class Contacts:
    """Exact contacts of the robot's moving solids with the arm, many at a time.

    Args:
        exact: The exact robot.
    """

    def __init__(self, exact: object) -> None:
        """Keep the arrays of the compiled loops."""
        robot = exact.robot
        pose = np.concatenate(
            [robot.solid_pose[:, :3, :3].reshape(-1, 9), robot.solid_pose[:, :3, 3]],
            axis=1,
        )
        self._robot = (
            robot.tree_i, robot.tree_f, np.asarray(exact.body), pose, exact.convexes,
            exact.body > 0,
        )  # fmt: skip

    def distances(self, q: np.ndarray, arm: ExactObstacles, cap: float) -> np.ndarray:
        """Return the distances at q (n, dof) [m], `cap` where they are larger."""
        out = np.empty(len(q))
        q = np.ascontiguousarray(q)
        kernels.exact_distances(*self._robot, q, arm.convexes, arm.frames, cap, out)
        return out

    def meet_cells(
        self, q: np.ndarray, region: Region, centers: np.ndarray
    ) -> np.ndarray:
        """Return (n,) whether a solid meets any of the cells at q (n, dof)."""
        out = np.zeros(len(q), bool)
        q = np.ascontiguousarray(q)
        kernels.meets_cells(*self._robot, q, region.box, centers, out)
        return out
