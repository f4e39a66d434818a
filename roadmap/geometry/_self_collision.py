"""Self-collision of configurations and of whole straight motions."""

import math

from numba import njit

from roadmap.geometry._gjk import separation
from roadmap.kinematics._forward import body_frames

# pair_i has the columns: shell a, shell b, their bodies, first and end row of the
# points of a, first and end row of the points of b


@njit(cache=True, nogil=True)
def pair_clearance(pair_i, balls, points, p, frames, need, v, s):
    """Bound the distance of pair `p` by bounding balls, then by GJK if they fail.

    v: (3,) separating direction of last time; all zero to start with the centres.
    """
    fa = frames[pair_i[p, 2]]
    fb = frames[pair_i[p, 3]]
    a, b = balls[pair_i[p, 0]], balls[pair_i[p, 1]]
    square = 0.0
    fresh = v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0
    for k in range(3):
        x = fa[3 * k] * a[0] + fa[3 * k + 1] * a[1] + fa[3 * k + 2] * a[2] + fa[9 + k]
        y = fb[3 * k] * b[0] + fb[3 * k + 1] * b[1] + fb[3 * k + 2] * b[2] + fb[9 + k]
        square += (x - y) * (x - y)
        if fresh:
            v[k] = x - y
    lower = math.sqrt(square) - a[3] - b[3]
    if lower >= need:
        return lower, 1e300
    rows_a = (pair_i[p, 4], pair_i[p, 5])
    rows_b = (pair_i[p, 6], pair_i[p, 7])
    return separation(points, rows_a, rows_b, fa, fb, v, need, s)


@njit(cache=True, nogil=True)
def configuration_clear(model, q, margin, scratch):
    """Return the first pair that is not proved `margin` apart at `q`, -1 for none."""
    tree_i, tree_f, pair_i, _, balls, points = model
    frames, axes, _, _, _, s = scratch
    body_frames(tree_i, tree_f, q, frames)
    for p in range(pair_i.shape[0]):
        axes[p, 0] = axes[p, 1] = axes[p, 2] = 0.0
        lower, _ = pair_clearance(pair_i, balls, points, p, frames, margin, axes[p], s)
        if lower < margin:
            return p
    return -1


@njit(cache=True, nogil=True)
def motion_clear(model, q, dq, margin, tolerance, scratch):
    """Prove that no pair comes nearer than `margin` along q + t dq, t in [0, 1].

    An interval is clear for a pair if the pair is `margin` plus its largest relative
    displacement over half the interval apart in the middle. Only the pairs that are
    not clear are tested again on its halves, until clear or until the displacement
    is below `tolerance`.

    Args:
        model: (tree_i, tree_f, pair_i, pair_reach, balls, points), see
            `SelfCollision`.
        q: (dof,) start.
        dq: (dof,) whole displacement.
        margin: Distance to keep [m].
        tolerance: Displacement below which an interval is given up [m], above 0.
        scratch: (frames, axes, moves, lists, stack, simplex) from `SelfCollision`;
            may be reused, not shared between threads.

    Returns:
        (pair, t): the pair that is not proved clear and where; (-1, 1.0) for none.
    """
    tree_i, tree_f, pair_i, pair_reach, balls, points = model
    frames, axes, moves, lists, stack, s = scratch
    dof = dq.shape[0]
    for p in range(pair_i.shape[0]):
        move = 0.0
        for j in range(dof):
            move += pair_reach[p, j] * abs(dq[j])
        moves[p] = move
        axes[p, 0] = axes[p, 1] = axes[p, 2] = 0.0
        lists[0, p] = p
    # the last row of the stack serves as q(t)
    at = stack[stack.shape[0] - 1]
    stack[0, 0], stack[0, 1], stack[0, 2] = 0.5, 0.5, pair_i.shape[0]
    depth = 0
    # stack[d]: middle, half length, number of pairs of lists[d], which child is next
    stack[0, 3] = 0.0
    while depth >= 0:
        state = stack[depth, 3]
        if state == 0.0:
            t, half = stack[depth, 0], stack[depth, 1]
            for j in range(dof):
                at[j] = q[j] + t * dq[j]
            body_frames(tree_i, tree_f, at, frames)
            left = 0
            for k in range(int(stack[depth, 2])):
                p = lists[depth, k]
                move = moves[p] * half
                lower, upper = pair_clearance(
                    pair_i, balls, points, p, frames, margin + move, axes[p], s
                )
                if lower >= margin + move:
                    continue
                if upper < margin or move < tolerance or depth + 2 >= lists.shape[0]:
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


@njit(cache=True, nogil=True)
def contacts(model, q, scratch, touching):
    """Write for each pair whether its shells are in contact at `q`."""
    tree_i, tree_f, pair_i, _, balls, points = model
    frames, axes, _, _, _, s = scratch
    body_frames(tree_i, tree_f, q, frames)
    for p in range(pair_i.shape[0]):
        lower, _ = pair_clearance(pair_i, balls, points, p, frames, 1e-9, axes[p], s)
        touching[p] = lower < 1e-9
