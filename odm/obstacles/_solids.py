"""Shapes of a frame as solids: exact signed distances, and the least along a chord.

All shapes are convex, so the signed distance (below 0 inside) is a convex function of
the place, and its tangents bound it from below. A chord is free of a shape when the
tangents at a few of its places prove it; where they do not, it is not free.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm._groups import FRAME, array
from roadmap.compiling.jit_options import INNER

CAPSULE, BOX, CYLINDER, MESH = 0, 1, 2, 3
MOST_CUTS = 48  # tangents of a chord; what they leave open is taken for too near
_FLAT = 1e-9  # [m] so near to a surface the planes and the rim alone tell the distance


class Solids(NamedTuple):
    """Shapes in the base frame, as the close test takes them.

    A row holds, of a capsule (also a sphere): end a, b - a, radius, |b - a|^2; of a
    box: centre, rotation (row by row), half sizes; of a cylinder: centre, unit axis,
    radius, half length; of a mesh: origin, rotation, first and last face, then centre
    and radius of a ball around it, and which of the meshes it is. A face
    holds outward normal, offset and three corners, in the mesh's own frame.
    """

    rows: np.ndarray = array("f8", "shapes 19", FRAME)
    kind: np.ndarray = array("i8", "shapes", FRAME)
    count: np.ndarray = array("i8", "1", FRAME)  # type: ignore[assignment]  # hides tuple's
    faces: np.ndarray = array("f8", "faces 13", FRAME)


@njit(**INNER)
def solid_gap(solids, k, x, y, z, enough):
    """Return (d, gx, gy, gz): signed distance of a point from solid k, and a tangent.

    For every point p of space, the distance there is at least d + g . (p - (x, y, z)).
    Of a mesh, d may be less than the distance where it is at least `enough`.
    """
    kind = solids.kind[k]
    row = solids.rows[k]
    if kind == CAPSULE:
        return capsule_gap(row, x, y, z)
    if kind == BOX:
        return box_gap(row, x, y, z)
    if kind == CYLINDER:
        return cylinder_gap(row, x, y, z)
    return mesh_gap(row, solids.faces, x, y, z, enough)


@njit(**INNER)
def solid_distance(solids, k, x, y, z, enough):
    """Return the signed distance of a point from solid k; see `solid_gap`."""
    if solids.kind[k] == CAPSULE:
        return rod_distance(rod_of(solids.rows[k]), x, y, z)
    return solid_gap(solids, k, x, y, z, enough)[0]


@njit(**INNER)
def inner_radius(solids, k):
    """Return a radius that no ball inside solid k is larger than."""
    row, kind = solids.rows[k], solids.kind[k]
    if kind == BOX:
        return min(row[12], min(row[13], row[14]))
    if kind == CYLINDER:
        return min(row[6], row[7])
    return row[17] if kind == MESH else row[6]


@njit(**INNER)
def rod_of(row):
    """Return what `rod_distance` takes of a capsule's row."""
    return row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7]


@njit(**INNER)
def rod_distance(rod, x, y, z):
    """Return the signed distance of a point from a capsule."""
    ax, ay, az, ux, uy, uz, radius, length2 = rod
    wx, wy, wz = x - ax, y - ay, z - az
    s = 0.0
    if length2 > 0.0:
        s = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) / length2))
    dx, dy, dz = wx - s * ux, wy - s * uy, wz - s * uz
    return math.sqrt(dx * dx + dy * dy + dz * dz) - radius


@njit(**INNER)
def capsule_gap(row, x, y, z):
    """Return distance and tangent of a point from a capsule."""
    wx, wy, wz = x - row[0], y - row[1], z - row[2]
    s = 0.0
    if row[7] > 0.0:
        s = (wx * row[3] + wy * row[4] + wz * row[5]) / row[7]
        s = min(1.0, max(0.0, s))
    dx, dy, dz = wx - s * row[3], wy - s * row[4], wz - s * row[5]
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    if d < 1e-9:
        return d - row[6], 0.0, 0.0, 0.0  # the axis is where it is least
    return d - row[6], dx / d, dy / d, dz / d


