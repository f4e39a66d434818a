"""Choosing the spheres of a cover, and proving that their union holds a solid."""

import numpy as np
from numba import njit

from roadmap._rows import copy_row
from roadmap.jit_options import FULL, FULL_INNER, INNER, LEAN


@njit(**LEAN)
def coverage(centers, radii, samples, rows):
    """Set bit s of rows[m] where sphere m holds sample s; rows (m, words) uint64."""
    one = np.uint64(1)
    for m in range(centers.shape[0]):
        for w in range(rows.shape[1]):
            rows[m, w] = np.uint64(0)
        rr = radii[m] * radii[m]
        for s in range(samples.shape[0]):
            x = samples[s, 0] - centers[m, 0]
            y = samples[s, 1] - centers[m, 1]
            z = samples[s, 2] - centers[m, 2]
            if x * x + y * y + z * z <= rr:
                rows[m, s >> 6] |= one << np.uint64(s & 63)


@njit(**INNER)
def _bits(v):
    """Count the bits of a 64-bit word."""
    v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
    low = np.uint64(0x3333333333333333)
    v = (v & low) + ((v >> np.uint64(2)) & low)
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((v * np.uint64(0x0101010101010101)) >> np.uint64(56))


@njit(**LEAN)
def complete(rows, missing, chosen, n, limit, useful):
    """Add greedily the rows that hold most of `missing` to chosen; return the count.

    Stops with `limit` + 1 where more than `limit` would be needed, or with what is
    there when nothing helps any more. useful: (m,) int64 scratch.
    """
    n_useful = rows.shape[0]
    for m in range(n_useful):
        useful[m] = m
    while True:
        best, best_gain, kept = -1, 0, 0
        for k in range(n_useful):
            m = useful[k]
            gain = 0
            for w in range(missing.shape[0]):
                if missing[w]:
                    gain += _bits(rows[m, w] & missing[w])
            if gain > best_gain:
                best, best_gain = m, gain
            if gain > 0:
                # a row that holds nothing missing will not help later either
                useful[kept] = m
                kept += 1
        n_useful = kept
        if best < 0:
            return n
        if n >= limit:
            return limit + 1
        chosen[n] = best
        n += 1
        for w in range(missing.shape[0]):
            missing[w] &= ~rows[best, w]


@njit(**FULL)
def improve(rows, everything, chosen, n, centers, rounds, seed):
    """Take neighbouring spheres out and complete again; keep what is not worse.

    A xorshift of `seed` picks who goes, so that the same input
    gives the same cover. Returns the new count.
    """
    words = everything.shape[0]
    trial = np.empty(chosen.shape[0], np.int64)
    missing = np.empty(words, np.uint64)
    useful = np.empty(rows.shape[0], np.int64)
    state = np.uint64(seed)
    for _ in range(rounds):
        if n < 2:
            return n
        state ^= state << np.uint64(13)
        state ^= state >> np.uint64(7)
        state ^= state << np.uint64(17)
        draw = np.int64(state >> np.uint64(33))
        pivot = draw % n
        out = 2 + (draw >> 12) % 4
        kept = _keep_far(chosen, n, pivot, out, centers, trial)
        for w in range(words):
            missing[w] = everything[w]
        for k in range(kept):
            for w in range(words):
                missing[w] &= ~rows[trial[k], w]
        if draw % 3 == 0:
            # a start that greed would not choose
            trial[kept] = _any_useful(rows, missing, draw)
            for w in range(words):
                missing[w] &= ~rows[trial[kept], w]
            kept += 1
        count = complete(rows, missing, trial, kept, n, useful)
        if count <= n:
            n = _without_redundant(rows, everything, trial, count)
            for k in range(n):
                chosen[k] = trial[k]
    return n


@njit(**FULL_INNER)
def _keep_far(chosen, n, pivot, out, centers, trial):
    """Copy chosen without the `out` ones nearest to the pivot."""
    p = centers[chosen[pivot]]
    gone = np.zeros(n, np.bool_)
    for _ in range(min(out, n)):
        best, nearest = -1, 1e300
        for k in range(n):
            c = centers[chosen[k]]
            d = (c[0] - p[0]) ** 2 + (c[1] - p[1]) ** 2 + (c[2] - p[2]) ** 2
            if not gone[k] and d < nearest:
                best, nearest = k, d
        gone[best] = True
    kept = 0
    for k in range(n):
        if not gone[k]:
            trial[kept] = chosen[k]
            kept += 1
    return kept


@njit(**INNER)
def _any_useful(rows, missing, draw):
    """Return a row that holds some of `missing`, starting the search at `draw`."""
    for k in range(rows.shape[0]):
        m = (draw + k) % rows.shape[0]
        for w in range(missing.shape[0]):
            if rows[m, w] & missing[w]:
                return m
    return 0


