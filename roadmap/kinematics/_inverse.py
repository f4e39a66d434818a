"""Inverse kinematics by damped least squares, one descent from one start."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.kinematics._forward import body_frames

# One radian counts as much as this many metres.
_LENGTH = 0.3


class Tool(NamedTuple):
    """A robot's bodies and the tool on one of them."""

    tree_i: np.ndarray  # (n_bodies, 3), as in `Robot`
    tree_f: np.ndarray  # (n_bodies, 17), as in `Robot`
    body: int  # that the tool is on
    pose: np.ndarray  # (12,) T_body_tip: rotation (9) and origin (3) [m]


@njit(cache=True, nogil=True)
def descend(tool, target, limits, q, steps, goal):
    """Move `q` towards the pose `target` of the tool, within limits.

    Levenberg-Marquardt: the damping shrinks after a step that helped and grows after
    one that did not; joints at a limit that want to leave it are left out.

    target: (12,) T_base_tool, rotation (9) and origin (3) [m]. limits: (dof, 2),
    infinite for a continuous joint. q: (dof,) start, gets the result. steps: the
    largest number of them. goal: (2,) position [m] and rotation [rad] error to reach.

    Returns:
        (position error [m], rotation error [rad]).
    """
    dof = q.shape[0]
    frames = np.empty((tool.tree_i.shape[0], 12))
    pose, error, new_error = np.empty(12), np.empty(6), np.empty(6)
    jac, trial, dq = np.empty((6, dof)), np.empty(dof), np.empty(dof)
    active = np.ones(dof, np.bool_)
    damping = 1e-3
    cost = _error(tool, target, q, frames, pose, error)
    for _ in range(steps):
        position = math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
        rotation = math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2) / _LENGTH
        if (position <= goal[0] and rotation <= goal[1]) or damping > 1e8:
            break
        body_frames(tool.tree_i, tool.tree_f, q, frames)
        _jacobian(tool, frames, pose, jac)
        active[:] = True
        _step(jac, error, damping, active, dq)
        for j in range(dof):
            stuck = q[j] <= limits[j, 0] and dq[j] < 0.0
            stuck |= q[j] >= limits[j, 1] and dq[j] > 0.0
            active[j] = not stuck
        _step(jac, error, damping, active, dq)
        for j in range(dof):
            trial[j] = min(max(q[j] + dq[j], limits[j, 0]), limits[j, 1])
        new = _error(tool, target, trial, frames, pose, new_error)
        if new < cost:
            cost = new
            q[:] = trial
            error[:] = new_error
            damping = max(damping * 0.2, 1e-12)
        else:
            # the tool pose of q again, for the next Jacobian
            _error(tool, target, q, frames, pose, error)
            damping *= 5.0
    position = math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
    rotation = math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2) / _LENGTH
    return position, rotation


@njit(cache=True, nogil=True)
def _error(tool, target, q, frames, pose, error):
    """Write the tool pose and the weighted error to the target; return its square."""
    body_frames(tool.tree_i, tool.tree_f, q, frames)
    f, tip = frames[tool.body], tool.pose
    for i in range(3):
        for j in range(3):
            x, y, z = tip[j], tip[3 + j], tip[6 + j]
            pose[3 * i + j] = f[3 * i] * x + f[3 * i + 1] * y + f[3 * i + 2] * z
        pose[9 + i] = (
            f[3 * i] * tip[9]
            + f[3 * i + 1] * tip[10]
            + f[3 * i + 2] * tip[11]
            + f[9 + i]
        )
        error[i] = target[9 + i] - pose[9 + i]
    # R = target pose^T, its skew part and its trace
    skew = np.zeros(3)
    trace = 0.0
    for i in range(3):
        for k in range(3):
            trace += target[3 * i + k] * pose[3 * i + k]
    for k in range(3):
        skew[0] += target[6 + k] * pose[3 + k] - target[3 + k] * pose[6 + k]
        skew[1] += target[k] * pose[6 + k] - target[6 + k] * pose[k]
        skew[2] += target[3 + k] * pose[k] - target[k] * pose[3 + k]
    sine = 0.5 * math.sqrt(skew[0] ** 2 + skew[1] ** 2 + skew[2] ** 2)
    cosine = 0.5 * (trace - 1.0)
    angle = math.atan2(sine, cosine)
    scale = 0.5 * _LENGTH * (angle / sine if sine > 1e-9 else 1.0)
    cost = 0.0
    for k in range(3):
        error[3 + k] = scale * skew[k]
    if sine <= 1e-9 and cosine < 0.0:
        # half a turn: any axis reduces it
        error[3], error[4], error[5] = _LENGTH * math.pi, 0.0, 0.0
    for k in range(6):
        cost += error[k] * error[k]
    return cost


@njit(cache=True, nogil=True)
def _jacobian(tool, frames, pose, jac):
    """Write the weighted Jacobian of the tool, which stands at `pose`."""
    tree_i, tree_f = tool.tree_i, tool.tree_f
    jac[:] = 0.0
    body = tool.body
    while body > 0:
        f, joint = frames[body], tree_i[body, 1]
        a, scale = tree_f[body, 12:15], tree_f[body, 15]
        x = f[0] * a[0] + f[1] * a[1] + f[2] * a[2]
        y = f[3] * a[0] + f[4] * a[1] + f[5] * a[2]
        z = f[6] * a[0] + f[7] * a[1] + f[8] * a[2]
        if tree_i[body, 2] == 1:
            u, v, w = pose[9] - f[9], pose[10] - f[10], pose[11] - f[11]
            jac[0, joint] += scale * (y * w - z * v)
            jac[1, joint] += scale * (z * u - x * w)
            jac[2, joint] += scale * (x * v - y * u)
            jac[3, joint] += scale * _LENGTH * x
            jac[4, joint] += scale * _LENGTH * y
            jac[5, joint] += scale * _LENGTH * z
        elif tree_i[body, 2] == 2:
            jac[0, joint] += scale * x
            jac[1, joint] += scale * y
            jac[2, joint] += scale * z
        body = tree_i[body, 0]


@njit(cache=True, nogil=True)
def _step(jac, error, damping, active, dq):
    """Write dq = J^T (J J^T + damping I)^-1 error over the active joints."""
    A, y = np.zeros((6, 6)), error.copy()
    for i in range(6):
        for k in range(i + 1):
            for j in range(dq.shape[0]):
                if active[j]:
                    A[i, k] += jac[i, j] * jac[k, j]
        A[i, i] += damping
    # Cholesky, forward and backward substitution
    for i in range(6):
        for k in range(i + 1):
            total = A[i, k]
            for m in range(k):
                total -= A[i, m] * A[k, m]
            A[i, k] = math.sqrt(max(total, 1e-18)) if i == k else total / A[k, k]
    for i in range(6):
        for m in range(i):
            y[i] -= A[i, m] * y[m]
        y[i] /= A[i, i]
    for i in range(5, -1, -1):
        for m in range(i + 1, 6):
            y[i] -= A[m, i] * y[m]
        y[i] /= A[i, i]
    for j in range(dq.shape[0]):
        dq[j] = 0.0
        if active[j]:
            for i in range(6):
                dq[j] += jac[i, j] * y[i]
