"""Forward kinematics and motion bounds over the arrays of a Robot."""

import math

from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN


@njit(**LEAN)
def body_frames(tree_i, tree_f, q, frames):
    """Write T_base_body of every body to `frames` (n, 12): rotation (9), origin (3)."""
    n_bodies = tree_i.shape[0]
    for b in range(n_bodies):
        f = tree_f[b]
        out = frames[b]
        parent = tree_i[b, 0]
        if parent < 0:
            for k in range(12):
                out[k] = f[k]
            continue
        up = frames[parent]
        px, py, pz = f[9], f[10], f[11]
        kind = tree_i[b, 2]
        value = 0.0
        if kind != 0:
            value = f[15] * q[tree_i[b, 1]] + f[16]
        if kind == 2:
            # the slide is along the axis seen in the joint frame
            sx = value * (f[0] * f[12] + f[1] * f[13] + f[2] * f[14])
            sy = value * (f[3] * f[12] + f[4] * f[13] + f[5] * f[14])
            sz = value * (f[6] * f[12] + f[7] * f[13] + f[8] * f[14])
            px, py, pz = px + sx, py + sy, pz + sz
        out[9] = up[0] * px + up[1] * py + up[2] * pz + up[9]
        out[10] = up[3] * px + up[4] * py + up[5] * pz + up[10]
        out[11] = up[6] * px + up[7] * py + up[8] * pz + up[11]
        if kind != 1:
            for i in range(3):
                for j in range(3):
                    out[3 * i + j] = (
                        up[3 * i] * f[j]
                        + up[3 * i + 1] * f[3 + j]
                        + up[3 * i + 2] * f[6 + j]
                    )
            continue
        c, s = math.cos(value), math.sin(value)
        v = 1.0 - c
        ax, ay, az = f[12], f[13], f[14]
        r00, r01, r02 = c + v * ax * ax, v * ax * ay - s * az, v * ax * az + s * ay
        r10, r11, r12 = v * ax * ay + s * az, c + v * ay * ay, v * ay * az - s * ax
        r20, r21, r22 = v * ax * az - s * ay, v * ay * az + s * ax, c + v * az * az
        for i in range(3):
            a = up[3 * i] * f[0] + up[3 * i + 1] * f[3] + up[3 * i + 2] * f[6]
            d = up[3 * i] * f[1] + up[3 * i + 1] * f[4] + up[3 * i + 2] * f[7]
            e = up[3 * i] * f[2] + up[3 * i + 1] * f[5] + up[3 * i + 2] * f[8]
            out[3 * i] = a * r00 + d * r10 + e * r20
            out[3 * i + 1] = a * r01 + d * r11 + e * r21
            out[3 * i + 2] = a * r02 + d * r12 + e * r22


@njit(**INNER)
def place_of(f, p):
    """Return where a body with frame f (12,) has its point p (>= 3,), three numbers."""
    x = f[0] * p[0] + f[1] * p[1] + f[2] * p[2] + f[9]
    y = f[3] * p[0] + f[4] * p[1] + f[5] * p[2] + f[10]
    z = f[6] * p[0] + f[7] * p[1] + f[8] * p[2] + f[11]
    return x, y, z


@njit(**INNER)
def turned(f, x, y, z):
    """Return a direction of a body with frame f (12,) in the world, three numbers."""
    wx = f[0] * x + f[1] * y + f[2] * z
    wy = f[3] * x + f[4] * y + f[5] * z
    wz = f[6] * x + f[7] * y + f[8] * z
    return wx, wy, wz


@njit(**INNER)
def turned_back(f, x, y, z):
    """Return a direction of the world as a body with frame f (12,) sees it."""
    bx = f[0] * x + f[3] * y + f[6] * z
    by = f[1] * x + f[4] * y + f[7] * z
    bz = f[2] * x + f[5] * y + f[8] * z
    return bx, by, bz


@njit(**LEAN)
def place_points(frames, point_body, points, out):
    """Write base-frame positions of body-fixed `points` (n, >=3) to `out` (n, 3)."""
    for i in range(points.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = place_of(frames[point_body[i]], points[i])


@njit(**LEAN)
def motion_bounds(tree_i, tree_f, reach, dq, rates, first, second):
    """Bound |p'| and |p''| of points p while q moves along `dq`.

    For point i with axis distances `reach[i]`, over the unit interval of t in
    q(t) = q + t dq: |p'(t)| <= first[i], |p''(t)| <= second[i]. The mixed derivative
    for joints j before k is z_j x (z_k x (p - o_k)), at most the distance of p from
    axis k; a slide has no derivative by what comes after it. `rates` (2, n_bodies)
    is work space.
    """
    n_bodies = tree_i.shape[0]
    for k in range(n_bodies):
        rates[0, k] = 0.0
        rates[1, k] = 0.0
        kind = tree_i[k, 2]
        if kind == 0:
            continue
        w = abs(tree_f[k, 15] * dq[tree_i[k, 1]])
        before = 0.0
        j = tree_i[k, 0]
        while j > 0:
            if tree_i[j, 2] == 1:
                before += abs(tree_f[j, 15] * dq[tree_i[j, 1]])
            j = tree_i[j, 0]
        rates[0, k] = w
        rates[1, k] = 2.0 * w * before + (w * w if kind == 1 else 0.0)
    for i in range(reach.shape[0]):
        speed = 0.0
        bend = 0.0
        for k in range(n_bodies):
            speed += rates[0, k] * reach[i, k]
            bend += rates[1, k] * reach[i, k]
        first[i] = speed
        second[i] = bend
