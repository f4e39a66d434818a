"""Points laid out for the close test, also those outside the grid."""

import numpy as np
from numba import njit

from odm.obstacles._cloud import (
    CHUNK,
    N_BAD,
    N_GIVEN,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    cell_of,
)
from odm.obstacles._occupancy import BEYOND, clear, mark_cells, sort_points
from roadmap._rows import in_line
from roadmap.jit_options import INNER, LEAN

FAR = 4e15  # in cells; what is not nearer is no number


@njit(**LEAN)
def lay_out(points, cloud):
    """Lay points (n, 3) out for the close test, also those outside the grid.

    Those count to the nearest block, whose box holds them. Return how many are not
    finite; these are left out.
    """
    clear(cloud)
    n, flat = points.shape[0], in_line(points)
    for first in range(0, n, CHUNK):
        last = min(first + CHUNK, n)
        where, steps = cloud.where[first:last], cloud.steps[: 3 * (last - first)]
        find_near_steps(flat[3 * first : 3 * last], steps, cloud.corners, cloud.h)
        find_blocks(steps, where, cloud.shape)
    known = mark_cells(cloud.where[:n], cloud)
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]
    cloud.counts[N_GIVEN] = n
    cloud.counts[N_INSIDE] = known
    cloud.counts[N_BAD] = n - known
    sort_points(points, cloud)
    return n - known


@njit(**INNER)
def find_near_steps(flat, steps, corners, h):
    """Write to `steps` (3 n,) how many cells points are from the grid's corner.

    As `find_steps`, but 0 before the corner, and -1 for what is no number alone.
    """
    inv = 1.0 / h
    for k in range(np.uint64(flat.shape[0])):
        x = (flat[k] - corners[k]) * inv
        near = np.int32(min(max(x, 0.0), BEYOND))
        steps[k] = near if abs(x) < FAR else np.int32(-1)


@njit(**INNER)
def find_blocks(steps, where, shape):
    """Write to `where` (n,) the first cell of the block that is nearest to each point.

    As `find_cells`, in vector code. -1 for what is not finite.
    """
    nby, nbz = np.int32(shape[1]), np.int32(shape[2])
    # the last cell along each axis
    nx, ny, nz = (
        np.int32(4 * shape[0] - 1),
        np.int32(4 * nby - 1),
        np.int32(4 * nbz - 1),
    )
    for i in range(np.uint64(where.shape[0])):
        k = np.uint64(3) * i
        x, y, z = steps[k], steps[k + np.uint64(1)], steps[k + np.uint64(2)]
        known = (x >= 0) & (y >= 0) & (z >= 0)
        x, y, z = x if x < nx else nx, y if y < ny else ny, z if z < nz else nz
        cell = cell_of(x, y, z, nby, nbz) & np.int32(-64)
        where[i] = np.int32(cell) if known else np.int32(-1)
