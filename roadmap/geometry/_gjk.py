"""Distance of two convex point sets [GJK1988], with a certified lower bound.

Whatever the iteration does, `separation` returns a true lower bound: for any
direction v, all points of A - B have x.v >= min(x.v), so that none is nearer to the
origin than min(x.v) / |v|. Points stay in their body frame; directions are turned.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER
from roadmap.kinematics._forward import place_of, turned_back


class Shell(NamedTuple):
    """A convex set of points on a body."""

    begin: int  # first row of its points
    end: int  # row behind the last one
    frame: np.ndarray  # (12,) pose of its body


@njit(**INNER)
def separation(points, a, b, v, need, s):
    """Bound the distance between two shells from below and above.

    Stops as soon as the distance is known to be at least `need`, or known to be less.

    points: (n, 3) vertices, each in its body frame. a, b: the shells. v: (3,) direction
    from B to A to start with; gets the best one. need: distance asked for [m]. s:
    (16, 3) scratch.

    Returns:
        (lower, upper) [m]; lower is negative where no gap is proved, upper is 0 in
        contact.
    """
    vx, vy, vz = v[0], v[1], v[2]
    length = math.sqrt(vx * vx + vy * vy + vz * vz)
    if not length > 1e-12:
        vx, vy, vz, length = 1.0, 0.0, 0.0, 1.0
    lower, upper = -1.0, 1e300
    n = 0
    for _ in range(32):
        # the point of A - B farthest against v
        _support(points, a, -vx, -vy, -vz, s[4])
        _support(points, b, vx, vy, vz, s[5])
        wx, wy, wz = s[4, 0] - s[5, 0], s[4, 1] - s[5, 1], s[4, 2] - s[5, 2]
        ahead = (vx * wx + vy * wy + vz * wz) / length
        if ahead > lower:
            lower = ahead
            v[0], v[1], v[2] = vx, vy, vz
        if lower >= need or upper < need or upper - ahead <= 1e-9:
            break
        s[n, 0], s[n, 1], s[n, 2] = wx, wy, wz
        n = _nearest(s, n + 1)
        vx, vy, vz = s[4, 0], s[4, 1], s[4, 2]
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        if n == 4 or length < 1e-9:
            return lower, 0.0
        if length >= upper:
            break
        upper = length
    return lower, upper


@njit(**INNER)
def _support(points, shell, dx, dy, dz, out):
    """Write the shell's world point that is farthest along (dx, dy, dz) to out."""
    x, y, z = turned_back(shell.frame, dx, dy, dz)
    best, which = -1e300, shell.begin
    for i in range(shell.begin, shell.end):
        d = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z
        if d > best:
            best, which = d, i
    out[0], out[1], out[2] = place_of(shell.frame, points[which])


@njit(**INNER)
def along(points, shell, dx, dy, dz):
    """Return how far a shell reaches along the world direction (dx, dy, dz)."""
    f = shell.frame
    x, y, z = turned_back(f, dx, dy, dz)
    best = other = -1e300
    n = (shell.end - shell.begin) // 2 * 2
    for i in range(shell.begin, shell.begin + n, 2):
        d = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z
        e = points[i + 1, 0] * x + points[i + 1, 1] * y + points[i + 1, 2] * z
        best, other = max(best, d), max(other, e)
    for i in range(shell.begin + n, shell.end):
        best = max(best, points[i, 0] * x + points[i, 1] * y + points[i, 2] * z)
    return max(best, other) + f[9] * dx + f[10] * dy + f[11] * dz


@njit(**INNER)
def _nearest(s, n):
    """Reduce the simplex s[:n] to the part nearest to the origin; return its size.

    The nearest point goes to s[4]. Size 4 means that the simplex holds the origin.
    """
    if n == 1:
        _copy(s, 0, 4)
        return 1
    if n == 2:
        return _nearest_on_segment(s)
    if n == 3:
        return _nearest_on_triangle(s)
    return _nearest_on_tetrahedron(s)


@njit(**INNER)
def _dot(s, i, j):
    return s[i, 0] * s[j, 0] + s[i, 1] * s[j, 1] + s[i, 2] * s[j, 2]


@njit(**INNER)
def _copy(s, i, j):
    s[j, 0], s[j, 1], s[j, 2] = s[i, 0], s[i, 1], s[i, 2]


@njit(**INNER)
def _nearest_on_segment(s):
    aa, ab, bb = _dot(s, 0, 0), _dot(s, 0, 1), _dot(s, 1, 1)
    along, whole = aa - ab, aa - 2.0 * ab + bb
    if along <= 0.0 or whole <= 0.0:
        _copy(s, 0, 4)
        return 1
    if along >= whole:
        _copy(s, 1, 0)
        _copy(s, 0, 4)
        return 1
    t = along / whole
    for k in range(3):
        s[4, k] = s[0, k] + t * (s[1, k] - s[0, k])
    return 2


@njit(**INNER)
def _nearest_on_triangle(s):
    """Reduce a triangle by its Voronoi regions [Ericson2005], section 5.1.5."""
    aa, bb, cc = _dot(s, 0, 0), _dot(s, 1, 1), _dot(s, 2, 2)
    ab, ac, bc = _dot(s, 0, 1), _dot(s, 0, 2), _dot(s, 1, 2)
    d1, d2, d3, d4, d5, d6 = aa - ab, aa - ac, ab - bb, ab - bc, ac - bc, ac - cc
    if d1 <= 0.0 and d2 <= 0.0:
        _copy(s, 0, 4)
        return 1
    if d3 >= 0.0 and d4 <= d3:
        _copy(s, 1, 0)
        _copy(s, 0, 4)
        return 1
    if d6 >= 0.0 and d5 <= d6:
        _copy(s, 2, 0)
        _copy(s, 0, 4)
        return 1
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _nearest_on_segment(s)
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        _copy(s, 2, 1)
        return _nearest_on_segment(s)
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        _copy(s, 2, 0)
        return _nearest_on_segment(s)
    whole = va + vb + vc
    for k in range(3):
        s[4, k] = (va * s[0, k] + vb * s[1, k] + vc * s[2, k]) / whole
    return 3


@njit(**INNER)
def _nearest_on_tetrahedron(s):
    """Reduce a tetrahedron to the nearest part of a face that the origin is beyond."""
    for i in range(4):
        _copy(s, i, 6 + i)
    best, size = 1e300, 4
    for i in range(4):
        # the face without vertex i
        for k in range(3):
            _copy(s, 6 + (i + 1 + k) % 4, k)
        if not _beyond(s, 6 + i):
            continue
        n = _nearest_on_triangle(s)
        square = _dot(s, 4, 4)
        if square < best:
            best, size = square, n
            for k in range(5):
                _copy(s, k, 10 + k)
    if size < 4:
        for k in range(5):
            _copy(s, 10 + k, k)
    return size


@njit(**INNER)
def _beyond(s, apex):
    """Say if the plane of s[:3] parts the origin from s[apex]; True when flat."""
    ux, uy, uz = s[1, 0] - s[0, 0], s[1, 1] - s[0, 1], s[1, 2] - s[0, 2]
    vx, vy, vz = s[2, 0] - s[0, 0], s[2, 1] - s[0, 1], s[2, 2] - s[0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    here = -(nx * s[0, 0] + ny * s[0, 1] + nz * s[0, 2])
    there = nx * s[apex, 0] + ny * s[apex, 1] + nz * s[apex, 2] + here
    # flat up to 1e-9 of the face's size: no side can be told
    if there * there <= 1e-18 * (nx * nx + ny * ny + nz * nz):
        return True
    return here * there < 0.0
