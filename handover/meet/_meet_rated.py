"""What single cells of an interaction workspace are worth now."""

import numpy as np
from numba import njit

from handover.jit_options import BARE
from handover.meet._meet import hand_value
from handover.meet._meet_pose import UNREACHED


@njit(**BARE)
def best_grasps(person, hands, cells, entries, room, value, grasp):
    """Write the best quality and grasp of entries (n,); UNREACHED and -1: none."""
    for i in range(entries.shape[0]):
        e = entries[i]
        value[i], grasp[i] = UNREACHED, -1
        p = np.searchsorted(cells.first, e, side="right") - 1
        x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
        for g in range(hands.wrist.shape[1]):
            r = cells.rotation[e]
            found = hand_value(person, hands, r, g, x, y, z, UNREACHED, room)
            if found > value[i]:
                value[i], grasp[i] = found, g
