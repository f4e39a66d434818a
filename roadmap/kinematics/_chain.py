"""A serial chain: tool pose, Jacobian, dexterity, and one damped step to a pose.

Every joint turns about, or slides along, the z axis of its frame. A pose is a row of
12 numbers: rotation (9, row-major) and origin (3). Configurations of a reach map lie
on a lattice of 16 bits per joint, so that a stored one is exactly the one tested.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import BARE, BARE_INNER, WITHIN, WITHIN_INNER
from roadmap.kinematics._six import outer, root_of_determinant, solution

LEVELS = 65535  # steps of a joint's lattice between its limits


class ChainArrays(NamedTuple):
    """What the kernels need to know of a chain.

    Attributes:
        fixed: (n + 1, 12) pose of each row's frame in the one before, at value 0; the
            last is the tool.
        kind: (n, 2) 1 turns or 2 slides; joint index.
        scale: (n, 2) factor and offset: the value is factor * q[joint] + offset.
        limits: (dof, 2) lower and upper [rad or unit].
        endless: (dof,) 1.0 where a joint turns without limit.
        length: (1,) length that counts as much as 1 rad in the dexterity [unit].
    """

    fixed: np.ndarray
    kind: np.ndarray
    scale: np.ndarray
    limits: np.ndarray
    endless: np.ndarray
    length: np.ndarray


@njit(**BARE_INNER)
def sine_cosine(x):
    """Return sin(x) and cos(x) for |x| < 1e5, within 2e-16, by additions and products.

    Much faster than a library's, and the same bits on every machine. Quarter turns are
    taken off, then the polynomials of fdlibm (k_sin.c, k_cos.c) do.
    """
    quarters = math.floor(x * 0.6366197723675814 + 0.5)
    r = (x - quarters * 1.5707963267341256) - quarters * 6.077100506506192e-11
    z = r * r
    p = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    p = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * p)
    )
    s = r + r * z * (-1.66666666666666324348e-01 + z * p)
    p = -2.75573143513906633035e-07 + z * (
        2.08757232129817482790e-09 - z * 1.13596475577881948265e-11
    )
    p = 4.16666666666666019037e-02 + z * (
        -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * p)
    )
    c = 1.0 - 0.5 * z + z * z * p
    # quarter turns by choices instead of jumps, which nobody could foresee
    turn = int(quarters)
    odd = turn & 1 != 0
    first, second = c if odd else s, s if odd else c
    first = -first if turn & 2 != 0 else first
    return first, -second if (turn + 1) & 2 != 0 else second


@njit(**BARE)
def forward(chain, q, frames):
    """Write the pose of each row to `frames` (n + 1, 12), the tool's to the last."""
    # no views of rows in here: each would cost as much as a row's arithmetic
    fixed, kind, scale = chain.fixed, chain.kind, chain.scale
    n = kind.shape[0]
    r00, r01, r02, px = fixed[0, 0], fixed[0, 1], fixed[0, 2], fixed[0, 9]
    r10, r11, r12, py = fixed[0, 3], fixed[0, 4], fixed[0, 5], fixed[0, 10]
    r20, r21, r22, pz = fixed[0, 6], fixed[0, 7], fixed[0, 8], fixed[0, 11]
    for b in range(n + 1):
        if b > 0:
            f0, f1, f2 = fixed[b, 0], fixed[b, 1], fixed[b, 2]
            f3, f4, f5 = fixed[b, 3], fixed[b, 4], fixed[b, 5]
            f6, f7, f8 = fixed[b, 6], fixed[b, 7], fixed[b, 8]
            x, y, z = fixed[b, 9], fixed[b, 10], fixed[b, 11]
            px += r00 * x + r01 * y + r02 * z
            py += r10 * x + r11 * y + r12 * z
            pz += r20 * x + r21 * y + r22 * z
            x, y, z = r00, r01, r02
            r00, r01 = x * f0 + y * f3 + z * f6, x * f1 + y * f4 + z * f7
            r02 = x * f2 + y * f5 + z * f8
            x, y, z = r10, r11, r12
            r10, r11 = x * f0 + y * f3 + z * f6, x * f1 + y * f4 + z * f7
            r12 = x * f2 + y * f5 + z * f8
            x, y, z = r20, r21, r22
            r20, r21 = x * f0 + y * f3 + z * f6, x * f1 + y * f4 + z * f7
            r22 = x * f2 + y * f5 + z * f8
        if b < n:
            value = scale[b, 0] * q[kind[b, 1]] + scale[b, 1]
            if kind[b, 0] == 1:
                s, c = sine_cosine(value)
                r00, r01 = c * r00 + s * r01, c * r01 - s * r00
                r10, r11 = c * r10 + s * r11, c * r11 - s * r10
                r20, r21 = c * r20 + s * r21, c * r21 - s * r20
            else:
                px, py, pz = px + value * r02, py + value * r12, pz + value * r22
        frames[b, 0], frames[b, 1], frames[b, 2] = r00, r01, r02
        frames[b, 3], frames[b, 4], frames[b, 5] = r10, r11, r12
        frames[b, 6], frames[b, 7], frames[b, 8] = r20, r21, r22
        frames[b, 9], frames[b, 10], frames[b, 11] = px, py, pz


