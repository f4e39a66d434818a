"""How far shapes may move before a free motion must be tested again.

A motion is kept in chords: between two configurations of it every sphere stays within a
sag (|p''| dt^2 / 8) of the straight line from where it is at the one to where it is at
the other. So what these lines have to spare from the shapes, less the sag, the motion
has. The configurations are the same in every frame, only the shapes move.

No point of a shape that was moved, turned or grown is farther than `displaced` from
where the shape was. So no distance from it is less by more than that, and a motion
that was free with more slack than that is free of the shape where it is now.
"""

import math

import numpy as np
from numba import njit

from odm.obstacles._solids import (
    BOX,
    CAPSULE,
    CYLINDER,
    chord_keeps,
    segments_distance2,
    solid_distance,
)
from roadmap.compiling._rows import in_line
from roadmap.compiling.jit_options import BARE_INNER, INNER
from roadmap.kinematics._forward import place_of

NEAR = 0.03  # [m] what has more to spare is not measured more exactly
LEAST = 1e-3  # [m] what has less to spare is tested anew
ENOUGH = 4.0 * NEAR  # [m] than which no more is asked for
FAR = 10.0  # [m] instead of what is to spare where there is no shape
SPEED, BEND, WIDE = 0, 1, 2  # rows of what is known of the bodies on a motion


@njit(**INNER)
def piece_spare(middle, bound, half, solids, near):
    """Return what all bodies have to spare from all shapes within `half` of a place.

    Or a bound below NEAR, where their balls alone do not tell.

    Args:
        middle: (3, lanes) where their balls are in the middle [m].
        bound: (3, lanes) SPEED, BEND and WIDE of each body; WIDE is the radius of a
            ball around what its spheres keep free [m], below 0: it has none.
        half: Share of the motion from the middle to either end.
        solids: The shapes.
        near: (lanes,) scratch.
    """
    spare = FAR
    for k in range(solids.count[0]):
        balls_from_solid((middle, middle), bound, (half, 0.0), solids, k, near)
        for b in range(near.shape[0]):
            if bound[WIDE, b] < 0.0:
                continue
            if not near[b] >= NEAR:  # a NaN is not free
                return near[b]
            spare = min(spare, near[b])
    return spare


@njit(**INNER)
def chord_spare(arm, lengths, ends, balls, bound, dt, solids, first):
    """Return what all spheres have to spare from all shapes along a part of a motion.

    A bound from below, exact to the sag; where it is below LEAST, any such number. And
    the sphere that has the least, -1 where that was told by balls around bodies alone.

    Args:
        arm: The robot.
        lengths: (n,) what the spheres keep from shapes [m], then scratch: (n,) and
            (lanes,).
        ends: (bodies, 12) frames of the configuration at either end.
        balls: (3, lanes) where the bodies' balls are at either end [m].
        bound: As of `piece_spare`.
        dt: The part's share of the motion.
        solids: The shapes.
        first: The sphere that had the least before, or -1: it is measured first, so
            that farther bodies are told by their balls.
    """
    (bare, gap, near), (begin, end) = lengths, ends
    spare, least = FAR, -1
    if first >= 0:
        b = arm.body[first]
        sag = bound[BEND, b - 1] * dt * dt / 8.0
        a = place_of(begin[b], arm.spheres[first])
        c = place_of(end[b], arm.spheres[first])
        least = first
        for k in range(solids.count[0]):
            d = line_distance(solids, k, a, c, bare[first] + sag)
            spare = d if not d >= spare else spare
        if not spare >= LEAST:
            return spare, least
    for k in range(solids.count[0]):
        balls_from_solid(balls, bound, (0.0, dt * dt / 8.0), solids, k, near)
        is_rod = solids.kind[k] == CAPSULE
        for b in range(1, begin.shape[0]):
            d = near[b - 1]
            if bound[WIDE, b - 1] < 0.0:
                continue
            if d >= min(spare, NEAR):
                spare = min(spare, d)
                continue
            f, g, sag = begin[b], end[b], bound[BEND, b - 1] * dt * dt / 8.0
            if is_rod:
                lines_from_rod(arm.spheres, in_fours(arm, b), f, g, solids.rows[k], gap)
            for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
                if is_rod:
                    d = gap[i] - (bare[i] + sag)
                else:
                    a, c = place_of(f, arm.spheres[i]), place_of(g, arm.spheres[i])
                    d = line_distance(solids, k, a, c, bare[i] + sag)
                if not d >= spare:
                    spare, least = d, i
            if not spare >= LEAST:
                return spare, least
    return spare, least


