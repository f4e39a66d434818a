"""The close test: a motion's spheres against points and solids, continuous, no cells.

A motion q + t dq is split by dichotomy. An interval is free when at its middle every
sphere is farther from every point than its radius plus its largest travel in half
the interval. Where that fails, the sphere's chord, thickened by the bound on the sag
(|p''| dt^2 / 8), may free it as soon as the sag is small, and decides at the bottom
level. From solids, whose distance is exact, a sphere keeps its bare radius, from points
the covering radius of their samples, too.
"""

import math

import numpy as np
from numba import njit

from odm.obstacles._cloud import N_LISTED
from odm.obstacles._solids import (
    CAPSULE,
    chord_keeps,
    rod_distance,
    rod_of,
    solid_distance,
)
from roadmap.compiling._rows import in_line
from roadmap.compiling.jit_options import BARE_INNER, INNER, LEAN, WITHIN_INNER
from roadmap.kinematics._forward import (
    body_frames,
    motion_bounds,
    place_of,
    place_points,
)

FINE_SAG = 5e-4  # [m] the chord test may give away this much
EARLY_SAG = 0.012  # [m] a coarser chord may free a body, but blocks none
ESCAPE_SLACK = 1e-3  # [m] "no nearer than now" holds up to this
MANY = 8  # boxes or points that are measured several at once, before one by one
BALL_ROUNDING = 1e-9  # [m] by which a body's ball is larger than computed
FIRST_SOLID = -2  # stands for solid 0 where a point's index is told, -3 for solid 1


@njit(**INNER)
def box_distance2(x, y, z, box):
    """Return the squared distance of a point from an axis-aligned box (6,)."""
    dx = max(0.0, max(box[0] - x, x - box[3]))
    dy = max(0.0, max(box[1] - y, y - box[4]))
    dz = max(0.0, max(box[2] - z, z - box[5]))
    return dx * dx + dy * dy + dz * dz


@njit(**WITHIN_INNER)
def list_near(cloud, x, y, z, reach):
    """List the blocks whose points may come within `reach` of a place [m]; return n.

    They are in cloud.near, in order, and cloud.away has the squared distance of every
    block's box. Of many boxes these are worked out first, for several at once.
    """
    away, near, reach2 = cloud.away, cloud.near, reach * reach
    n, place, found = cloud.counts[N_LISTED], (x, y, z), np.uint64(0)
    if n >= MANY:
        measure_boxes(cloud.box, n, place, away)
    for k in range(np.uint64(n)):
        if n < MANY:
            away[k] = box_distance2(x, y, z, cloud.box[k])
        near[found] = k
        found += np.uint64(not away[k] >= reach2)  # what is not a number is near
    return np.int64(found)


@njit(**BARE_INNER)
def measure_boxes(boxes, n, place, away):
    """Write to `away` the squared distances of the first n boxes (m, 6); no branch."""
    box, (x, y, z) = in_line(boxes), place
    for k in range(np.uint64(n)):
        at = np.uint64(6) * k
        dx = max(0.0, max(box[at] - x, x - box[at + np.uint64(3)]))
        dy = max(0.0, max(box[at + np.uint64(1)] - y, y - box[at + np.uint64(4)]))
        dz = max(0.0, max(box[at + np.uint64(2)] - z, z - box[at + np.uint64(5)]))
        away[k] = dx * dx + dy * dy + dz * dz


@njit(**BARE_INNER)
def any_within(xyz, begin, end, place, far2):
    """Return True if any of the points [begin:end] is nearer to a place; no branch."""
    flat, (x, y, z) = in_line(xyz), place
    found = 0
    for p in range(np.uint64(begin), np.uint64(end)):
        k = np.uint64(3) * p
        dx = flat[k] - x
        dy = flat[k + np.uint64(1)] - y
        dz = flat[k + np.uint64(2)] - z
        found += not dx * dx + dy * dy + dz * dz >= far2
    return found > 0


@njit(**INNER)
def chord_distance2(p, a, b):
    """Return the squared distance of point p from segment a b, three numbers each."""
    (px, py, pz), (ax, ay, az), (bx, by, bz) = p, a, b
    ux, uy, uz = bx - ax, by - ay, bz - az
    wx, wy, wz = px - ax, py - ay, pz - az
    length2 = ux * ux + uy * uy + uz * uz
    s = 0.0
    if length2 > 0.0:
        s = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) / length2))
    dx, dy, dz = wx - s * ux, wy - s * uy, wz - s * uz
    return dx * dx + dy * dy + dz * dz


