"""Points laid out for the close test: all, also outside the grid, or those near."""

import math

import numpy as np
from numba import njit

from odm.close_test._close import is_finite, list_near, prepare_motion, set_point
from odm.obstacles._cloud import (
    AS_GIVEN,
    CHUNK,
    LAYOUT,
    N_BAD,
    N_GIVEN,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    cell_of,
)
from odm.obstacles._occupancy import (
    BEYOND,
    clear,
    link_points,
    mark_cells,
    pick_points,
    sort_points,
)
from roadmap.compiling._rows import in_line
from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.kinematics._forward import body_frames, place_of

ALL_CELLS = np.uint64(0xFFFFFFFFFFFFFFFF)  # of a block
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


@njit(**INNER)
def pick_near(clearance, q, dq, cloud, pick, points):
    """Collect the points of all blocks that a motion q + t dq may come near.

    For a few motions that is much less than to sort all points, and the close test
    finds the same. As `body_at` and `body_chord` do, each body is held by a ball where
    the motion is half over, which is larger by how far a sphere of it moves till either
    end. The cloud is linked here, or has been.

    Returns:
        False where nothing can be said: q or dq is not finite, or a radius.
    """
    arm, work = clearance.arm, clearance.work
    if not (is_finite(q, dq) and prepare_motion(clearance, dq)):
        return False
    if cloud.counts[LAYOUT] == AS_GIVEN:
        link_points(cloud)
    clear(pick)
    set_point(q, dq, 0.5, work.point)
    body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
    for b in range(1, arm.tree_i.shape[0]):
        if arm.body_ptr[b + 1] == arm.body_ptr[b]:
            continue
        x, y, z = place_of(work.frames[0, b], arm.bound[b])
        reach = arm.bound[b, 3] + work.body_radius[b]
        reach += 0.5 * work.body_speed[b] + 0.125 * work.body_bend[b]
        for at in range(list_near(cloud, x, y, z, reach)):
            pick.words[cloud.occupied[cloud.near[at]]] = ALL_CELLS
    pick_marked(cloud, pick, points)
    return True


@njit(**INNER)
def pick_marked(cloud, pick, points):
    """Collect the points of the blocks that `pick` has, in the order of sorted ones."""
    count = 0
    for k in range(cloud.counts[N_LISTED]):
        b = cloud.occupied[k]
        if pick.words[b] != 0:
            pick.occupied[count] = b
            pick.slot[b] = count
            count += 1
    pick.counts[N_OCCUPIED] = count
    pick_points(pick, cloud, points)


@njit(**INNER)
def pick_reached(clearance, reach, cloud, pick, points):
    """Collect the points of all blocks that the robot can come near in any place.

    `reach` tells how far blocks are from the axis that all of the robot turns about.
    No sphere's centre is farther from it than `Arm.reach` says, so what lies beyond
    that and the sphere's radius can be in the way of nothing. The rest, such as most of
    a wall behind a person, is neither laid out nor looked at.

    Returns:
        False where nothing can be said: there is no such axis, or a radius is not
        finite.
    """
    arm, radii, far, b = clearance.arm, clearance.radii, 0.0, reach.body[0]
    if b < 0:
        return False
    for i in range(arm.spheres.shape[0]):
        most = arm.reach[i, b] + radii[i]
        if not most < math.inf:
            return False
        far = max(far, most)
    if cloud.counts[LAYOUT] == AS_GIVEN:
        link_points(cloud)
    clear(pick)
    for k in range(cloud.counts[N_LISTED]):
        block = cloud.occupied[k]
        if not reach.away[block] >= far:
            pick.words[block] = ALL_CELLS
    pick_marked(cloud, pick, points)
    return True
