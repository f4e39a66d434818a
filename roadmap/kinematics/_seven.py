"""Seven turning joints in closed form, with one angle free: see `seven.py`.

By products of exponentials: the axes stand where all angles are 0, and a tool pose T
is g = e1 e2 ... e7 times the tool's pose there, where ei turns about axis i.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import BARE, BARE_INNER

MOST = 8  # solutions for one value of the free angle


class Seven(NamedTuple):
    """An arm whose first three axes meet in S, and axes five and six in W."""

    axis: np.ndarray  # (7, 3) directions at 0, base frame
    place: np.ndarray  # (7, 3) a point of each axis
    shoulder: np.ndarray  # (3,) S
    wrist: np.ndarray  # (3,) W at 0
    tool: np.ndarray  # (12,) tool pose at 0
    scale: np.ndarray  # (7, 2) angle = scale[0] * q + scale[1]
    limits: np.ndarray  # (7, 2) of q
    round_wrist: bool  # axis seven goes through W, too


class Room(NamedTuple):
    """Working memory of one thread."""

    R: np.ndarray  # (8, 3, 3) rotations, see `aim` and `straighten`
    v: np.ndarray  # (8, 3) vectors
    three: np.ndarray  # (2, 2, 3) angles of shoulder and wrist
    q: np.ndarray  # (8, 7) solutions


@njit(**BARE_INNER)
def turn(axis, angle, out):
    """Write the rotation about a unit axis to `out` (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z, v = axis[0], axis[1], axis[2], 1.0 - c
    u, v, w = v * x, v * y, v * z
    out[0, 0], out[0, 1], out[0, 2] = c + u * x, u * y - s * z, u * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = u * y + s * z, c + v * y, v * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = u * z - s * y, v * z + s * x, c + w * z


@njit(**BARE_INNER)
def times(a, b, out):
    """Write a b to `out`, all (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(**BARE_INNER)
def times_back(a, b, out):
    """Write a^T b to `out`, all (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]


@njit(**BARE_INNER)
def apply(a, x, out):
    """Write the vector a x to `out`."""
    for i in range(3):
        out[i] = a[i, 0] * x[0] + a[i, 1] * x[1] + a[i, 2] * x[2]


@njit(**BARE_INNER)
def dot(a, b):
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**BARE_INNER)
def two_angles(p, q, r):
    """Return (n, first, second): the angles with p cos + q sin = r; n: 0 or 2."""
    size = math.sqrt(p * p + q * q)
    if not size > 1e-12 or abs(r) > size * (1.0 + 1e-12):
        return 0, 0.0, 0.0
    middle, half = math.atan2(q, p), math.acos(min(1.0, max(-1.0, r / size)))
    return 2, middle + half, middle - half


@njit(**BARE_INNER)
def turned_sum(axis, x, y):
    """Return (k, p, q) with y . Rot(axis, a) x = k + p cos a + q sin a."""
    ax, ay = dot(axis, x), dot(axis, y)
    k = ax * ay
    p = dot(x, y) - k
    q = (
        y[0] * (axis[1] * x[2] - axis[2] * x[1])
        + y[1] * (axis[2] * x[0] - axis[0] * x[2])
        + y[2] * (axis[0] * x[1] - axis[1] * x[0])
    )
    return k, p, q


@njit(**BARE_INNER)
def angle_between(axis, x, y):
    """Return the angle about a unit axis that turns x to y, as far as it can."""
    _, p, q = turned_sum(axis, x, y)
    return math.atan2(q, p)


