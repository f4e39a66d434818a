"""Motions against what stands still: exact solids, points, and the robot itself.

The scenery's half-spaces, boxes, round shapes and convex meshes are exact; the robot is
its sphere cover.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.close_test._arm import Clearance
from odm.close_test._close import (
    begin_intervals,
    motion_clear,
    set_point,
    split_interval,
)
from odm.obstacles._cloud import Cloud
from odm.obstacles._solids import Solids as Shapes
from odm.obstacles._solids import cylinder_gap, rod_distance, triangle_place
from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.geometry._self_collision import NEAR_END, motion_apart
from roadmap.kinematics._forward import body_frames, motion_bounds, place_of

PLANE, BOX, ROD, CYLINDER, HULL = 0.0, 1.0, 2.0, 3.0, 4.0  # first number of a row
FAR = 1.0  # [m] from a hull, where a ball around it is near enough to the truth
FINE_LENGTH = 1e-3  # [m] an interval is given up once no sphere moves by more
MAX_DEPTH = 20
NO_FACES = np.zeros((0, 13))
NO_FACES.setflags(write=False)


class Solids(NamedTuple):
    """Exact scenery, and the distance that the spheres keep from it."""

    rows: np.ndarray  # (n, 16) see `solid_distance`
    skip: np.ndarray  # (n_bodies, n) pairs that are left out
    margin: float  # [m]
    # [m] an interval at an end of a motion is given up once no sphere moves by more
    finest: float = FINE_LENGTH
    # (f, 13) of convex meshes: outward normal, offset, three corners
    faces: np.ndarray = NO_FACES


class Still(NamedTuple):
    """All that a robot must keep clear of and that never moves."""

    itself: tuple  # the model of its self-collision,
    margin: float  # how far its links stay apart, and
    tolerance: float  # to what depth that is looked at,
    finest: float  # ... and at the ends of a motion [m]
    solids: Solids
    scenery: Clearance
    cloud: Cloud  # points of the recipe's scenery
    place: Clearance
    place_cloud: Cloud  # points of the scenery of this place
    shapes: Shapes  # none: the recipe's scenery is points and rows of `solids`
    place_shapes: Shapes  # of this place


@njit(**INNER)
def solid_distance(x, y, z, solid, faces):
    """Return the distance of a point from a solid (16,); inside it is 0, or negative.

    Row of a half-space: 0, normal (3), offset: solid where n.x <= offset. Of a box: 1,
    centre (3), rotation (9, row-major), half sizes. Of a capsule: 2, end a (3), b - a
    (3), radius, |b - a|^2. Of a cylinder: 3, centre (3), unit axis (3), radius, half
    length. Of a convex mesh: 4, centre (3) and radius of a ball around it, first and
    last of its `faces`; farther than FAR from that ball, it is the ball's distance.
    """
    kind = solid[0]
    if kind == PLANE:
        return solid[1] * x + solid[2] * y + solid[3] * z - solid[4]
    if kind != BOX and not abs(x + y + z) < math.inf:
        return math.nan
    if kind == ROD:
        rod = (solid[1], solid[2], solid[3], solid[4], solid[5], solid[6])
        return rod_distance((*rod, solid[7], solid[8]), x, y, z)
    if kind == CYLINDER:
        return cylinder_gap(solid[1:], x, y, z)[0]
    ux, uy, uz = x - solid[1], y - solid[2], z - solid[3]
    if kind == HULL:
        far = math.sqrt(ux * ux + uy * uy + uz * uz) - solid[4]
        if far > FAR:
            return far
        return hull_distance(faces, int(solid[5]), int(solid[6]), x, y, z)
    total = 0.0
    for k in range(3):
        along = solid[4 + k] * ux + solid[7 + k] * uy + solid[10 + k] * uz
        over = abs(along) - solid[13 + k]
        if not over <= 0.0:  # a NaN stays one
            total += over * over
    return math.sqrt(total)


@njit(**INNER)
def hull_distance(faces, first, last, x, y, z):
    """Return the distance of a point from a convex mesh, negative inside.

    It is the farthest plane's inside. Outside, the nearest place lies on a face whose
    plane has the point in front of it.
    """
    best, nearest2 = -math.inf, math.inf
    for f in range(first, last):
        face = faces[f]
        over = face[0] * x + face[1] * y + face[2] * z - face[3]
        best = max(best, over)
        if not over <= 0.0:
            px, py, pz = triangle_place(face, x, y, z)
            d2 = (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
            nearest2 = min(nearest2, d2)
    return math.sqrt(nearest2) if best > 0.0 else best


@njit(**INNER)
def body_near_solids(arm, b, f, half, solids, work):
    """Test body b against all solids; 0 free, 1 open, 2 in contact."""
    rows, skip, margin, _, faces = solids
    result = 0
    wx, wy, wz = place_of(f, arm.bound[b])
    reach = arm.bound[b, 3] + work.body_radius[b] + margin
    reach += work.body_speed[b] * half
    for k in range(rows.shape[0]):
        if skip[b, k] or solid_distance(wx, wy, wz, rows[k], faces) >= reach:
            continue
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            s = arm.spheres[i]
            cx, cy, cz = place_of(f, s)
            d = solid_distance(cx, cy, cz, rows[k], faces) - s[3] - margin
            if not d >= 0.0:  # a NaN is contact
                work.found[0] = i
                work.found[1] = k
                work.value[1] = d
                return 2
            if not d >= work.speed[i] * half:
                result = 1
                work.found[0] = i
                work.found[1] = k
                work.value[1] = d
    return result


@njit(**LEAN)
def motion_clear_of_solids(arm, q, dq, solids, work):
    """Return True if q + t dq, t in [0, 1], keeps the margin from all solids.

    On False, work.found has the sphere and the solid, work.value t and the distance
    left.
    """
    if solids.rows.shape[0] == 0:
        return True
    motion_bounds(
        arm.tree_i, arm.tree_f, arm.reach, dq, work.rates, work.speed, work.bend
    )
    for b in range(arm.tree_i.shape[0]):
        work.body_speed[b] = 0.0
        work.body_radius[b] = 0.0
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            work.body_speed[b] = max(work.body_speed[b], work.speed[i])
            work.body_radius[b] = max(work.body_radius[b], arm.spheres[i, 3])
    top = 0
    begin_intervals(arm, work)
    while top >= 0:
        level, index = work.stack[top, 0], work.stack[top, 1]
        dt = 1.0 / (1 << level)
        t = (index + 0.5) * dt
        set_point(q, dq, t, work.point)
        body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
        open_ = False
        last = FINE_LENGTH
        if 0.5 * dt > NEAR_END * min(t, 1.0 - t):
            last = solids.finest
        mask = work.masks[top]
        for b in range(1, mask.shape[0]):
            if not mask[b]:
                continue
            frame = work.frames[0, b]
            state = body_near_solids(arm, b, frame, 0.5 * dt, solids, work)
            length = work.body_speed[b] * dt
            ends = length <= last or level == MAX_DEPTH
            if state == 2 or (state == 1 and ends):
                work.value[0] = t
                return False
            mask[b] = state == 1
            open_ = open_ or state == 1
        if open_:
            split_interval(work, top)
            top += 1
        else:
            top -= 1
    return True


@njit(**INNER)
def motion_free(still, q, dq, scratch):
    """Return whether the motion q + t dq is free of `still`.

    `scratch` is that of the self-collision.
    """
    arm, work = still.scenery.arm, still.scenery.work
    if not motion_clear_of_solids(arm, q, dq, still.solids, work):
        return False
    kept = still.margin, still.tolerance, still.finest
    if not motion_apart(still.itself, q, dq, *kept, scratch):
        return False
    if not motion_clear(still.scenery, q, dq, still.cloud, still.shapes, False):
        return False
    shapes = still.place_shapes
    return motion_clear(still.place, q, dq, still.place_cloud, shapes, False)


@njit(**LEAN)
def motions_free(still, q, dq, scratch, result):
    """Write to `result` (k,) which motions q[k] + t dq[k] are free of `still`."""
    for k in range(q.shape[0]):
        result[k] = motion_free(still, q[k], dq[k], scratch)
