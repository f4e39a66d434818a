"""Changes of a path that would save time: which one to test next."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.search._paths import leg_length, unwrap
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER, LEAN

# Roberts' R2 sequence in the plane: pairs of places, evenly spread and the same always
_R2_U, _R2_V = 0.7548776662466927, 0.5698402909980532
I, J, FROM_VERTEX, TO_VERTEX, N_CORNERS = 0, 1, 2, 3, 4


class Rest(NamedTuple):
    """What of a path may change: its corners q[at..last]."""

    q: np.ndarray  # (n, dof)
    at: int
    last: int
    first: float  # share of the first leg that stays


class Terms(NamedTuple):
    """What tells the time of a path."""

    # (5, dof) the joints' speed, acceleration, jerk, motion bound and weights
    robot: np.ndarray
    # how far a blend may be off [m], and BLEND_DEVIATION, TURN_A and TURN_J of
    # `roadmap.motion.blending`
    rounding: np.ndarray
    continuous: np.ndarray  # (dof,)


class Scratch(NamedTuple):
    """Room for a change and what comes of it."""

    new: np.ndarray  # (n, dof) the changed path
    corners: np.ndarray  # (3, dof) of the change
    ints: np.ndarray  # (5,) by the names above


@njit(**LEAN)
def path_time(q, n, robot, rounding):
    """Return about how long the path q[:n] takes [s].

    Legs at the speed that the joints allow; in a corner, which is rounded, no faster
    than the joints can turn there, and what it takes to slow down to that and speed up
    again. `robot` and `rounding` are those of Terms.
    """
    dof = q.shape[1]
    time = 0.0
    last = -1  # the beginning of the last leg that has a length
    last_length = last_v = last_a = last_j = 0.0
    for k in range(n - 1):
        length = 0.0
        for i in range(dof):
            length += (q[k + 1, i] - q[k, i]) ** 2
        length = math.sqrt(length)
        if length <= 1e-9:
            continue
        v = a = j = math.inf
        for i in range(dof):
            steep = max(abs(q[k + 1, i] - q[k, i]) / length, 1e-9)
            v = min(v, robot[0, i] / steep)
            a = min(a, robot[1, i] / steep)
            j = min(j, robot[2, i] / steep)
        time += length / v
        if last >= 0:
            far = 0.0
            for i in range(dof):
                far += robot[3, i] * _turn(q, last, last_length, k, length, i)
            d = min(0.5 * min(length, last_length), rounding[0] / (rounding[1] * far))
            slow = math.inf
            for i in range(dof):
                turn = _turn(q, last, last_length, k, length, i)
                slow = min(
                    slow,
                    math.sqrt(rounding[2] * robot[1, i] * 4.0 * d / (3.0 * turn)),
                    (rounding[3] * robot[2, i] * d * d / (1.5 * turn)) ** (1.0 / 3.0),
                )
            time += _lost(last_v, slow, last_a, last_j) + _lost(v, slow, a, j)
        last, last_length, last_v, last_a, last_j = k, length, v, a, j
    return time


@njit(**INNER)
def _turn(q, k, length_k, m, length_m, i):
    """Return by how much joint i's share changes from leg k to leg m; not quite 0."""
    u = (q[k + 1, i] - q[k, i]) / length_k
    w = (q[m + 1, i] - q[m, i]) / length_m
    return max(abs(w - u), 1e-9)


@njit(**INNER)
def _lost(fast, slow, a, j):
    """Return the time lost by changing between two speeds, against the faster one."""
    if slow >= fast:
        return 0.0
    change = (fast - slow) / a + math.sqrt((fast - slow) / j)
    return change * (fast - slow) / (2.0 * fast)


