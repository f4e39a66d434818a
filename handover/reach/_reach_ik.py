"""Inverse kinematics of a chain from many starts; the extremes of what it reaches."""

import math

import numpy as np
from numba import njit

from handover.reach._reach_touch import touches_itself
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import BARE, BARE_INNER, FULL, FULL_INNER
from roadmap.kinematics._chain import (
    dexterity,
    draw_code,
    forward,
    from_lattice,
    jacobian,
)
from roadmap.kinematics._inverse import descend

# length of the scaled error, about 1e-6 m and 1e-6 rad; most steps
_GOAL = 1e-5, 60.0


@njit(**FULL)
def starts_taken(chain, poses, scale, touch, work, starts, used):
    """Write to used (n,) how many starts each pose (n, 12) took, 0 where all failed.

    A start succeeds where it leads to a solution free of self-collision. starts: seed
    and largest number of them. scale: as of `pose_error`.
    """
    seed, attempts = starts
    trial = np.empty_like(work.q)
    for i in range(poses.shape[0]):
        used[i] = 0
        touch.axes[:] = 0.0
        for k in range(attempts):
            draw_code(seed, i * attempts + k, work.code)
            from_lattice(chain, work.code, work.q)
            if not descend(chain, poses[i], scale, _GOAL, work, trial):
                continue
            if touches_itself(touch, work.q, work.frames):
                continue
            used[i] = k + 1
            break


@njit(**BARE)
def most_dexterous(chain, seed, n_drawn, steps, work, best):
    """Write the most dexterous q (dof,) of some to `best`; returns its dexterity.

    First come samples of the stream `seed`, then steps (n, dof) away from the best so
    far, within the limits. Where no sample has any dexterity, 0 and nothing is written.
    """
    most, q, limits = 0.0, work.q, chain.limits
    for k in range(n_drawn + steps.shape[0]):
        if k < n_drawn:
            draw_code(seed, k, work.code)
            from_lattice(chain, work.code, q)
        elif most == 0.0:
            break
        else:
            for j in range(q.shape[0]):
                value = best[j] + steps[k - n_drawn, j]
                q[j] = min(max(value, limits[j, 0]), limits[j, 1])
        forward(chain, q, work.frames)
        jacobian(chain, work.frames, work.jac)
        value = dexterity(chain, q, work.jac, work.weighted, work.gram)
        if value > most:
            most = value
            copy_row(q, best)
    return most


@njit(**BARE)
def stretch(chain, direction, work):
    """Move work.q to where the tool is furthest along `direction`, joint by joint.

    Along one turning joint the tool's place is a + b cos + c sin: the best angle
    within the limits is known. Returns how far the tool is.
    """
    best = -1e300
    for _ in range(30):
        for j in range(work.q.shape[0]):
            _best_value(chain, direction, work, j)
        forward(chain, work.q, work.frames)
        now = _along(direction, work.frames[-1])
        if now <= best + 1e-9:
            break
        best = now
    return best


@njit(**BARE_INNER)
def _along(direction, tool):
    return direction[0] * tool[9] + direction[1] * tool[10] + direction[2] * tool[11]


@njit(**FULL_INNER)
def _best_value(chain, direction, work, j):
    q, low, high = work.q, chain.limits[j, 0], chain.limits[j, 1]
    start, best, keep = q[j], -1e300, q[j]
    turns = False
    for b in range(chain.kind.shape[0]):
        if chain.kind[b, 1] == j:
            turns = chain.kind[b, 0] == 1 and chain.scale[b, 0] == 1.0
    angle = start
    if turns:
        values = np.empty(3)
        for k in range(3):
            q[j] = k * 0.5 * math.pi
            forward(chain, q, work.frames)
            values[k] = _along(direction, work.frames[-1])
        middle = 0.5 * (values[0] + values[2])
        angle = math.atan2(values[1] - middle, values[0] - middle)
    for value in (low, high, start, angle, angle + 2 * math.pi, angle - 2 * math.pi):
        if low <= value <= high:
            q[j] = value
            forward(chain, q, work.frames)
            now = _along(direction, work.frames[-1])
            if now > best:
                best, keep = now, value
    q[j] = keep
