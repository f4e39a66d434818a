"""Compiled loops of grasping: a hand's links, exact distances, fingers that close."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.exact import _distances as exact
from odm.exact._distances import compose, point_at
from roadmap.compiling.jit_options import BARE_INNER, FULL, FULL_INNER

TURNS, SLIDES = 1, 2  # kinds of joints; 0: fixed
_TIE = 1e-9  # [m] more than rounding: what may be as near is looked at
_STEPS = 400  # of a closing joint; each is at least half the tolerance


class HandArrays(NamedTuple):
    """A hand as arrays: links with parents first, and its convex solids."""

    parent: np.ndarray  # (n,) link it hangs on; -1: the palm frame
    fixed: np.ndarray  # (n, 12) its joint's frame in the parent's
    axis: np.ndarray  # (n, 3) of the joint
    kind: np.ndarray  # (n,) 0, TURNS or SLIDES
    driver: np.ndarray  # (n,) index of the driving joint, -1
    scale: np.ndarray  # (n, 2) factor and offset of the joint's value
    solids: exact.Convexes  # owner: the link
    local: np.ndarray  # (m, 12) poses of the solids in their links
    bounds: np.ndarray  # (m, 6) box around a solid in its own frame: low, high [m]
    lever: np.ndarray  # (k,) no point moves farther per unit of a driver [m]
    moves: np.ndarray  # (k, m) bool: drivers that move a solid


class MeshArrays(NamedTuple):
    """Triangles in chunks, each with a ball around it, in the object's frame."""

    faces: exact.Convexes
    first: np.ndarray  # (c + 1,) triangles of a chunk
    ball: np.ndarray  # (c, 4) centre and radius [m]


class HandState(NamedTuple):
    """Where a hand is: what the loops write."""

    palm: np.ndarray  # (12,) pose of the palm frame in the object's
    values: np.ndarray  # (k,) of the drivers
    links: np.ndarray  # (n, 12)
    frames: np.ndarray  # (m, 12) poses of the solids
    touched: np.ndarray  # (k,) int64: solid that stopped a driver, -1


