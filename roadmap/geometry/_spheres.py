"""Choosing the spheres of a cover, and proving that their union holds a solid."""

import numpy as np
from numba import njit

from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import FULL, FULL_INNER, INNER, LEAN


@njit(**LEAN)
def coverage(centers, radii, samples, around, rows):
    """Set bit s of rows[m] where sphere m holds sample s.

    samples: (3, n), one coordinate a row; rows: (m, words) uint64. around: (words, 4)
    scratch, a ball around the samples of each word.
    """
    for w in range(rows.shape[1]):
        _ball_around(samples[:, 64 * w : 64 * (w + 1)], around[w])
    for m in range(centers.shape[0]):
        a, b, c, r = centers[m, 0], centers[m, 1], centers[m, 2], radii[m]
        for w in range(rows.shape[1]):
            word, first = np.uint64(0), 64 * w
            x, y, z = around[w, 0] - a, around[w, 1] - b, around[w, 2] - c
            far = r + around[w, 3]
            apart = x * x + y * y + z * z > far * far
            for s in range(0 if apart else min(64, samples.shape[1] - first)):
                x = samples[0, first + s] - a
                y = samples[1, first + s] - b
                z = samples[2, first + s] - c
                word |= np.uint64(x * x + y * y + z * z <= r * r) << np.uint64(s)
            rows[m, w] = word


@njit(**INNER)
def _ball_around(points, ball):
    """Write a ball around points (3, n), a little larger than it must be."""
    ball[3] = 0.0
    for k in range(3):
        low, high = points[k, 0], points[k, 0]
        for s in range(points.shape[1]):
            low, high = min(low, points[k, s]), max(high, points[k, s])
        ball[k] = 0.5 * (low + high)
        ball[3] += (high - low) * (high - low)
    ball[3] = 0.5 * ball[3] ** 0.5 + 1e-9


@njit(**INNER)
def _bits(v):
    """Count the bits of a 64-bit word."""
    v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
    low = np.uint64(0x3333333333333333)
    v = (v & low) + ((v >> np.uint64(2)) & low)
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((v * np.uint64(0x0101010101010101)) >> np.uint64(56))


@njit(**INNER)
def _words(row):
    """Return how many bits a row has, and in which words, as bits; 63: or any later."""
    n, found = 0, np.uint64(0)
    for w in range(row.shape[0]):
        n += _bits(row[w])
        found |= np.uint64(row[w] != 0) << np.uint64(min(w, 63))
    return n, found


@njit(**INNER)
def _complete(rows, held, words, missing, chosen, n, limit, scratch):
    """Add greedily the rows that hold most of `missing` to chosen; return the count.

    Stops with `limit` + 1 where more than `limit` would be needed. The rows together
    hold all of `missing`. held, words: (m,) `_words` of each row. scratch: (4, m + 1)
    int64. A row never gains more than `most`, what it may have when last asked.
    """
    useful, most, some, rest = scratch[0], scratch[1], scratch[2], scratch[3]
    n_useful, (left, where) = 0, _words(missing)
    for m in range(rows.shape[0]):
        useful[n_useful], most[n_useful] = m, held[m]
        n_useful += words[m] & where != 0
    while left > 0:
        if n >= limit:
            return limit + 1
        n_some, later = 0, left
        for w in range(missing.shape[0]):
            later -= _bits(missing[w])
            some[n_some], rest[n_some] = w, later
            n_some += missing[w] != 0
        # with no row that gains its share they would be more than `limit`
        best, best_gain, kept = -1, (left - 1) // (limit - n), 0
        for k in range(n_useful):
            m, gain = useful[k], most[k]
            if gain > best_gain:
                sure, gain = 0, left
                for i in range(n_some):
                    sure += _bits(rows[m, some[i]] & missing[some[i]])
                    gain = sure + rest[i]
                    if gain <= best_gain:
                        break
                if gain > best_gain:
                    best, best_gain = m, gain
            # a row that holds nothing missing will not help later either
            useful[kept], most[kept] = m, gain
            kept += gain > 0
        n_useful = kept
        if best < 0:
            return limit + 1
        chosen[n] = best
        n += 1
        left -= best_gain
        for w in range(missing.shape[0]):
            missing[w] &= ~rows[best, w]
    return n


@njit(**FULL)
def choose(rows, chosen, n, few, centers, rounds, seed):
    """Complete the first n of chosen to a cover, and better one of `few` rows or fewer.

    Bettering takes neighbouring spheres out and completes again, `rounds` times; what
    is not worse is kept. A xorshift of `seed` picks who goes, so that the same input
    gives the same cover. Returns the new count.
    """
    everything = np.zeros(rows.shape[1], np.uint64)
    held, words = np.empty(rows.shape[0], np.int64), np.empty(rows.shape[0], np.uint64)
    for m in range(rows.shape[0]):
        held[m], words[m] = _words(rows[m])
        for w in range(everything.shape[0]):
            everything[w] |= rows[m, w]
    trial, missing = np.empty_like(chosen), np.empty_like(everything)
    scratch = np.empty((4, max(rows.shape) + 1), np.int64)
    _without(rows, everything, chosen, n, missing)
    n = _complete(rows, held, words, missing, chosen, n, chosen.shape[0] - 1, scratch)
    state = np.uint64(seed)
    for _ in range(rounds if n <= few else 0):
        if n < 2:
            return n
        state ^= state << np.uint64(13)
        state ^= state >> np.uint64(7)
        state ^= state << np.uint64(17)
        draw = np.int64(state >> np.uint64(33))
        pivot = draw % n
        out = 2 + (draw >> 12) % 4
        kept = _keep_far(chosen, n, pivot, out, centers, trial)
        _without(rows, everything, trial, kept, missing)
        if draw % 3 == 0:
            # a start that greed would not choose
            trial[kept] = _any_useful(rows, missing, draw)
            for w in range(missing.shape[0]):
                missing[w] &= ~rows[trial[kept], w]
            kept += 1
        count = _complete(rows, held, words, missing, trial, kept, n, scratch)
        if count <= n:
            n = _without_redundant(rows, everything, trial, count)
            for k in range(n):
                chosen[k] = trial[k]
    return n


@njit(**INNER)
def _without(rows, everything, chosen, n, missing):
    """Write to `missing` what the first n of chosen do not hold."""
    for w in range(everything.shape[0]):
        missing[w] = everything[w]
    for k in range(n):
        for w in range(everything.shape[0]):
            missing[w] &= ~rows[chosen[k], w]


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


@njit(**FULL_INNER)
def _without_redundant(rows, everything, chosen, n):
    """Drop every row whose samples the others hold; return the new count."""
    once, twice = np.zeros_like(everything), np.zeros_like(everything)
    k, last = n - 1, n + 1  # how many there were when they were counted
    while k >= 0:
        for w in range(everything.shape[0] if n < last else 0):
            once[w] = twice[w] = np.uint64(0)
            for j in range(n):
                twice[w] |= once[w] & rows[chosen[j], w]
                once[w] |= rows[chosen[j], w]
        needed, last = False, n
        for w in range(everything.shape[0]):
            others = twice[w] | (once[w] & ~rows[chosen[k], w])
            if everything[w] & ~others:
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
