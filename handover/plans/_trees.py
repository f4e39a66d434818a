"""Two trees of proved motions between two poses of an arm: RRT-Connect.

J. Kuffner and S. LaValle, RRT-Connect (2000), as in `odm/search/_connect.py`, over the
proof of `_space.py`. Samples are a Halton sequence: the same question gives the same
path. Joints of the hand stand still.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from handover.plans._space import motion_clear, stands_clear
from odm.search._connect import PRIMES, halton
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import BARE, BARE_INNER, FULL, FULL_INNER

STRIDE = 1.0  # [rad or m] longest motion between two branches
NEARBY = 3  # every so many-th sample is drawn near a branch
SPREAD = 0.6  # [rad or m] this far from it at most
WORTH = 0.98  # of what it replaces a cut must be shorter than
MOST_FAILED = 20  # cuts in a row that fail, after which shortening ends


class Trees(NamedTuple):
    """Working memory of a search."""

    q: np.ndarray  # (2, n, dof)
    parent: np.ndarray  # (2, n)
    count: np.ndarray  # (2,)
    route: np.ndarray  # (m, dof) the path that was found
    corners: np.ndarray  # (1,) how many
    ends: np.ndarray  # (2,) which start and which goal it joins
    tests: np.ndarray  # (1,) motions tested
    sample: np.ndarray  # (3, dof)


@njit(**BARE_INNER)
def apart(a, b):
    """Return the distance of two configurations."""
    total = 0.0
    for j in range(a.shape[0]):
        total += (b[j] - a[j]) * (b[j] - a[j])
    return math.sqrt(total)


@njit(**BARE_INNER)
def passes(space, trees, q, q_to, tolerance, scratch):
    """Return whether a straight motion is proved, its end looked at first."""
    trees.tests[0] += 1
    begin, end = np.int64(0), space.pairs.shape[0]
    if stands_clear(space, q_to, begin, end, scratch) >= 0:
        return False
    dq = trees.sample[1]
    for j in range(q.shape[0]):
        dq[j] = q_to[j] - q[j]
    pair, _ = motion_clear(space, q, dq, tolerance, scratch)
    return pair < 0


@njit(**BARE_INNER)
def nearest(trees, side, q):
    """Return the branch of a tree nearest to q."""
    best, at = math.inf, 0
    for i in range(trees.count[side]):
        far = apart(trees.q[side, i], q)
        if far < best:
            best, at = far, i
    return at


@njit(**BARE_INNER)
def grow(space, trees, side, near, q, tolerance, scratch):
    """Add a branch from `near` towards q; return it (-1: none) and if it is there."""
    if trees.count[side] == trees.parent.shape[1]:
        return -1, False
    begin, new = trees.q[side, near], trees.count[side]
    far = apart(begin, q)
    share = 1.0 if far <= STRIDE else STRIDE / far
    end = trees.q[side, new]
    for j in range(q.shape[0]):
        end[j] = q[j] if share == 1.0 else begin[j] + share * (q[j] - begin[j])
    if not passes(space, trees, begin, end, tolerance, scratch):
        return -1, False
    trees.parent[side, new] = near
    trees.count[side] = new + 1
    return new, share == 1.0


@njit(**FULL_INNER)
def draw(trees, number, side, limits, n_arm):
    """Write sample `number`, now and then near a branch."""
    out = trees.sample[0]
    base = np.int64(halton(number, 61) * trees.count[side])
    for j in range(n_arm):
        u = halton(number, PRIMES[j])
        low, high = limits[j, 0], limits[j, 1]
        if number % NEARBY == 0:
            at = trees.q[side, base, j] + SPREAD * (2.0 * u - 1.0)
            out[j] = min(high, max(low, at))
        else:
            out[j] = low + u * (high - low)


@njit(**BARE)
def connect(space, trees, starts, goals, limits, n_arm, budget, tolerance, scratch):
    """Look for a path of proved motions; True: it is in trees.route.

    starts, goals: (m, dof) and (k, dof); trees.ends says which ones were joined. The
    budget counts motions tested.
    """
    trees.tests[0], trees.corners[0] = 0, 0
    if straight(space, trees, starts, goals, tolerance, scratch):
        return True
    for side in range(2):
        roots = starts if side == 0 else goals
        trees.count[side] = roots.shape[0]
        for i in range(roots.shape[0]):
            trees.parent[side, i] = -1
            copy_row(roots[i], trees.q[side, i])
    copy_row(starts[0], trees.sample[0])  # the hand's joints
    number = 0
    while trees.tests[0] < budget:
        number += 1
        a = 0 if trees.count[0] <= trees.count[1] else 1
        b = 1 - a
        draw(trees, number, a, limits, n_arm)
        near = nearest(trees, a, trees.sample[0])
        new, _ = grow(space, trees, a, near, trees.sample[0], tolerance, scratch)
        if new < 0:
            if trees.count[a] == trees.parent.shape[1]:
                return False
            continue
        other, there = nearest(trees, b, trees.q[a, new]), False
        while other >= 0 and not there:
            other, there = grow(
                space, trees, b, other, trees.q[a, new], tolerance, scratch
            )
        if there and write_route(trees, a, new, other):
            return True
    return False


@njit(**BARE_INNER)
def straight(space, trees, starts, goals, tolerance, scratch):
    """Join a start and a goal by one motion, the nearest ones first."""
    last, n = -1.0, goals.shape[0]
    for _ in range(starts.shape[0] * n):
        best, at = math.inf, -1
        for k in range(starts.shape[0] * n):
            far = apart(starts[k // n], goals[k % n])
            if last < far < best:
                best, at = far, k
        if at < 0:
            return False
        last, i, j = best, at // n, at % n
        if passes(space, trees, starts[i], goals[j], tolerance, scratch):
            copy_row(starts[i], trees.route[0])
            copy_row(goals[j], trees.route[1])
            trees.corners[0], trees.ends[0], trees.ends[1] = 2, i, j
            return True
    return False


@njit(**BARE_INNER)
def write_route(trees, a, new, other):
    """Write the path over a branch of tree `a` and one of the other, the same place."""
    first, last = (new, other) if a == 0 else (other, new)
    n, i = 0, first
    while i >= 0:
        i = trees.parent[0, i]
        n += 1
    m, i = 0, last
    while i >= 0:
        i = trees.parent[1, i]
        m += 1
    if n + m - 1 > trees.route.shape[0]:
        return False
    for side in range(2):  # from where they meet, to the start and to the goal
        k, i = n - 1, first if side == 0 else last
        while i >= 0:
            copy_row(trees.q[side, i], trees.route[k])
            trees.ends[side] = i
            i = trees.parent[side, i]
            k += 2 * side - 1
    trees.corners[0] = n + m - 1
    return True


@njit(**FULL)
def shorten(space, trees, budget, tolerance, scratch):
    """Cut corners of the route between drawn points on it; each cut is proved."""
    route, tested, failed, k = trees.route, 0, 0, 0
    a, b = trees.sample[0], trees.sample[2]
    while tested < budget and trees.corners[0] > 2 and failed < MOST_FAILED:
        k += 1
        failed += 1
        n = trees.corners[0]
        u, w = halton(k, 2) * (n - 1), halton(k, 3) * (n - 1)
        low, high = min(u, w), max(u, w)
        i, j = min(int(low), n - 2), min(int(high), n - 2)
        if i == j:
            continue
        length = 0.0
        for c in range(a.shape[0]):
            a[c] = route[i, c] + (low - i) * (route[i + 1, c] - route[i, c])
            b[c] = route[j, c] + (high - j) * (route[j + 1, c] - route[j, c])
        length = apart(a, route[i + 1]) + apart(route[j], b)
        for c in range(i + 1, j):
            length += apart(route[c], route[c + 1])
        if apart(a, b) > WORTH * length or n + 2 > route.shape[0]:
            continue
        tested += 1
        if not passes(space, trees, a, b, tolerance, scratch):
            continue
        shift = i + 2 - j
        if shift > 0:
            for c in range(n - 1, j, -1):
                copy_row(route[c], route[c + shift])
        else:
            for c in range(j + 1, n):
                copy_row(route[c], route[c + shift])
        copy_row(a, route[i + 1])
        copy_row(b, route[i + 2])
        trees.corners[0] = n + shift
        failed = 0
    return tested
