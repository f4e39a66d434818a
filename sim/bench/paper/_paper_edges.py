"""Compiled loops of `odm bench odm-paper`: region expansion and exact contacts."""

import numpy as np
from numba import njit

from odm.exact._distances import ball_gap, core_distance, nearest_pair
from roadmap.compiling.jit_options import FULL, INNER
from roadmap.kinematics._forward import body_frames

TOUCH = 1e-9  # cap of a question that is only whether solids touch [m]


@njit(**FULL)
def expand_region(box, rods, frames, start, low, h, seen, stack, tests):
    """Mark in `seen` (x, y, z) the cells whose cubes a convex solid meets.

    The region expand method of the paper: from the cell at the middle of each solid
    on to the six neighbours of every cell that meets it, each decided by an exact
    collision test.

    Args:
        box: Convexes: one cube of side h about its origin.
        rods: Convexes of the obstacle.
        frames: (n, 12) their poses.
        start: (n, 3) cell in the middle of each.
        low: (3,) corner of cell (0, 0, 0) [m].
        h: Side of a cell [m].
        seen: (x, y, z) uint8 out; a cell is 1 where it meets a solid.
        stack: (m, 3) int64 scratch; as many as cells are enough.
        tests: (1,) out: collision tests made.

    Returns:
        The number of cells that meet a solid.
    """
    cube = np.zeros(12)
    cube[0], cube[4], cube[8] = 1.0, 1.0, 1.0
    asked = np.zeros(seen.shape, np.uint8)
    n_cells, tests[0] = 0, 0
    for r in range(frames.shape[0]):
        asked[:] = 0
        top = 1
        for c in range(3):
            stack[0, c] = start[r, c]
        asked[start[r, 0], start[r, 1], start[r, 2]] = 1
        while top > 0:
            top -= 1
            x, y, z = stack[top, 0], stack[top, 1], stack[top, 2]
            cube[9] = low[0] + (x + 0.5) * h
            cube[10] = low[1] + (y + 0.5) * h
            cube[11] = low[2] + (z + 0.5) * h
            tests[0] += 1
            if not touch(rods, r, frames[r], box, 0, cube):
                continue
            if seen[x, y, z] == 0:
                seen[x, y, z] = 1
                n_cells += 1
            for side in range(6):
                step = 1 - 2 * (side & 1)
                i = x + (step if side < 2 else 0)
                j = y + (step if 2 <= side < 4 else 0)
                k = z + (step if side >= 4 else 0)
                if i < 0 or j < 0 or k < 0:
                    continue
                if i >= seen.shape[0] or j >= seen.shape[1] or k >= seen.shape[2]:
                    continue
                if asked[i, j, k] == 0:
                    asked[i, j, k] = 1
                    stack[top, 0], stack[top, 1], stack[top, 2] = i, j, k
                    top += 1
    return n_cells


@njit(**INNER)
def touch(a, i, frame_a, b, j, frame_b):
    """Return whether solid i of a touches solid j of b."""
    if ball_gap(a, i, frame_a, b, j, frame_b) > 0.0:
        return False
    margin = a.margin[i] + b.margin[j]
    low, _ = core_distance(a, i, frame_a, b, j, frame_b, margin + TOUCH)
    return low <= margin


@njit(**INNER)
def place_solids(tree_i, tree_f, q, body, pose, frames, out):
    """Write the poses (n, 12) of solids fixed to bodies, for a configuration."""
    body_frames(tree_i, tree_f, q, frames)
    for s in range(body.shape[0]):
        f, p = frames[body[s]], pose[s]
        for i in range(3):
            for j in range(3):
                out[s, 3 * i + j] = (
                    f[3 * i] * p[j] + f[3 * i + 1] * p[3 + j] + f[3 * i + 2] * p[6 + j]
                )
            out[s, 9 + i] = (
                f[3 * i] * p[9] + f[3 * i + 1] * p[10] + f[3 * i + 2] * p[11] + f[9 + i]
            )


@njit(**FULL)
def exact_distances(
    tree_i, tree_f, body, pose, solids, use, q, rods, rod_frames, cap, out
):
    """Write the exact distance of robot and obstacle at every q (n, dof), up to cap."""
    frames, placed = np.empty((tree_i.shape[0], 12)), np.empty((body.shape[0], 12))
    found = np.empty(2, np.int64)
    for k in range(q.shape[0]):
        place_solids(tree_i, tree_f, q[k], body, pose, frames, placed)
        out[k], _ = nearest_pair(solids, use, placed, rods, rod_frames, cap, found)


@njit(**FULL)
def meets_cells(tree_i, tree_f, body, pose, solids, use, q, box, centers, out):
    """Write for every q (n, dof) whether a solid meets the cube at any of centers."""
    frames, placed = np.empty((tree_i.shape[0], 12)), np.empty((body.shape[0], 12))
    cube = np.zeros(12)
    cube[0], cube[4], cube[8] = 1.0, 1.0, 1.0
    for k in range(q.shape[0]):
        place_solids(tree_i, tree_f, q[k], body, pose, frames, placed)
        out[k] = False
        for c in range(centers.shape[0]):
            for i in range(3):
                cube[9 + i] = centers[c, i]
            for s in range(body.shape[0]):
                if use[s] and touch(solids, s, placed[s], box, 0, cube):
                    out[k] = True
                    break
            if out[k]:
                break
