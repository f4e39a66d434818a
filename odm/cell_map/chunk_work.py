"""What is done to the chunks of a build: motions are tested, nodes and edges swept."""

from typing import NamedTuple

import numpy as np

from odm._groups import block_type
from odm.cell_map import _sweep as sweep
from odm.close_test.safety import Safety
from odm.close_test.static import StaticTest
from odm.obstacles.scenery import Scenery
from roadmap.builds.chunks import Job
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


def sweep_job(swept: sweep.Swept, stage: str) -> Job:
    """Return the job of sweeping motions less the cells of their two nodes."""
    return Job(f"{__name__}:swept_cells", f"{__name__}:as_it_is", swept, stage, 3)


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


def at_rest(swept: sweep.Swept, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return what `swept_cells` takes of configurations (k, dof)."""
    kind = block_type(np.prod(swept.grid.shape))
    ends, ptr = np.full((len(q), 2), -1), np.zeros(1, np.int64)
    nothing = np.zeros(0, kind), np.zeros(0, np.uint64)
    return np.array(q), np.zeros(q.shape), ends, ptr, *nothing


def swept_cells(
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
    motion's two nodes, which are left out; -1: there are none.
    """
    nodes, room = sweep.ItemCells(ptr, block, mask), _ENTRIES * len(q)
    while True:
        counts = np.empty(len(q), np.int64)
        blocks, masks = np.empty(room, block.dtype), np.empty(room, np.uint64)
        lists = sweep.Lists(counts, blocks, masks)
        end = sweep.sweep_edges(swept, q, dq, ends, nodes, lists)
        if end == -2:
            raise BuildRefused(
                "the robot sweeps a cell outside the workspace grid, which is a "
                "fault of the grid's bound; please report the recipe"
            )
        if end >= 0:
            return counts, blocks[:end].copy(), masks[:end].copy()
        room *= 2
