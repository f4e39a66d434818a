"""How well an arm reaches: average manipulability by voxel.

As [Huaman2014], section IV-A: many random configurations of each arm, and in each
voxel the average manipulability of those whose tool centre point lies in it; 0 where
none does.
"""

from dataclasses import dataclass

import numpy as np

from handover.chain import Chain
from handover.grasps._arm_reach import tools_and_jacobians
from roadmap.arrays import frozen
from roadmap.ranges import check_number

_CHUNK = 20_000  # configurations at a time


@dataclass(frozen=True, eq=False)
class ArmReach:
    """Average manipulability of an arm by the place of its tool centre point.

    Attributes:
        name: Of the arm.
        origin: (3,) lower corner of the voxels, base frame [m].
        cell: Side of a voxel [m].
        average: (nx, ny, nz) average of sqrt(det(J J^T)), 0 where it does not reach.
    """

    name: str
    origin: np.ndarray
    cell: float
    average: np.ndarray

    def at(self, point: np.ndarray) -> float:
        """Return the entry at a point (3,), base frame [m]; 0: not reached."""
        return float(self.entries(np.asarray(point, float)[None])[0])

    def entries(self, points: np.ndarray) -> np.ndarray:
        """Return the entries at points (n, 3), base frame [m]."""
        at = np.floor((points - self.origin) / self.cell).astype(int)
        inside = ((at >= 0) & (at < self.average.shape)).all(axis=1)
        at[~inside] = 0
        return np.where(inside, self.average[tuple(at.T)], 0.0)

    def gap(self, point: np.ndarray) -> float:
        """Return how far a point is from the nearest middle of a reached voxel [m]."""
        middles = self.origin + (np.argwhere(self.average > 0) + 0.5) * self.cell
        return float(np.linalg.norm(middles - point, axis=1).min())


def build_arm_reach(
    chain: Chain,
    name: str = "",
    tool_center: tuple[float, float, float] = (0.0, 0.0, 0.0),
    samples: int = 300_000,
    cell: float = 0.05,
    seed: int = 1,
) -> ArmReach:
    """Sample an arm's configurations and average its manipulability by voxel.

    Args:
        chain: Of the arm, in metres.
        name: Of the arm; the chain's if left.
        tool_center: The tool centre point in the tool frame [m].
        samples: Configurations, uniform within the limits; 300 000 are about 10 a voxel
            of 5 cm within reach.
        cell: Side of a voxel [m].
        seed: Same seed, same bytes.

    Raises:
        BadInput: A number out of range.
    """
    check_number("samples", samples, 100, 50_000_000, whole=True)
    check_number("cell [m]", cell, 0.005, 0.5)
    rng = np.random.default_rng(seed)
    low, high = chain.limits.T
    frames, offset = np.empty((len(chain.kind) + 1, 12)), np.array(tool_center, float)
    points, values = [], []
    for first in range(0, samples, _CHUNK):
        n = min(_CHUNK, samples - first)
        q = rng.uniform(low, high, (n, chain.dof))
        some, jac = np.empty((n, 3)), np.empty((n, 6, chain.dof))
        tools_and_jacobians(chain.arrays, q, offset, frames, some, jac)
        points.append(some)
        values.append(_manipulability(jac))
    return _by_voxel(name or chain.name, np.concatenate(points), values, cell)


def _manipulability(jac: np.ndarray) -> np.ndarray:
    """Return sqrt(det(J J^T)) of Jacobians (n, 6, dof); J^T J below six joints."""
    if jac.shape[2] < 6:
        jac = jac.transpose(0, 2, 1)
    return np.sqrt(np.maximum(0.0, np.linalg.det(jac @ jac.transpose(0, 2, 1))))


def _by_voxel(
    name: str, points: np.ndarray, values: list[np.ndarray], cell: float
) -> ArmReach:
    origin = np.floor(points.min(axis=0) / cell) * cell
    at = np.floor((points - origin) / cell).astype(np.int64)
    shape = tuple(at.max(axis=0) + 1)
    flat = np.ravel_multi_index(tuple(at.T), shape)
    total = np.bincount(flat, np.concatenate(values), minlength=np.prod(shape))
    count = np.bincount(flat, minlength=np.prod(shape))
    average = (total / np.maximum(count, 1)).reshape(shape)
    return ArmReach(name, frozen(origin, float), cell, frozen(average, np.float64))
