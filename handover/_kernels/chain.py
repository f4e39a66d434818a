"""A serial chain: tool pose, Jacobian, dexterity, and one damped step to a pose.

Every joint turns about, or slides along, the z axis of its frame. A pose is a row of
12 numbers: rotation (9, row-major) and origin (3). Configurations of a reach map lie
on a lattice of 16 bits per joint, so that a stored one is exactly the one tested.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

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


@njit(cache=True, nogil=True)
def forward(chain, q, frames):
    """Write the frame of each row after its motion to `frames` (n + 1, 12)."""
    n = chain.kind.shape[0]
    for b in range(n + 1):
        f, out = chain.fixed[b], frames[b]
        if b == 0:
            for k in range(12):
                out[k] = f[k]
        else:
            up = frames[b - 1]
            for i in range(3):
                x, y, z = up[3 * i], up[3 * i + 1], up[3 * i + 2]
                out[3 * i] = x * f[0] + y * f[3] + z * f[6]
                out[3 * i + 1] = x * f[1] + y * f[4] + z * f[7]
                out[3 * i + 2] = x * f[2] + y * f[5] + z * f[8]
                out[9 + i] = x * f[9] + y * f[10] + z * f[11] + up[9 + i]
        if b == n:
            return
        value = chain.scale[b, 0] * q[chain.kind[b, 1]] + chain.scale[b, 1]
        if chain.kind[b, 0] == 1:
            c, s = math.cos(value), math.sin(value)
            for i in range(3):
                x, y = out[3 * i], out[3 * i + 1]
                out[3 * i] = c * x + s * y
                out[3 * i + 1] = c * y - s * x
        else:
            for i in range(3):
                out[9 + i] += value * out[3 * i + 2]


@njit(cache=True, nogil=True)
def jacobian(chain, frames, jac):
    """Write the (6, dof) Jacobian of the tool: linear [unit], angular."""
    n = chain.kind.shape[0]
    tool = frames[n]
    jac[:] = 0.0
    for b in range(n):
        f, j, scale = frames[b], chain.kind[b, 1], chain.scale[b, 0]
        x, y, z = scale * f[2], scale * f[5], scale * f[8]
        if chain.kind[b, 0] == 1:
            u, v, w = tool[9] - f[9], tool[10] - f[10], tool[11] - f[11]
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


@njit(cache=True, nogil=True)
def limit_weight(chain, q, j):
    """Return 1 / sqrt(1 + |dh/dq|) of joint j, h as in [Chan1995]; 0 at a limit."""
    if chain.endless[j] > 0.5:
        return 1.0
    low, high = chain.limits[j, 0], chain.limits[j, 1]
    span = high - low
    t = (2.0 * q[j] - low - high) / span
    room = 1.0 - t * t
    if room <= 1e-9:
        return 0.0
    return 1.0 / math.sqrt(1.0 + 4.0 * abs(t) / (span * room * room))


@njit(cache=True, nogil=True)
def dexterity(chain, q, jac, weighted, gram):
    """Return Yoshikawa's measure of the Jacobian with columns weighted by limits.

    sqrt(det(J J^T)), or sqrt(det(J^T J)) where there are fewer than 6 joints. Work
    space: weighted (6, dof), gram (m, m) with m >= min(6, dof).
    """
    dof = jac.shape[1]
    for j in range(dof):
        w = limit_weight(chain, q, j)
        for i in range(3):
            weighted[i, j] = w * jac[i, j] / chain.length[0]
            weighted[3 + i, j] = w * jac[3 + i, j]
    n = min(6, dof)
    for i in range(n):
        for k in range(i + 1):
            total = 0.0
            if dof >= 6:
                for j in range(dof):
                    total += weighted[i, j] * weighted[k, j]
            else:
                for j in range(6):
                    total += weighted[j, i] * weighted[j, k]
            gram[i, k] = total
    volume = 1.0
    for i in range(n):
        for k in range(i + 1):
            total = gram[i, k]
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def damped_step(jac, scale, error, damping, active, scaled, gram, dq):
    """Write dq = A^T (A A^T + damping I)^-1 error, A the scaled active columns."""
    dof = dq.shape[0]
    for i in range(6):
        over = 1.0 / scale[i // 3]
        for j in range(dof):
            scaled[i, j] = active[j] * over * jac[i, j]
    y = gram[6]
    for i in range(6):
        for k in range(i + 1):
            total = damping if i == k else 0.0
            for j in range(dof):
                total += scaled[i, j] * scaled[k, j]
            for m in range(k):
                total -= gram[i, m] * gram[k, m]
            if i == k:  # the inverse of the diagonal is kept
                gram[i, i] = 1.0 / math.sqrt(max(total, 1e-18))
            else:
                gram[i, k] = total * gram[k, k]
        total = error[i]
        for m in range(i):
            total -= gram[i, m] * y[m]
        y[i] = total * gram[i, i]
    for i in range(5, -1, -1):
        total = y[i]
        for m in range(i + 1, 6):
            total -= gram[m, i] * y[m]
        y[i] = total * gram[i, i]
    for j in range(dof):
        total = 0.0
        for i in range(6):
            total += scaled[i, j] * y[i]
        dq[j] = total


@njit(cache=True, nogil=True)
def limited_step(chain, q, scale, damping, work):
    """Move q by a damped step; joints that stand at a limit and would leave it rest.

    work: jac and error are read; active, weighted, gram and dq are work space.
    """
    dof = q.shape[0]
    jac, error, active, dq = work.jac, work.error, work.active, work.dq
    scaled, gram = work.weighted, work.gram
    active[:] = 1.0
    damped_step(jac, scale, error, damping, active, scaled, gram, dq)
    stuck = False
    for j in range(dof):
        if chain.endless[j] > 0.5:
            continue
        below = q[j] <= chain.limits[j, 0] and dq[j] < 0.0
        above = q[j] >= chain.limits[j, 1] and dq[j] > 0.0
        if below or above:
            active[j] = 0.0
            stuck = True
    if stuck:
        damped_step(jac, scale, error, damping, active, scaled, gram, dq)
    for j in range(dof):
        value = q[j] + dq[j]
        low, high = chain.limits[j, 0], chain.limits[j, 1]
        if chain.endless[j] > 0.5:
            value -= (high - low) * math.floor((value - low) / (high - low))
        q[j] = min(max(value, low), high)


@njit(cache=True, nogil=True)
def to_lattice(chain, q, code):
    """Write the nearest lattice point of q to `code` (dof,) uint16."""
    for j in range(q.shape[0]):
        low, high = chain.limits[j, 0], chain.limits[j, 1]
        t = (q[j] - low) / (high - low) if high > low else 0.0
        code[j] = np.uint16(min(max(t, 0.0), 1.0) * LEVELS + 0.5)


@njit(cache=True, nogil=True)
def from_lattice(chain, code, q):
    """Write the configuration of a lattice point to q."""
    for j in range(q.shape[0]):
        low, high = chain.limits[j, 0], chain.limits[j, 1]
        q[j] = low + (high - low) * (float(code[j]) / LEVELS)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _mix(z):
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
