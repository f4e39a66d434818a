"""Distances of convex solids with a certificate: GJK that returns both bounds.

A convex is a core (points, or a cylinder) grown by a margin: spheres and capsules are
one and two points with a margin. [Gil1988] walks the Minkowski difference A - B: the
simplex gives an upper bound, and every support point a lower bound that holds whatever
the simplex looks like, since all of A - B lies beyond that plane.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import FULL, FULL_INNER, INNER, LEAN

POINTS, ROUND = 0, 1  # kinds of core
MAX_STEPS = 200
# bounds closer than this [m] are equal for us
TIGHT = 1e-10


class Convexes(NamedTuple):
    """Convex solids, each in its own frame."""

    kind: np.ndarray  # (n,) POINTS or ROUND
    ptr: np.ndarray  # (n + 1,) points of a core
    points: np.ndarray  # (N, 3)
    size: np.ndarray  # (n, 2) radius and half length along z of a ROUND core
    margin: np.ndarray  # (n,) what the core is grown by [m]
    ball: np.ndarray  # (n, 4) centre and radius of a ball around the solid
    owner: np.ndarray  # (n,) body of a robot, shape of an obstacle


@njit(**INNER)
def point_at(f, p):
    """Return where pose f (12,) has a point p (>= 3,)."""
    x = f[0] * p[0] + f[1] * p[1] + f[2] * p[2] + f[9]
    y = f[3] * p[0] + f[4] * p[1] + f[5] * p[2] + f[10]
    z = f[6] * p[0] + f[7] * p[1] + f[8] * p[2] + f[11]
    return x, y, z


@njit(**INNER)
def compose(f, g, out):
    """Write the product of poses f and g (12,) to out, which is neither."""
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = (
                f[3 * i] * g[j] + f[3 * i + 1] * g[3 + j] + f[3 * i + 2] * g[6 + j]
            )
        out[9 + i] = (
            f[3 * i] * g[9] + f[3 * i + 1] * g[10] + f[3 * i + 2] * g[11] + f[9 + i]
        )


@njit(**INNER)
def support(set_, i, frame, dx, dy, dz, out):
    """Write the point of core i, placed by `frame` (12,), that is farthest along d."""
    x = frame[0] * dx + frame[3] * dy + frame[6] * dz
    y = frame[1] * dx + frame[4] * dy + frame[7] * dz
    z = frame[2] * dx + frame[5] * dy + frame[8] * dz
    if set_.kind[i] == ROUND:
        across = math.sqrt(x * x + y * y)
        px, py = 0.0, 0.0
        if across > 0.0:
            px, py = set_.size[i, 0] * x / across, set_.size[i, 0] * y / across
        pz = set_.size[i, 1] if z >= 0.0 else -set_.size[i, 1]
    else:
        best, at = -np.inf, set_.ptr[i]
        for k in range(set_.ptr[i], set_.ptr[i + 1]):
            p = set_.points[k]
            value = p[0] * x + p[1] * y + p[2] * z
            if value > best:
                best, at = value, k
        px, py, pz = set_.points[at, 0], set_.points[at, 1], set_.points[at, 2]
    out[0] = frame[0] * px + frame[1] * py + frame[2] * pz + frame[9]
    out[1] = frame[3] * px + frame[4] * py + frame[5] * pz + frame[10]
    out[2] = frame[6] * px + frame[7] * py + frame[8] * pz + frame[11]


@njit(**INNER)
def near_edge(w, i, j, v):
    """Write to v the point of edge (i, j) nearest to 0 if it is inside; say whether."""
    ab, ax = 0.0, 0.0
    for c in range(3):
        e = w[j, c] - w[i, c]
        ab += e * e
        ax -= w[i, c] * e
    if ab <= 0.0 or ax < 0.0 or ax > ab:
        return False
    t = ax / ab
    for c in range(3):
        v[c] = w[i, c] + t * (w[j, c] - w[i, c])
    return True


@njit(**INNER)
def near_face(w, i, j, k, v):
    """Write to v the point of face (i, j, k) nearest to 0 if inside; say whether."""
    e11, e12, e22, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        p, q = w[j, c] - w[i, c], w[k, c] - w[i, c]
        e11 += p * p
        e12 += p * q
        e22 += q * q
        b1 -= w[i, c] * p
        b2 -= w[i, c] * q
    det = e11 * e22 - e12 * e12
    if det <= 1e-14 * e11 * e22:
        return False
    s = (b1 * e22 - b2 * e12) / det
    t = (b2 * e11 - b1 * e12) / det
    if s < 0.0 or t < 0.0 or s + t > 1.0:
        return False
    for c in range(3):
        v[c] = w[i, c] + s * (w[j, c] - w[i, c]) + t * (w[k, c] - w[i, c])
    return True


@njit(**INNER)
def side(w, i, j, k, p):
    """Return which side of plane (i, j, k) row p lies on, and where 0 lies (signed)."""
    ax, ay, az = w[j, 0] - w[i, 0], w[j, 1] - w[i, 1], w[j, 2] - w[i, 2]
    bx, by, bz = w[k, 0] - w[i, 0], w[k, 1] - w[i, 1], w[k, 2] - w[i, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    at_p = nx * (w[p, 0] - w[i, 0]) + ny * (w[p, 1] - w[i, 1])
    at_p += nz * (w[p, 2] - w[i, 2])
    at_0 = -(nx * w[i, 0] + ny * w[i, 1] + nz * w[i, 2])
    return at_p, at_0


@njit(**INNER)
def holds_origin(w):
    """Say whether 0 lies in the tetrahedron of the four rows of w.

    In a flat one, as two parallel edges make it, all signs are rounding. So the rows
    must add up to 0, too, weighted by what the signs claim: that proves a contact.
    """
    x, y, z, total = 0.0, 0.0, 0.0, 0.0
    for p in range(4):
        i, j, k = (p + 1) % 4, (p + 2) % 4, (p + 3) % 4
        at_p, at_0 = side(w, i, j, k, p)
        if at_p == 0.0 or at_p * at_0 < 0.0:
            return False
        weight = at_0 / at_p
        x += weight * w[p, 0]
        y += weight * w[p, 1]
        z += weight * w[p, 2]
        total += weight
    # not `<=`: where all weights are 0, nothing is proved
    return math.sqrt(x * x + y * y + z * z) < TIGHT * total


@njit(**INNER)
def keep_if_nearer(rows, n, v, best, kept, v_best):
    """Keep the face `rows[:n]` with its nearest point v if that is the nearest yet."""
    size = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if size >= best:
        return best
    for r in range(4):
        kept[r] = rows[r] if r < n else -1
    copy_row(v, v_best)
    return size


@njit(**FULL_INNER)
def reduce_simplex(w, n, v_best):
    """Keep the smallest face of the simplex nearest to 0; return its number of rows.

    All faces are tried, so that a flat or repeated simplex costs no correctness.
    Returns 0 when the simplex holds 0.
    """
    if n == 4 and holds_origin(w):
        return 0
    kept = np.full(4, -1)
    rows = np.full(4, -1)
    v = np.empty(3)
    best = np.inf
    for i in range(n):
        rows[0] = i
        copy_row(w[i], v)
        best = keep_if_nearer(rows, 1, v, best, kept, v_best)
        for j in range(i):
            rows[1] = j
            if near_edge(w, j, i, v):
                best = keep_if_nearer(rows, 2, v, best, kept, v_best)
            for k in range(j):
                rows[2] = k
                if near_face(w, k, j, i, v):
                    best = keep_if_nearer(rows, 3, v, best, kept, v_best)
    new = np.empty((3, 3))
    m = 0
    for r in range(3):
        if kept[r] >= 0:
            copy_row(w[kept[r]], new[m])
            m += 1
    for r in range(m):
        copy_row(new[r], w[r])
    return m


@njit(**INNER)
def square_up(w, n, v):
    """Set v across the face of the n rows of w, freed of rounding; say whether it is.

    The nearest point of a long thin face is rounded so much that it is not square to
    it; a bound along it is then too low by the length of the solids times that angle.
    """
    if n < 2:
        return False
    ax, ay, az = w[1, 0] - w[0, 0], w[1, 1] - w[0, 1], w[1, 2] - w[0, 2]
    if n == 2:
        bx, by, bz = ay * v[2] - az * v[1], az * v[0] - ax * v[2], ax * v[1] - ay * v[0]
    else:
        bx, by, bz = w[2, 0] - w[0, 0], w[2, 1] - w[0, 1], w[2, 2] - w[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size == 0.0:
        return False
    if nx * v[0] + ny * v[1] + nz * v[2] < 0.0:
        size = -size
    v[0], v[1], v[2] = nx / size, ny / size, nz / size
    return True


@njit(**FULL)
def core_distance(a, i, frame_a, b, j, frame_b, enough):
    """Return bounds (lower, upper) on the distance of two cores [m]; (0, 0): contact.

    Stops early once the lower bound reaches `enough`; the upper one is then loose.
    """
    return core_between(a, i, frame_a, b, j, frame_b, enough, np.empty(3))


@njit(**FULL_INNER)
def core_between(a, i, frame_a, b, j, frame_b, enough, v):
    """Return what `core_distance` does; v (3,) out: a way from core j to core i."""
    w = np.empty((4, 3))
    pa, pb = np.empty(3), np.empty(3)
    for c in range(3):
        v[c] = 1.0 if c == 0 else 0.0
    n, low, high, last = 0, 0.0, np.inf, False
    for _ in range(MAX_STEPS):
        support(a, i, frame_a, -v[0], -v[1], -v[2], pa)
        support(b, j, frame_b, v[0], v[1], v[2], pb)
        along = 0.0
        for c in range(3):
            w[n, c] = pa[c] - pb[c]
            along += v[c] * w[n, c]
        low = max(low, along / math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2))
        if last or low >= high - TIGHT or low >= enough:
            break
        n = reduce_simplex(w, n + 1, v)
        size = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
        if n == 0 or size < 1e-12:
            return 0.0, 0.0
        if size < high:
            high = size
        elif square_up(w, n, v):  # rounding: no progress left but in the direction
            last = True
        else:
            break
    return min(low, high), high


@njit(**INNER)
def ball_gap(a, i, frame_a, b, j, frame_b):
    """Return a lower bound on the distance of two convexes by their balls [m]."""
    total = 0.0
    for c in range(3):
        at = frame_a[9 + c] - frame_b[9 + c]
        for k in range(3):
            at += frame_a[3 * c + k] * a.ball[i, k] - frame_b[3 * c + k] * b.ball[j, k]
        total += at * at
    return math.sqrt(total) - a.ball[i, 3] - b.ball[j, 3]


@njit(**LEAN)
def nearest_pair(a, use_a, frames_a, b, frames_b, cap, found):
    """Return the smallest distance of two sets of convexes, and how sure it is [m].

    Of those of the robot that `use_a` (n,) selects and all of the obstacles, at poses
    `frames_a` (n, 12) and `frames_b` (m, 12). Distances beyond `cap` are not resolved:
    the answer is at most that. `found` (2,) gets the two indices, -1 for none.

    Returns:
        A lower bound, and the gap to the upper bound of that pair. At most 0 where
        solids touch (cores that overlap count as 0 minus their margins).
    """
    best, gap = cap, 0.0
    found[0], found[1] = -1, -1
    for i in range(a.kind.shape[0]):
        if not use_a[i]:
            continue
        for j in range(b.kind.shape[0]):
            if ball_gap(a, i, frames_a[i], b, j, frames_b[j]) >= best:
                continue
            margin = a.margin[i] + b.margin[j]
            low, high = core_distance(
                a, i, frames_a[i], b, j, frames_b[j], best + margin
            )
            if low - margin < best:
                best, gap = low - margin, high - low
                found[0], found[1] = i, j
    return best, gap


@njit(**LEAN)
def nearest_between(a, frames, one, other, cap, found):
    """Return distance and gap of the convexes of two owners; see nearest_pair."""
    best, gap = cap, 0.0
    found[0], found[1] = -1, -1
    for i in range(a.kind.shape[0]):
        if a.owner[i] != one:
            continue
        for j in range(a.kind.shape[0]):
            if a.owner[j] != other:
                continue
            if ball_gap(a, i, frames[i], a, j, frames[j]) >= best:
                continue
            margin = a.margin[i] + a.margin[j]
            low, high = core_distance(a, i, frames[i], a, j, frames[j], best + margin)
            if low - margin < best:
                best, gap = low - margin, high - low
                found[0], found[1] = i, j
    return best, gap