@njit(**BARE_INNER)
def any_beside(xyz, begin, end, chord, far2):
    """Return True if any of the points [begin:end] is nearer to a chord; no branch.

    Each distance is the one of `chord_distance2`, to the last bit.
    """
    flat, ((ax, ay, az), (bx, by, bz)) = in_line(xyz), chord
    ux, uy, uz = bx - ax, by - ay, bz - az
    length2 = ux * ux + uy * uy + uz * uz
    found = 0
    for p in range(np.uint64(begin), np.uint64(end)):
        k = np.uint64(3) * p
        px, py, pz = flat[k], flat[k + np.uint64(1)], flat[k + np.uint64(2)]
        wx, wy, wz = px - ax, py - ay, pz - az
        share = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) / length2))
        s = share if length2 > 0.0 else 0.0
        dx, dy, dz = wx - s * ux, wy - s * uy, wz - s * uz
        found += not dx * dx + dy * dy + dz * dz >= far2
    return found > 0


@njit(**INNER)
def prepare_motion(clearance, dq):
    """Fill the motion bounds of the scratch for displacement `dq`.

    Returns False where a radius is not finite: nothing can be proved then.
    """
    arm, radii, bare, tolerance, work = clearance
    motion_bounds(
        arm.tree_i, arm.tree_f, arm.reach, dq, work.rates, work.speed, work.bend
    )
    for b in range(arm.tree_i.shape[0]):
        fastest = 0.0
        bend = 0.0
        widest = 0.0
        thinnest = math.inf
        barest = 0.0
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            fastest = max(fastest, work.speed[i])
            bend = max(bend, work.bend[i])
            widest = max(widest, radii[i])
            thinnest = min(thinnest, radii[i])
            barest = max(barest, bare[i])
            if not (abs(radii[i]) < math.inf and abs(bare[i]) < math.inf):
                return False
        bottom = 0
        if widest > 0.0:
            # at least as deep as the cells of any of its spheres
            bottom = 1 + sample_level(thinnest, fastest, bend, tolerance)
        while bottom < MAX_LEVEL and bend > 8.0 * FINE_SAG * (1 << 2 * bottom):
            bottom += 1
        early = 0
        while early < bottom and bend > 8.0 * EARLY_SAG * (1 << 2 * early):
            early += 1
        work.early[b] = early
        work.body_speed[b] = fastest
        work.body_radius[b] = widest
        work.body_bare[b] = barest
        work.body_bend[b] = bend
        work.bottom[b] = bottom
    return True


@njit(**INNER)
def set_point(q, dq, t, point):
    """Write q + t dq to `point`."""
    for j in range(q.shape[0]):
        point[j] = q[j] + t * dq[j]


@njit(**INNER)
def displacement(q_from, q_to, continuous, dq):
    """Write q_to - q_from to `dq`, continuous joints the short way."""
    for j in range(dq.shape[0]):
        d = q_to[j] - q_from[j]
        if continuous[j]:
            d -= 2.0 * math.pi * round(d / (2.0 * math.pi))
        dq[j] = d


@njit(**INNER)
def threshold(radius, i, px, py, pz, escape, anchor):
    """Return the distance that sphere i must keep from a point."""
    if not escape:
        return radius
    dx, dy, dz = px - anchor[i, 0], py - anchor[i, 1], pz - anchor[i, 2]
    now = math.sqrt(dx * dx + dy * dy + dz * dz)
    return min(radius, max(0.0, now - ESCAPE_SLACK))


@njit(**BARE_INNER)
def place_spheres(spheres, first, last, frame, places):
    """Write where a body with a frame (12,) has its spheres' centres; no branch.

    Of spheres first to last - 1 (n, 4), to the first three rows of `places` (4, n).
    """
    flat, x, n = in_line(spheres), in_line(places), np.uint64(places.shape[1])
    f0, f1, f2, f3, f4, f5 = frame[0], frame[1], frame[2], frame[3], frame[4], frame[5]
    f6, f7, f8 = frame[6], frame[7], frame[8]
    f9, f10, f11 = frame[9], frame[10], frame[11]
    for i in range(np.uint64(first), np.uint64(last)):
        k = np.uint64(4) * i
        px, py, pz = flat[k], flat[k + np.uint64(1)], flat[k + np.uint64(2)]
        x[i] = f0 * px + f1 * py + f2 * pz + f9
        x[i + n] = f3 * px + f4 * py + f5 * pz + f10
        x[i + n + n] = f6 * px + f7 * py + f8 * pz + f11


