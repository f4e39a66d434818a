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

from odm.exact._distances import point_at
from roadmap.compiling.jit_options import BARE, BARE_INNER, FULL_INNER, WITHIN_INNER
from roadmap.geometry._gjk import Shell, separation
from roadmap.kinematics._forward import body_frames, turned
from roadmap.kinematics._inverse import descend
from roadmap.kinematics._seven import solve_all


class Space(NamedTuple):
    """What moves, what stands, and which pairs must stay apart.

    Bodies and groups of the arm come first, then the object, then what stands.
    """

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
    thing: int  # the group of the object
    axis_row: np.ndarray  # (p,) first row of a pair's axes in the scratch
    turn_body: np.ndarray  # (dof,) body whose joint turns by it, -1: not so simple


class Scratch(NamedTuple):
    """Working memory of one thread."""

    frames: np.ndarray  # (n_bodies, 12)
    moves: np.ndarray  # (p,)
    lists: np.ndarray  # (depth, p)
    stack: np.ndarray  # (depth + 1, max(4, dof))
    simplex: np.ndarray  # (16, 3)
    group_at: np.ndarray  # (m, 3) where the groups' balls are, world frame [m]
    part_at: np.ndarray  # (n, 3) the same of the parts
    axes: np.ndarray  # (rows, 3) what parted two parts last, 0: unknown
    arms: np.ndarray  # (thing + 1, dof) distance from a joint's axis [m], -1: unknown
    leg: np.ndarray  # (dof,)
    stale: np.ndarray  # (1,) whether what stands has moved since it was written


@njit(**BARE_INNER)
def put_balls(space, first, end, scratch):
    """Write where the balls of groups first..end and of their parts are."""
    frames, at = scratch.frames, scratch.part_at
    for g in range(first, end):
        out, f = scratch.group_at[g], frames[space.group_body[g]]
        out[0], out[1], out[2] = point_at(f, space.group_ball[g])
        for i in range(space.group_span[g, 0], space.group_span[g, 1]):
            f = frames[space.part_body[i]]
            at[i, 0], at[i, 1], at[i, 2] = point_at(f, space.part_ball[i])


@njit(**FULL_INNER)
def place(space, q, scratch):
    """Write where all is that moves, at joints q; what stands, if that is stale."""
    if scratch.stale[0]:
        body_frames(space.tree_i, space.tree_f, q, scratch.frames)
        put_balls(space, space.thing + 1, space.group_body.shape[0], scratch)
        for i in range(scratch.axes.shape[0]):  # no answer depends on the last one
            for k in range(3):
                scratch.axes[i, k] = 0.0
        scratch.stale[0] = False
    else:
        n = space.group_body[space.thing] + 1
        body_frames(space.tree_i[:n], space.tree_f[:n], q, scratch.frames)
    put_balls(space, np.int64(0), space.thing + 1, scratch)
    for g in range(space.thing + 1):
        scratch.arms[g, 0] = -1.0


@njit(**WITHIN_INNER)
def beyond(a, b, far):
    """Return whether two points are at least `far` apart."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return far <= 0.0 or x * x + y * y + z * z >= far * far


@njit(**BARE_INNER)
def pair_apart(space, p, need, scratch):
    """Return (lower, upper) bounds of a pair's distance; `need` at most is proved."""
    ga, gb = space.pairs[p, 0], space.pairs[p, 1]
    at, gat, ball = scratch.part_at, scratch.group_at, space.part_ball
    ra, rb = space.group_ball[ga, 3], space.group_ball[gb, 3]
    if beyond(gat[ga], gat[gb], need + ra + rb):
        return need, 1e300
    lower, upper, row, wide = need, 1e300, space.axis_row[p], need
    a0, a1 = space.group_span[ga, 0], space.group_span[ga, 1]
    for j in range(space.group_span[gb, 0], space.group_span[gb, 1]):
        row += a1 - a0
        if beyond(gat[ga], at[j], wide + ra + ball[j, 3]):
            continue
        for i in range(a0, a1):
            if beyond(at[i], at[j], wide + ball[i, 3] + ball[j, 3]):
                continue
            # farther than their middles they cannot be: are they apart at all?
            ask = wide if beyond(at[i], at[j], wide) else space.margin[p]
            low, up = parts_apart(space, i, j, ask, scratch, row - a1 + i)
            lower, upper = min(lower, low), min(upper, up)
            if upper < space.margin[p]:
                return lower, upper
            if low < need:  # it is not proved; does the rest touch?
                wide = space.margin[p]
    return lower, upper