@njit(**BARE_INNER)
def joint_pose(kind, axis, value, out):
    """Write the motion (12,) of a joint at a value."""
    x, y, z = axis[0], axis[1], axis[2]
    s, c = 0.0, 1.0
    if kind == TURNS:
        s, c = math.sin(value), math.cos(value)
    v = 1.0 - c
    out[0], out[1], out[2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[3], out[4], out[5] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[6], out[7], out[8] = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    slide = value if kind == SLIDES else 0.0
    for k in range(3):
        out[9 + k] = slide * axis[k]


@njit(**FULL)
def place(hand, state):
    """Write the poses of links and solids at the state's palm and values."""
    motion, joint = np.empty(12), np.empty(12)
    for n in range(hand.parent.shape[0]):
        base = state.palm if hand.parent[n] < 0 else state.links[hand.parent[n]]
        if hand.kind[n] == 0:
            compose(base, hand.fixed[n], state.links[n])
            continue
        d = hand.driver[n]
        value = state.values[d] * hand.scale[n, 0] + hand.scale[n, 1]
        joint_pose(hand.kind[n], hand.axis[n], value, motion)
        compose(base, hand.fixed[n], joint)
        compose(joint, motion, state.links[n])
    for i in range(hand.local.shape[0]):
        compose(state.links[hand.solids.owner[i]], hand.local[i], state.frames[i])


@njit(**BARE_INNER)
def box_gap(box, frame, ball):
    """Return a lower bound on the distance of a placed box (6,) from a ball (4,)."""
    x, y, z = ball[0] - frame[9], ball[1] - frame[10], ball[2] - frame[11]
    total = 0.0
    for k in range(3):
        at = frame[k] * x + frame[3 + k] * y + frame[6 + k] * z
        out = max(box[k] - at, at - box[3 + k], 0.0)
        total += out * out
    return math.sqrt(total) - ball[3]


@njit(**FULL_INNER)
def least_along(set_, i, frame, v, out):
    """Write the unit vector (3,) along v; return the least place of solid i along it.

    -inf where v is 0.
    """
    size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if size < 1e-9:
        out[0], out[1], out[2] = 0.0, 0.0, 0.0
        return -np.inf
    least = np.empty(3)
    x, y, z = v[0] / size, v[1] / size, v[2] / size
    exact.support(set_, i, frame, -x, -y, -z, least)
    out[0], out[1], out[2] = x, y, z
    return least[0] * x + least[1] * y + least[2] * z - set_.margin[i]


@njit(**BARE_INNER)
def most_along(set_, j, u):
    """Return the farthest place along u (3,) of a core of points on its own frame."""
    most = -np.inf
    for k in range(set_.ptr[j], set_.ptr[j + 1]):
        p = set_.points[k]
        most = max(most, p[0] * u[0] + p[1] * u[1] + p[2] * u[2])
    return most


@njit(**FULL)
def clearance(hand, state, use, mesh, cap, found):
    """Return the distance of the solids chosen by `use` (m,) from the mesh's surface.

    A lower bound, exact to 1e-10; at most `cap` [m]. `found` (2,) holds solid and
    triangle that were the nearest before, or -1; it gets those that are now, -1 where
    nothing is nearer than `cap`. The direction in which a solid was apart from the last
    triangle shows at once that it is as far from most others.
    """
    best = cap
    still, v, u = np.zeros(12), np.empty(3), np.zeros(3)
    gaps = np.empty(mesh.ball.shape[0])
    still[0], still[4], still[8] = 1.0, 1.0, 1.0
    a, b = hand.solids, mesh.faces
    first, j = found[0], found[1]
    found[0], found[1] = -1, -1
    if first >= 0 and use[first]:
        f = state.frames[first]
        low, _ = exact.core_between(a, first, f, b, j, still, np.inf, v)
        if low - a.margin[first] < best:
            best = low - a.margin[first]
            found[0], found[1] = first, j
    way = v.copy()
    for i in range(use.shape[0]):
        if not use[i]:
            continue
        f, box, least = state.frames[i], hand.bounds[i], -np.inf
        u[:] = 0.0
        if i == first:
            least = least_along(a, i, f, way, u)
        nearest = 0
        for c in range(gaps.shape[0]):
            gaps[c] = box_gap(box, f, mesh.ball[c])
            if gaps[c] < gaps[nearest]:
                nearest = c
        for k in range(-1, gaps.shape[0]):
            c = nearest if k < 0 else k
            if gaps[c] >= best or k == nearest:
                continue
            ball = mesh.ball[c]
            place = ball[0] * u[0] + ball[1] * u[1] + ball[2] * u[2] + ball[3]
            if least - place >= best + _TIE:
                continue
            for j in range(mesh.first[c], mesh.first[c + 1]):
                if least - most_along(b, j, u) >= best + _TIE:
                    continue
                if box_gap(box, f, b.ball[j]) >= best:
                    continue
                low, _ = exact.core_between(a, i, f, b, j, still, best + a.margin[i], v)
                least = least_along(a, i, f, v, u)
                if low - a.margin[i] < best:
                    best = low - a.margin[i]
                    found[0], found[1] = i, j
    return best


@njit(**FULL)
def close_joint(hand, state, d, end, mesh, tolerance):
    """Move driver `d` towards `end` until one of its solids is within `tolerance`.

    Conservative advancement: no point moves farther than the distance that is free, so
    nothing is jumped over and nothing overlaps. Returns whether it touched.
    """
    found = np.full(2, -1)
    state.touched[d] = -1
    for _ in range(_STEPS):
        place(hand, state)
        rest = end - state.values[d]
        free = clearance(hand, state, hand.moves[d], mesh, 1.0, found)
        if free <= tolerance:
            state.touched[d] = found[0]
            return True
        if abs(rest) < 1e-9:
            return False
        step = (free - 0.5 * tolerance) / hand.lever[d]
        state.values[d] += min(max(rest, -step), step)
    return False


@njit(**FULL)
def touching(hand, state, points, within, link, gap):
    """Find the surface points that a solid of the hand is nearer to than `within` [m].

    `points` are convexes of one point each, object frame. `link` (n,) gets the link of
    the nearest solid, -1 where none is near, `gap` (n,) its distance [m].
    """
    still = np.zeros(12)
    still[0], still[4], still[8] = 1.0, 1.0, 1.0
    a = hand.solids
    middles = np.empty((a.kind.shape[0], 3))
    for i in range(a.kind.shape[0]):
        at = point_at(state.frames[i], a.ball[i])
        middles[i, 0], middles[i, 1], middles[i, 2] = at
    for k in range(points.kind.shape[0]):
        link[k], gap[k] = -1, within
        point = points.ball[k]
        for i in range(a.kind.shape[0]):
            far = a.ball[i, 3] + gap[k] + _TIE
            x, y = point[0] - middles[i, 0], point[1] - middles[i, 1]
            z = point[2] - middles[i, 2]
            if x * x + y * y + z * z > far * far:
                continue
            f = state.frames[i]
            if box_gap(hand.bounds[i], f, points.ball[k]) >= gap[k]:
                continue
            low, _ = exact.core_distance(
                a, i, f, points, k, still, gap[k] + a.margin[i]
            )
            if low - a.margin[i] < gap[k]:
                gap[k] = low - a.margin[i]
                link[k] = a.owner[i]


@njit(**FULL)
def meets_itself(hand, state, pairs, found):
    """Say whether links of `pairs` (n, 2) touch each other."""
    for p in range(pairs.shape[0]):
        near, _ = exact.nearest_between(
            hand.solids, state.frames, pairs[p, 0], pairs[p, 1], 1e-4, found
        )
        if near < 1e-4:
            return True
    return False
