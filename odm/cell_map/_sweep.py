"""Cells that the sphere cover sweeps, as 64-bit words of 4 x 4 x 4 cells.

Cell (ix, iy, iz) is bit (ix & 3) << 4 | (iy & 3) << 2 | iz & 3 of the word of block
(ix >> 2, iy >> 2, iz >> 2). A motion q + t dq, t in [0, 1], is sampled at dyadic t,
for each sphere at a level of its own. Between two samples the centre stays within
`sag` of the chord (|p''| dt^2 / 8), and a tube of radius R round a chord of length s
lies in the union of the two balls of radius sqrt(R^2 + s^2 / 4) at its ends. So the
balls of radius sqrt((R + sag)^2 + s^2 / 4) at the samples cover the whole sweep.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.cell_map._block import cells_near
from odm.close_test._arm import Arm
from odm.close_test._close import MAX_LEVEL, SAG_SHARE, sample_level
from roadmap.compiling.jit_options import FULL, INNER, LEAN, WITHIN_INNER
from roadmap.kinematics._forward import body_frames, motion_bounds, place_points


class Grid(NamedTuple):
    """Cells of side h from `origin` on, shape[a] blocks of four cells along axis a."""

    origin: np.ndarray  # (3,) [m]
    h: float  # [m]
    shape: np.ndarray  # (3,)


class Swept(NamedTuple):
    """What is swept, and into which cells."""

    arm: Arm
    radii: np.ndarray  # (n,) with rho and clearance [m]
    # largest inflation of a piece [m]; negative leaves the motion bound out, for the
    # audit of the audit only
    tolerance: float
    grid: Grid


class SweepScratch(NamedTuple):
    """Work space of one sweep at a time; see `sweep_scratch`."""

    words: np.ndarray  # (n_blocks,) zero between sweeps
    frames: np.ndarray  # (n_bodies, 12)
    speed: np.ndarray  # (n,)
    bend: np.ndarray  # (n,)
    point: np.ndarray  # (dof,)
    rates: np.ndarray  # (2, n_bodies)
    centers: np.ndarray  # (2 ** MAX_LEVEL + 1, n, 3)


class Lists(NamedTuple):
    """Cells of items one after the other, as blocks and masks."""

    counts: np.ndarray  # (k,) entries of an item
    block: np.ndarray
    mask: np.ndarray


class ItemCells(NamedTuple):
    """Cells of items; item i owns the entries ptr[i] to ptr[i + 1]."""

    ptr: np.ndarray
    block: np.ndarray
    mask: np.ndarray


@njit(**WITHIN_INNER)
def gap(low, high, at):
    """Return how far coordinate `at` is from the interval [low, high]."""
    return max(0.0, max(low - at, at - high))


@njit(**INNER)
def mark_ball(center, radius, grid, words):
    """Set the bits of the cells whose cube comes within `radius` of a point (3,).

    Returns False where a cell would lie outside the grid, or the point is not finite.
    """
    origin, inv = grid.origin, 1.0 / grid.h
    gx, gy = (center[0] - origin[0]) * inv, (center[1] - origin[1]) * inv
    gz = (center[2] - origin[2]) * inv
    r = radius * inv
    nbx, nby, nbz = grid.shape[0], grid.shape[1], grid.shape[2]
    if not (gx - r >= 0.0 and gy - r >= 0.0 and gz - r >= 0.0):
        return False
    if not (gx + r < 4 * nbx and gy + r < 4 * nby and gz + r < 4 * nbz):
        return False
    first, last, r2 = int(gz - r) >> 2, int(gz + r) >> 2, r * r
    for bx in range(int(gx - r) >> 2, (int(gx + r) >> 2) + 1):
        x = 4.0 * bx
        dx = gap(x, x + 4.0, gx)
        for by in range(int(gy - r) >> 2, (int(gy + r) >> 2) + 1):
            y = 4.0 * by
            dy = gap(y, y + 4.0, gy)
            if dx * dx + dy * dy > r2:
                continue
            line = (bx * nby + by) * nbz
            for bz in range(first, last + 1):
                words[line + bz] |= cells_near(x, y, 4.0 * bz, gx, gy, gz, r2)
    return True


@njit(**INNER)
def longest_chord(centers, i, step, pieces):
    """Return the longest chord of ball i between every `step`-th of its samples."""
    longest = 0.0
    for k in range(0, pieces, step):
        a, b = centers[k, i], centers[k + step, i]
        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        longest = max(longest, dx * dx + dy * dy + dz * dz)
    return math.sqrt(longest)


@njit(**INNER)
def place_samples(arm, q, dq, pieces, scratch):
    """Write the centres of all spheres at t = k / pieces to scratch.centers[k]."""
    for k in range(pieces + 1):
        for j in range(dq.shape[0]):
            scratch.point[j] = q[j] + dq[j] * k / pieces
        body_frames(arm.tree_i, arm.tree_f, scratch.point, scratch.frames)
        place_points(scratch.frames, arm.body, arm.spheres, scratch.centers[k])


@njit(**LEAN)
def sweep_motion(swept, q, dq, scratch):
    """Mark in scratch.words all cells of the motion q + t dq; False: outside the grid.

    Spheres of body 0 are left out, they never move.
    """
    arm, radii, tolerance, _ = swept
    speed, bend, most = scratch.speed, scratch.bend, abs(tolerance)
    motion_bounds(arm.tree_i, arm.tree_f, arm.reach, dq, scratch.rates, speed, bend)
    finest = 0
    for i in range(radii.shape[0]):
        finest = max(finest, sample_level(radii[i], speed[i], bend[i], most))
    pieces = 1 << finest
    place_samples(arm, q, dq, pieces, scratch)
    for i in range(radii.shape[0]):
        if arm.body[i] == 0:
            continue
        pieces_i = 0
        if speed[i] != 0.0 and tolerance >= 0.0:
            # by the true chords, fewer pieces do than by the bound on the speed
            pieces_i = 1
            while True:
                dt = 1.0 / pieces_i
                tube = radii[i] + SAG_SHARE * bend[i] * dt * dt / 8.0
                step = pieces // pieces_i
                half = 0.5 * longest_chord(scratch.centers, i, step, pieces)
                if math.sqrt(tube * tube + half * half) - radii[i] <= tolerance:
                    break
                if pieces_i == pieces:
                    break
                pieces_i *= 2
        if not mark_samples(swept, i, pieces, pieces_i, scratch):
            return False
    return True


@njit(**INNER)
def mark_samples(swept, i, pieces, pieces_i, scratch):
    """Mark the balls of sphere i at its pieces_i + 1 samples; 0: at the first only."""
    step = pieces
    tube = swept.radii[i]
    if pieces_i > 0:
        step = pieces // pieces_i
        tube += SAG_SHARE * scratch.bend[i] / (8.0 * pieces_i * pieces_i)
    before = 0.0
    for k in range(0, pieces + 1 if pieces_i > 0 else 1, step):
        c = scratch.centers[k, i]
        after = 0.0
        if pieces_i > 0 and k < pieces:
            d = scratch.centers[k + step, i]
            after = (d[0] - c[0]) ** 2 + (d[1] - c[1]) ** 2 + (d[2] - c[2]) ** 2
        ball = math.sqrt(tube * tube + 0.25 * max(before, after))
        if not mark_ball(c, ball, swept.grid, scratch.words):
            return False
        before = after
    return True


@njit(**FULL)
def sweep_scratch(arm, grid, dof):
    """Return the work space for sweeps of this robot into this grid."""
    n, n_bodies = arm.spheres.shape[0], arm.tree_i.shape[0]
    return SweepScratch(
        np.zeros(grid.shape[0] * grid.shape[1] * grid.shape[2], np.uint64),
        np.empty((n_bodies, 12)),
        np.empty(n),
        np.empty(n),
        np.empty(dof),
        np.empty((2, n_bodies)),
        np.empty(((1 << MAX_LEVEL) + 1, n, 3)),
    )


@njit(**INNER)
def take_words(words, lists, start):
    """Move the non-zero words to lists from `start` on, clear them; return the end."""
    end = start
    for b in range(words.shape[0]):
        if words[b] != 0:
            if end >= lists.block.shape[0]:
                return -1
            lists.block[end] = b
            lists.mask[end] = words[b]
            words[b] = 0
            end += 1
    return end


@njit(**INNER)
def remove_words(nodes, node, words):
    """Clear from `words` the cells of a node."""
    for k in range(nodes.ptr[node], nodes.ptr[node + 1]):
        words[nodes.block[k]] &= ~nodes.mask[k]


@njit(**LEAN)
def sweep_edges(swept, q, dq, ends, nodes, lists):
    """Sweep motions q[k] + t dq[k], less the cells of their two end nodes.

    `ends` (k, 2) are node ids, or -1 to keep all cells. Returns the number of entries;
    -1: the lists are too short; -2: a cell lies outside the grid.
    """
    scratch = sweep_scratch(swept.arm, swept.grid, q.shape[1])
    end = 0
    for k in range(q.shape[0]):
        if not sweep_motion(swept, q[k], dq[k], scratch):
            return -2
        for side in range(2):
            if ends[k, side] >= 0:
                remove_words(nodes, ends[k, side], scratch.words)
        start = end
        end = take_words(scratch.words, lists, start)
        if end < 0:
            return -1
        lists.counts[k] = end - start
    return end


@njit(**LEAN)
def merge_lists(a, b, out):
    """Write to `out` the union of two layers' cells, item by item.

    Blocks ascend within an item, in the result too. Returns the number of entries;
    the scratch must do for both layers one after the other.
    """
    end = 0
    out.ptr[0] = 0
    for item in range(a.ptr.shape[0] - 1):
        i, i_end = a.ptr[item], a.ptr[item + 1]
        j, j_end = b.ptr[item], b.ptr[item + 1]
        while i < i_end or j < j_end:
            if j >= j_end or (i < i_end and a.block[i] < b.block[j]):
                out.block[end] = a.block[i]
                out.mask[end] = a.mask[i]
                i += 1
            elif i >= i_end or b.block[j] < a.block[i]:
                out.block[end] = b.block[j]
                out.mask[end] = b.mask[j]
                j += 1
            else:
                out.block[end] = a.block[i]
                out.mask[end] = a.mask[i] | b.mask[j]
                i += 1
                j += 1
            end += 1
        out.ptr[item + 1] = end
    return end