@njit(**WITHIN)
def jacobian(chain, frames, jac):
    """Write the (6, dof) Jacobian of the tool: linear [unit], angular."""
    kind, scales = chain.kind, chain.scale
    n = kind.shape[0]
    tx, ty, tz = frames[n, 9], frames[n, 10], frames[n, 11]
    for i in range(6):
        for j in range(jac.shape[1]):
            jac[i, j] = 0.0
    for b in range(n):
        j, scale = kind[b, 1], scales[b, 0]
        x, y, z = scale * frames[b, 2], scale * frames[b, 5], scale * frames[b, 8]
        if kind[b, 0] == 1:
            u, v, w = tx - frames[b, 9], ty - frames[b, 10], tz - frames[b, 11]
            jac[0, j] += y * w - z * v
            jac[1, j] += z * u - x * w
            jac[2, j] += x * v - y * u
            jac[3, j] += x
            jac[4, j] += y
            jac[5, j] += z
        else:
            jac[0, j] += x
            jac[1, j] += y
            jac[2, j] += z


@njit(**WITHIN_INNER)
def limit_weight(chain, q, j):
    """Return 1 / (1 + |dh/dq|) of joint j, h as in [Chan1995]; 0 at a limit."""
    if chain.endless[j] > 0.5:
        return 1.0
    low, high = chain.limits[j, 0], chain.limits[j, 1]
    span = high - low
    t = (2.0 * q[j] - low - high) / span
    room = 1.0 - t * t
    if room <= 1e-9:
        return 0.0
    square = span * room * room
    return square / (square + 4.0 * abs(t))


@njit(**WITHIN)
def dexterity(chain, q, jac, weighted, gram):
    """Return Yoshikawa's measure of the Jacobian with columns weighted by limits.

    sqrt(det(J W J^T)) with the squares W of the weights, or sqrt(det(W J^T J)) where
    there are fewer than 6 joints. Work space: weighted (dof, 7), gram (6, 6).
    """
    dof = jac.shape[1]
    over = 1.0 / chain.length[0]
    for j in range(dof):
        weighted[j, 6] = limit_weight(chain, q, j)
        for i in range(3):
            weighted[j, i] = over * jac[i, j]
            weighted[j, 3 + i] = jac[3 + i, j]
    if dof >= 6:
        outer(weighted, 0.0, gram)
        return root_of_determinant(gram, 1e-24)
    volume = 1.0
    for i in range(dof):
        for k in range(i + 1):
            total = 0.0
            for m in range(6):
                total += weighted[i, m] * weighted[k, m]
            total *= math.sqrt(weighted[i, 6] * weighted[k, 6])
            for m in range(k):
                total -= gram[i, m] * gram[k, m]
            if i == k:
                if total <= 1e-24:
                    return 0.0
                gram[i, i] = math.sqrt(total)
                volume *= gram[i, i]
            else:
                gram[i, k] = total / gram[k, k]
    return volume


@njit(**WITHIN_INNER)
def pose_error(tool, target, scale, error):
    """Write the way from `tool` to `target`, rows divided by scale; return its square.

    scale: (2,) length and angle that count as 1. The rotation is the skew part of
    target tool^T lengthened to the angle.
    """
    s0 = s1 = s2 = 0.0
    trace = 0.0
    for k in range(3):
        error[k] = (target[9 + k] - tool[9 + k]) / scale[0]
        s0 += target[6 + k] * tool[3 + k] - target[3 + k] * tool[6 + k]
        s1 += target[k] * tool[6 + k] - target[6 + k] * tool[k]
        s2 += target[3 + k] * tool[k] - target[k] * tool[3 + k]
        for i in range(3):
            trace += target[3 * i + k] * tool[3 * i + k]
    sine = 0.5 * math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    cosine = 0.5 * (trace - 1.0)
    if sine <= 1e-9 and cosine < 0.0:
        s0, s1, s2 = 2.0 * math.pi, 0.0, 0.0  # half a turn: any axis will do
    elif sine > 1e-9:
        stretch = math.atan2(sine, cosine) / sine
        s0, s1, s2 = stretch * s0, stretch * s1, stretch * s2
    # s is twice the rotation vector
    error[3], error[4], error[5] = (
        0.5 * s0 / scale[1],
        0.5 * s1 / scale[1],
        0.5 * s2 / scale[1],
    )
    total = 0.0
    for k in range(6):
        total += error[k] * error[k]
    return total


