"""Points laid out for the close test, beside those of the frame."""

import numpy as np

from odm.close_test._sorted_clouds import lay_out
from odm.obstacles.grid import WorkspaceGrid


class SortedCloud:
    """Room for points that are laid out anew as often as one likes.

    Points outside the grid count, too: radii may be grown by extra clearance, or by how
    far a person can come. So its words are no occupancy.

    Attributes:
        cloud: The points that were laid out last.
    """

    def __init__(self, grid: WorkspaceGrid) -> None:
        self.grid = grid
        self.cloud = grid.new_cloud(0)
        self._n = 0  # points laid out

    def of(self, points: np.ndarray) -> object:
        """Return (n, 3) points [m] as a cloud; the one before is overwritten."""
        return self.of_all(points)[0]

    def of_all(self, points: np.ndarray) -> tuple[object, int]:
        """Return the same and how many are not finite, which are left out."""
        n, before = len(points), self._n
        self._n = n
        if not n and not before:
            return self.cloud, 0
        if n > len(self.cloud.where):
            self.cloud = self.grid.new_cloud(2 * n)
        return self.cloud, lay_out(points, self.cloud)
