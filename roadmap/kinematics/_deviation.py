"""Bounds on the deviation of sphere centres from a path, on blends and off it.

Where q leaves a configuration along dq, a centre's velocity is J dq. J itself changes
along another direction: |d/dt J(q + t da) db| is bounded by `mixed_rates` over all
configurations. So what is known exactly at one configuration holds nearby, but for a
term of second order (docs/decisions/0006).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import FULL, INNER
from roadmap.kinematics._forward import body_frames, turned

# Farthest of a blend from its corner path, in d |w - u|: P of `longest_blend`.
BLEND_DEVIATION = 3.0 / 16.0
_ALONG = 3.0 / 8.0  # what the legs to the corner may weigh; see `longest_blend`


class CoverModel(NamedTuple):
    """The robot's bodies and the spheres on them; see `Robot`."""

    tree_i: np.ndarray  # (n_bodies, 3)
    tree_f: np.ndarray  # (n_bodies, 17)
    spheres: np.ndarray  # (n, 4) centre in body frame, radius [m]
    body: np.ndarray  # (n,)
    reach: np.ndarray  # (n, n_bodies) [m]


class DeviationWork(NamedTuple):
    """Scratch of `legs_deviation`."""

    frames: np.ndarray  # (n_bodies, 12)
    twist: np.ndarray  # (n_bodies, >= 6)
    along: np.ndarray  # (n_bodies,)
    bend: np.ndarray  # (n_bodies,)
    rate: np.ndarray  # (n_bodies,)
    speed: np.ndarray  # (n,)


@njit(**INNER)
def center_speeds(cover, q, dq, frames, twist, speed):
    """Write |J(q) dq| of every sphere's centre to `speed` (n,).

    frames (n_bodies, 12) and twist (n_bodies, 6), angular and linear velocity of the
    bodies' origins, are written, too.
    """
    tree_i, tree_f, spheres, body, _ = cover
    body_frames(tree_i, tree_f, q, frames)
    for b in range(tree_i.shape[0]):
        parent = tree_i[b, 0]
        if parent < 0:
            for k in range(6):
                twist[b, k] = 0.0
            continue
        up, f, t = frames[parent], frames[b], twist[parent]
        x, y, z = f[9] - up[9], f[10] - up[10], f[11] - up[11]
        for k in range(3):
            twist[b, k] = t[k]
        twist[b, 3] = t[3] + t[1] * z - t[2] * y
        twist[b, 4] = t[4] + t[2] * x - t[0] * z
        twist[b, 5] = t[5] + t[0] * y - t[1] * x
        if tree_i[b, 2] == 0:
            continue
        rate = tree_f[b, 15] * dq[tree_i[b, 1]]
        first = 0 if tree_i[b, 2] == 1 else 3
        axis = tree_f[b]
        for k in range(3):
            along = f[3 * k] * axis[12] + f[3 * k + 1] * axis[13]
            twist[b, first + k] += rate * (along + f[3 * k + 2] * axis[14])
    for i in range(spheres.shape[0]):
        f, t, s = frames[body[i]], twist[body[i]], spheres[i]
        x, y, z = turned(f, s[0], s[1], s[2])
        vx = t[3] + t[1] * z - t[2] * y
        vy = t[4] + t[2] * x - t[0] * z
        vz = t[5] + t[0] * y - t[1] * x
        speed[i] = math.sqrt(vx * vx + vy * vy + vz * vz)


@njit(**INNER)
def mixed_rates(tree_i, tree_f, a, b, rates):
    """Write what body k's joint adds to |p''[a, b]|, per reach, to `rates`.

    p''[a, b] is the sum of p_jk (a_j b_k + a_k b_j) over joints j before k, and of
    p_kk a_k b_k; |p_jk| is at most the distance of p from axis k (1 for a slide), and
    0 where j is a slide. With b = a that is `motion_bounds`.
    """
    for k in range(tree_i.shape[0]):
        rates[k] = 0.0
        if tree_i[k, 2] == 0:
            continue
        a_k = abs(tree_f[k, 15] * a[tree_i[k, 1]])
        b_k = abs(tree_f[k, 15] * b[tree_i[k, 1]])
        a_before = 0.0
        b_before = 0.0
        j = tree_i[k, 0]
        while j > 0:
            if tree_i[j, 2] == 1:
                a_before += abs(tree_f[j, 15] * a[tree_i[j, 1]])
                b_before += abs(tree_f[j, 15] * b[tree_i[j, 1]])
            j = tree_i[j, 0]
        rates[k] = a_before * b_k + b_before * a_k
        if tree_i[k, 2] == 1:
            rates[k] += a_k * b_k


