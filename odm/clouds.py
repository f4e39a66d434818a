"""Points laid out for the close test, beside those of the frame."""

import numpy as np

from odm._kernels import occupancy
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
        if len(points) > len(self._cloud.where):
            self._cloud = self.grid.new_cloud(2 * len(points))
        occupancy.clear(self._cloud)
        occupancy.mark_points(points, self._cloud)
        occupancy.sort_points(points, self._cloud)
        return self._cloud
