"""ReachGrid: the 6-D cells of a reach map, and the box that a chain can reach."""

from dataclasses import dataclass

import numpy as np

from handover.chain import Chain
from handover.reach import _reach_build as kernels
from handover.reach.extremes import reachable_box
from handover.reach.rotations import RotationGrid, rotation_grid
from roadmap.arrays import freeze, frozen
from roadmap.errors import BadInput


@dataclass(frozen=True, eq=False)
class ReachGrid:
    """Cells of position and rotation.

    A cell's number is position * n_rotations + rotation, a position's
    (x * ny + y) * nz + z. Cell borders go through the frame's origin.
    """

    origin: np.ndarray  # (3,) lower corner [unit of the chain]
    cell: float  # side of a position cell
    shape: tuple[int, int, int]  # nx, ny, nz
    rotations: RotationGrid  # the rotation grid

    def __post_init__(self) -> None:
        freeze(self, origin=float)

    @property
    def n_positions(self) -> int:
        """Number of position cells."""
        return int(np.prod(self.shape))

    @property
    def n_cells(self) -> int:
        """Number of 6-D cells."""
        return self.n_positions * self.rotations.n_cells

    @property
    def arrays(self) -> kernels.Grid:
        """The arrays for the kernels."""
        turns = self.rotations
        return kernels.Grid(
            frozen(np.array([*self.shape, turns.n_cells]), np.int64),
            frozen(np.array([turns.n_side, turns.n_roll]), np.int64),
            frozen(np.array([*self.origin, self.cell]), np.float64),
            frozen(np.array([0.5 * self.cell, 0.5 * turns.step]), np.float64),
            turns.centers.reshape(-1, 9),
            turns.pixel_frames,
            turns.neighbors,
        )

    def cells_of(self, poses: np.ndarray) -> np.ndarray:
        """Return the (n,) int64 cells of poses (n, 4, 4); -1 outside of the grid."""
        p = self.positions_of(poses[:, :3, 3])
        r = self.rotations.cell_of(poses[:, :3, :3])
        return np.where(p < 0, -1, p * self.rotations.n_cells + r)

    def positions_of(self, points: np.ndarray) -> np.ndarray:
        """Return the (n,) int64 position cells of points (n, 3); -1 outside."""
        index = np.floor((points - self.origin) / self.cell)
        inside = ((index >= 0) & (index < self.shape)).all(axis=1)
        index = np.where(inside[:, None], index, 0).astype(np.int64)
        flat = (index[:, 0] * self.shape[1] + index[:, 1]) * self.shape[2]
        return np.where(inside, flat + index[:, 2], -1)

    def centers(self, cells: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) at the centres of cells (n,)."""
        cells = np.asarray(cells, np.int64)
        p, r = np.divmod(cells, self.rotations.n_cells)
        poses = np.zeros((len(cells), 4, 4))
        poses[:, :3, :3] = self.rotations.centers[r]
        poses[:, :3, 3] = self.points(p)
        poses[:, 3, 3] = 1.0
        return poses

    def points(self, positions: np.ndarray) -> np.ndarray:
        """Return the (n, 3) centres of position cells (n,)."""
        index = np.stack(np.unravel_index(positions, self.shape), axis=1)
        return self.origin + (index + 0.5) * self.cell

    def colours(self, changed: np.ndarray) -> list[np.ndarray]:
        """Return `changed` positions in eight groups without neighbours in one."""
        near = changed.reshape(self.shape).copy()
        for axis in range(3):
            moved = np.moveaxis(near, axis, 0)
            source = np.moveaxis(changed.reshape(self.shape), axis, 0)
            moved[1:] |= source[:-1]
            moved[:-1] |= source[1:]
        index = np.argwhere(near)
        colour = (index & 1) @ [4, 2, 1]
        flat = np.ravel_multi_index(index.T, self.shape)
        # corners of the cubes first, then what lies beside more and more of them
        return [flat[colour == k] for k in (0, 1, 2, 4, 3, 5, 6, 7)]

    @property
    def box(self) -> np.ndarray:
        """(2, 3) lower and upper corner."""
        return np.stack([self.origin, self.origin + self.cell * np.array(self.shape)])


def reach_grid(chain: Chain, cell: float, n_rotations: int) -> ReachGrid:
    """Return the grid that holds all that a chain reaches, its cells checked."""
    if not (np.isfinite(cell) and cell > 0):
        raise BadInput(f"the cell is {cell}; give a length above 0")
    box = reachable_box(chain)
    low, high = np.floor(box[0] / cell), np.ceil(box[1] / cell)
    shape = tuple(int(n) for n in np.maximum(high - low, 1))
    return ReachGrid(low * cell, float(cell), shape, rotation_grid(n_rotations))