@njit(**INNER)
def box_gap(row, x, y, z):
    """Return distance and tangent of a point from a box."""
    ux, uy, uz = x - row[0], y - row[1], z - row[2]
    total = 0.0
    best, best_axis, best_sign = -math.inf, 0, 1.0
    gx = gy = gz = 0.0
    for a in range(3):
        # the box's axis a is column a of its rotation
        rx, ry, rz = row[3 + a], row[6 + a], row[9 + a]
        along = rx * ux + ry * uy + rz * uz
        sign = 1.0 if along >= 0.0 else -1.0
        over = abs(along) - row[12 + a]
        if over > best:
            best, best_axis, best_sign = over, a, sign
        if over > 0.0:
            total += over * over
            gx += sign * over * rx
            gy += sign * over * ry
            gz += sign * over * rz
    if best < _FLAT:
        a, s = best_axis, best_sign
        return best, s * row[3 + a], s * row[6 + a], s * row[9 + a]
    d = math.sqrt(total)
    return d, gx / d, gy / d, gz / d


@njit(**INNER)
def cylinder_gap(row, x, y, z):
    """Return distance and tangent of a point from a cylinder."""
    ux, uy, uz = x - row[0], y - row[1], z - row[2]
    ax, ay, az = row[3], row[4], row[5]
    along = ux * ax + uy * ay + uz * az
    sx, sy, sz = ux - along * ax, uy - along * ay, uz - along * az
    side = math.sqrt(sx * sx + sy * sy + sz * sz)
    sign = 1.0 if along >= 0.0 else -1.0
    out, up = side - row[6], abs(along) - row[7]
    if side > 1e-9:
        sx, sy, sz = sx / side, sy / side, sz / side
    else:
        sx = sy = sz = 0.0  # on the axis, where the distance from it is least
    if out < _FLAT and up < _FLAT:
        if out > up:
            return out, sx, sy, sz
        return up, sign * ax, sign * ay, sign * az
    out, up = max(out, 0.0), max(up, 0.0)
    d = math.sqrt(out * out + up * up)
    u, v = out / d, sign * up / d
    return d, u * sx + v * ax, u * sy + v * ay, u * sz + v * az


@njit(**INNER)
def mesh_gap(row, faces, x, y, z, enough):
    """Return distance and tangent of a point from a convex mesh.

    A ball around it and the planes of its faces bound the distance from below: where
    that is `enough`, it is what is returned.
    """
    bx, by, bz = x - row[14], y - row[15], z - row[16]
    ball = math.sqrt(bx * bx + by * by + bz * bz)
    if ball - row[17] >= enough and ball > _FLAT:
        return ball - row[17], bx / ball, by / ball, bz / ball
    ux, uy, uz = x - row[0], y - row[1], z - row[2]
    lx = row[3] * ux + row[6] * uy + row[9] * uz
    ly = row[4] * ux + row[7] * uy + row[10] * uz
    lz = row[5] * ux + row[8] * uy + row[11] * uz
    best, at = -math.inf, 0
    for f in range(int(row[12]), int(row[13])):
        face = faces[f]
        over = face[0] * lx + face[1] * ly + face[2] * lz - face[3]
        if over > best:
            best, at = over, f
    d, nx, ny, nz = best, faces[at, 0], faces[at, 1], faces[at, 2]
    if best >= _FLAT and best < enough:
        d = math.inf
        for f in range(int(row[12]), int(row[13])):
            face = faces[f]
            if face[0] * lx + face[1] * ly + face[2] * lz - face[3] <= 0.0:
                continue  # turned away: the nearest place is on another face, too
            px, py, pz = triangle_place(face, lx, ly, lz)
            px, py, pz = lx - px, ly - py, lz - pz
            here = math.sqrt(px * px + py * py + pz * pz)
            if here < d:
                d = here
                nx, ny, nz = px / here, py / here, pz / here
    gx = row[3] * nx + row[4] * ny + row[5] * nz
    gy = row[6] * nx + row[7] * ny + row[8] * nz
    gz = row[9] * nx + row[10] * ny + row[11] * nz
    return d, gx, gy, gz