@njit(**FULL_INNER)
def parts_apart(space, i, j, need, scratch, row):
    """Return (lower, upper) bounds of two parts' distance; `need` at most is proved."""
    v = scratch.axes[row]
    if v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0:
        for k in range(3):
            v[k] = scratch.part_at[i, k] - scratch.part_at[j, k]
    pad, frames = space.radius[i] + space.radius[j], scratch.frames
    a = Shell(space.part_span[i, 0], space.part_span[i, 1], frames[space.part_body[i]])
    b = Shell(space.part_span[j, 0], space.part_span[j, 1], frames[space.part_body[j]])
    low, up = separation(space.points, a, b, v, need + pad, scratch.simplex)
    return low - pad, up - pad


@njit(**BARE)
def stands_clear(space, q, begin, end, scratch):
    """Return the first of pairs begin..end that is not clear at `q`, -1 for none."""
    place(space, q, scratch)
    for p in range(begin, end):
        ga, gb = space.pairs[p, 0], space.pairs[p, 1]
        far = space.margin[p] + space.group_ball[ga, 3] + space.group_ball[gb, 3]
        if beyond(scratch.group_at[ga], scratch.group_at[gb], far):
            continue
        lower, _ = pair_apart(space, p, space.margin[p], scratch)
        if not lower >= space.margin[p]:
            return p
    return -1


@njit(**BARE_INNER)
def arm_of(space, g, scratch):
    """Write how far the far side of a moving group's ball is from each joint's axis."""
    arms, center = scratch.arms[g], scratch.group_at[g]
    for j in range(arms.shape[0]):
        body = space.turn_body[j]
        if body < 0:
            arms[j] = math.inf
            continue
        f, a = scratch.frames[body], space.tree_f[body]
        ax, ay, az = turned(f, a[12], a[13], a[14])
        x, y, z = center[0] - f[9], center[1] - f[10], center[2] - f[11]
        u, v, w = y * az - z * ay, z * ax - x * az, x * ay - y * ax
        arms[j] = math.sqrt(u * u + v * v + w * w) + space.group_ball[g, 3]


@njit(**BARE_INNER)
def move_of(space, p, dq, half, scratch):
    """Bound how far a pair moves while the joints move by +- half dq from here [m].

    A joint carries a point by its distance from the joint's axis, which is what it is
    here and what the joints beyond can move the point in that time; never more than
    `reach`, which holds everywhere.
    """
    ga, gb = space.pairs[p, 0], space.pairs[p, 1]
    held = space.tree_i[space.group_body[space.thing], 0] >= 0
    g = gb if gb < space.thing or (gb == space.thing and held) else ga
    arms, move = scratch.arms[g], 0.0
    if arms[0] < 0.0:
        arm_of(space, g, scratch)
    for k in range(dq.shape[0]):
        j = dq.shape[0] - 1 - k
        if space.reach[p, j] > 0.0 and dq[j] != 0.0:
            turn = half * abs(dq[j])
            move += turn * min(space.reach[p, j], arms[j] + move)
    return move


@njit(**BARE_INNER)
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
    depth = np.int64(0)  # no literal: it would be another kernel
    while depth >= 0:
        state = stack[depth, 3]
        if state == 0.0:
            t, half = stack[depth, 0], stack[depth, 1]
            for j in range(dq.shape[0]):
                at[j] = q[j] + t * dq[j]
            place(space, at, scratch)
            bad, left = sift(space, dq, half, depth, tolerance, scratch)
            if bad >= 0:
                return bad, t
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


