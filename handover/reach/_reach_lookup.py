"""Look up cells of a packed reach map: bits per position, then entries in their order.

Position p has row `row_of[p]` (-1: nothing is reached there); bit r of a row tells that
rotation r is reached; the entries of a row follow each other in the other arrays.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from handover.reach._reach_build import ROOT, cell_of, origin_cell
from roadmap.compiling.jit_options import BARE, BARE_INNER, WITHIN


class Packed(NamedTuple):
    """Arrays of a packed map."""

    row_of: np.ndarray  # (n_positions,) row or -1
    bits: np.ndarray  # (n_rows, words) reached rotations
    first: np.ndarray  # (n_rows + 1,) first entry of each row
    first_root: np.ndarray  # (n_rows + 1,) first stored witness of each row
    quality: np.ndarray  # (n,) 1 to 255
    predecessor: np.ndarray  # (n,) of each cell, see `Cells` of the build
    roots: np.ndarray  # (n_roots, dof) stored witnesses, lattice points


@njit(**BARE_INNER)
def ones(word):
    """Return the number of set bits of a uint64."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    low = np.uint64(0x3333333333333333)
    word = (word & low) + ((word >> np.uint64(2)) & low)
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@njit(**WITHIN)
def entry_of(packed, n_rotations, cell):
    """Return the entry of a cell, -1 where it is not reached or cell is -1."""
    if cell < 0:
        return -1
    row = packed.row_of[cell // n_rotations]
    if row < 0:
        return -1
    r = cell % n_rotations
    word = packed.bits[row, r >> 6]
    bit = np.uint64(1) << np.uint64(r & 63)
    if not word & bit:
        return -1
    at = packed.first[row] + ones(word & (bit - np.uint64(1)))
    for k in range(r >> 6):
        at += ones(packed.bits[row, k])
    return at


@njit(**BARE)
def qualities_of_cells(packed, n_rotations, cells, out):
    """Write the quality byte of each cell to `out` (n,); 0 where not reached."""
    for i in range(cells.shape[0]):
        at = entry_of(packed, n_rotations, cells[i])
        out[i] = packed.quality[at] if at >= 0 else 0


@njit(**BARE)
def qualities_of_poses(packed, grid, poses, out):
    """Write the quality byte at each pose (n, 12) to `out` (n,); 0: not reached."""
    for i in range(poses.shape[0]):
        at = entry_of(packed, grid.size[3], cell_of(grid, poses[i]))
        out[i] = packed.quality[at] if at >= 0 else 0


@njit(**BARE)
def predecessors_to_root(packed, grid, cell, predecessors):
    """Write the predecessors from a reached cell back to its root; return their number.

    And the row of the root in `packed.roots`, -1 where the map contradicts itself.
    """
    n = 0
    while True:
        at = entry_of(packed, grid.size[3], cell)
        if at < 0:
            return n, -1
        if packed.predecessor[at] == ROOT:
            row = packed.row_of[cell // grid.size[3]]
            root = packed.first_root[row]
            for k in range(packed.first[row], at):
                root += packed.predecessor[k] == ROOT
            return n, root
        if n == predecessors.shape[0]:
            return n, -1
        predecessors[n] = packed.predecessor[at]
        n += 1
        cell = origin_cell(grid, cell, predecessors[n - 1])
