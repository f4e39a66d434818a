"""Which cells a camera sees to be free, and which lie behind a seen surface.

A cube is seen free when every ray that may pass it, and those next to it, is known
to be free to behind it. A pixel without a reading is left out if all eight around it
have one; then each disc of a radius of 1 pixel holds the centre of one that counts.

Let O be a union of balls of radius kappa z / (1 - kappa) or more at depth z, with
kappa = 1 / f, P a point of O in the cube at depth z, and B a ball of just that radius
in O that holds P, with its centre C at depth c. The disc through C parallel to the
image has a radius of 1 pixel in it at least, so it holds the centre of a pixel that
counts: that ray meets O, and its reading is at most c <= z / (1 - kappa). The nearest
one lies within 1 pixel of the image of C, which lies within f |P - C| sec(angle) / c of
that of P. So if the readings of all pixels within

    pad = 1 + (f / f_least) sec(angle) / (1 - 2 kappa)

of the cube's image exceed its largest depth / (1 - kappa), the cube holds no point
of O.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.cameras._windows import cover, least, none_above
from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.kinematics._forward import place_of

HIDDEN, PARTLY, WHOLE = 0, 1, 2  # how much of a cube's image lies in the picture
CUT = 3  # a hidden block with cells that are not: it reaches behind the camera
UNSEEN, FREE, SHADOW, OCCUPIED, REMEMBERED, UNKNOWN, BEYOND = 0, 1, 2, 3, 4, 5, 6
NEAREST = 0.02  # [m] a cube nearer than that to the camera's plane is not looked at
NOTHING = 65535


class Sight(NamedTuple):
    """From where a camera looks, and what it saw."""

    pose: np.ndarray  # (12,) from base frame to camera
    lens: np.ndarray  # (12,) see `odm.cameras.view`
    table: np.ndarray  # (levels, rows, columns) of readings


class Images(NamedTuple):
    """Where the images of all cubes of a grid lie."""

    kind: np.ndarray  # (nx, ny, nz) HIDDEN, PARTLY, WHOLE or CUT
    rect: np.ndarray  # (nx, ny, nz, 5) squares that cover it; see `_windows.py`
    limit: np.ndarray  # (nx, ny, nz) reading that must be exceeded behind it


@njit(**INNER)
def limit_of(depth, lens):
    """Return the reading that must be exceeded behind `depth` [m].

    Beyond the largest reading it is that one: no cube there is free, and one is in
    shadow where anything is seen.
    """
    limit = (depth / (1.0 - lens[7]) + lens[8]) / lens[4]
    return NOTHING - 1 if limit >= NOTHING - 1 else int(math.floor(limit))


@njit(**INNER)
def clip_image(left, right, low, high, lens, table, out):
    """Write the squares of an image rectangle; return how much is in the picture."""
    u0, u1 = math.ceil(left - lens[5]), math.floor(right + lens[5])
    v0, v1 = math.ceil(low - lens[6]), math.floor(high + lens[6])
    wide, tall = lens[9], lens[10]
    if u1 < 0 or v1 < 0 or u0 >= wide or v0 >= tall:
        return HIDDEN
    whole = u0 >= 0 and v0 >= 0 and u1 < wide and v1 < tall
    left, right = int(max(u0, 0.0)) >> 1, int(min(u1, wide - 1.0)) >> 1
    low, high = int(max(v0, 0.0)) >> 1, int(min(v1, tall - 1.0)) >> 1
    if not cover(left, right, low, high, table, out):
        return HIDDEN  # it fills the picture: too near to be looked at
    return WHOLE if whole else PARTLY


@njit(**INNER)
def spread(pose, at, slope):
    """Return the sum of |a - slope c| over row a of a pose (12,) and its last row c."""
    x, y = abs(pose[at] - slope * pose[6]), abs(pose[at + 1] - slope * pose[7])
    return x + y + abs(pose[at + 2] - slope * pose[8])


@njit(**INNER)
def place_cube(sight, center, half, out):
    """Write where a cube's image lies.

    A corner (dx, dy, dz) from the centre (x, y, z), in the camera's frame, is seen
    f (dx - dz x / z) / (z + dz) away from it; the numerator is largest at the corner
    that has the sign of each of its terms.

    `half` is half of the cube's side [m]; `out` (5,) gets the squares of the camera's
    table that cover it (see `_windows.py`).

    Returns:
        HIDDEN, PARTLY or WHOLE, and the reading that must be exceeded behind it.
    """
    pose, lens, table = sight
    x, y, z = place_of(pose, center)
    deep = half * (abs(pose[6]) + abs(pose[7]) + abs(pose[8]))
    if z - deep < NEAREST:
        return HIDDEN, 0
    sx, sy = x / z, y / z
    grow = half / (z - deep)
    wide = lens[0] * grow * spread(pose, 0, sx)
    tall = lens[1] * grow * spread(pose, 3, sy)
    u, v = lens[2] + lens[0] * sx, lens[3] + lens[1] * sy
    how = clip_image(u - wide, u + wide, v - tall, v + tall, lens, table, out)
    return how, limit_of(z + deep, lens)


@njit(**LEAN)
def place_cubes(sight, origin, side, images, limit_low):
    """Place all cubes of a grid; see place_cube.

    `limit_low` (nx, ny, nz) gets a reading that is in front of the whole cube.
    """
    pose, lens = sight.pose, sight.lens
    kind, rect, limit = images
    nx, ny, nz = kind.shape
    half = 0.5 * side
    thick = side * (abs(pose[6]) + abs(pose[7]) + abs(pose[8]))
    for i in range(nx):
        px = origin[0] + side * i + half
        for j in range(ny):
            py = origin[1] + side * j + half
            for k in range(nz):
                pz = origin[2] + side * k + half
                how, behind = place_cube(sight, (px, py, pz), half, rect[i, j, k])
                kind[i, j, k] = how
                limit[i, j, k] = behind
                z = pose[6] * px + pose[7] * py + pose[8] * pz + pose[11]
                limit_low[i, j, k] = limit_of(max(0.0, z - 0.5 * thick), lens)


@njit(**INNER)
def fill_block(state, x, y, z, kind):
    """Let the 64 cells of a block be FREE, or SHADOW where they are not FREE."""
    for i in range(4 * x, 4 * x + 4):
        for j in range(4 * y, 4 * y + 4):
            row = state[i, j]
            if kind == FREE:
                for k in range(4 * z, 4 * z + 4):
                    if row[k] != BEYOND:
                        row[k] = FREE
            else:
                for k in range(4 * z, 4 * z + 4):
                    if row[k] == UNSEEN:
                        row[k] = SHADOW


@njit(**LEAN)
def see_cells(view, state, shadow):
    """Write what one camera sees of every cell: FREE, else SHADOW, else nothing.

    FREE by any camera wins over SHADOW by another; cells with points are marked later
    and win over both.
    """
    # taken out once: each time costs a counted reference
    near, seen, top_near, top_seen = view.near, view.seen, view.top_near, view.top_seen
    kind, rect = view.block_kind, view.block_rect
    limit, low = view.block_limit, view.block_low
    cells = Images(view.cell_kind, view.cell_rect, view.cell_limit)
    nbx, nby, nbz = kind.shape
    for x in range(nbx):
        for y in range(nby):
            for z in range(nbz):
                how = kind[x, y, z]
                if how == HIDDEN:
                    continue
                if how != CUT:
                    deep, shallow = limit[x, y, z], low[x, y, z]
                    if how == WHOLE and least(near, rect, x, y, z) > deep:
                        fill_block(state, x, y, z, FREE)
                        continue
                    if none_above(top_near, rect, x, y, z, shallow):
                        if not shadow or least(seen, rect, x, y, z) > deep:
                            continue
                        if how == WHOLE and none_above(
                            top_seen, rect, x, y, z, shallow
                        ):
                            fill_block(state, x, y, z, SHADOW)
                            continue
                see_block(near, seen, cells, state, (x, y, z), shadow)


@njit(**INNER)
def see_block(near, seen, cells, state, block, shadow):
    """Look at the 64 cells of a block one by one."""
    kind, rect, limits = cells
    x, y, z = block
    for i in range(4 * x, 4 * x + 4):
        for j in range(4 * y, 4 * y + 4):
            for k in range(4 * z, 4 * z + 4):
                how = kind[i, j, k]
                if how == HIDDEN or state[i, j, k] == FREE:
                    continue
                limit = limits[i, j, k]
                if how == WHOLE and least(near, rect, i, j, k) > limit:
                    state[i, j, k] = FREE
                elif shadow and least(seen, rect, i, j, k) <= limit:
                    state[i, j, k] = SHADOW


@njit(**LEAN)
def mark_hits(hit4, hit, state):
    """Let cells with a point be OCCUPIED, whatever else was seen."""
    for i in range(hit4.shape[0]):
        for j in range(hit4.shape[1]):
            for k in range(hit4.shape[2]):
                if hit4[i, j, k] == 0:
                    continue
                for z in range(4 * k, 4 * k + 4):
                    if hit[i, j, z] != 0 and state[i, j, z] != BEYOND:
                        state[i, j, z] = OCCUPIED
