"""What is done to the chunks of a build: motions are tested, nodes and edges swept."""

from typing import NamedTuple

import numpy as np

from odm._groups import block_type
from odm.cell_map import _sweep as sweep
from odm.close_test.safety import Safety
from odm.close_test.static import StaticTest
from odm.obstacles.scenery import Scenery
from roadmap.chunks import Job
from roadmap.errors import BuildRefused
from roadmap.geometry.self_collision import TOLERANCE
from roadmap.robot.robot import Robot

_ENTRIES = 160  # first guess per item; a chunk that needs more is done again


class StaticTestSpec(NamedTuple):
    """What motions are tested against."""

    robot: Robot
    scenery: Scenery
    safety: Safety


def motion_job(robot: Robot, scenery: Scenery, safety: Safety, stage: str) -> Job:
    """Return the job of testing motions q + t dq, both (k, dof) -> (k,) bool."""
    spec = StaticTestSpec(robot, scenery, safety)
    return Job(f"{__name__}:test_motions", f"{__name__}:static_test", spec, stage, 2)


def node_job(swept: sweep.Swept) -> Job:
    """Return the job of sweeping configurations (k, dof)."""
    return Job(f"{__name__}:cells_of_nodes", f"{__name__}:as_it_is", swept, "node", 1)


def edge_job(swept: sweep.Swept) -> Job:
    """Return the job of sweeping motions less the cells of their two nodes."""
    return Job(f"{__name__}:cells_of_edges", f"{__name__}:as_it_is", swept, "edge", 3)


def static_test(spec: StaticTestSpec, threads: int = 1) -> StaticTest:
    """Make the test of a roadmap's motions: their ends are drawn, none is needed."""
    return StaticTest(*spec, threads=threads, finest=TOLERANCE)


def as_it_is(swept: sweep.Swept) -> sweep.Swept:
    """Return what needs no making."""
    return swept


def test_motions(
    test: StaticTest, q: np.ndarray, dq: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return which motions q + t dq are free: (k,) bool."""
    return (test.motions_free(q, dq),)


def cells_of_nodes(swept: sweep.Swept, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return counts (k,), blocks and masks of configurations (k, dof)."""
    return _lists(swept, len(q), lambda out: sweep.sweep_nodes(swept, q, out))


def cells_of_edges(
    swept: sweep.Swept,
    q: np.ndarray,
    dq: np.ndarray,
    ends: np.ndarray,
    ptr: np.ndarray,
    block: np.ndarray,
    mask: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Return counts (k,), blocks and masks of motions q + t dq, (k, dof) each.

    `ends` (k, 2) are the rows of `ptr`, `block` and `mask` that hold the cells of a
    motion's two nodes, which are left out.
    """
    nodes = sweep.ItemCells(ptr, block, mask)
    motions = swept, q, dq, ends, nodes
    return _lists(swept, len(q), lambda out: sweep.sweep_edges(*motions, out))


def _lists(swept: sweep.Swept, size: int, job) -> tuple:  # noqa: ANN001
    kind = block_type(np.prod(swept.grid.shape))
    room = _ENTRIES * size
    while True:
        counts = np.empty(size, np.int64)
        blocks, masks = np.empty(room, kind), np.empty(room, np.uint64)
        end = job(sweep.Lists(counts, blocks, masks))
        if end == -2:
            raise BuildRefused(
                "the robot sweeps a cell outside the workspace grid, which is a "
                "fault of the grid's bound; please report the recipe"
            )
        if end >= 0:
            return counts, blocks[:end].copy(), masks[:end].copy()
        room *= 2
