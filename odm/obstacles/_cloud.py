"""Points of one frame, sorted by block, as compiled loops take them."""

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from odm._groups import FRAME, array

CHUNK = 128  # points that are looked at together: they stay in the first cache


class Cloud(NamedTuple):
    """Points of one frame, by block; see `_occupancy.py`."""

    origin: np.ndarray = array("f8", "3")  # corner of the grid
    h: float = array("f8", "")  # cell size
    # the origin, once for each point of a chunk
    corners: np.ndarray = array("f8", f"{3 * CHUNK}")
    shape: np.ndarray = array("i8", "3")  # blocks
    words: np.ndarray = array("u8", "blocks", FRAME)  # occupied cells
    # block ids, the first counts[N_OCCUPIED] are valid
    occupied: np.ndarray = array("i4", "blocks", FRAME)
    slot: np.ndarray = array("i4", "blocks", FRAME)  # position in `occupied`
    # first point of an occupied block; -1 for none where points are linked
    start: np.ndarray = array("i4", "blocks+1", FRAME)
    # bounds of its points; where these are linked, of the block itself
    box: np.ndarray = array("f8", "blocks 6", FRAME)
    # scratch: squared distance of each block's box, and those that are near
    away: np.ndarray = array("f8", "blocks", FRAME)
    near: np.ndarray = array("i4", "blocks", FRAME)
    xyz: np.ndarray = array("f8", "points 3", FRAME)  # points by block
    # index each had in the input; where points are linked: the next of the same block
    order: np.ndarray = array("i4", "points", FRAME)
    # block << 6 | bit of each input point, -1 outside
    where: np.ndarray = array("i4", "points", FRAME)
    # scratch: coordinates of a chunk's points, in whole cells from the corner
    steps: np.ndarray = array("i4", f"{3 * CHUNK}", FRAME)
    # occupied blocks, points inside, outside, bad, how they are laid out, and of the
    # close test: the first points, and the first occupied blocks, which hold them; how
    # often points were looked up by what they may be near; and 1 once those are laid
    # out that the robot can come near at all
    counts: np.ndarray = array("i8", "9", FRAME)


N_OCCUPIED, N_INSIDE, N_OUTSIDE, N_BAD, LAYOUT, N_GIVEN, N_LISTED = range(7)
N_LOOKED, ARE_REACHED = 7, 8
# how points are laid out: not at all; by block; each names the next one of its block
AS_GIVEN, SORTED, LINKED = range(3)


@intrinsic
def cell_of(typingctx, x, y, z, shape_y, shape_z):  # noqa: ANN001, ANN201
    """Return block << 6 | bit of a cell by its place in the grid.

    In numbers of 32 bits, of which the processor handles eight at once: to numba the
    product of two of them has 64.
    """

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        x, y, z, shape_y, shape_z = args
        two, four, six, low = (ir.IntType(32)(v) for v in (2, 4, 6, 3))
        bx, by, bz = (builder.lshr(v, two) for v in (x, y, z))
        row = builder.add(builder.mul(bx, shape_y), by)
        block = builder.add(builder.mul(row, shape_z), bz)
        rx, ry, rz = (builder.and_(v, low) for v in (x, y, z))
        column = builder.or_(builder.shl(rx, four), builder.shl(ry, two))
        bit = builder.or_(column, rz)
        return builder.or_(builder.shl(block, six), bit)

    if not all(v == types.int32 for v in (x, y, z, shape_y, shape_z)):
        return None
    return types.int32(x, y, z, shape_y, shape_z), codegen


@intrinsic
def bits_of(typingctx, x):  # noqa: ANN001, ANN201
    """Return the 64 bits of a double, as an integer."""

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen
