"""Points and poses in the world, for a robot whose base stands somewhere in it."""

import numpy as np

from odm.obstacles._occupancy import place
from roadmap.arrays import frozen
from roadmap.transforms import check_pose, inverse_pose


class WorldFrame:
    """Where the base stands.

    Args:
        T_world_base: (4, 4) pose of the base in the world [m].

    Raises:
        BadInput: Not a rigid motion.
    """

    def __init__(self, T_world_base: np.ndarray) -> None:
        T = check_pose(T_world_base, "T_world_base")
        self.T_world_base = frozen(T, np.float64)
        self.T_base_world = frozen(inverse_pose(T), np.float64)
        self.at_base = bool(np.array_equal(T, np.eye(4)))
        self._room = np.zeros((0, 3))

    def points(self, p_world: np.ndarray) -> np.ndarray:
        """Return (n, 3) points of the world in the base frame [m].

        In memory of its own, which the next call overwrites; the points themselves
        where the base stands at the origin.
        """
        if self.at_base:
            return p_world
        n = len(p_world)
        if n > len(self._room):
            self._room = np.zeros((2 * n, 3))
        out = self._room[:n]
        place(p_world, self.T_base_world, out)
        return out

    def pose(self, T_world: np.ndarray) -> np.ndarray:
        """Return a pose (4, 4) of the world in the base frame."""
        return T_world if self.at_base else self.T_base_world @ T_world

    def direction(self, v_world: np.ndarray) -> np.ndarray:
        """Return a direction (3,) of the world in the base frame."""
        return v_world if self.at_base else self.T_base_world[:3, :3] @ v_world