@njit(**BARE_INNER)
def any_at_box(places, first, last, box, radii, speed, share):
    """Return True if any of spheres first to last - 1 may come near a box (6,).

    Within its radius and `share` of its speed. The squared distances of their centres,
    which `place_spheres` wrote to `places`, go to its last row. No branch.
    """
    x, n, found = in_line(places), np.uint64(places.shape[1]), 0
    b0, b1, b2, b3, b4, b5 = box[0], box[1], box[2], box[3], box[4], box[5]
    for i in range(np.uint64(first), np.uint64(last)):
        cx, cy, cz = x[i], x[i + n], x[i + n + n]
        dx = max(0.0, max(b0 - cx, cx - b3))
        dy = max(0.0, max(b1 - cy, cy - b4))
        dz = max(0.0, max(b2 - cz, cz - b5))
        d2 = dx * dx + dy * dy + dz * dz
        x[i + n + n + n] = d2
        far = radii[i] + speed[i] * share
        found += not d2 >= far * far
    return found > 0


@njit(**INNER)
def body_at(clearance, b, frame, half, cloud, escape):
    """Test body b at one configuration; 0 free, 1 undecided, 2 blocked by a point."""
    arm, radii, work = clearance.arm, clearance.radii, clearance.work
    near = arm.bound[b, 3] + work.body_radius[b]
    reach = near + work.body_speed[b] * half
    wx, wy, wz = place_of(frame, arm.bound[b])
    result, places = 0, work.places
    n_near = list_near(cloud, wx, wy, wz, reach)
    if n_near == 0:
        return 0
    first, last = arm.body_ptr[b], arm.body_ptr[b + 1]
    place_spheres(arm.spheres, first, last, frame, places)
    for at in range(n_near):
        k = cloud.near[at]
        if cloud.away[k] >= reach * reach:
            continue
        begin, end = cloud.start[k], cloud.start[k + 1]
        # once the interval is undecided, only a blocking point changes that
        share = half if result == 0 else 0.0
        if not any_at_box(places, first, last, cloud.box[k], radii, work.speed, share):
            continue
        for i in range(first, last):
            travel = work.speed[i] * half if result == 0 else 0.0
            far = radii[i] + travel
            if places[3, i] >= far * far:
                continue
            cx, cy, cz = places[0, i], places[1, i], places[2, i]
            if end - begin >= MANY:
                place, r = (cx, cy, cz), radii[i]
                if not any_within(cloud.xyz, begin, end, place, far * far):
                    continue
                if result == 0 and not escape:
                    if not any_within(cloud.xyz, begin, end, place, r * r):
                        result, reach = 1, near
                        continue
            for p in range(begin, end):
                px, py, pz = cloud.xyz[p, 0], cloud.xyz[p, 1], cloud.xyz[p, 2]
                dx, dy, dz = px - cx, py - cy, pz - cz
                d2 = dx * dx + dy * dy + dz * dz
                if d2 >= far * far:
                    continue
                r = threshold(radii[i], i, px, py, pz, escape, work.anchor)
                if d2 < r * r:
                    work.found[0] = i
                    work.found[1] = cloud.order[p]
                    work.value[1] = math.sqrt(d2)
                    return 2
                if result == 0 and d2 < (r + travel) * (r + travel):
                    result = 1
                    reach = near
    return result


