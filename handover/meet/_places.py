"""The best that a hand can do at places of its grip, over rotations and elbows."""

from typing import NamedTuple

import numpy as np
from numba import njit

from handover.human._arm_solve import solve_arm
from handover.meet._quality import EFFORT, quality_of
from handover.reach._reach_build import Work
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import FULL
from roadmap.kinematics._chain import ChainArrays, dexterity, forward, jacobian

# columns: the five parts of quality.py, then these
DEXTERITY, COMBINED, ONLINE, TOTAL, COLUMNS = 5, 6, 7, 8, 9


class PlaceArm(NamedTuple):
    """The arm whose hand is placed."""

    state: np.ndarray  # (68,) of `_quality.py`, and so the next two
    obstacles: np.ndarray  # (m, 7) capsules
    settings: np.ndarray  # (19,)
    chain: ChainArrays  # of the same arm
    # (3,) of q_online in q_total; the dexterity that is 1; largest swivel between
    # representatives [rad]
    shares: np.ndarray


class PlaceScratch(NamedTuple):
    """Working memory: that of the chain, and work, q and swivels of `solve_arm`."""

    chain: Work
    work: np.ndarray
    joints: np.ndarray
    swivels: np.ndarray


@njit(**FULL)
def best_at_places(arm, turns, points, scratch, out, found):
    """Write the best of each quality over all rotations and elbows of each place.

    Of the hand's rotations `turns` (m, 9) at `points` (n, 3) of the grip, canonical
    shoulder frame [m]. `out` (n, COLUMNS) gets the maxima, 0 where nothing is reached,
    COMBINED of half dexterity and half effort; `found` (n, 9) the joints of the best
    total, its rotation, and the rotations reached.
    """
    state, obstacles, settings, chain, shares = arm
    own = scratch.chain
    pose, parts = np.empty(12), np.empty(5)
    for i in range(points.shape[0]):
        out[i] = 0.0
        found[i] = 0.0
        copy_row(points[i], pose[9:])
        for r in range(turns.shape[0]):
            copy_row(turns[r], pose[:9])
            n, _ = solve_arm(
                state, pose, shares[2], scratch.work, scratch.joints, scratch.swivels
            )
            if n > 0:
                found[i, 8] += 1.0
            for k in range(n):
                q = scratch.joints[k]
                online = quality_of(state, obstacles, settings, q, parts)
                forward(chain, q, own.frames)
                jacobian(chain, own.frames, own.jac)
                measure = dexterity(chain, q, own.jac, own.weighted, own.gram)
                easy = min(measure / shares[1], 1.0)
                total = shares[0] * online + (1.0 - shares[0]) * easy
                for j in range(5):
                    if parts[j] > out[i, j]:  # never where it is NaN
                        out[i, j] = parts[j]
                both = 0.5 * (easy + parts[EFFORT])
                out[i, DEXTERITY] = max(out[i, DEXTERITY], easy)
                out[i, COMBINED] = max(out[i, COMBINED], both)
                out[i, ONLINE] = max(out[i, ONLINE], online)
                if total > out[i, TOTAL]:
                    out[i, TOTAL] = total
                    copy_row(q, found[i, :7])
                    found[i, 7] = r
