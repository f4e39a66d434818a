"""RobotCells: the cells of a coarser grid that a robot reaches, from its reach map."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from handover.reach.reach_grid import ReachGrid
from handover.reach.reach_map import ReachMap
from handover.reach.rotations import rotation_grid
from roadmap.arrays import freeze
from roadmap.errors import BadInput

# of each map in use, by the rest of what was asked for: seconds each, of a large robot
_KNOWN: "WeakKeyDictionary[ReachMap, dict[tuple, RobotCells]]" = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class RobotCells:
    """Reached cells, position by position."""

    grid: ReachGrid  # the coarse grid, in the frame of the reach map (the robot's base)
    positions: np.ndarray  # (p,) ascending position cells where anything is reached
    points: np.ndarray  # (p, 3) their centres [m]
    first: np.ndarray  # (p + 1,) first entry of each
    # (n,) rotation cell of each entry, ascending within a position
    rotation: np.ndarray

    def __post_init__(self) -> None:
        freeze(self, positions=np.int64, points=float, first=np.int64)
        freeze(self, rotation=np.int32)

    def __len__(self) -> int:
        return len(self.rotation)

    def keys(self) -> np.ndarray:
        """(n,) int64 cell of each entry in `grid`, ascending."""
        at = np.repeat(self.positions, np.diff(self.first))
        return at * self.grid.rotations.n_cells + self.rotation

    def kept(self, keep: np.ndarray) -> "RobotCells":
        """Return the entries of `keep` (n,) bool only."""
        return _packed(self.grid, self.keys()[keep])


def robot_cells(
    reach: ReachMap, cell: float, rotations: int, marked_share: float = 0.0
) -> RobotCells:
    """Return the cells of a coarser grid that a robot reaches.

    A fine cell belongs to the coarse cell that holds its centre, in position and in
    rotation. A coarse cell is reached when more than `marked_share` of the fine cells
    that belong to it are marked. With the reach map's own sizes the cells are its own.
    They are found once for a map in memory.

    Args:
        reach: Map of a robot, in metres.
        cell: Side of a coarse position cell [m].
        rotations: Coarse rotation cells.
        marked_share: From 0 to below 1.

    Raises:
        BadInput: The map is of a person's arm, or the grid finer than it.
    """
    fine = reach.grid
    if reach.chain.unit != "m":
        raise BadInput(
            f"the reach map of {reach.chain.name} is in units of {reach.chain.unit}; "
            "give a robot's map, in metres"
        )
    if cell < fine.cell - 1e-9:
        raise BadInput(
            f"cells of {cell} m are finer than the {fine.cell} m of the reach map; "
            "give larger ones, or build a finer map"
        )
    if rotations > fine.rotations.n_cells:
        raise BadInput(
            f"{rotations} rotations are more than the {fine.rotations.n_cells} of the "
            "reach map; give fewer, or build a finer map"
        )
    asked = float(cell), int(rotations), float(marked_share)
    known = _KNOWN.setdefault(reach, {})
    if asked not in known:
        known[asked] = _coarse(reach, *asked)
    return known[asked]


def _coarse(
    reach: ReachMap, cell: float, rotations: int, marked_share: float
) -> RobotCells:
    fine = reach.grid
    low = np.floor(fine.box[0] / cell + 1e-6)
    high = np.ceil(fine.box[1] / cell - 1e-6)
    shape = tuple(int(n) for n in high - low)
    grid = ReachGrid(low * cell, cell, shape, rotation_grid(rotations))
    if abs(cell - fine.cell) < 1e-9 and rotations == fine.rotations.n_cells:
        return _packed(grid, _moved(reach, grid))
    to_position = grid.positions_of(fine.points(np.arange(fine.n_positions)) + 1e-9)
    to_rotation = grid.rotations.cell_of(fine.rotations.centers).astype(np.int64)
    n = grid.rotations.n_cells
    p, r = np.divmod(reach.marked_cells(), fine.rotations.n_cells)
    marked = np.bincount(to_position[p] * n + to_rotation[r], minlength=grid.n_cells)
    held = np.outer(
        np.bincount(to_position, minlength=grid.n_positions),
        np.bincount(to_rotation, minlength=n),
    )
    # a coarse cell at the rim is not held by the fine grid as a whole
    held[:] = held.max(axis=0)
    return _packed(grid, np.flatnonzero(marked > marked_share * held.ravel()))


def _moved(reach: ReachMap, grid: ReachGrid) -> np.ndarray:
    """Return the marked cells of a map in a grid that differs in its corner only."""
    p, r = np.divmod(reach.marked_cells(), reach.grid.rotations.n_cells)
    at = grid.positions_of(reach.grid.points(p))
    return np.sort(at * grid.rotations.n_cells + r)


def _packed(grid: ReachGrid, keys: np.ndarray) -> RobotCells:
    p, r = np.divmod(keys, grid.rotations.n_cells)
    positions, first = np.unique(p, return_index=True)
    first = np.append(first, len(keys))
    return RobotCells(grid, positions, grid.points(positions), first, r)