@njit(**INNER)
def body_chord(clearance, b, f, g, dt, cloud, escape):
    """Test body b along the chords between frames f and g; False: blocked."""
    arm, radii, work = clearance.arm, clearance.radii, clearance.work
    # in the middle of the chords: no place on them is farther from it than their ends
    h, ball = work.frames[0, b], arm.bound[b]
    wx, wy, wz = place_of(h, ball)
    reach = ball[3] + work.body_radius[b] + work.body_speed[b] * 0.5 * dt
    reach += work.body_bend[b] * dt * dt / 8.0
    n_near = list_near(cloud, wx, wy, wz, reach)
    for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
        s = arm.spheres[i]
        ax, ay, az = place_of(f, s)
        bx, by, bz = place_of(g, s)
        sag = work.bend[i] * dt * dt / 8.0
        mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        half = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2) * 0.5
        far = radii[i] + sag + half
        for at in range(n_near):
            k = cloud.near[at]
            if box_distance2(mx, my, mz, cloud.box[k]) >= far * far:
                continue
            begin, end = cloud.start[k], cloud.start[k + 1]
            if end - begin >= MANY:
                r = radii[i] + sag
                chord = (ax, ay, az), (bx, by, bz)
                if not any_beside(cloud.xyz, begin, end, chord, r * r):
                    continue
            for p in range(begin, end):
                px, py, pz = cloud.xyz[p, 0], cloud.xyz[p, 1], cloud.xyz[p, 2]
                d2 = chord_distance2((px, py, pz), (ax, ay, az), (bx, by, bz))
                r = radii[i] + sag
                if d2 >= r * r:
                    continue
                r = threshold(radii[i], i, px, py, pz, escape, work.anchor) + sag
                if d2 < r * r:
                    work.found[0] = i
                    work.found[1] = cloud.order[p]
                    work.value[1] = math.sqrt(d2)
                    return False
    return True


@njit(**INNER)
def solid_threshold(solids, k, radius, i, escape, anchor):
    """Return the distance that sphere i must keep from solid k."""
    if not escape:
        return radius
    x, y, z = anchor[i, 0], anchor[i, 1], anchor[i, 2]
    return min(radius, solid_distance(solids, k, x, y, z, math.inf) - ESCAPE_SLACK)


@njit(**INNER)
def bodies_at_solids(clearance, mask, half, solids, escape):
    """Test the bodies of `mask` at one configuration; False: one is in the way.

    work.state says of each whether it is free, 0, or open, 1.
    """
    arm, bare, work = clearance.arm, clearance.bare, clearance.work
    for b in range(1, mask.shape[0]):
        work.state[b] = 0
        if not mask[b]:
            continue
        f, ball = work.frames[0, b], arm.bound[b]
        near = ball[3] + work.body_bare[b]
        reach = near + work.body_speed[b] * half
        wx, wy, wz = place_of(f, ball)
        open_ = False
        for k in range(solids.count[0]):
            rod, is_rod = rod_of(solids.rows[k]), solids.kind[k] == CAPSULE
            if is_rod:
                d = rod_distance(rod, wx, wy, wz)
            else:
                d = solid_distance(solids, k, wx, wy, wz, reach)
            if d >= reach:
                continue
            for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
                s = arm.spheres[i]
                cx, cy, cz = place_of(f, s)
                # once the interval is open, only a solid in the way is news
                travel = 0.0 if open_ else work.speed[i] * half
                far = bare[i] + travel
                if is_rod:
                    d = rod_distance(rod, cx, cy, cz)
                else:
                    d = solid_distance(solids, k, cx, cy, cz, far)
                if d >= far:
                    continue
                r = bare[i]
                if escape:
                    r = solid_threshold(solids, k, r, i, True, work.anchor)
                if d < r:
                    work.found[0] = i
                    work.found[1] = FIRST_SOLID - k
                    work.value[1] = d
                    return False
                if not open_ and d < r + travel:
                    open_ = True
                    reach = near
        work.state[b] = 1 if open_ else 0
    return True


@njit(**INNER)
def chords_at_solids(clearance, mask, level, solids, escape):
    """Test bodies along the chords between two frames of work; see `chords_clear`.

    work.state says of each body of `mask` whether it is free, 0, or in the way, 1.
    """
    arm, work = clearance.arm, clearance.work
    dt = 1.0 / (1 << level)
    for b in range(1, mask.shape[0]):
        work.state[b] = 0
        if not mask[b] or level < work.early[b]:
            continue
        h, ball = work.frames[0, b], arm.bound[b]  # in the middle of the chords
        wx, wy, wz = place_of(h, ball)
        reach = ball[3] + work.body_bare[b] + work.body_speed[b] * 0.5 * dt
        reach += work.body_bend[b] * dt * dt / 8.0
        for k in range(solids.count[0]):
            if solid_distance(solids, k, wx, wy, wz, reach) >= reach:
                continue
            if not chord_at_solid(clearance, b, dt, solids, k, escape):
                work.state[b] = 1
                break