@njit(**INNER)
def reached(rates, reach, i):
    """Combine bounds per body into the bound for one sphere centre."""
    total = 0.0
    for k in range(rates.shape[0]):
        total += rates[k] * reach[i, k]
    return total


@njit(**FULL)
def longest_blend(cover, corner, u, w, room, most):
    """Return (d, off): half-length of a corner's blend and bound on its deviation [m].

    No centre is farther than `off` <= `most` [m] from the corner path, and d is
    at most `room`. The blend is beside the corner path by e(y) (w - u) with
    e = 2 d y^3 (1 - y / 2), where that is r = d (1 - 2 y) from the corner, y from 0
    to 1/2 there and back. There |J (w - u)| <= V + B r + C e, with V at the corner
    itself, B bounding p''[u, w - u] and p''[w, w - u], and C p''[w - u, w - u]; so

        off <= e (V + B r) + C e^2 / 2 <= P d max(V, 3/8 B d) + C (P d)^2 / 2

    with P = 3/16, since e (1 + 8/3 (1 - 2 y)) is largest at y = 1/2.
    """
    tree_i, tree_f, reach = cover.tree_i, cover.tree_f, cover.reach
    n, n_bodies, dof = reach.shape[0], tree_i.shape[0], u.shape[0]
    turn = np.empty(dof)
    for j in range(dof):
        turn[j] = w[j] - u[j]
    speed = np.empty(n)
    frames, twist = np.empty((n_bodies, 12)), np.empty((n_bodies, 6))
    rates = np.empty((3, n_bodies))
    center_speeds(cover, corner, turn, frames, twist, speed)
    mixed_rates(tree_i, tree_f, u, turn, rates[0])
    mixed_rates(tree_i, tree_f, w, turn, rates[1])
    mixed_rates(tree_i, tree_f, turn, turn, rates[2])
    curved = 0.5 * BLEND_DEVIATION * BLEND_DEVIATION
    d = room
    for i in range(n):
        along = max(reached(rates[0], reach, i), reached(rates[1], reach, i))
        bend = reached(rates[2], reach, i)
        first, second = BLEND_DEVIATION * speed[i], curved * bend
        if (first + second * d) * d > most:
            d = 2.0 * most / (first + math.sqrt(first * first + 4.0 * second * most))
        second += BLEND_DEVIATION * _ALONG * along
        if second * d * d > most:
            d = math.sqrt(most / second)
    off = 0.0
    for i in range(n):
        along = max(reached(rates[0], reach, i), reached(rates[1], reach, i))
        e = BLEND_DEVIATION * d
        fastest = max(speed[i], _ALONG * along * d)
        bend = reached(rates[2], reach, i)
        off = max(off, e * fastest + 0.5 * bend * e * e)
    return d, min(off, most)


@njit(**INNER)
def legs_deviation(cover, q_leg, leg, share, off, work):
    """Bound the deviation from a leg of motions that begin off it, to its ends [m].

    They begin at q_leg + off, with q_leg at `share` of the leg, whose displacement is
    `leg`. After the part t of such a motion a centre is off the leg by at most

        (1 - t) min(G, V + t B + (1 - t) C / 2),

    with V = |J(q_leg) off|, B bounding p''[off] along what is left of the leg, C
    p''[off, off], and G |J off| at any configuration.
    """
    tree_i, tree_f, _, _, reach = cover
    frames, twist, along, bend, rate, speed = work
    center_speeds(cover, q_leg, off, frames, twist, speed)
    mixed_rates(tree_i, tree_f, leg, off, along)
    mixed_rates(tree_i, tree_f, off, off, bend)
    for k in range(tree_i.shape[0]):
        rate[k] = 0.0
        if tree_i[k, 2] != 0:
            rate[k] = abs(tree_f[k, 15] * off[tree_i[k, 1]])
    longer = max(share, 1.0 - share)
    worst = 0.0
    for i in range(reach.shape[0]):
        most = reached(rate, reach, i)
        if most <= worst:
            continue
        begin = speed[i] + 0.5 * reached(bend, reach, i)
        worst = max(worst, highest(begin, longer * reached(along, reach, i), most))
    return worst


@njit(**INNER)
def highest(begin, slope, most):
    """Return the largest (1 - t) min(most, begin + t slope) for t in [0, 1]."""
    if begin >= most:
        return most
    t = max(0.0, 0.5 * (slope - begin) / slope) if slope > 0.0 else 0.0
    if begin + t * slope <= most:
        return (1.0 - t) * (begin + t * slope)
    return (1.0 - (most - begin) / slope) * most
