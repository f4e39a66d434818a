"""Blocked cells as points: the centres of cubes that cover them.

Points stand for the blocked set B, a union of cubes, if each sphere of the robot that
comes within its radius + m of B has one of them within radius + covering radius + m.
Let `e` be half the diagonal of an eighth of a cell, the covering radius that is given.

- Where a cell is *full* and so are its six neighbours across faces, only its centre
  is given. A sphere centred in it is at most 2 e from that point, which is within
  radius + e + m if e <= least radius + m (`dense` is set where that fails).
- In all other blocked cells the centre of each blocked eighth is given. Let a sphere
  centred outside such inner cells come within radius + m of a point x of B. The
  straight way to x ends in an eighth that is given, or enters an inner cell through a
  face, and there leaves a full neighbour, which is given as it is no inner cell; so the
  way meets a given eighth no farther off than x, whose centre is within e of there.
- Cells BEYOND the robot's reach, a ball, get no points and count as full: the way above
  runs between two points of that ball, so it never needs theirs.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from odm.cameras._seen import FREE, OCCUPIED, SHADOW, WHOLE, Sight, place_cube
from odm.cameras._windows import least
from roadmap.compiling.jit_options import INNER, LEAN

FULL = 255


class Cells(NamedTuple):
    """All cells; sets of them have a bit each, (nx, ny, words), else (nx, ny, nz)."""

    blocked: np.ndarray
    inner: np.ndarray  # full with full neighbours
    closed: np.ndarray  # full without a look at `eighths`
    full: np.ndarray  # all eighths are blocked
    beyond: np.ndarray  # out of the robot's reach
    state: np.ndarray  # what is seen
    hit: np.ndarray  # eighths with a point
    eighths: np.ndarray  # blocked eighths of all cells that are not `closed`
    origin: np.ndarray  # (3,) of the grid [m]
    h: float  # side of a cell [m]


@njit(**LEAN)
def pack(state4, unseen, blocked):
    """Set the bits (nx, ny, words) of UNSEEN cells, and of those neither that nor FREE.

    `state4` (nx, ny, nz / 4) uint32 holds four cells at a time, none above 7.
    """
    ones, gather = np.uint64(0x01010101), np.uint64(0x10204080)
    one, two, last = np.uint64(1), np.uint64(2), np.uint64(28)
    four_bits = np.uint64(15)
    for x in range(state4.shape[0]):
        for y in range(state4.shape[1]):
            row = state4[x, y]
            for w in range(unseen.shape[2]):
                none, some = np.uint64(0), np.uint64(0)
                for k in range(16 * w, min(row.shape[0], 16 * w + 16)):
                    four = np.uint64(row[k])
                    if four == 0:
                        none |= four_bits << np.uint64(4 * k - 64 * w)
                        continue
                    high = (four >> one) | (four >> two)
                    # a bit of each byte, side by side
                    any_bit = (((four | high) & ones) * gather >> last) & four_bits
                    high = ((high & ones) * gather >> last) & four_bits
                    none |= (any_bit ^ four_bits) << np.uint64(4 * k - 64 * w)
                    some |= high << np.uint64(4 * k - 64 * w)
                unseen[x, y, w] = none
                blocked[x, y, w] = some


@njit(**LEAN)
def add_unseen(unseen, bits, blocked):
    """Block the unseen cells in `bits`; `bits` keeps those."""
    for x in range(bits.shape[0]):
        for y in range(bits.shape[1]):
            for w in range(bits.shape[2]):
                bits[x, y, w] &= unseen[x, y, w]
                blocked[x, y, w] |= bits[x, y, w]


@njit(**LEAN)
def list_inner(bits, inner):
    """Set `inner` to the cells of `bits` whose six neighbours are in `bits` too."""
    nx, ny, nw = bits.shape
    one, last = np.uint64(1), np.uint64(63)
    for x in range(nx):
        for y in range(ny):
            edge = x == 0 or y == 0 or x + 1 == nx or y + 1 == ny
            for w in range(nw):
                word = bits[x, y, w]
                if edge or word == 0:
                    inner[x, y, w] = 0
                    continue
                up, down = word << one, word >> one
                if w > 0:
                    up |= bits[x, y, w - 1] >> last
                if w + 1 < nw:
                    down |= bits[x, y, w + 1] << last
                inner[x, y, w] = (
                    word & up & down
                    & bits[x - 1, y, w] & bits[x + 1, y, w]
                    & bits[x, y - 1, w] & bits[x, y + 1, w]
                )  # fmt: skip


@njit(**INNER)
def beside_free(state, x, y, z):
    """Return True if a cell across a face of this one is seen to be FREE."""
    nx, ny, nz = state.shape
    return (
        (x > 0 and state[x - 1, y, z] == FREE)
        or (x + 1 < nx and state[x + 1, y, z] == FREE)
        or (y > 0 and state[x, y - 1, z] == FREE)
        or (y + 1 < ny and state[x, y + 1, z] == FREE)
        or (z > 0 and state[x, y, z - 1] == FREE)
        or (z + 1 < nz and state[x, y, z + 1] == FREE)
    )


@njit(**INNER)
def open_eighths(sight, corner, h, wanted, scratch):
    """Return those of the `wanted` eighths of a cell that a camera sees to be free."""
    near, quarter = sight.table, 0.25 * h
    free = 0
    for k in range(8):
        if (wanted >> k) & 1 == 0:
            continue
        px = corner[0] + quarter * (1 + 2 * (k >> 2))
        py = corner[1] + quarter * (1 + 2 * ((k >> 1) & 1))
        pz = corner[2] + quarter * (1 + 2 * (k & 1))
        how, limit = place_cube(sight, (px, py, pz), quarter, scratch[0, 0, 0])
        if how == WHOLE and least(near, scratch, 0, 0, 0) > limit:
            free |= 1 << k
    return free


@njit(**LEAN)
def choose_eighths(cells, shadow):
    """Choose the blocked eighths of the cells that are not in `closed`.

    All of them; but without `shadow`, those of an OCCUPIED cell that have no point in
    them are free, and such cells leave `closed` and `full`.
    """
    blocked, closed, full = cells.blocked, cells.closed, cells.full
    beyond, state, hit, eighths = cells.beyond, cells.state, cells.hit, cells.eighths
    one = np.uint64(1)
    for x in range(blocked.shape[0]):
        for y in range(blocked.shape[1]):
            for w in range(blocked.shape[2]):
                word = blocked[x, y, w] & ~beyond[x, y, w]
                if shadow:
                    word &= ~closed[x, y, w]
                z = 64 * w
                while word != 0:
                    if word & one != 0:
                        eighths[x, y, z] = FULL
                        if not shadow and state[x, y, z] == OCCUPIED:
                            eighths[x, y, z] = hit[x, y, z]
                            others = ~(one << np.uint64(z & 63))
                            closed[x, y, w] &= others
                            full[x, y, w] &= others
                    word >>= one
                    z += 1


@njit(**LEAN)
def clear_eighths(view, cells, scratch):
    """Free the eighths a camera sees to be free, in seen cells beside free ones.

    Cells with free eighths leave `full`; those without a blocked one become FREE and
    leave `blocked`.
    """
    sight = Sight(view.pose, view.lens, view.near)
    blocked, closed, full = cells.blocked, cells.closed, cells.full
    beyond, state, hit, eighths = cells.beyond, cells.state, cells.hit, cells.eighths
    origin, h = cells.origin, cells.h
    for x in range(blocked.shape[0]):
        for y in range(blocked.shape[1]):
            for w in range(blocked.shape[2]):
                word = blocked[x, y, w] & ~closed[x, y, w] & ~beyond[x, y, w]
                z = 64 * w - 1
                while word != 0:
                    mine = word & np.uint64(1) != 0
                    word >>= np.uint64(1)
                    z += 1
                    bit = np.uint64(1) << np.uint64(z & 63)
                    if not mine:
                        continue
                    kind = state[x, y, z]
                    if kind != SHADOW and kind != OCCUPIED:
                        continue
                    wanted = eighths[x, y, z] & ~hit[x, y, z]
                    if wanted == 0 or not beside_free(state, x, y, z):
                        continue
                    corner = origin[0] + h * x, origin[1] + h * y, origin[2] + h * z
                    free = open_eighths(sight, corner, h, wanted, scratch)
                    if free == 0:
                        continue
                    left = eighths[x, y, z] & ~free
                    eighths[x, y, z] = left
                    full[x, y, w] &= ~bit
                    if left == 0:
                        state[x, y, z] = FREE
                        blocked[x, y, w] &= ~bit


@njit(**LEAN)
def write_points(cells, dense, out):
    """Write the points of all blocked cells in reach; return how many there are.

    With `dense` inner cells get all their eighths, too. More points than fit into `out`
    (room, 3) are counted, not written.
    """
    blocked, inner, closed, beyond = (
        cells.blocked, cells.inner, cells.closed, cells.beyond
    )  # fmt: skip
    eighths, origin, h = cells.eighths, cells.origin, cells.h
    n = 0
    room = out.shape[0]
    quarter = 0.25 * h
    one = np.uint64(1)
    for i in range(blocked.shape[0]):
        x = origin[0] + h * i
        for j in range(blocked.shape[1]):
            y = origin[1] + h * j
            for w in range(blocked.shape[2]):
                word = blocked[i, j, w] & ~beyond[i, j, w]
                inside, whole = inner[i, j, w], closed[i, j, w]
                c = 64 * w - 1
                while word != 0:
                    mine = word & one != 0
                    lone, all_eight = inside & one != 0, whole & one != 0
                    word >>= one
                    inside >>= one
                    whole >>= one
                    c += 1
                    if not mine:
                        continue
                    z = origin[2] + h * c
                    if lone and not dense:
                        if n < room:
                            out[n, 0] = x + 2.0 * quarter
                            out[n, 1] = y + 2.0 * quarter
                            out[n, 2] = z + 2.0 * quarter
                        n += 1
                        continue
                    mask = np.int64(FULL) if all_eight else np.int64(eighths[i, j, c])
                    for e in range(8):
                        if (mask >> e) & 1 == 0:
                            continue
                        if n < room:
                            out[n, 0] = x + quarter * (1 + 2 * (e >> 2))
                            out[n, 1] = y + quarter * (1 + 2 * ((e >> 1) & 1))
                            out[n, 2] = z + quarter * (1 + 2 * (e & 1))
                        n += 1
    return n
