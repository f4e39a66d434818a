"""Points of one frame, sorted by block, as compiled loops take them."""

from typing import NamedTuple

import numpy as np

from odm._groups import FRAME, array


class Cloud(NamedTuple):
    """Points of one frame, by block; see `_occupancy.py`."""

    origin: np.ndarray = array("f8", "3")  # corner of the grid
    h: float = array("f8", "")  # cell size
    shape: np.ndarray = array("i8", "3")  # blocks
    words: np.ndarray = array("u8", "blocks", FRAME)  # occupied cells
    # block ids, the first counts[N_OCCUPIED] are valid
    occupied: np.ndarray = array("i4", "blocks", FRAME)
    slot: np.ndarray = array("i4", "blocks", FRAME)  # position in `occupied`
    # first point of an occupied block
    start: np.ndarray = array("i4", "blocks+1", FRAME)
    box: np.ndarray = array("f8", "blocks 6", FRAME)  # bounds of its points
    # scratch: squared distance of each block's box, and those that are near
    away: np.ndarray = array("f8", "blocks", FRAME)
    near: np.ndarray = array("i4", "blocks", FRAME)
    xyz: np.ndarray = array("f8", "points 3", FRAME)  # points by block
    order: np.ndarray = array("i4", "points", FRAME)  # index each had in the input
    # block << 6 | bit of each input point, -1 outside
    where: np.ndarray = array("i4", "points", FRAME)
    # occupied blocks, points inside, outside, bad, sorted?, and of the close test: the
    # first points, and the first occupied blocks, which hold them
    counts: np.ndarray = array("i8", "7", FRAME)


N_OCCUPIED, N_INSIDE, N_OUTSIDE, N_BAD, IS_SORTED = 0, 1, 2, 3, 4
N_GIVEN, N_LISTED = 5, 6
