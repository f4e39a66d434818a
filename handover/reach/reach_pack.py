"""Pack the settled cells of a build into the arrays of a ReachMap."""

import numpy as np

from handover.reach import _reach_build as kernels
from handover.reach import _reach_lookup as lookup
from handover.reach._reach_build import Cells
from handover.reach.chain import Chain
from handover.reach.reach_grid import ReachGrid
from handover.reach.reach_map import ReachMap


def compressed(
    chain: Chain, grid: ReachGrid, cells: Cells, reference: float, built: dict
) -> ReachMap:
    """Pack the settled cells of a build into a ReachMap."""
    n = grid.rotations.n_cells
    quality = cells.quality.reshape(-1, n)
    count = np.count_nonzero(quality, axis=1)
    occupied = np.flatnonzero(count)
    row_of = np.full(grid.n_positions, -1, np.int32)
    row_of[occupied] = np.arange(len(occupied))
    bits = np.zeros((len(occupied), -(-n // 64)), np.uint64)
    lookup.pack_bits(quality[occupied], bits)
    marked = np.flatnonzero(cells.quality)
    way = cells.way[marked]
    rooted = way == kernels.ROOT
    row = row_of[marked[rooted] // n]
    packed = lookup.Packed(
        row_of=row_of,
        bits=bits,
        first=np.concatenate([[0], np.cumsum(count[occupied])]),
        first_root=np.searchsorted(row, np.arange(len(occupied) + 1)),
        quality=cells.quality[marked],
        way=way,
        roots=cells.witness[marked[rooted]],
    )
    return ReachMap(chain, grid, packed, float(reference), built)
