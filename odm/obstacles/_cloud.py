"""Points of one frame, sorted by block, as compiled loops take them."""

from typing import NamedTuple

import numpy as np


class Cloud(NamedTuple):
    """Points of one frame, by block; see occupancy.py."""

    origin: np.ndarray  # (3,) corner of the grid
    h: float  # cell size
    shape: np.ndarray  # (3,) blocks
    words: np.ndarray  # (n_blocks,) occupied cells
    occupied: np.ndarray  # (n_blocks,) block ids, the first counts[0] are valid
    slot: np.ndarray  # (n_blocks,) position of a block in `occupied`
    start: np.ndarray  # (n_blocks + 1,) first point of an occupied block
    box: np.ndarray  # (n_blocks, 6) bounds of its points, lower and upper
    xyz: np.ndarray  # (capacity, 3) points by block
    order: np.ndarray  # (capacity,) index each had in the input
    where: np.ndarray  # (capacity,) block << 6 | bit of each input point, -1 outside
    counts: np.ndarray  # (5,) occupied blocks, points inside, outside, bad, sorted?


N_OCCUPIED, N_INSIDE, N_OUTSIDE, N_BAD, IS_SORTED = 0, 1, 2, 3, 4