@njit(**INNER)
def chord_at_solid(clearance, b, dt, solids, k, escape):
    """Test body b along its chords against solid k; False: in the way."""
    arm, bare, work = clearance.arm, clearance.bare, clearance.work
    f, g = work.frames[1, b], work.frames[2, b]
    for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
        s = arm.spheres[i]
        ax, ay, az = place_of(f, s)
        cx, cy, cz = place_of(g, s)
        sag = work.bend[i] * dt * dt / 8.0
        r = bare[i] + sag
        mx, my, mz = 0.5 * (ax + cx), 0.5 * (ay + cy), 0.5 * (az + cz)
        half = math.sqrt((cx - ax) ** 2 + (cy - ay) ** 2 + (cz - az) ** 2) * 0.5
        d = solid_distance(solids, k, mx, my, mz, r + half)
        if d >= r + half:
            continue
        if escape:
            r = solid_threshold(solids, k, bare[i], i, True, work.anchor) + sag
        if not chord_keeps(solids, k, (ax, ay, az), (cx, cy, cz), r):
            work.found[0] = i
            work.found[1] = FIRST_SOLID - k
            work.value[1] = min(d, bare[i])
            return False
    return True


@njit(**INNER)
def is_finite(q, dq):
    """Return False where a motion holds NaN or infinity: comparisons would lie."""
    for j in range(q.shape[0]):
        if not (abs(q[j]) < math.inf and abs(dq[j]) < math.inf):
            return False
    return True


@njit(**INNER)
def begin_intervals(arm, work):
    """Let the whole motion be the only interval, with all bodies that have spheres."""
    work.stack[0, 0] = 0
    work.stack[0, 1] = 0
    for b in range(arm.tree_i.shape[0]):
        work.masks[0, b] = b > 0 and arm.body_ptr[b + 1] > arm.body_ptr[b]


@njit(**INNER)
def split_interval(work, top):
    """Replace the interval at `top` of the stack by its halves, the first on top."""
    level, index = work.stack[top, 0], work.stack[top, 1]
    for b in range(work.masks.shape[1]):
        work.masks[top + 1, b] = work.masks[top, b]
    work.stack[top, 0] = level + 1
    work.stack[top, 1] = 2 * index + 1
    work.stack[top + 1, 0] = level + 1
    work.stack[top + 1, 1] = 2 * index


@njit(**LEAN)
def motion_clear(clearance, q, dq, cloud, solids, escape):
    """Return True if the whole motion q + t dq, t in [0, 1], keeps its distance.

    On False, work.found has the sphere and the point's index, FIRST_SOLID - k for solid
    k, and work.value t and the distance. What is not finite is not clear, whatever
    stands about: the point is -1 then. With `escape`, what is nearer than that need
    only not come nearer than work.anchor has it. The points must have been sorted.
    """
    arm, work = clearance.arm, clearance.work
    work.found[2] += 1
    known = is_finite(q, dq)
    points, shapes = cloud.counts[N_LISTED] > 0, solids.count[0] > 0
    if known and not points and not shapes:
        return True
    if not (known and prepare_motion(clearance, dq)):
        work.found[0] = 0
        work.found[1] = -1
        work.value[0] = 0.0
        work.value[1] = 0.0
        return False
    top = 0
    begin_intervals(arm, work)
    while top >= 0:
        level, index = work.stack[top, 0], work.stack[top, 1]
        dt = 1.0 / (1 << level)
        t = (index + 0.5) * dt
        set_point(q, dq, t, work.point)
        body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
        work.found[3] += 1
        mask = work.masks[top]
        open_ = False
        chords = False
        if shapes and not bodies_at_solids(clearance, mask, 0.5 * dt, solids, escape):
            work.value[0] = t
            return False
        for b in range(1, mask.shape[0]):
            if not mask[b]:
                continue
            frame = work.frames[0, b]
            state = work.state[b] if shapes else 0
            if points:
                other = body_at(clearance, b, frame, 0.5 * dt, cloud, escape)
                state = max(state, other)
            if state == 2:
                work.value[0] = t
                return False
            mask[b] = state == 1
            if state == 1:
                if level >= work.early[b]:
                    chords = True
                else:
                    open_ = True
        if chords:
            verdict = chords_clear(clearance, q, dq, top, cloud, solids, escape)
            if verdict == 2:
                work.value[0] = t
                return False
            open_ = open_ or verdict == 1
        if open_:
            split_interval(work, top)
            top += 1
        else:
            top -= 1
    return True