@njit(**INNER)
def _cut(rest, u, v, robot, scratch):
    """Write a straight leg between two places of the path; False: there is none."""
    q, at, last, first = rest
    corners, ints = scratch.corners, scratch.ints
    dof = q.shape[1]
    total = begin = 0.0
    for k in range(at, last):
        length = leg_length(q[k], q[k + 1], robot[4])
        if k == at:
            begin = first * length
        total += length
    low, high = min(u, v), max(u, v)
    a = begin + low * (total - begin)
    b = begin + high * (total - begin)
    i = j = -1
    end = 0.0
    for k in range(at, last):
        length = leg_length(q[k], q[k + 1], robot[4])
        end += length
        if i < 0 and end > a:
            i = k
            for m in range(dof):
                leg = q[k + 1, m] - q[k, m]
                corners[0, m] = q[k + 1, m] - (end - a) / length * leg
        if j < 0 and end > b:
            j = k
            for m in range(dof):
                leg = q[k + 1, m] - q[k, m]
                corners[1, m] = q[k + 1, m] - (end - b) / length * leg
    if i < 0 or j < 0 or i == j:
        return False
    ints[I], ints[J] = i, j
    ints[FROM_VERTEX] = ints[TO_VERTEX] = 0
    ints[N_CORNERS] = 2
    return True


@njit(**INNER)
def _pull(rest, u, v, scratch):
    """Write two legs past a corner, nearer to the straight line; False for none."""
    q, at, last, first = rest
    corners, ints = scratch.corners, scratch.ints
    dof = q.shape[1]
    n = last - at - 1
    if n < 1:
        return False
    k = at + 1 + min(int(u * n), n - 1)
    behind = k > at + 1
    along = length2 = 0.0
    for m in range(dof):
        q_a = q[k - 1, m] if behind else q[at, m] + first * (q[at + 1, m] - q[at, m])
        corners[0, m] = q_a
        corners[2, m] = q[k + 1, m]
        line = q[k + 1, m] - q_a
        along += (q[k, m] - q_a) * line
        length2 += line * line
    share = min(max(along / max(length2, 1e-12), 0.0), 1.0)
    for m in range(dof):
        foot = corners[0, m] + share * (corners[2, m] - corners[0, m])
        corners[1, m] = q[k, m] + v * (foot - q[k, m])
    ints[I], ints[J] = k - 1, k + 1
    ints[FROM_VERTEX], ints[TO_VERTEX] = (1 if behind else 0), 1
    ints[N_CORNERS] = 3
    return True


@njit(**LEAN)
def next_change(rest, terms, scratch, drawn, most, worth):
    """Look for a change that saves the share `worth` of the rest of a path.

    At most `most` changes are weighed, from number `drawn` + 1 on. Returns (the last
    number, found): `scratch` says what was found.
    """
    q, at, last, _ = rest
    robot, rounding, continuous = terms
    new, corners, ints = scratch
    before = path_time(q[at:], last - at + 1, robot, rounding)
    for _ in range(most):
        drawn += 1
        u, v = (0.5 + drawn * _R2_U) % 1.0, (0.5 + drawn * _R2_V) % 1.0
        if drawn % 2:
            found = _cut(rest, u, v, robot, scratch)
        else:
            found = _pull(rest, u, v, scratch)
        if not found:
            continue
        unwrap(corners, ints[N_CORNERS], continuous)
        n = 0
        for k in range(at, ints[I] + 1):
            copy_row(q[k], new[n])
            n += 1
        for k in range(ints[N_CORNERS]):
            copy_row(corners[k], new[n])
            n += 1
        for k in range(ints[J] if ints[TO_VERTEX] else ints[J] + 1, last + 1):
            copy_row(q[k], new[n])
            n += 1
        if path_time(new, n, robot, rounding) < (1.0 - worth) * before:
            return drawn, True
    return drawn, False


def new_scratch(room: int, dof: int) -> Scratch:
    """Return scratch for paths of so many corners."""
    return Scratch(np.empty((room + 4, dof)), np.empty((3, dof)), np.zeros(5, np.int64))
