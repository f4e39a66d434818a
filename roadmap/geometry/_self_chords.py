"""Whole motions against the robot itself, proved pair by pair along chords.

A point that moves by x(t) is never farther from the chord between x(t0) and x(t1) than
(t1 - t0)^2 / 8 times the bound of its second derivative. So two shells are apart all
along where one direction parts them at both ends by more than that sag. The direction
is fixed in the body that carries both: joints that move both do not count.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER
from roadmap.geometry._gjk import Shell, along, separation
from roadmap.kinematics._forward import body_frames, place_of, turned, turned_back

MAX_DEPTH = 7  # halvings of a motion
_SAG_WASTED = 0.3  # [m] a sag for which no pair is far enough apart
_SAG_OF_SHELLS = 0.005  # [m] and one for which shells are not looked at yet
_SAG_LAST = 2e-4  # [m] below it a pair is given up


class Chords(NamedTuple):
    """Scratch of one thread."""

    frames: np.ndarray  # (MAX_DEPTH + 2, n_bodies, 12) of the bodies at ends of chords
    rods: np.ndarray  # (MAX_DEPTH + 2, n_shells, 6) ends of the rods there
    axes: np.ndarray  # (n, 3) what parted each pair last, in the body that carries both
    sags: np.ndarray  # (n,) of the whole motion as one chord [m]
    lists: np.ndarray  # (MAX_DEPTH + 1, n) pairs that are open at a level
    levels: np.ndarray  # (MAX_DEPTH + 1, 4) how many, rows of both ends, next child
    way: np.ndarray  # (3,) a direction,
    after: np.ndarray  # (3,) and another
    at: np.ndarray  # (dof,) a configuration
    simplex: np.ndarray  # (16, 3) of GJK


@njit(**INNER)
def place_ends(model, q, dq, t, row, c):
    """Place bodies and rods at q + t dq in a row of the scratch."""
    for j in range(dq.shape[0]):
        c.at[j] = q[j] + t * dq[j]
    frames = c.frames[row]
    body_frames(model.tree_i, model.tree_f, c.at, frames)
    for i in range(model.rods.shape[0]):
        f, r, out = frames[model.shell_body[i]], model.rods[i], c.rods[row, i]
        out[0], out[1], out[2] = place_of(f, r)
        out[3], out[4], out[5] = place_of(f, r[3:])


@njit(**INNER)
def write_sags(model, dq, c):
    """Write how far each pair's points can be from their chords, whole motion [m]."""
    tree_i, tree_f = model.tree_i, model.tree_f
    for p in range(model.pairs.shape[0]):
        bend, common = 0.0, model.carrier[p]
        for side in range(2):
            shell, body = model.pairs[p, side], model.pairs[p, 2 + side]
            beyond = 0.0  # twice the speeds by joints beyond this one
            while body != common:
                kind = tree_i[body, 2]
                if kind != 0:
                    w = abs(tree_f[body, 15] * dq[tree_i[body, 1]])
                    reach = w * model.shell_reach[shell, body]
                    if kind == 1:
                        bend += w * (beyond + reach)
                    beyond += 2.0 * reach
                body = tree_i[body, 0]
        c.sags[p] = 0.125 * bend


@njit(**INNER)
def rods_apart(model, p, c, first, last, axis):
    """Return how far a direction (in the carrier) parts the rods at both ends [m]."""
    a, b = model.pairs[p, 0], model.pairs[p, 1]
    least = math.inf
    for end in range(2):
        row = last if end else first
        f = c.frames[row, model.carrier[p]]
        wx, wy, wz = turned(f, axis[0], axis[1], axis[2])
        ra, rb = c.rods[row, a], c.rods[row, b]
        low = min(
            wx * ra[0] + wy * ra[1] + wz * ra[2], wx * ra[3] + wy * ra[4] + wz * ra[5]
        )
        high = max(
            wx * rb[0] + wy * rb[1] + wz * rb[2], wx * rb[3] + wy * rb[4] + wz * rb[5]
        )
        least = min(least, low - high)
    return least - model.rods[a, 6] - model.rods[b, 6]


@njit(**INNER)
def shells_apart(model, p, c, first, last, axis):
    """Return how far a direction (in the carrier) parts the shells at both ends [m]."""
    row_i = model.pairs[p]
    least = math.inf
    for end in range(2):
        frames = c.frames[last if end else first]
        wx, wy, wz = turned(frames[model.carrier[p]], axis[0], axis[1], axis[2])
        a = Shell(row_i[4], row_i[5], frames[row_i[2]])
        b = Shell(row_i[6], row_i[7], frames[row_i[3]])
        low = -along(model.points, a, -wx, -wy, -wz)
        least = min(least, low - along(model.points, b, wx, wy, wz))
    return least


@njit(**INNER)
def towards(rods, a, b, out):
    """Write the way from rod b to rod a where they are nearest; return its length."""
    p, r = rods[a], rods[b]
    ux, uy, uz = p[3] - p[0], p[4] - p[1], p[5] - p[2]
    vx, vy, vz = r[3] - r[0], r[4] - r[1], r[5] - r[2]
    wx, wy, wz = p[0] - r[0], p[1] - r[1], p[2] - r[2]
    uu = ux * ux + uy * uy + uz * uz + 1e-18
    uv = ux * vx + uy * vy + uz * vz
    vv = vx * vx + vy * vy + vz * vz + 1e-18
    uw = ux * wx + uy * wy + uz * wz
    vw = vx * wx + vy * wy + vz * wz
    below = uu * vv - uv * uv
    s = 0.5
    if below > 1e-12 * uu * vv:
        s = min(1.0, max(0.0, (uv * vw - vv * uw) / below))
    t = (uv * s + vw) / vv
    if t < 0.0:
        t, s = 0.0, min(1.0, max(0.0, -uw / uu))
    elif t > 1.0:
        t, s = 1.0, min(1.0, max(0.0, (uv - uw) / uu))
    out[0] = wx + s * ux - t * vx
    out[1] = wy + s * uy - t * vy
    out[2] = wz + s * uz - t * vz
    return math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])


