"""Points laid out for the close test, also those outside the grid."""

import numpy as np
from numba import njit

from odm.obstacles._cloud import (
    IS_SORTED,
    N_BAD,
    N_GIVEN,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    cell_of,
)
from odm.obstacles._occupancy import clear, mark_cells, sort_points
from roadmap.jit_options import INNER, LEAN

FAR = 4e15  # in cells; what is not nearer is no number


@njit(**LEAN)
def lay_out(points, cloud):
    """Lay points (n, 3) out for the close test, also those outside the grid.

    Those count to the nearest block, whose box holds them. Return how many are not
    finite; these are left out.
    """
    clear(cloud)
    n, where = points.shape[0], cloud.where[: points.shape[0]]
    flat = points.reshape(-1)
    bad = find_blocks(flat, where, cloud.origin, cloud.h, cloud.shape)
    mark_cells(where, cloud)
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]
    cloud.counts[N_GIVEN] = n
    cloud.counts[N_INSIDE] = n - bad
    cloud.counts[N_BAD] = bad
    sort_points(points, cloud)
    cloud.counts[IS_SORTED] = 1
    return bad


@njit(**INNER)
def find_blocks(flat, where, origin, h, shape):
    """Write to `where` (n,) the first cell of the block that is nearest to each point.

    As `find_cells`, in vector code. -1 for what is not finite.

    Returns:
        How many are not.
    """
    ox, oy, oz = origin[0], origin[1], origin[2]
    inv = 1.0 / h
    top_x, top_y, top_z = 4.0 * shape[0] - 1, 4.0 * shape[1] - 1, 4.0 * shape[2] - 1
    ny, nz = np.int32(shape[1]), np.int32(shape[2])
    bad = 0
    for i in range(np.uint64(where.shape[0])):
        k = np.uint64(3) * i
        x = (flat[k] - ox) * inv
        y = (flat[k + np.uint64(1)] - oy) * inv
        z = (flat[k + np.uint64(2)] - oz) * inv
        finite = (abs(x) < FAR) & (abs(y) < FAR) & (abs(z) < FAR)
        ix = np.int32(min(max(x, 0.0), top_x))
        iy = np.int32(min(max(y, 0.0), top_y))
        iz = np.int32(min(max(z, 0.0), top_z))
        cell = cell_of(ix, iy, iz, ny, nz)
        where[i] = np.int32(cell & np.int32(-64)) if finite else np.int32(-1)
        bad += not finite
    return bad
