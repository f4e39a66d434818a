"""Motions against exact scenery: half-spaces and boxes, by the sphere cover."""

import math

from numba import njit

from odm.close_test._close import set_point
from roadmap.kinematics._forward import body_frames, motion_bounds

FINE_WAY = 1e-3  # [m] an interval is given up once no sphere makes more way than this
MAX_DEPTH = 20


@njit(cache=True, nogil=True)
def solid_distance(x, y, z, solid):
    """Return the distance of a point from a solid (17,), 0 inside a box.

    Row of a half-space: 0, normal (3), offset: solid where n.x <= offset (negative
    distance inside). Row of a box: 1, centre (3), rotation (9, row-major), half sizes.
    """
    if solid[0] == 0.0:
        return solid[1] * x + solid[2] * y + solid[3] * z - solid[4]
    ux, uy, uz = x - solid[1], y - solid[2], z - solid[3]
    total = 0.0
    for k in range(3):
        along = solid[4 + k] * ux + solid[7 + k] * uy + solid[10 + k] * uz
        over = abs(along) - solid[13 + k]
        if not over <= 0.0:  # a NaN stays one
            total += over * over
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def body_near_solids(arm, b, margin, f, half, solids, skip, work):
    """Test body b against all solids; 0 free, 1 open, 2 in contact."""
    result = 0
    bx, by, bz = arm.bound[b, 0], arm.bound[b, 1], arm.bound[b, 2]
    wx = f[0] * bx + f[1] * by + f[2] * bz + f[9]
    wy = f[3] * bx + f[4] * by + f[5] * bz + f[10]
    wz = f[6] * bx + f[7] * by + f[8] * bz + f[11]
    reach = arm.bound[b, 3] + work.body_radius[b] + margin
    reach += work.body_speed[b] * half
    for k in range(solids.shape[0]):
        if skip[b, k] or solid_distance(wx, wy, wz, solids[k]) >= reach:
            continue
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            s = arm.spheres[i]
            cx = f[0] * s[0] + f[1] * s[1] + f[2] * s[2] + f[9]
            cy = f[3] * s[0] + f[4] * s[1] + f[5] * s[2] + f[10]
            cz = f[6] * s[0] + f[7] * s[1] + f[8] * s[2] + f[11]
            d = solid_distance(cx, cy, cz, solids[k]) - s[3] - margin
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


@njit(cache=True, nogil=True)
def motion_clear_of_solids(arm, margin, q, dq, solids, skip, work):
    """Return True if q + t dq, t in [0, 1], keeps `margin` from all solids.

    `skip` (n_bodies, n_solids) leaves pairs out. On False, work.found has the sphere
    and the solid, work.value t and the distance left.
    """
    n_bodies = arm.tree_i.shape[0]
    if solids.shape[0] == 0:
        return True
    motion_bounds(
        arm.tree_i, arm.tree_f, arm.reach, dq, work.rates, work.speed, work.bend
    )
    for b in range(n_bodies):
        work.body_speed[b] = 0.0
        work.body_radius[b] = 0.0
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            work.body_speed[b] = max(work.body_speed[b], work.speed[i])
            work.body_radius[b] = max(work.body_radius[b], arm.spheres[i, 3])
    top = 0
    work.stack[0, 0] = 0
    work.stack[0, 1] = 0
    for b in range(n_bodies):
        work.masks[0, b] = b > 0 and arm.body_ptr[b + 1] > arm.body_ptr[b]
    while top >= 0:
        level, index = work.stack[top, 0], work.stack[top, 1]
        dt = 1.0 / (1 << level)
        t = (index + 0.5) * dt
        set_point(q, dq, t, work.point)
        body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
        open_ = False
        mask = work.masks[top]
        for b in range(1, n_bodies):
            if not mask[b]:
                continue
            state = body_near_solids(
                arm, b, margin, work.frames[0, b], 0.5 * dt, solids, skip, work
            )
            way = work.body_speed[b] * dt
            if state == 2 or (state == 1 and (way <= FINE_WAY or level == MAX_DEPTH)):
                work.value[0] = t
                return False
            mask[b] = state == 1
            open_ = open_ or state == 1
        if not open_:
            top -= 1
            continue
        for b in range(n_bodies):
            work.masks[top + 1, b] = mask[b]
        work.stack[top, 0] = level + 1
        work.stack[top, 1] = 2 * index + 1
        work.stack[top + 1, 0] = level + 1
        work.stack[top + 1, 1] = 2 * index
        top += 1
    return True