@njit(**WITHIN_INNER)
def damped_step(scaled, error, damping, gram, dq):
    """Write dq = W A^T (A W A^T + damping I)^-1 error.

    scaled: (dof, 7) columns of the Jacobian A, rows divided by the scale, and W: 1 for
    a joint that may move, 0 for one that rests.
    """
    outer(scaled, damping, gram)
    x0, x1, x2, x3, x4, x5 = solution(gram, error)
    for j in range(dq.shape[0]):
        total = scaled[j, 0] * x0 + scaled[j, 1] * x1 + scaled[j, 2] * x2
        total += scaled[j, 3] * x3 + scaled[j, 4] * x4 + scaled[j, 5] * x5
        dq[j] = scaled[j, 6] * total


@njit(**WITHIN_INNER)
def limited_step(chain, q, scale, damping, work):
    """Move q by a damped step; joints that stand at a limit and would leave it rest.

    work: jac and error are read; weighted, gram and dq are work space.
    """
    dof = q.shape[0]
    jac, error, dq = work.jac, work.error, work.dq
    scaled, gram = work.weighted, work.gram
    over_length, over_angle = 1.0 / scale[0], 1.0 / scale[1]
    for j in range(dof):
        for i in range(3):
            scaled[j, i] = over_length * jac[i, j]
            scaled[j, 3 + i] = over_angle * jac[3 + i, j]
        scaled[j, 6] = 1.0
    damped_step(scaled, error, damping, gram, dq)
    stuck = False
    for j in range(dof):
        if chain.endless[j] > 0.5:
            continue
        below = q[j] <= chain.limits[j, 0] and dq[j] < 0.0
        above = q[j] >= chain.limits[j, 1] and dq[j] > 0.0
        if below or above:
            scaled[j, 6] = 0.0
            stuck = True
    if stuck:
        damped_step(scaled, error, damping, gram, dq)
    for j in range(dof):
        value = q[j] + dq[j]
        low, high = chain.limits[j, 0], chain.limits[j, 1]
        if chain.endless[j] > 0.5:
            value -= (high - low) * math.floor((value - low) / (high - low))
        q[j] = min(max(value, low), high)


@njit(**WITHIN_INNER)
def to_lattice(chain, q, code):
    """Write the nearest lattice point of q to `code` (dof,) uint16."""
    for j in range(q.shape[0]):
        low, high = chain.limits[j, 0], chain.limits[j, 1]
        t = (q[j] - low) / (high - low) if high > low else 0.0
        code[j] = np.uint16(min(max(t, 0.0), 1.0) * LEVELS + 0.5)


@njit(**WITHIN)
def from_lattice(chain, code, q):
    """Write the configuration of a lattice point to q."""
    for j in range(q.shape[0]):
        low, high = chain.limits[j, 0], chain.limits[j, 1]
        # rounding must not carry the last level beyond the limit
        q[j] = min(low + (high - low) * (float(code[j]) / LEVELS), high)


@njit(**WITHIN)
def draw_code(seed, index, code):
    """Write sample `index` of a stream to `code` (dof,): every tenth value a limit.

    SplitMix64 over (seed, index, joint): any sample can be drawn again by its index.
    """
    state = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(index)
    state = _mix(state)
    for j in range(code.shape[0]):
        state = state + np.uint64(0x9E3779B97F4A7C15)
        bits = _mix(state)
        code[j] = np.uint16(bits & np.uint64(0xFFFF))
        if (bits >> np.uint64(16)) & np.uint64(0xFFFF) < np.uint64(6554):
            end = (bits >> np.uint64(32)) & np.uint64(1)
            code[j] = np.uint16(LEVELS) if end == np.uint64(1) else np.uint16(0)


@njit(**WITHIN_INNER)
def _mix(z):
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