@njit(**BARE_INNER)
def three_angles(a, b, c, R, room, found):
    """Write all (first, second, third) with Rot(a) Rot(b) Rot(c) = R; return how many.

    a, b, c: unit axes, neighbours not parallel. found: (2, 3).
    """
    d, e, M, N = room.v[5], room.v[6], room.R[6], room.R[7]
    apply(R, c, d)
    k, p, q = turned_sum(b, c, a)
    n, first, second = two_angles(p, q, dot(a, d) - k)
    # any vector across the third axis tells its angle
    x = room.v[7]
    smallest = 0
    for i in range(3):
        x[i] = 0.0
        if abs(c[i]) < abs(c[smallest]):
            smallest = i
    x[smallest] = 1.0
    for s in range(n):
        angle = first if s == 0 else second
        turn(b, angle, M)
        apply(M, c, e)
        found[s, 0] = angle_between(a, e, d)
        found[s, 1] = angle
        turn(a, found[s, 0], N)
        # what is left: (Rot(a) Rot(b))^T R x against x, about c
        left = room.v[4]
        apply(R, x, left)
        y = room.R[5, 0]
        for i in range(3):
            y[i] = N[0, i] * left[0] + N[1, i] * left[1] + N[2, i] * left[2]
        for i in range(3):
            left[i] = M[0, i] * y[0] + M[1, i] * y[1] + M[2, i] * y[2]
        found[s, 2] = angle_between(c, x, left)
    return n


@njit(**BARE_INNER)
def within(arm, room, k):
    """Turn row k of room.q from angles to joints; False where one leaves its range."""
    for j in range(7):
        fits, value = joint_of(arm, j, room.q[k, j])
        if not fits:
            return False
        room.q[k, j] = value
    return True


@njit(**BARE_INNER)
def elbows(arm, far2):
    """Return (n, first, second): the elbow's angles at |S W|^2 = far2 [m^2]."""
    w, e, s = arm.wrist, arm.place[3], arm.shoulder
    u = ux, uy, uz = w[0] - e[0], w[1] - e[1], w[2] - e[2]
    c = cx, cy, cz = e[0] - s[0], e[1] - s[1], e[2] - s[2]
    # |c + Rot(a4) u|^2 = far2
    k, p, q = turned_sum(arm.axis[3], u, c)
    own = ux * ux + uy * uy + uz * uz + cx * cx + cy * cy + cz * cz
    return two_angles(p, q, 0.5 * (far2 - own) - k)


@njit(**BARE_INNER)
def straighten(arm, elbow, far, M, room):
    """Write the elbow's rotation to M, and to R[3] the least one that aims at W."""
    u, y = room.v[2], room.v[1]
    for i in range(3):
        u[i] = arm.wrist[i] - arm.place[3, i]
    turn(arm.axis[3], elbow, M)
    apply(M, u, y)
    for i in range(3):
        y[i] = (y[i] + arm.place[3, i] - arm.shoulder[i]) / far
    shortest_turn(y, room.v[0], room.R[3], room.v[3])


@njit(**BARE_INNER)
def aim(arm, target, room):
    """Write the rotation of T tool^-1 to R[0], the way from S to W to v[0].

    Both as if the last joint were at 0. Returns their distance [m].
    """
    g, p, u = room.R[0], room.v[0], room.v[2]
    for i in range(3):
        for j in range(3):
            g[i, j] = 0.0
            for k in range(3):
                g[i, j] += target[3 * i + k] * arm.tool[3 * j + k]
        u[i] = arm.wrist[i] - arm.tool[9 + i]
    apply(g, u, p)
    far2 = 0.0
    for i in range(3):
        p[i] += target[9 + i] - arm.shoulder[i]
        far2 += p[i] * p[i]
    return math.sqrt(far2)


@njit(**BARE_INNER)
def within_reach(arm, target, room):
    """Say whether a pose is not too far off, or too near, for the elbow to reach W."""
    if not arm.round_wrist:
        return True
    far = aim(arm, target, room)
    n, first, second = elbows(arm, far * far)
    if n == 0 or far < 1e-9:
        return False
    return joint_of(arm, 3, first)[0] or joint_of(arm, 3, second)[0]