@njit(**INNER)
def balls_from_solid(ends, bound, shares, solids, k, near):
    """Write to `near` what balls around bodies have to spare from solid k at least [m].

    Their centres go in straight lines. Of a mesh, ENOUGH is told of what has more.

    Args:
        ends: Twice (3, lanes), where the lines begin and end [m].
        bound: As of `piece_spare`; where WIDE is below 0 the number says nothing.
        shares: What counts of SPEED and of BEND: the balls are wider by that.
        solids: The shapes.
        k: Which one.
        near: (lanes,) where it goes.
    """
    if solids.kind[k] == CAPSULE:
        begin, end, known = in_line(ends[0]), in_line(ends[1]), in_line(bound)
        balls_from_rod(begin, end, known, shares, solids.rows[k], near)
        return
    a, c = ends
    for b in range(near.shape[0]):
        ax, ay, az, cx, cy, cz = a[0, b], a[1, b], a[2, b], c[0, b], c[1, b], c[2, b]
        half = 0.5 * math.sqrt((cx - ax) ** 2 + (cy - ay) ** 2 + (cz - az) ** 2)
        reach = bound[WIDE, b] + half
        reach += bound[SPEED, b] * shares[0] + bound[BEND, b] * shares[1]
        x, y, z = 0.5 * (ax + cx), 0.5 * (ay + cy), 0.5 * (az + cz)
        near[b] = solid_distance(solids, k, x, y, z, reach + ENOUGH) - reach


@njit(**BARE_INNER)
def balls_from_rod(begin, end, bound, shares, rod, near):
    """As `balls_from_solid` of a capsule, with flat arrays, for four bodies at once."""
    rx, ry, rz, ux, uy, uz = rod[0], rod[1], rod[2], rod[3], rod[4], rod[5]
    radius, per = rod[6], 1.0 / rod[7] if rod[7] > 0.0 else 0.0
    n = np.uint64(near.shape[0])
    for b in range(n):
        c = b + n
        d = c + n
        vx, vy, vz = end[b] - begin[b], end[c] - begin[c], end[d] - begin[d]
        wx = begin[b] + 0.5 * vx - rx
        wy = begin[c] + 0.5 * vy - ry
        wz = begin[d] + 0.5 * vz - rz
        t = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) * per))
        dx, dy, dz = wx - t * ux, wy - t * uy, wz - t * uz
        reach = bound[d] + 0.5 * math.sqrt(vx * vx + vy * vy + vz * vz)
        reach += bound[b] * shares[0] + bound[c] * shares[1]
        near[b] = math.sqrt(dx * dx + dy * dy + dz * dz) - radius - reach


@njit(**INNER)
def in_fours(arm, b):
    """Return first and last + 1 of a body's spheres, and of so many beside them.

    They are a multiple of four, if the robot has so many.
    """
    begin, end = arm.body_ptr[b], arm.body_ptr[b + 1]
    more = -(end - begin) % 4
    if end + more <= arm.spheres.shape[0]:
        return begin, end + more
    return max(0, begin - more), end


@njit(**BARE_INNER)
def lines_from_rod(spheres, which, f, g, rod, gap):
    """Write to `gap` what the lines of spheres' centres have to spare from a capsule.

    Of spheres which[0] to which[1] - 1 (n, 4), whose body goes from frame f to g (12,).
    The arithmetic is that of `line_distance`, without a branch, so that the processor
    does it for four spheres at once.
    """
    flat = in_line(spheres)
    rx, ry, rz, ux, uy, uz = rod[0], rod[1], rod[2], rod[3], rod[4], rod[5]
    radius, uu = rod[6], rod[7]
    f0, f1, f2, f3, f4, f5 = f[0], f[1], f[2], f[3], f[4], f[5]
    f6, f7, f8, f9, f10, f11 = f[6], f[7], f[8], f[9], f[10], f[11]
    g0, g1, g2, g3, g4, g5 = g[0], g[1], g[2], g[3], g[4], g[5]
    g6, g7, g8, g9, g10, g11 = g[6], g[7], g[8], g[9], g[10], g[11]
    for i in range(np.uint64(which[0]), np.uint64(which[1])):
        k = np.uint64(4) * i
        px, py, pz = flat[k], flat[k + np.uint64(1)], flat[k + np.uint64(2)]
        cx = f0 * px + f1 * py + f2 * pz + f9
        cy = f3 * px + f4 * py + f5 * pz + f10
        cz = f6 * px + f7 * py + f8 * pz + f11
        vx = g0 * px + g1 * py + g2 * pz + g9 - cx
        vy = g3 * px + g4 * py + g5 * pz + g10 - cy
        vz = g6 * px + g7 * py + g8 * pz + g11 - cz
        vv = vx * vx + vy * vy + vz * vz
        wx, wy, wz = rx - cx, ry - cy, rz - cz
        uw = ux * wx + uy * wy + uz * wz
        vw = vx * wx + vy * wy + vz * wz
        uv = ux * vx + uy * vy + uz * vz
        det = uu * vv - uv * uv
        s = min(1.0, max(0.0, (uv * vw - uw * vv) / det)) if det > 0.0 else 0.0
        t = (uv * s + vw) / vv if vv > 0.0 else 0.0
        beyond = t < 0.0 or t > 1.0 or not vv > 0.0
        end = min(1.0, max(0.0, t))
        at_end = min(1.0, max(0.0, (uv * end - uw) / uu))
        s = at_end if beyond and uu > 0.0 else s
        t = end if beyond else t
        dx = wx + s * ux - t * vx
        dy = wy + s * uy - t * vy
        dz = wz + s * uz - t * vz
        gap[i] = math.sqrt(dx * dx + dy * dy + dz * dz) - radius


