"""The search for an evasion: which direction keeps more distance than the best one."""

from typing import NamedTuple

import numpy as np
from numba import njit

from odm.close_test._close import gap_from_solids, set_point
from odm.obstacles._solids import Solids
from roadmap.compiling.jit_options import LEAN
from roadmap.kinematics._forward import body_frames


class Coming(NamedTuple):
    """Who is expected, and how far the robot gets until then."""

    solids: Solids  # of all moments, one after the other
    ptr: np.ndarray  # (moments + 1,) which of them are there at a moment
    times: np.ndarray  # (moments,) that the robot has until then [s]


@njit(**LEAN)
def next_better(arm, coming, q, dq, needed, bounds, work):
    """Return the first direction that keeps more distance from solids, and how much.

    Of motions dq (k, dof) from q, each of which takes `needed` (k,) [s]. `bounds` (3,):
    the first to look at; the distance to be above; that above which more is no better
    [m].

    Returns:
        The motion's number and the least distance on it [m]; k where none is better.
    """
    begin, best, ample = int(bounds[0]), bounds[1], bounds[2]
    last = coming.times.shape[0] - 1
    for k in range(begin, dq.shape[0]):
        gap = ample
        # the last is the nearest, mostly: what is too near is known after one look
        for t in range(last, -1, -1):
            set_point(q, dq[k], min(1.0, coming.times[t] / needed[k]), work.point)
            body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
            there = coming.ptr[t], coming.ptr[t + 1]
            gap = gap_from_solids(arm, work, coming.solids, *there, gap, best)
            if gap <= best:
                break
        if gap > best:
            return k, gap
    return dq.shape[0], best
