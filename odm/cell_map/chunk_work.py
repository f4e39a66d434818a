"""What is done to the chunks of a build: motions are tested, nodes and edges swept."""

from typing import NamedTuple

import numpy as np

from odm.cell_map import _sweep as sweep
from odm.close_test.safety import Safety
from odm.close_test.static import StaticTest
from odm.obstacles.scenery import Scenery
from roadmap.chunks import Job
from roadmap.errors import BuildRefused
from roadmap.geometry.self_collision import TOLERANCE
from roadmap.robot.robot import Robot

_ENTRIES = 160  # first guess per item; a chunk that needs more is done again


class Standing(NamedTuple):
    """What motions are tested against."""

    robot: Robot
    scenery: Scenery
    safety: Safety


class Sweeping(NamedTuple):
    """What is swept: see `_sweep.Swept`; `wide` blocks have 32-bit numbers."""

    swept: sweep.Swept
    wide: bool


def motion_job(robot: Robot, scenery: Scenery, safety: Safety, stage: str) -> Job:
    """Return the job of testing motions q + t dq, both (k, dof) -> (k,) bool."""
    spec = Standing(robot, scenery, safety)
    return Job(f"{__name__}:test_motions", f"{__name__}:static_test", spec, stage, 2)


def node_job(spec: Sweeping) -> Job:
    """Return the job of sweeping configurations (k, dof)."""
    return Job(f"{__name__}:cells_of_nodes", f"{__name__}:as_it_is", spec, "node", 1)


def edge_job(spec: Sweeping) -> Job:
    """Return the job of sweeping motions less the cells of their two nodes."""
    return Job(f"{__name__}:cells_of_edges", f"{__name__}:as_it_is", spec, "edge", 3)


def static_test(spec: Standing, threads: int = 1) -> StaticTest:
    """Make the test of a roadmap's motions: their ends are drawn, none is needed."""
    return StaticTest(*spec, threads=threads, finest=TOLERANCE)


def as_it_is(spec: Sweeping) -> Sweeping:
    """Return what needs no making."""
    return spec


def test_motions(
    test: StaticTest, q: np.ndarray, dq: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return which motions q + t dq are free: (k,) bool."""
    return (test.motions_free(q, dq),)


def cells_of_nodes(spec: Sweeping, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return counts (k,), blocks and masks of configurations (k, dof)."""
    return _lists(spec, len(q), lambda out: sweep.sweep_nodes(spec.swept, q, out))


def cells_of_edges(
    spec: Sweeping,
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
    return _lists(
        spec, len(q), lambda out: sweep.sweep_edges(spec.swept, q, dq, ends, nodes, out)
    )


def _lists(spec: Sweeping, size: int, job) -> tuple[np.ndarray, ...]:  # noqa: ANN001
    room = _ENTRIES * size
    while True:
        counts = np.empty(size, np.int64)
        blocks = np.empty(room, np.uint32 if spec.wide else np.uint16)
        masks = np.empty(room, np.uint64)
        end = job(sweep.Lists(counts, blocks, masks))
        if end == -2:
            raise BuildRefused(
                "the robot sweeps a cell outside the workspace grid, which is a "
                "fault of the grid's bound; please report the recipe"
            )
        if end >= 0:
            return counts, blocks[:end].copy(), masks[:end].copy()
        room *= 2