@njit(**BARE_INNER)
def sift(space, dq, half, depth, tolerance, scratch):
    """List the pairs of an interval that are not clear in it for the next depth.

    Returns:
        (pair, count): a pair that is given up, -1 for none, and how many are listed.
    """
    moves, lists, left = scratch.moves, scratch.lists, 0
    for k in range(int(scratch.stack[depth, 2])):
        p = np.int64(lists[depth, k])
        ga, gb, move = space.pairs[p, 0], space.pairs[p, 1], moves[p] * half
        far = space.margin[p] + space.group_ball[ga, 3] + space.group_ball[gb, 3]
        if beyond(scratch.group_at[ga], scratch.group_at[gb], far + move):
            continue
        move = move_of(space, p, dq, half, scratch)
        need = space.margin[p] + move
        lower, upper = pair_apart(space, p, need, scratch)
        if lower >= need:
            continue
        last = move < tolerance or depth + 2 >= lists.shape[0]
        if upper < space.margin[p] or last:
            return p, left
        lists[depth + 1, left] = p
        left += 1
    return -1, left


@njit(**BARE)
def path_clear(space, path, tolerance, scratch):
    """Prove the legs of a path (n, dof); return the first (pair, leg) that is not."""
    dq = scratch.leg
    for i in range(path.shape[0] - 1):
        for j in range(path.shape[1]):
            dq[j] = path[i + 1, j] - path[i, j]
        pair, _ = motion_clear(space, path[i], dq, tolerance, scratch)
        if pair >= 0:
            return pair, i
    return -1, -1


@njit(**BARE)
def follow(chain, target, step, steps, goal, work, trial, out):
    """Follow a straight line of the palm as far as the arm can; return the last corner.

    target: (12,) pose of the palm at corner 0, written. step: (3,) to the next one.
    goal: (5,) length and angle that count as 1; error to reach and most steps of a
    descent; most that a joint turns in a step. out: (steps + 1, dof) corners, all as
    the first one; the arm's joints, which come first, are written.
    """
    n = work.q.shape[0]
    for k in range(1, steps + 1):
        for i in range(3):
            target[9 + i] += step[i]
        for j in range(n):
            work.q[j] = out[k - 1, j]
        if not descend(chain, target, goal[:2], goal[2:4], work, trial):
            return k - 1
        for j in range(n):
            if abs(work.q[j] - out[k - 1, j]) > goal[4]:
                return k - 1
            out[k, j] = work.q[j]
    return steps


class Solver(NamedTuple):
    """An arm in closed form."""

    seven: tuple  # the arm, frame of its mount
    room: tuple  # for that
    free: np.ndarray  # (k,) values of the free angle
    found: np.ndarray  # (8 k, 7) solutions


@njit(**BARE_INNER)
def fill(q, arm, fingers):
    """Write joints of arm and hand to q."""
    n = arm.shape[0]
    for j in range(n):
        q[j] = arm[j]
    for j in range(fingers.shape[0]):
        q[n + j] = fingers[j]


@njit(**BARE)
def postures(space, arm, target, shut, wide, out, scratch):
    """Write free joints that bring the palm to a pose to out (n, dof), return how many.

    target: (12,) in the frame of the arm's mount. shut, wide: (k,) fingers of the
    closed and of the open hand, both must be free; the closed ones are written.
    """
    n = solve_all(arm.seven, target, arm.free, arm.room, arm.found)
    count, begin, end = 0, np.int64(0), space.pairs.shape[0]
    for i in range(n):
        q = out[count]
        fill(q, arm.found[i], wide)
        if stands_clear(space, q, begin, end, scratch) >= 0:
            continue
        fill(q, arm.found[i], shut)
        if stands_clear(space, q, begin, end, scratch) < 0:
            count += 1
    return count
