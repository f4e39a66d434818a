"""Cells of a 6-D reachability map: samples, witnesses of neighbours, their replay.

A cell is position * n_rotations + rotation; a position is (x * ny + y) * nz + z. A
marked cell has a witness, a lattice point, and its predecessor: itself a root, which is
stored, or propagated from a neighbouring cell's witness by a few damped steps.
Replaying these steps from the root gives the same witness.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from handover.reach._reach_touch import Touch, touches_itself
from handover.reach._rotations import rotation_cell
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import BARE, FULL, WITHIN, WITHIN_INNER
from roadmap.kinematics._chain import (
    ChainArrays,
    dexterity,
    draw_code,
    forward,
    from_lattice,
    jacobian,
    limited_step,
    pose_error,
    to_lattice,
)

ROOT = 255  # predecessor of a cell whose witness is stored
MAX_DEPTH = 30  # propagations between a witness and its root
_STEPS = 4  # damped steps of one propagation
_DAMPING = 0.05
_ROOM = 0.25  # of a cell: how far from its centre a propagation may aim


class Grid(NamedTuple):
    """Cells in position and rotation."""

    size: np.ndarray  # (4,) nx, ny, nz, n_rotations
    sides: np.ndarray  # (2,) HEALPix n_side and rolls
    place: np.ndarray  # (4,) origin (3) and cell [unit]
    scale: np.ndarray  # (2,) half a cell [unit] and half a rotation step [rad]
    centers: np.ndarray  # (n_rotations, 9) rotation of each cell's centre
    pixel_frames: np.ndarray  # (n_pixels, 9)
    neighbors: np.ndarray  # (n_rotations, k) filled with -1


class Cells(NamedTuple):
    """The state of a fill, one entry a cell."""

    quality: np.ndarray  # of the witness, 1 to 255; 0 where the cell is not marked
    sample: np.ndarray  # quality of the best sample; 0 where there is none
    # index of the best sample; without one, the failed predecessors (bits)
    source: np.ndarray
    # ROOT, or the neighbour whose witness was propagated: the k-th in rotation, n + k
    # in position
    predecessor: np.ndarray
    depth: np.ndarray  # propagations from the root
    witness: np.ndarray  # (n, dof) lattice points


class Work(NamedTuple):
    """Working memory of one thread."""

    frames: np.ndarray
    jac: np.ndarray
    weighted: np.ndarray
    gram: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    error: np.ndarray
    code: np.ndarray
    target: np.ndarray


class Build(NamedTuple):
    """What one thread fills a map with."""

    chain: ChainArrays
    grid: Grid
    cells: Cells
    touch: Touch
    work: Work


@njit(**WITHIN_INNER)
def position_of(grid, T):
    """Return the position cell of a pose, -1 outside of the grid."""
    flat = 0
    for k in range(3):
        i = math.floor((T[9 + k] - grid.place[k]) / grid.place[3])
        if not 0 <= i < grid.size[k]:
            return -1
        flat = flat * grid.size[k] + int(i)
    return flat


@njit(**WITHIN)
def cell_of(grid, T):
    """Return the cell of a pose, -1 outside of the grid."""
    p = position_of(grid, T)
    if p < 0:
        return -1
    return p * grid.size[3] + rotation_cell(
        T, grid.sides[0], grid.sides[1], grid.pixel_frames
    )


@njit(**WITHIN)
def center_of(grid, cell, T):
    """Write the pose of a cell's centre to T (12,)."""
    p, r = cell // grid.size[3], cell % grid.size[3]
    for k in range(9):
        T[k] = grid.centers[r, k]
    z, rest = p % grid.size[2], p // grid.size[2]
    y, x = rest % grid.size[1], rest // grid.size[1]
    T[9] = grid.place[0] + (x + 0.5) * grid.place[3]
    T[10] = grid.place[1] + (y + 0.5) * grid.place[3]
    T[11] = grid.place[2] + (z + 0.5) * grid.place[3]


@njit(**WITHIN_INNER)
def position_neighbor(grid, p, axis):
    """Return the position next to `p` on side 0 to 5 (-x, +x, -y..), -1 outside."""
    z, rest = p % grid.size[2], p // grid.size[2]
    y, x = rest % grid.size[1], rest // grid.size[1]
    step = 2 * (axis & 1) - 1
    if axis < 2:
        x += step
    elif axis < 4:
        y += step
    else:
        z += step
    inside = 0 <= x < grid.size[0] and 0 <= y < grid.size[1] and 0 <= z < grid.size[2]
    return (x * grid.size[1] + y) * grid.size[2] + z if inside else -1