@njit(**INNER)
def _without_redundant(rows, everything, chosen, n):
    """Drop every row whose samples the others hold; return the new count."""
    k = n - 1
    while k >= 0:
        needed = False
        for w in range(everything.shape[0]):
            rest = everything[w]
            for j in range(n):
                if j != k:
                    rest &= ~rows[chosen[j], w]
            if rest:
                needed = True
                break
        if not needed:
            for j in range(k, n - 1):
                chosen[j] = chosen[j + 1]
            n -= 1
        k -= 1
    return n


@njit(**LEAN)
def worst_power(region, centers, squares, tol, stack, where):
    """Bound the largest power of a point of a convex region to its nearest sphere.

    The power of x to sphere i is |x - c_i|^2 - r_i^2; the union of the spheres holds
    the region if min_i of it is never above 0. Branch and bound: a box is dropped
    when it lies outside the region, or when some sphere's power is at most
    max(worst, 0) + tol in its whole, else it is halved.

    region: (normals, offsets, ball, box): the points of n.x <= d for all normals and
    of the ball (4,); box (6,) is centre and half extents of a box around them.
    squares: (n,) r_i^2. stack: (k, 6) scratch. where: (3,) gets the worst point.

    Returns:
        The bound max(worst, 0) + tol [m^2]; -1 when the stack is full, which proves
        nothing.
    """
    worst, top = 0.0, 1
    copy_row(region[3], stack[0])
    while top > 0:
        top -= 1
        whole, middle = _power(centers, squares, stack[top])
        if whole <= worst + tol:
            continue
        side = _side(region, stack[top])
        if side > 0:
            continue
        if side < 0 and middle > worst:
            worst = middle
            for k in range(3):
                where[k] = stack[top, k]
        if whole <= worst + tol:
            continue
        if top + 2 > stack.shape[0]:
            return -1.0
        _halve(stack, top)
        top += 2
    return worst + tol


@njit(**LEAN)
def holes(region, centers, squares, rule, stack, found):
    """Write points of the region of a power above rule[0] to found; return n.

    A search, not a proof: boxes below rule[1] in half extent are not split further,
    and nothing is looked for nearer than rule[2] to a point found. Stops when full.
    """
    n, top = 0, 1
    copy_row(region[3], stack[0])
    while top > 0:
        top -= 1
        b = stack[top]
        whole, middle = _power(centers, squares, b)
        if whole <= rule[0]:
            continue
        side = _side(region, b)
        if side > 0:
            continue
        size = max(b[3], max(b[4], b[5]))
        near = False
        for k in range(n):
            x, y, z = found[k, 0] - b[0], found[k, 1] - b[1], found[k, 2] - b[2]
            near |= x * x + y * y + z * z < rule[2] * rule[2]
        if near and size < 0.5 * rule[2]:
            continue
        if side < 0 and middle > rule[0] and not near:
            found[n, 0], found[n, 1], found[n, 2] = b[0], b[1], b[2]
            n += 1
        if n == found.shape[0] or top + 2 > stack.shape[0]:
            return n
        if size > rule[1]:
            _halve(stack, top)
            top += 2
    return n


@njit(**INNER)
def _side(region, box):
    """Return 1 for a box outside the region, -1 for its centre inside, else 0."""
    normals, offsets, ball, _ = region
    x, y, z = abs(box[0] - ball[0]), abs(box[1] - ball[1]), abs(box[2] - ball[2])
    rr = ball[3] * ball[3]
    side = -1 if x * x + y * y + z * z <= rr else 0
    x, y, z = max(x - box[3], 0.0), max(y - box[4], 0.0), max(z - box[5], 0.0)
    if x * x + y * y + z * z > rr:
        return 1
    for f in range(offsets.shape[0]):
        n = normals[f]
        over = n[0] * box[0] + n[1] * box[1] + n[2] * box[2] - offsets[f]
        if over > 0.0:
            if over > abs(n[0]) * box[3] + abs(n[1]) * box[4] + abs(n[2]) * box[5]:
                return 1
            side = 0
    return side


@njit(**INNER)
def _power(centers, squares, box):
    """Return min over spheres of the largest power in a box, and at its centre."""
    whole, middle = 1e300, 1e300
    for i in range(squares.shape[0]):
        u = abs(box[0] - centers[i, 0])
        v = abs(box[1] - centers[i, 1])
        w = abs(box[2] - centers[i, 2])
        middle = min(middle, u * u + v * v + w * w - squares[i])
        u, v, w = u + box[3], v + box[4], w + box[5]
        whole = min(whole, u * u + v * v + w * w - squares[i])
    return whole, middle


@njit(**INNER)
def _halve(stack, top):
    """Replace the box at `top` by its two halves across the longest extent."""
    a, b, c = stack[top, 3], stack[top, 4], stack[top, 5]
    axis = 0 if a >= b and a >= c else (1 if b >= c else 2)
    half = 0.5 * stack[top, 3 + axis]
    for k in range(6):
        stack[top + 1, k] = stack[top, k]
    stack[top, 3 + axis] = half
    stack[top + 1, 3 + axis] = half
    stack[top, axis] -= half
    stack[top + 1, axis] += half
