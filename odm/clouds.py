"""Points laid out for the close test, beside those of the frame."""

from collections.abc import Sequence

import numpy as np

from odm._kernels import braking, occupancy
from odm.grid import WorkspaceGrid

PAD = 0.6  # [m]


class SortedCloud:
    """Room for points that are laid out anew as often as one likes.

    Args:
        grid: The map's grid; it is enlarged by PAD on all sides, since radii may be
            grown by that much (extra clearance, braking).
    """

    def __init__(self, grid: WorkspaceGrid) -> None:
        """Have no room yet."""
        more = int(np.ceil(PAD / (4 * grid.h)))
        origin = grid.origin - 4 * grid.h * more
        self.grid = WorkspaceGrid(origin, grid.h, grid.blocks + 2 * more)
        self._cloud = self.grid.new_cloud(0)

    def of(self, points: np.ndarray) -> object:
        """Return (n, 3) points [m] as a cloud; the one before is overwritten."""
        self._make_room(points)
        occupancy.clear(self._cloud)
        occupancy.mark_points(points, self._cloud)
        occupancy.sort_points(points, self._cloud)
        return self._cloud

    def of_all(self, points: np.ndarray) -> tuple[object, int]:
        """Return (n, 3) points as a cloud, those outside the grid, too.

        Its words are no occupancy. The other value tells how many are not finite.
        """
        self._make_room(points)
        return self._cloud, braking.lay_out(points, self._cloud)

    def _make_room(self, points: np.ndarray) -> None:
        if len(points) > len(self._cloud.where):
            self._cloud = self.grid.new_cloud(2 * len(points))


class SortedClouds:
    """Room for several sets of points at a time.

    Args:
        grid: The map's grid.
    """

    def __init__(self, grid: WorkspaceGrid) -> None:
        """Have no room yet."""
        self._grid = grid
        self._rooms: list[SortedCloud] = []

    def of(self, sets: Sequence[np.ndarray]) -> list:
        """Return sets of points (n, 3) [m] as clouds; those before are overwritten."""
        while len(self._rooms) < len(sets):
            self._rooms.append(SortedCloud(self._grid))
        return [
            room.of_all(points)[0]
            for room, points in zip(self._rooms, sets, strict=False)
        ]