@njit(**WITHIN_INNER)
def origin_cell(grid, cell, predecessor):
    """Return the cell that a predecessor of `cell` stands for, -1 for none."""
    p, r = cell // grid.size[3], cell % grid.size[3]
    n = grid.neighbors.shape[1]
    if predecessor < n:
        near = grid.neighbors[r, predecessor]
        return p * grid.size[3] + near if near >= 0 else -1
    if predecessor >= n + 6:
        return -1
    near = position_neighbor(grid, p, predecessor - n)
    return near * grid.size[3] + r if near >= 0 else -1


@njit(**WITHIN_INNER)
def quality_byte(measure, reference):
    """Return 1 to 255 for a dexterity relative to the reference."""
    return np.uint8(1 + int(254.0 * min(measure / reference, 1.0)))


@njit(**BARE)
def draw_samples(build, seed, start, reference, where, quality):
    """Write cell and quality of samples start, start + 1, ... to the two arrays.

    The cell is -1 where the sample is no better than the one there, or in
    self-collision. reference: the dexterity that is quality 1.
    """
    chain, grid, cells, touch, work = build
    touch.axes[:] = 0.0
    for i in range(where.shape[0]):
        draw_code(seed, start + i, work.code)
        from_lattice(chain, work.code, work.q)
        forward(chain, work.q, work.frames)
        cell = cell_of(grid, work.frames[-1])
        where[i] = cell
        if cell >= 0:
            jacobian(chain, work.frames, work.jac)
            w = dexterity(chain, work.q, work.jac, work.weighted, work.gram)
            quality[i] = quality_byte(w, reference)
            if quality[i] <= cells.sample[cell] or touches_itself(
                touch, work.q, work.frames
            ):
                where[i] = -1


@njit(**BARE)
def keep_best(part, parts, n_rotations, start, where, quality, cells):
    """Enter the samples of every `parts`-th position; the best of each cell stays.

    The outcome does not depend on how the work is split: of equal samples the first
    in order stays.
    """
    for i in range(where.shape[0]):
        c = where[i]
        if c < 0 or (c // n_rotations) % parts != part:
            continue
        if quality[i] > cells.sample[c]:
            cells.sample[c] = quality[i]
            cells.source[c] = start + i


@njit(**WITHIN_INNER)
def propagate(chain, grid, parent, origin, cell, work):
    """Move the witness of cell `origin` into the neighbouring `cell` by damped steps.

    To a neighbour in position only the tool's place moves, and only some way into the
    cell: its centre may be out of reach where its near side is not. To a neighbour in
    rotation the tool turns to the rotation of the centre and keeps its place.

    parent: (dof,) lattice point. The result is in work.code, work.q and work.frames.

    Returns:
        True when the tool is inside the cell.
    """
    from_lattice(chain, parent, work.q)
    forward(chain, work.q, work.frames)
    tool, target = work.frames[-1], work.target
    center_of(grid, cell, target)
    n = grid.size[3]
    if origin % n == cell % n:
        for k in range(9):
            target[k] = tool[k]
    room = _ROOM * grid.place[3]
    for k in range(9, 12):
        target[k] = min(max(tool[k], target[k] - room), target[k] + room)
    before = pose_error(tool, target, grid.scale, work.error)
    for _ in range(_STEPS):
        jacobian(chain, work.frames, work.jac)
        limited_step(chain, work.q, grid.scale, _DAMPING, work)
        to_lattice(chain, work.q, work.code)
        from_lattice(chain, work.code, work.q)
        forward(chain, work.q, work.frames)
        if position_of(grid, tool) == cell // n and (
            rotation_cell(tool, grid.sides[0], grid.sides[1], grid.pixel_frames)
            == cell % n
        ):
            return True
        after = pose_error(tool, target, grid.scale, work.error)
        if after > 0.8 * before:
            return False
        before = after
    return False


@njit(**FULL)
def replay(chain, grid, predecessors, root, cell, work):
    """Propagate a root's witness from predecessor to cell, at last into `cell`.

    predecessors: (n,) from the cell back to the root. root: (dof,) lattice point. The
    result is in work.code; False where a step no longer arrives.
    """
    path = np.empty(predecessors.shape[0] + 1, np.int64)
    path[0] = cell
    for k in range(predecessors.shape[0]):
        path[k + 1] = origin_cell(grid, path[k], predecessors[k])
    parent = root.copy()
    for j in range(root.shape[0]):
        work.code[j] = root[j]
    for k in range(predecessors.shape[0] - 1, -1, -1):
        if not propagate(chain, grid, parent, path[k + 1], path[k], work):
            return False
        copy_row(work.code, parent)
    return True
