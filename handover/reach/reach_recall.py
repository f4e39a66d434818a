"""Recall of a reach map: the share of all reachable tool poses that it knows."""

from dataclasses import asdict, dataclass

import numpy as np

from handover.chain import Chain
from handover.reach import _reach_build as kernels
from handover.reach import _reach_lookup as lookup
from handover.reach._reach_ik import starts_taken
from handover.reach.extremes import reachable_box, work_of
from handover.reach.reach_map import ReachMap
from handover.reach.reach_touch import touch_of
from roadmap.builds.chunks import Progress
from roadmap.errors import BadInput, BadMap
from roadmap.geometry.self_collision import configuration_free

_CHUNK, _STARTS = 50, 24  # poses between two looks at the progress; for each
_SEED_OFFSET = 90_001  # not the samples that the map was drawn with


@dataclass(frozen=True)
class Recall:
    """How many poses of a random set a map knows."""

    poses: int  # uniformly random poses in the box that the tool can reach
    solvable: int  # those that inverse kinematics solved, free of self-collision
    marked: int  # those of them whose cell is marked
    # solutions that took more than half of the starts: where these are not few,
    # `solvable` misses poses that are hard to solve
    late: int
    # marked cells with a pose that was not solved: only a part of such a cell can be
    # reached
    marked_unsolved: int

    @property
    def recall(self) -> float | None:
        """Share of the solvable poses that are marked; None without any."""
        return self.marked / self.solvable if self.solvable else None

    @property
    def margin(self) -> float | None:
        """Half width of the 95 % interval [Wilson1927, about]."""
        if not self.solvable:
            return None
        p, n = (self.marked + 2) / (self.solvable + 4), self.solvable + 4
        return 1.96 * (p * (1 - p) / n) ** 0.5

    def as_dict(self) -> dict:
        """Return the figures as plain data."""
        return asdict(self) | {"recall": self.recall, "margin": self.margin}


def measure_recall(
    reach: ReachMap,
    chain: Chain | None = None,
    poses: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Recall:
    """Ask a map for uniformly random poses that inverse kinematics can solve.

    Samples of forward kinematics would flatter: they fall where the map's own samples
    fell. Poses are drawn in the box that the tool can reach, rotations uniformly, and
    solved from 24 random starts by damped least squares.

    Args:
        reach: The map.
        chain: The chain with its robot, so that solutions in self-collision do not
            count; default: the map's, without it.
        poses: How many are drawn.
        seed: Of poses and starts.
        progress: Called with (stage, done, total).

    Raises:
        BadInput: A chain that is not the map's, or nothing to draw.
    """
    chain = chain or reach.chain
    if chain.fingerprint() != reach.chain.fingerprint():
        raise BadInput(
            f"{chain.name} is not what the map of {reach.chain.name} was built for; "
            "give the chain it was built from"
        )
    if poses < 1:
        raise BadInput(f"{poses} poses are too few; give 1 or more")
    if chain.dof < 6:
        return Recall(poses, 0, 0, 0, 0)  # a random pose is never reached
    drawn = random_poses(reachable_box(chain), poses, np.random.default_rng(seed))
    used = solved(reach, chain, drawn, seed + _SEED_OFFSET, progress)
    bytes_ = np.empty(poses, np.uint8)
    lookup.qualities_of_poses(reach.packed, reach.grid.arrays, drawn, bytes_)
    known, can = bytes_ > 0, used > 0
    return Recall(
        poses,
        int(can.sum()),
        int((known & can).sum()),
        int((used > _STARTS // 2).sum()),
        int((known & ~can).sum()),
    )


def center_rate(
    reach: ReachMap,
    chain: Chain | None = None,
    cells: int = 500,
    progress: Progress | None = None,
) -> float:
    """Return the share of marked cells whose exact centre can be reached."""
    chain = chain or reach.chain
    some = _some_cells(reach, cells)
    poses, grid = np.empty((len(some), 12)), reach.grid.arrays
    for pose, cell in zip(poses, some, strict=True):
        kernels.center_of(grid, cell, pose)
    used = solved(reach, chain, poses, _SEED_OFFSET, progress, "centres of cells")
    return float((used > 0).mean())


def witness_precision(
    reach: ReachMap,
    chain: Chain | None = None,
    cells: int = 2000,
    progress: Progress | None = None,
) -> float:
    """Return the share of marked cells whose witness proves them reached.

    Each witness is made again and judged by code that did not make it: its joints are
    within their limits, its tool is in the cell by numpy's arithmetic, and its links
    are apart by the planner's own test where the chain has its robot.
    """
    tell = progress or (lambda stage, done, total: None)
    chain = chain or reach.chain
    some = _some_cells(reach, cells)
    good = 0
    for k, cell in enumerate(some.tolist()):
        good += _proves(reach, chain, cell)
        if k % _CHUNK == _CHUNK - 1 or k == len(some) - 1:
            tell("witnesses", k + 1, len(some))
    return good / len(some)


def _proves(reach: ReachMap, chain: Chain, cell: int) -> bool:
    try:
        whole = reach.witness_of(cell)
    except BadMap:
        return False
    q = whole[list(chain.rows)] if chain.rows else whole
    if (q < chain.limits[:, 0]).any() or (q > chain.limits[:, 1]).any():
        return False
    if reach.grid.cells_of(chain.tool_pose(q)[None])[0] != cell:
        return False
    return chain.robot is None or configuration_free(chain.robot, whole)[0]


def _some_cells(reach: ReachMap, n: int) -> np.ndarray:
    marked = reach.marked_cells()
    return np.random.default_rng(0).choice(marked, min(n, len(marked)), False)


def solved(
    reach: ReachMap,
    chain: Chain,
    poses: np.ndarray,
    seed: int,
    progress: Progress | None = None,
    stage: str = "random poses",
) -> np.ndarray:
    """Return how many starts each pose (n, 12) took, 0 where none led to a solution."""
    tell = progress or (lambda stage, done, total: None)
    work, touch = work_of(chain), touch_of(chain)
    used = np.zeros(len(poses), np.int64)
    for k in range(0, len(poses), _CHUNK):
        part = slice(k, k + _CHUNK)
        starts_taken(
            chain.arrays, poses[part], reach.grid.arrays.scale, touch, work,
            (seed + k, _STARTS), used[part],
        )  # fmt: skip
        tell(stage, min(k + _CHUNK, len(poses)), len(poses))
    return used


def random_poses(box: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return (n, 12) poses, uniform in a box (2, 3) and over all rotations."""
    from scipy.spatial.transform import Rotation  # not where maps are only asked

    turns = Rotation.from_quat(rng.normal(size=(4, n)).T[:, [1, 2, 3, 0]]).as_matrix()
    return np.hstack([turns.reshape(n, 9), rng.uniform(*box, (n, 3))])
