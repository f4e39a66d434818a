"""Convex parts of a moving arm against all else: poses and whole straight motions.

The same proof as that of self-collision (`roadmap/geometry/_self_collision.py`): an
interval is clear for a pair when, in its middle, the two are farther apart than the
margin and all that they can move in half of it. Parts are points with a radius round
them, so balls and capsules are exact. Parts of one link are a group with a ball.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.geometry._gjk import Shell, separation
from roadmap.jit_options import FULL
from roadmap.kinematics._forward import body_frames


class Space(NamedTuple):
    """What moves, what stands, and which pairs must stay apart."""

    tree_i: np.ndarray  # (n_bodies, 3) bodies, as in `Robot`
    tree_f: np.ndarray  # (n_bodies, 17)
    part_body: np.ndarray  # (n,)
    part_span: np.ndarray  # (n, 2) rows of its points
    part_ball: np.ndarray  # (n, 4) around a part: centre in its body, radius
    radius: np.ndarray  # (n,) that its points have
    points: np.ndarray  # (k, 3) body frames [m]
    group_body: np.ndarray  # (m,) body that a group's ball is on
    group_ball: np.ndarray  # (m, 4)
    group_span: np.ndarray  # (m, 2) its parts
    pairs: np.ndarray  # (p, 2) groups
    reach: np.ndarray  # (p, dof) relative motion per unit of a joint [m/rad or 1]
    margin: np.ndarray  # (p,) to be kept [m]
    first: int  # so many pairs, from the first on, depend on the hand's pose alone


class Scratch(NamedTuple):
    """Working memory of one thread."""

    frames: np.ndarray  # (n_bodies, 12)
    moves: np.ndarray  # (p,)
    lists: np.ndarray  # (depth, p)
    stack: np.ndarray  # (depth + 1, max(4, dof))
    v: np.ndarray  # (3,)
    simplex: np.ndarray  # (16, 3)


@njit(**FULL)
def balls_gap(fa, a, fb, b, v):
    """Return the distance of two balls on bodies; v gets the way from b to a."""
    square = 0.0
    for k in range(3):
        x = fa[3 * k] * a[0] + fa[3 * k + 1] * a[1] + fa[3 * k + 2] * a[2] + fa[9 + k]
        y = fb[3 * k] * b[0] + fb[3 * k + 1] * b[1] + fb[3 * k + 2] * b[2] + fb[9 + k]
        v[k] = x - y
        square += (x - y) * (x - y)
    return math.sqrt(square) - a[3] - b[3]


@njit(**FULL)
def pair_apart(space, p, need, scratch):
    """Return (lower, upper) bounds of a pair's distance; exact only below `need`."""
    frames, v = scratch.frames, scratch.v
    ga, gb = space.pairs[p, 0], space.pairs[p, 1]
    fa, fb = frames[space.group_body[ga]], frames[space.group_body[gb]]
    lower = balls_gap(fa, space.group_ball[ga], fb, space.group_ball[gb], v)
    if lower >= need:
        return lower, 1e300
    lower, upper = 1e300, 1e300
    for i in range(space.group_span[ga, 0], space.group_span[ga, 1]):
        fi = frames[space.part_body[i]]
        if balls_gap(fi, space.part_ball[i], fb, space.group_ball[gb], v) >= need:
            continue
        for j in range(space.group_span[gb, 0], space.group_span[gb, 1]):
            fj = frames[space.part_body[j]]
            low = balls_gap(fi, space.part_ball[i], fj, space.part_ball[j], v)
            if low >= need:
                continue
            pad = space.radius[i] + space.radius[j]
            a = Shell(space.part_span[i, 0], space.part_span[i, 1], fi)
            b = Shell(space.part_span[j, 0], space.part_span[j, 1], fj)
            low, up = separation(space.points, a, b, v, need + pad, scratch.simplex)
            lower, upper = min(lower, low - pad), min(upper, up - pad)
            if upper < space.margin[p]:
                return lower, upper
    return lower, upper


@njit(**FULL)
def stands_clear(space, q, begin, end, scratch):
    """Return the first of pairs begin..end that is not clear at `q`, -1 for none."""
    body_frames(space.tree_i, space.tree_f, q, scratch.frames)
    for p in range(begin, end):
        lower, _ = pair_apart(space, p, space.margin[p], scratch)
        if not lower >= space.margin[p]:
            return p
    return -1


@njit(**FULL)
def gap_of(space, q, p, most, scratch):
    """Return the distance of pair p at `q`, at most `most` [m]."""
    body_frames(space.tree_i, space.tree_f, q, scratch.frames)
    lower, _ = pair_apart(space, p, most, scratch)
    return min(lower, most)


@njit(**FULL)
def motion_clear(space, q, dq, tolerance, scratch):
    """Prove that all pairs keep their margins along q + t dq, t in [0, 1].

    tolerance: [m] a pair that can move by no more and is not clear is given up.

    Returns:
        (pair, t) that is not proved clear, and where; (-1, 1.0) for none.
    """
    moves, lists, stack = scratch.moves, scratch.lists, scratch.stack
    for p in range(space.pairs.shape[0]):
        move = 0.0
        for j in range(dq.shape[0]):
            move += space.reach[p, j] * abs(dq[j])
        if not move < math.inf:
            return p, 0.0
        moves[p] = move
        lists[0, p] = p
    at = stack[stack.shape[0] - 1]
    stack[0, 0], stack[0, 1] = 0.5, 0.5
    stack[0, 2], stack[0, 3] = space.pairs.shape[0], 0.0
    depth = 0
    while depth >= 0:
        state = stack[depth, 3]
        if state == 0.0:
            t, half = stack[depth, 0], stack[depth, 1]
            for j in range(dq.shape[0]):
                at[j] = q[j] + t * dq[j]
            body_frames(space.tree_i, space.tree_f, at, scratch.frames)
            left = 0
            for k in range(int(stack[depth, 2])):
                p = lists[depth, k]
                move = moves[p] * half
                need = space.margin[p] + move
                lower, upper = pair_apart(space, p, need, scratch)
                if lower >= need:
                    continue
                last = move < tolerance or depth + 2 >= lists.shape[0]
                if upper < space.margin[p] or last:
                    return p, t
                lists[depth + 1, left] = p
                left += 1
            if left == 0:
                depth -= 1
                continue
            stack[depth + 1, 2] = left
        elif state == 2.0:
            depth -= 1
            continue
        half = 0.5 * stack[depth, 1]
        stack[depth + 1, 0] = stack[depth, 0] + (half if state == 1.0 else -half)
        stack[depth + 1, 1] = half
        stack[depth + 1, 3] = 0.0
        stack[depth, 3] = state + 1.0
        depth += 1
    return -1, 1.0
