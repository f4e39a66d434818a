"""Symmetric 6 x 6 systems, written out: what a step and a dexterity are made of.

Loops over such small arrays spend most of their time waiting for what they have just
stored; written out, all numbers stay in the processor. Additions come in a fixed order,
so the same numbers give the same bits on every machine.
"""

import math

from numba import njit

from roadmap.compiling.jit_options import WITHIN_INNER


@njit(**WITHIN_INNER)
def outer(columns, diagonal, g):
    """Write the sum of weight c c^T over columns c, + diagonal I, to g (6, 6).

    columns: (n, 7) each with its weight at the end.
    """
    n = columns.shape[0]
    for i in range(6):
        # sums side by side, not one after the other: the processor does them at once
        a = b = c = d = e = f = 0.0
        for j in range(n):
            v = columns[j, 6] * columns[j, i]
            a += v * columns[j, 0]
            b += v * columns[j, 1]
            c += v * columns[j, 2]
            d += v * columns[j, 3]
            e += v * columns[j, 4]
            f += v * columns[j, 5]
        g[i, 0], g[i, 1], g[i, 2] = a, b, c
        g[i, 3], g[i, 4], g[i, 5] = d, e, f
        g[i, i] += diagonal


@njit(**WITHIN_INNER)
def eliminated(g):
    """Return g = L D L^T: the pivots (6), and below L's diagonal row by row (15)."""
    d0, c10, c20, c30, c40, c50 = g[0, 0], g[1, 0], g[2, 0], g[3, 0], g[4, 0], g[5, 0]
    o = 1.0 / d0
    l10, l20, l30, l40, l50 = c10 * o, c20 * o, c30 * o, c40 * o, c50 * o
    d1 = g[1, 1] - l10 * c10
    c21 = g[2, 1] - l20 * c10
    c31 = g[3, 1] - l30 * c10
    c41 = g[4, 1] - l40 * c10
    c51 = g[5, 1] - l50 * c10
    o = 1.0 / d1
    l21, l31, l41, l51 = c21 * o, c31 * o, c41 * o, c51 * o
    d2 = g[2, 2] - l20 * c20 - l21 * c21
    c32 = g[3, 2] - l30 * c20 - l31 * c21
    c42 = g[4, 2] - l40 * c20 - l41 * c21
    c52 = g[5, 2] - l50 * c20 - l51 * c21
    o = 1.0 / d2
    l32, l42, l52 = c32 * o, c42 * o, c52 * o
    d3 = g[3, 3] - l30 * c30 - l31 * c31 - l32 * c32
    c43 = g[4, 3] - l40 * c30 - l41 * c31 - l42 * c32
    c53 = g[5, 3] - l50 * c30 - l51 * c31 - l52 * c32
    o = 1.0 / d3
    l43, l53 = c43 * o, c53 * o
    d4 = g[4, 4] - l40 * c40 - l41 * c41 - l42 * c42 - l43 * c43
    c54 = g[5, 4] - l50 * c40 - l51 * c41 - l52 * c42 - l53 * c43
    l54 = c54 / d4
    d5 = g[5, 5] - l50 * c50 - l51 * c51 - l52 * c52 - l53 * c53 - l54 * c54
    rows = l10, l20, l21, l30, l31, l32, l40, l41, l42, l43, l50, l51, l52, l53, l54
    return (d0, d1, d2, d3, d4, d5), rows


@njit(**WITHIN_INNER)
def solution(g, b):
    """Return x with g x = b, g (6, 6) positive definite."""
    pivots, rows = eliminated(g)
    d0, d1, d2, d3, d4, d5 = pivots
    l10, l20, l21, l30, l31, l32, l40, l41, l42, l43, l50, l51, l52, l53, l54 = rows
    y0 = b[0]
    y1 = b[1] - l10 * y0
    y2 = b[2] - l20 * y0 - l21 * y1
    y3 = b[3] - l30 * y0 - l31 * y1 - l32 * y2
    y4 = b[4] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
    y5 = b[5] - l50 * y0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4
    x5 = y5 / d5
    x4 = y4 / d4 - l54 * x5
    x3 = y3 / d3 - l43 * x4 - l53 * x5
    x2 = y2 / d2 - l32 * x3 - l42 * x4 - l52 * x5
    x1 = y1 / d1 - l21 * x2 - l31 * x3 - l41 * x4 - l51 * x5
    x0 = y0 / d0 - l10 * x1 - l20 * x2 - l30 * x3 - l40 * x4 - l50 * x5
    return x0, x1, x2, x3, x4, x5


@njit(**WITHIN_INNER)
def root_of_determinant(g, least):
    """Return sqrt(det g), 0 where a pivot is not above `least`."""
    pivots, _ = eliminated(g)
    d0, d1, d2, d3, d4, d5 = pivots
    if not (d0 > least and d1 > least and d2 > least):
        return 0.0
    if not (d3 > least and d4 > least and d5 > least):
        return 0.0
    return math.sqrt(d0 * d1 * d2 * (d3 * d4 * d5))