@njit(**INNER)
def line_distance(solids, k, a, c, keep):
    """Return what the line from a to c has to spare beyond `keep` from solid k [m].

    Three numbers each. Of a capsule it is exact, of others a bound from below.
    """
    (ax, ay, az), (cx, cy, cz) = a, c
    if solids.kind[k] == CAPSULE:
        row = solids.rows[k]
        d2 = segments_distance2(
            (row[0], row[1], row[2]),
            (row[3], row[4], row[5]),
            row[7],
            (ax, ay, az),
            (cx - ax, cy - ay, cz - az),
        )
        return math.sqrt(d2) - row[6] - keep
    half = 0.5 * math.sqrt((cx - ax) ** 2 + (cy - ay) ** 2 + (cz - az) ** 2)
    mx, my, mz = 0.5 * (ax + cx), 0.5 * (ay + cy), 0.5 * (az + cz)
    need = keep + half + NEAR
    d = solid_distance(solids, k, mx, my, mz, need) - keep - half
    if d >= 2.0 * LEAST or not chord_keeps(solids, k, a, c, keep + 2.0 * LEAST):
        return d
    return 2.0 * LEAST


@njit(**INNER)
def displaced(rows, kinds, count, solids):
    """Bound how far any place of the shapes is from where its shape was before [m].

    `rows` (k, 19) are the `count` shapes before, of `kinds`. Infinite where there are
    more or fewer shapes now, others, or a mesh.
    """
    if count != solids.count[0]:
        return math.inf
    most = 0.0
    for k in range(count):
        kind = solids.kind[k]
        if kind != kinds[k]:
            return math.inf
        if kind == CAPSULE:
            moved = rod_displaced(rows[k], solids.rows[k])
        elif kind == CYLINDER:
            moved = cylinder_displaced(rows[k], solids.rows[k])
        elif kind == BOX:
            moved = box_displaced(rows[k], solids.rows[k])
        else:
            return math.inf
        if not moved <= most:  # a NaN stays one
            most = moved
    return most


@njit(**INNER)
def apart(a, b, first, last):
    """Return the distance of two places: numbers first to last - 1 of two rows."""
    total = 0.0
    for j in range(first, last):
        total += (a[j] - b[j]) ** 2
    return math.sqrt(total)


@njit(**INNER)
def rod_displaced(old, new):
    """Bound the displacement of a capsule's places: an end's, and what it grew by."""
    first = apart(old, new, 0, 3)
    total = 0.0
    for j in range(3):
        total += (new[j] + new[3 + j] - old[j] - old[3 + j]) ** 2
    return max(first, math.sqrt(total)) + max(0.0, new[6] - old[6])


@njit(**INNER)
def cylinder_displaced(old, new):
    """Bound the displacement of a cylinder's places; its axis turns rim and ends."""
    turned = apart(old, new, 3, 6) * (new[6] + new[7])
    grown = max(0.0, new[6] - old[6]) + max(0.0, new[7] - old[7])
    return apart(old, new, 0, 3) + turned + grown


@njit(**INNER)
def box_displaced(old, new):
    """Bound the displacement of a box's places; its rotation turns the corners."""
    half2 = new[12] * new[12] + new[13] * new[13] + new[14] * new[14]
    turned = apart(old, new, 3, 12) * math.sqrt(half2)
    grown = 0.0
    for j in range(12, 15):
        grown += max(0.0, new[j] - old[j]) ** 2
    return apart(old, new, 0, 3) + turned + math.sqrt(grown)
