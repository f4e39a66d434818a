"""Self-collision of configurations and of whole straight motions."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.geometry._gjk import Shell, separation
from roadmap.geometry._self_chords import Chords, apart_along
from roadmap.kinematics._forward import body_frames, place_of

_SHORT = 0.3  # [m] displacement up to which halves are as quick as chords
_SPARE = 1e-4  # [m] more than GJK is ever off
NEAR_END = 0.05  # part of the way to an end that an interval there is no longer than


class SelfModel(NamedTuple):
    """The tested pairs of shells of a robot.

    `pairs` has the columns: shell a, shell b, their bodies, first and end row of the
    points of a, first and end row of the points of b.
    """

    tree_i: np.ndarray  # (n_bodies, 3) bodies, as in `Robot`
    tree_f: np.ndarray  # (n_bodies, 17)
    pairs: np.ndarray  # (n, 8)
    reach: np.ndarray  # (n, dof) relative motion per unit of a joint [m/rad or 1]
    balls: np.ndarray  # (n_shells, 4) around the shells: centre in body frame, radius
    points: np.ndarray  # (k, 3) vertices in body frames [m]
    shell_body: np.ndarray  # (n_shells,) body that carries each shell
    # (n_shells, 7) around the shells: both ends of an axis in the body frame, radius
    rods: np.ndarray
    carrier: np.ndarray  # (n,) the last body that carries both shells of a pair
    shell_reach: np.ndarray  # (n_shells, n_bodies) as in `Robot`


class SelfWork(NamedTuple):
    """Scratch for one thread."""

    frames: np.ndarray  # (n_bodies, 12)
    axes: np.ndarray  # (n, 3) separating direction of each pair
    moves: np.ndarray  # (n,) relative displacement of each pair [m]
    lists: np.ndarray  # (depth, n) pairs that are open at a level
    stack: np.ndarray  # (depth + 1, max(4, dof)) see `_halved`
    simplex: np.ndarray  # (16, 3) of GJK
    chords: Chords


@njit(**LEAN)
def pair_clearance(model, p, frames, need, v, s):
    """Bound the distance of pair `p` by bounding balls, then by GJK if they fail.

    v: (3,) separating direction of last time; all zero to start with the centres.
    """
    pair_i, balls = model.pairs, model.balls
    fa = frames[pair_i[p, 2]]
    fb = frames[pair_i[p, 3]]
    a, b = balls[pair_i[p, 0]], balls[pair_i[p, 1]]
    (ax, ay, az), (bx, by, bz) = place_of(fa, a), place_of(fb, b)
    x, y, z = ax - bx, ay - by, az - bz
    if v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0:
        v[0], v[1], v[2] = x, y, z
    lower = math.sqrt(x * x + y * y + z * z) - a[3] - b[3]
    if lower >= need:
        return lower, 1e300
    shell_a = Shell(np.int64(pair_i[p, 4]), np.int64(pair_i[p, 5]), fa)
    shell_b = Shell(np.int64(pair_i[p, 6]), np.int64(pair_i[p, 7]), fb)
    return separation(model.points, shell_a, shell_b, v, need, s)


@njit(**LEAN)
def configuration_clear(model, q, margin, scratch):
    """Return the first pair that is not proved `margin` apart at `q`, -1 for none."""
    frames, axes, s = scratch.frames, scratch.axes, scratch.simplex
    body_frames(model.tree_i, model.tree_f, q, frames)
    for p in range(model.pairs.shape[0]):
        axes[p, 0] = axes[p, 1] = axes[p, 2] = 0.0
        lower, _ = pair_clearance(model, p, frames, margin, axes[p], s)
        if lower < margin:
            return p
    return -1


@njit(**LEAN)
def motion_clear(model, q, dq, margin, tolerance, finest, scratch):
    """Prove that no pair comes nearer than `margin` along q + t dq, t in [0, 1].

    An interval is clear for a pair if the pair is `margin` plus its largest relative
    displacement over half the interval apart in the middle. Only the pairs that are
    not clear are tested again on its halves, until clear or until the displacement
    is below `tolerance`. Towards the ends it is halved down to `finest`, so that a
    robot whose links are close together may move them apart: the distance may grow by
    little, and only from the end on.

    `tolerance` is above 0, `finest` at most that, all in metres; `scratch` may be
    reused, not shared between threads.

    Returns:
        (pair, t): the pair that is not proved clear and where; (-1, 1.0) for none.
    """
    for p in range(model.pairs.shape[0]):
        scratch.lists[0, p] = p
    limits = (margin, tolerance, finest)
    return _halved(model, q, dq, limits, scratch, model.pairs.shape[0])


@njit(**LEAN)
def motion_apart(model, q, dq, margin, tolerance, finest, scratch):
    """Return whether `motion_clear` finds no pair, in a fraction of its time.

    What chords prove farther apart than that could refuse is not halved; a pair that
    they do not prove is asked of the halves alone.
    """
    longest, size = _write_moves(model, dq, scratch), 0.0
    for j in range(dq.shape[0]):
        size += abs(q[j]) + abs(dq[j])
    if not size < math.inf or longest < _SHORT:  # chords ask for finite numbers
        return motion_clear(model, q, dq, margin, tolerance, finest, scratch)[0] < 0
    need = margin + tolerance + _SPARE
    chords, first = scratch.chords, scratch.lists[0]
    n, near = apart_along(model, q, dq, margin, need, chords, first)
    if near >= 0:
        n, first[0] = 1, near
    if n == 0:
        return True
    pair, _ = _halved(model, q, dq, (margin, tolerance, finest), scratch, n)
    if near < 0 or pair >= 0:
        return pair < 0
    return motion_clear(model, q, dq, margin, tolerance, finest, scratch)[0] < 0


@njit(**INNER)
def _halved(model, q, dq, limits, scratch, n):
    """Halve a motion until the first `n` pairs of `lists` are clear."""
    margin, tolerance, finest = limits
    frames, axes, moves, lists, stack, s, _ = scratch
    _write_moves(model, dq, scratch)
    for k in range(n):
        axes[lists[0, k], 0] = axes[lists[0, k], 1] = axes[lists[0, k], 2] = 0.0
    # the last row of the stack serves as q(t)
    at = stack[stack.shape[0] - 1]
    # stack[d]: middle, half length, number of pairs of lists[d], which child is next
    stack[0, 0], stack[0, 1] = 0.5, 0.5
    stack[0, 2], stack[0, 3] = n, 0.0
    depth = 0
    while depth >= 0:
        state = stack[depth, 3]
        if state == 0.0:
            t, half = stack[depth, 0], stack[depth, 1]
            for j in range(dq.shape[0]):
                at[j] = q[j] + t * dq[j]
            body_frames(model.tree_i, model.tree_f, at, frames)
            left, last = 0, tolerance
            if half > NEAR_END * min(t, 1.0 - t):
                last = finest
            for k in range(int(stack[depth, 2])):
                p = np.int64(lists[depth, k])
                move = moves[p] * half
                need = margin + move
                lower, upper = pair_clearance(model, p, frames, need, axes[p], s)
                if lower >= need:
                    continue
                if upper < margin or move < last or depth + 2 >= lists.shape[0]:
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


@njit(**INNER)
def _write_moves(model, dq, scratch):
    """Write each pair's displacement along dq; return the longest."""
    longest = 0.0
    for p in range(model.pairs.shape[0]):
        move = 0.0
        for j in range(dq.shape[0]):
            move += model.reach[p, j] * abs(dq[j])
        scratch.moves[p] = move
        longest = max(longest, move)
    return longest


@njit(**LEAN)
def contacts(model, q, scratch, touching):
    """Write for each pair whether its shells are in contact at `q`."""
    frames, axes, s = scratch.frames, scratch.axes, scratch.simplex
    body_frames(model.tree_i, model.tree_f, q, frames)
    for p in range(model.pairs.shape[0]):
        lower, _ = pair_clearance(model, p, frames, 1e-9, axes[p], s)
        touching[p] = lower < 1e-9
