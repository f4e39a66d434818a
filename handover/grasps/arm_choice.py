"""Which arm takes the object: reachability with average manipulability by voxel.

As [Huaman2014], section IV-A: many random configurations of each arm, and in each
voxel the average manipulability of those whose tool centre point lies in it; 0 where
none does.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handover.chain import Chain
from handover.grasps._arm_reach import tools_and_jacobians
from roadmap.arrays import frozen
from roadmap.errors import BadInput
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


@dataclass(frozen=True)
class ArmChoice:
    """Which arm to use.

    Attributes:
        arm: Its name, None where no arm reaches.
        entries: Average manipulability of each arm at the object, 0: not reached.
        reason: Why, in a sentence.
    """

    arm: str | None
    entries: Mapping[str, float]
    reason: str


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


def choose_arm(reaches: Mapping[str, ArmReach], point: np.ndarray) -> ArmChoice:
    """Choose the arm that reaches a point best.

    Args:
        reaches: Of each arm, all in the same base frame.
        point: (3,) where the object is, base frame [m].

    Returns:
        The only arm that reaches it, the better of several, or none; with the reason.
    """
    point = np.asarray(point, float)
    if not reaches or point.shape != (3,) or not np.isfinite(point).all():
        raise BadInput(
            f"an arm is chosen for {point!r} among {list(reaches)}; give a finite (3,) "
            "point and at least one arm"
        )
    entries = {name: reach.at(point) for name, reach in reaches.items()}
    able = [name for name, entry in entries.items() if entry > 0.0]
    place = "(" + ", ".join(f"{x:.2f}" for x in point) + ") m"
    if not able:
        gaps = {name: reach.gap(point) for name, reach in reaches.items()}
        near = min(gaps, key=gaps.__getitem__)
        return ArmChoice(
            None,
            entries,
            f"no arm reaches {place}; {near} comes within {gaps[near]:.2f} m: bring "
            "the object or the base nearer by that much",
        )
    best = max(able, key=entries.__getitem__)
    if len(able) == 1:
        return ArmChoice(best, entries, f"only {best} reaches {place}")
    told = ", ".join(f"{name} {entries[name]:.3g}" for name in able)
    return ArmChoice(
        best, entries, f"{best} has the most average manipulability at {place}: {told}"
    )


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
