"""Least and largest readings over rectangles of an image, in a few look-ups each.

Level k of a table holds at [i, j] the least value of the 2^k x 2^k square that begins
there (`odm.cameras.view.lift`). Four squares that may overlap cover a rectangle.
"""

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN

COARSE = 4  # side of the squares of `largest`, in entries


@njit(**LEAN)
def largest_of_squares(level, top):
    """Write to `top` the largest entry of each COARSE x COARSE square of `level`."""
    rows, columns = level.shape
    for i in range(top.shape[0]):
        out = top[i]
        out[:] = 0
        for a in range(COARSE * i, min(rows, COARSE * i + COARSE)):
            row = level[a]
            for b in range(columns):
                out[b // COARSE] = max(out[b // COARSE], row[b])


@njit(**INNER)
def cover(left, right, low, high, table, out):
    """Write the four squares that cover a rectangle of entries of a table, inclusive.

    Columns left to right, rows low to high. `out` (5,) gets the level, first and last
    column of squares, first and last row of them; a side shorter than the squares is
    lengthened. False where the rectangle is too large for any level.
    """
    level = 0
    while 2 << level < max(right - left, high - low) + 1:
        level += 1
    size = 1 << level
    if level >= table.shape[0] or size > min(table.shape[1], table.shape[2]):
        return False
    out[0] = level
    out[1] = min(left, table.shape[2] - size)
    out[2] = max(out[1], right - size + 1)
    out[3] = min(low, table.shape[1] - size)
    out[4] = max(out[3], high - size + 1)
    return True


@njit(**INNER)
def least(table, r, x, y, z):
    """Return the least entry of the rectangle that squares `r[x, y, z]` (5,) cover.

    Indices are unsigned: numba then asks for none whether it is negative.
    """
    k = r[x, y, z, 0]
    left, right = r[x, y, z, 1], r[x, y, z, 2]
    low, high = r[x, y, z, 3], r[x, y, z, 4]
    a = min(table[k, low, left], table[k, low, right])
    b = min(table[k, high, left], table[k, high, right])
    return min(a, b)


@njit(**INNER)
def none_above(top, r, x, y, z, limit):
    """Return True if no entry that squares `r[x, y, z]` (5,) cover is above `limit`.

    `top` has the largest of coarse squares, so entries next to them count too.
    """
    last = (1 << np.int64(r[x, y, z, 0])) - 1
    first_i, last_i = r[x, y, z, 3] // COARSE, (r[x, y, z, 4] + last) // COARSE
    first_j, last_j = r[x, y, z, 1] // COARSE, (r[x, y, z, 2] + last) // COARSE
    for i in range(first_i, last_i + 1):
        for j in range(first_j, last_j + 1):
            if top[i, j] > limit:
                return False
    return True
