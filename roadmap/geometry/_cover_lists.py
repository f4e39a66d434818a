"""Which of many small balls lie within reach of the centres of others, as lists."""

import math

import numpy as np
from numba import njit

from roadmap.jit_options import FULL, FULL_INNER


@njit(**FULL)
def cover_lists(pairs, centers, radii, reach):
    """Return which balls each ball covers, and which cover it, as lists (CSR).

    A ball covers itself, and another one that lies within `reach` of its own centre.

    Args:
        pairs: (m, 2) balls that may cover each other: each two once, in any order.
        centers: (n, 3) [m].
        radii: (n,) [m].
        reach: How far around its centre a ball covers [m].

    Returns:
        Where the list of each ball begins, and the end, (n + 1,), and the balls named,
        ascending in each list; then the same of those that cover it.
    """
    n, m = radii.shape[0], pairs.shape[0]
    fits, ptr = np.zeros((m, 2), np.bool_), np.zeros(n + 1, np.int64)
    for k in range(m):
        total = 0.0
        for c in range(3):
            apart = centers[pairs[k, 0], c] - centers[pairs[k, 1], c]
            total += apart * apart
        for side in range(2):
            if math.sqrt(total) + radii[pairs[k, 1 - side]] <= reach:
                fits[k, side] = True
                ptr[pairs[k, side] + 1] += 1
    for i in range(n):
        ptr[i + 1] += ptr[i] + 1
    covers, free = np.empty(ptr[n], np.int64), ptr.copy()
    for i in range(n):
        covers[free[i]] = i
        free[i] += 1
    for k in range(m):
        for side in range(2):
            if fits[k, side]:
                i = pairs[k, side]
                covers[free[i]] = pairs[k, 1 - side]
                free[i] += 1
    back_ptr, covered_by = turned_lists(ptr, covers)
    ptr, covers = turned_lists(back_ptr, covered_by)  # once more: ascending
    return ptr, covers, back_ptr, covered_by


@njit(**FULL_INNER)
def turned_lists(ptr, named):
    """Return the lists (CSR) of what names each of n things, ascending."""
    n = ptr.shape[0] - 1
    back_ptr, by = np.zeros(n + 1, np.int64), np.empty(named.shape[0], np.int64)
    for at in range(named.shape[0]):
        back_ptr[named[at] + 1] += 1
    for i in range(n):
        back_ptr[i + 1] += back_ptr[i]
    free = back_ptr.copy()
    for i in range(n):
        for at in range(ptr[i], ptr[i + 1]):
            by[free[named[at]]] = i
            free[named[at]] += 1
    return back_ptr, by