@njit(**INNER)
def place_clear(clearance, q, cloud, solids):
    """Return True if a configuration keeps its distance: `motion_clear` at rest."""
    arm, radii, bare, _, work = clearance
    work.found[2] += 1
    work.found[3] += 1
    work.found[0], work.found[1] = 0, -1
    work.value[0] = work.value[1] = 0.0
    if not is_finite(q, q):
        return False
    body_frames(arm.tree_i, arm.tree_f, q, work.frames[0])
    for b in range(1, arm.tree_i.shape[0]):
        widest, barest = 0.0, 0.0
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            if not (abs(radii[i]) < math.inf and abs(bare[i]) < math.inf):
                return False
            widest, barest = max(widest, radii[i]), max(barest, bare[i])
        f, ball = work.frames[0, b], arm.bound[b]
        wx, wy, wz = place_of(f, ball)
        near = ball[3] + barest
        for k in range(solids.count[0]):
            if solid_distance(solids, k, wx, wy, wz, near) >= near:
                continue
            for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
                s = arm.spheres[i]
                cx, cy, cz = place_of(f, s)
                d = solid_distance(solids, k, cx, cy, cz, bare[i])
                if d < bare[i]:
                    work.found[0], work.found[1] = i, FIRST_SOLID - k
                    work.value[1] = d
                    return False
        if cloud.counts[N_LISTED] > 0:
            work.body_radius[b], work.body_speed[b] = widest, 0.0
            for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
                work.speed[i] = 0.0
            if body_at(clearance, b, f, 0.0, cloud, False) == 2:
                return False
    return True


@njit(**INNER)
def chords_clear(clearance, q, dq, top, cloud, solids, escape):
    """Test the bodies of the interval at `top` that are still open, by their chords.

    Those that are free leave its mask. Returns 0 where all are; 1: some are open;
    2: one is in the way, at the bottom level.
    """
    arm, work = clearance.arm, clearance.work
    level, index = work.stack[top, 0], work.stack[top, 1]
    dt, mask = 1.0 / (1 << level), work.masks[top]
    set_point(q, dq, index * dt, work.point)
    body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[1])
    set_point(q, dq, (index + 1) * dt, work.point)
    body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[2])
    work.found[3] += 2
    points, shapes = cloud.counts[N_LISTED] > 0, solids.count[0] > 0
    if shapes:
        chords_at_solids(clearance, mask, level, solids, escape)
    result = 0
    for b in range(1, mask.shape[0]):
        if mask[b] and level >= work.early[b]:
            f, g = work.frames[1, b], work.frames[2, b]
            free = not shapes or work.state[b] == 0
            if free and points:
                free = body_chord(clearance, b, f, g, dt, cloud, escape)
            if free:
                mask[b] = False
            elif level < work.bottom[b]:
                result = 1
            else:
                return 2
    return result


@njit(**LEAN)
def first_blocked(clearance, path, cloud, solids, leg):
    """Return the first leg of a path (k, dof) that comes too near, -1 for none.

    `leg` (dof,) is scratch. A single corner is a robot at rest.
    """
    for k in range(max(1, path.shape[0] - 1)):
        for j in range(path.shape[1]):
            leg[j] = path[min(k + 1, path.shape[0] - 1), j] - path[k, j]
        if not motion_clear(clearance, path[k], leg, cloud, solids, False):
            return k
    return -1


@njit(**LEAN)
def place_anchor(arm, q, work):
    """Write the sphere centres at q to work.anchor, where an escape begins."""
    body_frames(arm.tree_i, arm.tree_f, q, work.frames[0])
    place_points(work.frames[0], arm.body, arm.spheres, work.anchor)


@njit(**INNER)
def ball_of(arm, b):
    """Return the radius of a ball round all spheres of a body [m]."""
    widest = 0.0
    for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
        widest = max(widest, arm.spheres[i, 3])
    return widest + (arm.bound[b, 3] + BALL_ROUNDING)