@njit(**INNER)
def triangle_place(face, x, y, z):
    """Return the place of a triangle that is nearest to a point above its plane."""
    ax, ay, az = face[4], face[5], face[6]
    bx, by, bz = face[7] - ax, face[8] - ay, face[9] - az
    cx, cy, cz = face[10] - ax, face[11] - ay, face[12] - az
    px, py, pz = x - ax, y - ay, z - az
    d1 = bx * px + by * py + bz * pz
    d2 = cx * px + cy * py + cz * pz
    bb = bx * bx + by * by + bz * bz
    bc = bx * cx + by * cy + bz * cz
    cc = cx * cx + cy * cy + cz * cz
    det = bb * cc - bc * bc
    if det > 0.0:
        v, w = (cc * d1 - bc * d2) / det, (bb * d2 - bc * d1) / det
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            return ax + v * bx + w * cx, ay + v * by + w * cy, az + v * bz + w * cz
    # the nearest of the three edges
    s = min(1.0, max(0.0, d1 / bb)) if bb > 0.0 else 0.0
    qx, qy, qz = s * bx, s * by, s * bz
    best = (px - qx) ** 2 + (py - qy) ** 2 + (pz - qz) ** 2
    s = min(1.0, max(0.0, d2 / cc)) if cc > 0.0 else 0.0
    ex, ey, ez = s * cx, s * cy, s * cz
    d = (px - ex) ** 2 + (py - ey) ** 2 + (pz - ez) ** 2
    if d < best:
        best, qx, qy, qz = d, ex, ey, ez
    ux, uy, uz = cx - bx, cy - by, cz - bz
    uu = ux * ux + uy * uy + uz * uz
    s = 0.0
    if uu > 0.0:
        s = ((px - bx) * ux + (py - by) * uy + (pz - bz) * uz) / uu
        s = min(1.0, max(0.0, s))
    ex, ey, ez = bx + s * ux, by + s * uy, bz + s * uz
    d = (px - ex) ** 2 + (py - ey) ** 2 + (pz - ez) ** 2
    if d < best:
        qx, qy, qz = ex, ey, ez
    return ax + qx, ay + qy, az + qz


@njit(**INNER)
def segments_distance2(a, u, uu, c, v):
    """Return the squared distance of segments a + s u and c + t v, s, t in [0, 1].

    Three numbers each; `uu` is |u|^2.
    """
    (ax, ay, az), (ux, uy, uz) = a, u
    (cx, cy, cz), (vx, vy, vz) = c, v
    vv = vx * vx + vy * vy + vz * vz
    wx, wy, wz = ax - cx, ay - cy, az - cz
    uw = ux * wx + uy * wy + uz * wz
    vw = vx * wx + vy * wy + vz * wz
    uv = ux * vx + uy * vy + uz * vz
    s = t = 0.0
    if uu > 0.0 and vv > 0.0:
        det = uu * vv - uv * uv
        if det > 0.0:
            s = min(1.0, max(0.0, (uv * vw - uw * vv) / det))
        t = (uv * s + vw) / vv
        if t < 0.0 or t > 1.0:
            t = min(1.0, max(0.0, t))
            s = min(1.0, max(0.0, (uv * t - uw) / uu))
    elif uu > 0.0:
        s = min(1.0, max(0.0, -uw / uu))
    elif vv > 0.0:
        t = min(1.0, max(0.0, vw / vv))
    dx = wx + s * ux - t * vx
    dy = wy + s * uy - t * vy
    dz = wz + s * uz - t * vz
    return dx * dx + dy * dy + dz * dz


@njit(**INNER)
def chord_keeps(solids, k, a, b, need):
    """Return True if all places of the chord a b keep `need` from solid k; proved.

    `a` and `b` are three numbers each. A chord that touches `need` to within rounding
    may be refused.
    """
    (ax, ay, az), (bx, by, bz) = a, b
    ux, uy, uz = bx - ax, by - ay, bz - az
    if solids.kind[k] == CAPSULE:
        row = solids.rows[k]
        far = need + row[6]
        c, v = (row[0], row[1], row[2]), (row[3], row[4], row[5])
        d2 = segments_distance2(c, v, row[7], a, (ux, uy, uz))
        return far <= 0.0 or d2 >= far * far
    low, high = 0.0, 1.0
    d_low, gx, gy, gz = solid_gap(solids, k, ax, ay, az, need)
    if d_low < need:
        return False
    rise_low = gx * ux + gy * uy + gz * uz
    d_high, gx, gy, gz = solid_gap(solids, k, bx, by, bz, need)
    if d_high < need:
        return False
    rise_high = gx * ux + gy * uy + gz * uz
    for _ in range(MOST_CUTS):
        if rise_low >= 0.0 or rise_high <= 0.0:
            return True  # it is least at an end
        # where the tangents at the ends of what is open meet, they bound it from below
        t = d_high - d_low + rise_low * low - rise_high * high
        t = t / (rise_low - rise_high)
        if d_low + rise_low * (t - low) >= need:
            return True
        t = min(high, max(low, t))
        d, gx, gy, gz = solid_gap(
            solids, k, ax + t * ux, ay + t * uy, az + t * uz, need
        )
        if d < need:
            return False
        rise = gx * ux + gy * uy + gz * uz
        if rise < 0.0:
            low, d_low, rise_low = t, d, rise
        else:
            high, d_high, rise_high = t, d, rise
    return False