@njit(**INNER)
def add_turned(f, way, scale, axis):
    """Add a world direction, seen in frame f and scaled, to `axis`."""
    x, y, z = turned_back(f, way[0] * scale, way[1] * scale, way[2] * scale)
    axis[0], axis[1], axis[2] = axis[0] + x, axis[1] + y, axis[2] + z


@njit(**INNER)
def unit(axis):
    """Make a direction one long; False where it is none."""
    length = math.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    if not length > 1e-9:
        return False
    for k in range(3):
        axis[k] /= length
    return True


@njit(**INNER)
def chord_state(model, p, c, first, last, sag, margin, need):
    """Return 0 where a pair keeps `need` along a chord, 1 open, 2 nearer than `margin`.

    `sag`: of this chord [m].
    """
    if sag > _SAG_WASTED:
        return 1
    axis, way, s = c.axes[p], c.way, c.simplex
    asked = need + sag
    known = axis[0] != 0.0 or axis[1] != 0.0 or axis[2] != 0.0
    if known:
        if rods_apart(model, p, c, first, last, axis) >= asked:
            return 0
    a, b, carrier = model.pairs[p, 0], model.pairs[p, 1], model.carrier[p]
    x, y, z = axis[0], axis[1], axis[2]
    axis[0] = axis[1] = axis[2] = 0.0
    near = math.inf
    for end in range(2):
        row = last if end else first
        length = towards(c.rods[row], a, b, way)
        near = min(near, length)
        scale = 1.0 / length if length > 1e-9 else 0.0
        add_turned(c.frames[row, carrier], way, scale, axis)
    spare = near - model.rods[a, 6] - model.rods[b, 6] - asked
    if unit(axis) and spare >= 0.0:
        if rods_apart(model, p, c, first, last, axis) >= asked:
            return 0
    if known:
        axis[0], axis[1], axis[2] = x, y, z
    if sag > _SAG_OF_SHELLS:
        return 1
    if shells_apart(model, p, c, first, last, axis) >= asked:
        return 0
    row_i, after = model.pairs[p], c.after
    after[0] = after[1] = after[2] = 0.0
    for end in range(2):
        frames = c.frames[last if end else first]
        f = frames[carrier]
        way[0], way[1], way[2] = turned(f, axis[0], axis[1], axis[2])
        one = Shell(row_i[4], row_i[5], frames[row_i[2]])
        other = Shell(row_i[6], row_i[7], frames[row_i[3]])
        lower, upper = separation(model.points, one, other, way, asked, s)
        if lower < asked:
            return 2 if upper < margin else 1
        unit(way)
        add_turned(f, way, 1.0, after)
    axis[0], axis[1], axis[2] = after[0], after[1], after[2]
    if unit(axis) and (shells_apart(model, p, c, first, last, axis) >= asked):
        return 0
    return 1


@njit(**INNER)
def begin_chords(model, q, dq, c):
    """Let the whole motion be one chord, for which all pairs are open."""
    write_sags(model, dq, c)
    place_ends(model, q, dq, 0.0, 0, c)
    place_ends(model, q, dq, 1.0, 1, c)
    n, whole = model.pairs.shape[0], c.levels[0]
    for p in range(n):
        c.axes[p, 0] = c.axes[p, 1] = c.axes[p, 2] = 0.0
        c.lists[0, p] = p
    whole[0], whole[1], whole[2], whole[3] = n, 0, 1, 0


@njit(**INNER)
def apart_along(model, q, dq, margin, need, c, left):
    """Find the pairs that are not proved `need` apart along q + t dq, t in [0, 1] [m].

    `left` (n,) gets them; q and dq must be finite.

    Returns:
        (how many are left, -1), or (0, a pair that is seen nearer than `margin` [m]),
        which ends the search.
    """
    begin_chords(model, q, dq, c)
    lists, levels = c.lists, c.levels
    n_left, begin, depth = 0, 0, 0  # `begin` in the smallest chords
    while depth >= 0:
        first, last, child = levels[depth, 1], levels[depth, 2], levels[depth, 3]
        if child == 0:
            share, open_ = 0.25**depth, 0
            for k in range(levels[depth, 0]):
                p = lists[depth, k]
                sag = c.sags[p] * share
                if sag < 0.0:
                    continue
                state = chord_state(model, p, c, first, last, sag, margin, need)
                if state == 2:
                    return 0, p
                if state == 1:
                    if depth == MAX_DEPTH or sag < _SAG_LAST:
                        left[n_left] = p
                        n_left += 1
                        c.sags[p] = -1.0  # not asked again
                        continue
                    lists[depth + 1, open_] = p
                    open_ += 1
            if open_ == 0:
                begin += 1 << (MAX_DEPTH - depth)
                depth -= 1
                continue
            half = 1 << (MAX_DEPTH - depth - 1)
            t = (begin + half) / (1 << MAX_DEPTH)
            place_ends(model, q, dq, t, depth + 2, c)
            levels[depth + 1, 0] = open_
            levels[depth + 1, 1], levels[depth + 1, 2] = first, depth + 2
        elif child == 1:
            levels[depth + 1, 1], levels[depth + 1, 2] = depth + 2, last
        else:
            depth -= 1
            continue
        levels[depth, 3] = child + 1
        levels[depth + 1, 3] = 0
        depth += 1
    return n_left, -1