@njit(**INNER)
def gap_from_points(arm, work, b, cloud, best):
    """Return the least distance of body b's spheres from the points, at most `best`.

    The bodies stand where work.frames[0] has them. work.found as of `separation`.
    """
    first, last = arm.body_ptr[b], arm.body_ptr[b + 1]
    f = work.frames[0, b]
    wx, wy, wz = place_of(f, arm.bound[b])
    # no sphere is nearer than the ball round all of the body's
    reach = max(0.0, best + ball_of(arm, b))
    n_near = list_near(cloud, wx, wy, wz, reach)
    for i in range(first, last):
        s = arm.spheres[i]
        cx, cy, cz = place_of(f, s)
        for at in range(n_near):
            far = best + s[3]
            if far <= 0.0:
                break
            k = cloud.near[at]
            if box_distance2(cx, cy, cz, cloud.box[k]) >= far * far:
                continue
            begin, end, far2 = cloud.start[k], cloud.start[k + 1], far * far
            if end - begin >= MANY:
                place = cx, cy, cz
                if not any_within(cloud.xyz, begin, end, place, far2 + BALL_ROUNDING):
                    continue
            for p in range(begin, end):
                dx = cloud.xyz[p, 0] - cx
                dy = cloud.xyz[p, 1] - cy
                dz = cloud.xyz[p, 2] - cz
                d = math.sqrt(dx * dx + dy * dy + dz * dz) - s[3]
                if d < best:
                    best = d
                    work.found[0] = i
                    work.found[1] = cloud.order[p]
    return best


@njit(**INNER)
def gap_from_solids(arm, work, solids, begin, end, best, least):
    """Return the least distance of the cover from solids begin to end, at most `best`.

    The bodies stand where work.frames[0] has them. A value that is not above `least`
    may be no more than some of their distances. work.found as of `separation`.
    """
    for b in range(1, arm.tree_i.shape[0]):
        first, last = arm.body_ptr[b], arm.body_ptr[b + 1]
        if first == last:
            continue
        f, ball = work.frames[0, b], arm.bound[b]
        wx, wy, wz = place_of(f, ball)
        reach = ball_of(arm, b)
        for k in range(begin, end):
            # no sphere is nearer than the ball round all of the body's
            far = best + reach
            rod, is_rod = rod_of(solids.rows[k]), solids.kind[k] == CAPSULE
            if is_rod:
                d = rod_distance(rod, wx, wy, wz)
            else:
                d = solid_distance(solids, k, wx, wy, wz, far)
            if d >= far:
                continue
            for i in range(first, last):
                s = arm.spheres[i]
                cx, cy, cz = place_of(f, s)
                if is_rod:
                    d = rod_distance(rod, cx, cy, cz) - s[3]
                else:
                    d = solid_distance(solids, k, cx, cy, cz, best + s[3]) - s[3]
                if d < best:
                    best = d
                    work.found[0] = i
                    work.found[1] = FIRST_SOLID - k
            if best <= least:
                return best
    return best


@njit(**LEAN)
def separation(arm, q, cloud, solids, limit, work):
    """Return the least distance of the cover from points and solids, at most `limit`.

    work.found gets the sphere and the point's index (-1: none within `limit`), or
    FIRST_SOLID - k for solid k.
    """
    body_frames(arm.tree_i, arm.tree_f, q, work.frames[0])
    best = limit
    work.found[0] = -1
    work.found[1] = -1
    listed = cloud.counts[N_LISTED]
    for b in range(1, arm.tree_i.shape[0] if listed else 0):
        best = gap_from_points(arm, work, b, cloud, best)
    return gap_from_solids(arm, work, solids, 0, solids.count[0], best, -math.inf)


MAX_LEVEL = 8  # finest dichotomy; above it the balls grow instead
# All finer chords stay within 1 + 1/4 times the sag of a coarse one (see docs); the
# cells take 4/3, so that what cells call free the close test calls free at any depth.
SAG_SHARE = 4.0 / 3.0


@njit(**INNER)
def sample_level(radius, speed, bend, tolerance):
    """Return the level for a sphere: its motion is sampled in 2**level pieces."""
    level = 0
    while True:
        dt = 1.0 / (1 << level)
        sag = SAG_SHARE * bend * dt * dt / 8.0
        half = 0.5 * speed * dt
        ball = math.sqrt((radius + sag) * (radius + sag) + half * half)
        if ball - radius <= tolerance or level == MAX_LEVEL:
            return level
        level += 1
