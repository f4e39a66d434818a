"""How many bytes a frame touches, by what it must read: the limit of its speed.

An estimate, counted from what lies in the memory after a frame, not measured: points
that are read, copied and marked, blocks that are set and cleared, stamps, signatures
and cell lists of what is left of the path. Searches and close tests are left out.
"""

import numpy as np

from odm.obstacles._cloud import N_OCCUPIED
from odm.search._state import EDGE_BASE
from odm.search.state import Memory

_POINT = 24 + 24 + 4  # read, copied; its cell
_BLOCK = 2 * (8 + 4) + 4 + 4  # word and listing, set and cleared; slot and region
_STAMP = 8 + 8 + 8 + 4  # time, period, cells, listing
_SIGN, _WORD = 32, 8  # of an item; of a block that a list names


def bytes_touched(memory: Memory, segment: int, n_points: int) -> int:
    """Return about how many bytes a frame touched in which the path was kept.

    Args:
        memory: Of the planner, after the frame.
        segment: The segment of the path that the robot is on.
        n_points: Points of the frame.
    """
    graph, path = memory.graph, memory.path
    blocks = int(memory.cloud.counts[N_OCCUPIED])
    total = n_points * _POINT + blocks * (_BLOCK + _STAMP)
    n, frame = len(graph.adj_ptr) - 1, memory.search.signature
    for ref in path.ref[segment : int(path.count[0]) - 1].tolist():
        cells, items = memory.pool, [ref]
        begin, end, entry = cells.begin, cells.end, cells.block.itemsize + _WORD
        if ref <= EDGE_BASE:
            edge = EDGE_BASE - ref
            cells, items = graph, [n + edge, *graph.edges[edge].tolist()]
            begin, end = graph.start[:-1, 0], graph.start[1:, 0]
            entry = graph.step.itemsize + _WORD
        elif ref < 0:
            continue
        for item in items:
            total += _SIGN
            if np.any(cells.signature[4 * item : 4 * item + 4] & frame):
                total += (int(end[item]) - int(begin[item])) * entry
    return total