@njit(**BARE_INNER)
def solve_round(arm, target, free, room, found):
    """Write the solutions for all swivels of the elbow, the last axis through W.

    Where W is does not depend on the swivel: elbow first, and out of reach is told at
    once.
    """
    far = aim(arm, target, room)
    if far < 1e-9:
        return 0
    n, first, second = elbows(arm, far * far)
    for i in range(3):
        room.v[0][i] /= far
    total, M = 0, room.R[1]
    for e in range(n):
        fits, elbow = joint_of(arm, 3, first if e == 0 else second)
        if not fits:
            continue
        straighten(arm, elbow * arm.scale[3, 0] + arm.scale[3, 1], far, M, room)
        for k in range(free.shape[0]):
            for i in range(with_swivel(arm, elbow, free[k], M, room, 0)):
                if total == found.shape[0]:
                    return total
                for j in range(7):
                    found[total, j] = room.q[i, j]
                total += 1
    return total


@njit(**BARE_INNER)
def solve_at(arm, target, free, room):
    """Write all joints that bring the tool to a pose, the last angle given, to room.q.

    target: (12,) rotation and origin. free: [rad] of the last joint, which does not go
    through W.

    Returns:
        How many; all within the limits.
    """
    g, M, N, R0 = room.R[0], room.R[1], room.R[2], room.R[3]
    p, u, w = room.v[0], room.v[2], room.v[3]
    aim(arm, target, room)
    # take the last joint away: g becomes g e7^-1
    turn(arm.axis[6], -free, M)
    for i in range(3):
        u[i] = arm.wrist[i] - arm.place[6, i]
    apply(M, u, w)
    for i in range(3):
        u[i] = w[i] + arm.place[6, i] - arm.tool[9 + i]
    apply(g, u, p)
    times(g, M, N)
    for i in range(3):
        for j in range(3):
            g[i, j] = N[i, j]
    far2 = 0.0
    for i in range(3):
        p[i] += target[9 + i] - arm.shoulder[i]
        far2 += p[i] * p[i]
    far = math.sqrt(far2)
    if far < 1e-9:
        return 0
    n, first, second = elbows(arm, far2)
    for i in range(3):
        p[i] /= far
    count = 0
    for e in range(n):
        elbow = first if e == 0 else second
        fits, _ = joint_of(arm, 3, elbow)
        if not fits:
            continue
        straighten(arm, elbow, far, M, room)
        # Rot(p, x) R0 R4 a5 must stand to g a6 as a5 does to a6
        apply(M, arm.axis[4], w)
        s = room.R[4, 0]
        apply(R0, w, s)
        apply(g, arm.axis[5], w)
        k, a, b = turned_sum(p, s, w)
        m, one, two = two_angles(a, b, dot(arm.axis[4], arm.axis[5]) - k)
        for x in range(m):
            swivel = one if x == 0 else two
            count = with_last(arm, elbow, swivel, free, M, room, count)
    return count


@njit(**BARE_INNER)
def shortest_turn(x, y, out, w):
    """Write the least rotation from unit vector x to y; w (3,) is scratch."""
    c = dot(x, y)
    w[0] = x[1] * y[2] - x[2] * y[1]
    w[1] = x[2] * y[0] - x[0] * y[2]
    w[2] = x[0] * y[1] - x[1] * y[0]
    if c < -1.0 + 1e-12:  # half a turn about anything across
        least = 0
        for i in range(3):
            if abs(x[i]) < abs(x[least]):
                least = i
        square = 0.0
        for i in range(3):
            w[i] = (1.0 if i == least else 0.0) - x[least] * x[i]
            square += w[i] * w[i]
        size = math.sqrt(square)
        for i in range(3):
            w[i] /= size
        turn(w, math.pi, out)
        return
    f = 1.0 / (1.0 + c)
    for i in range(3):
        for j in range(3):
            out[i, j] = f * w[i] * w[j]
        out[i, i] += c
    out[0, 1] -= w[2]
    out[0, 2] += w[1]
    out[1, 0] += w[2]
    out[1, 2] -= w[0]
    out[2, 0] -= w[1]
    out[2, 1] += w[0]


