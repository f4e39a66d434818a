"""Least and largest readings over rectangles of an image, in a few look-ups each.

Level k of a table holds at [i, j] the least value of the 2^k x 2^k square that begins
there (`odm.cameras.view.lift`). Four squares that may overlap cover a rectangle.
"""

from numba import njit

COARSE = 4  # side of the squares of `largest`, in entries


@njit(cache=True, nogil=True)
def largest_of_squares(level, top):
    """Write to `top` the largest entry of each COARSE x COARSE square of `level`."""
    rows, columns = level.shape
    for i in range(top.shape[0]):
        for j in range(top.shape[1]):
            most = level[COARSE * i, COARSE * j]
            for a in range(COARSE * i, min(rows, COARSE * i + COARSE)):
                for b in range(COARSE * j, min(columns, COARSE * j + COARSE)):
                    if level[a, b] > most:
                        most = level[a, b]
            top[i, j] = most


@njit(cache=True, nogil=True)
def cover(left, right, low, high, table, out):
    """Write the four squares that cover a rectangle of entries, inclusive.

    Args:
        left, right, low, high: First and last column, first and last row.
        table: (levels, rows, columns).
        out: (5,) level, first and last column of squares, first and last row of them.
            A side shorter than the squares is lengthened.

    Returns:
        False where the rectangle is too large for any level.
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


@njit(cache=True, nogil=True)
def least(table, r):
    """Return the least entry of the rectangle that squares `r` (5,) cover."""
    level = table[r[0]]
    a = min(level[r[3], r[1]], level[r[3], r[2]])
    b = min(level[r[4], r[1]], level[r[4], r[2]])
    return min(a, b)


@njit(cache=True, nogil=True)
def none_above(top, r, limit):
    """Return True if no entry that squares `r` (5,) cover is larger than `limit`.

    `top` has the largest of coarse squares, so entries next to them count too.
    """
    last = (1 << r[0]) - 1
    for i in range(r[3] // COARSE, (r[4] + last) // COARSE + 1):
        for j in range(r[1] // COARSE, (r[2] + last) // COARSE + 1):
            if top[i, j] > limit:
                return False
    return True