@njit(**BARE_INNER)
def joint_of(arm, j, angle):
    """Return (fits, value): the joint's value for an angle, and if it has that."""
    low, high = arm.limits[j, 0], arm.limits[j, 1]
    factor = arm.scale[j, 0]
    value = (angle - arm.scale[j, 1]) / factor
    period = 2.0 * math.pi / abs(factor)
    value -= period * round((value - 0.5 * (low + high)) / period)
    return low - 1e-9 <= value <= high + 1e-9, min(max(value, low), high)


@njit(**BARE_INNER)
def kept(arm, j, angles, n):
    """Turn rows (n, 3) of angles to joints j, j + 1, j + 2; return how many fit.

    Those that are within their limits are moved to the front.
    """
    count = 0
    for s in range(n):
        a, x = joint_of(arm, j, angles[s, 0])
        b, y = joint_of(arm, j + 1, angles[s, 1])
        c, z = joint_of(arm, j + 2, angles[s, 2])
        if a and b and c:
            angles[count, 0], angles[count, 1], angles[count, 2] = x, y, z
            count += 1
    return count


@njit(**BARE_INNER)
def with_swivel(arm, elbow, swivel, M, room, count):
    """Add the solutions for an elbow and its swivel; M is the elbow's rotation."""
    g, N, R0, K = room.R[0], room.R[2], room.R[3], room.R[4]
    turn(room.v[0], swivel, N)
    times(N, R0, K)  # shoulder
    ax, three = arm.axis, room.three
    shoulders = three_angles(ax[0], ax[1], ax[2], K, room, three[0])
    shoulders = kept(arm, 0, three[0], shoulders)
    if shoulders == 0:
        return count
    times_back(K, g, N)
    times_back(M, N, K)  # wrist
    wrists = three_angles(ax[4], ax[5], ax[6], K, room, three[1])
    wrists = kept(arm, 4, three[1], wrists)
    for s in range(shoulders):
        for t in range(wrists):
            for j in range(3):
                room.q[count, j] = three[0, s, j]
                room.q[count, 4 + j] = three[1, t, j]
            room.q[count, 3] = elbow
            count += 1
    return count


@njit(**BARE_INNER)
def with_last(arm, elbow, swivel, last, M, room, count):
    """Add the solutions for an elbow, its swivel and the last joint's angle."""
    g, N, R0, K = room.R[0], room.R[2], room.R[3], room.R[4]
    turn(room.v[0], swivel, N)
    times(N, R0, K)
    ax = arm.axis
    shoulders = three_angles(ax[0], ax[1], ax[2], K, room, room.three[0])
    times_back(K, g, N)
    times_back(M, N, K)  # Rot(a5) Rot(a6)
    d = room.v[6]
    apply(K, ax[5], d)
    five = angle_between(ax[4], ax[5], d)
    turn(ax[4], five, N)
    d, e = room.v[6], room.v[7]
    apply(K, ax[4], d)  # Rot(a5)^T K a5 against a5, about a6
    for i in range(3):
        e[i] = N[0, i] * d[0] + N[1, i] * d[1] + N[2, i] * d[2]
    six = angle_between(ax[5], ax[4], e)
    for s in range(shoulders):
        for j in range(3):
            room.q[count, j] = room.three[0, s, j]
        room.q[count, 3], room.q[count, 4] = elbow, five
        room.q[count, 5], room.q[count, 6] = six, last
        if within(arm, room, count):
            count += 1
    return count


@njit(**BARE)
def solve_all(arm, target, free, room, found):
    """Write the solutions for all values of `free` (k,) to `found`; return how many."""
    if arm.round_wrist:
        return solve_round(arm, target, free, room, found)
    n = 0
    for k in range(free.shape[0]):
        for i in range(solve_at(arm, target, free[k], room)):
            if n == found.shape[0]:
                return n
            for j in range(7):
                found[n, j] = room.q[i, j]
            n += 1
    return n
