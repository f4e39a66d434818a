"""Motions that were free with distance to spare, and where the shapes were then.

Only what was proved of the very motion counts, or of one that it is a part of. The
robot's own distances are those that were kept then: another hand, or other clearance,
forgets all (`Frame.set_sampling`, `Frame.hand_changed`).
"""

from numba import njit

from odm.close_test._slack import displaced
from odm.obstacles._cloud import N_LISTED
from odm.search._off_path import motion_deviation
from odm.search._state import view
from roadmap.geometry._segments import nearest_share

SAME = 1e-7  # [m] a motion so near to one that was proved is taken for a part of it
# [m] what is left of a slack at least: the ordinary test would free the motion, too
RESERVE = 1e-3


@njit(cache=True, nogil=True)
def has_slack(state):
    """Return True if the frame has shapes alone, and few enough of them."""
    count = view(state, "solids").count[0]
    if count == 0 or view(state, "cloud").counts[N_LISTED] > 0:
        return False
    return count <= view(state, "slacks").kind.shape[1]


@njit(cache=True, nogil=True)
def find_slack(state, q, dq):
    """Return the row of a motion that q + dq is the rest of, or all of; or -1."""
    slacks = view(state, "slacks")
    bound = view(state, "certificates").motion_bound
    for k in range(slacks.spare.shape[0]):
        if slacks.spare[k] < 0.0:
            continue
        off = 0.0
        for j in range(q.shape[0]):
            off += abs(q[j] + dq[j] - slacks.end[k, j]) * bound[j]
            if not off <= SAME:
                break
        if off <= SAME:
            a, b = slacks.begin[k], slacks.end[k]
            if motion_deviation(a, b, nearest_share(a, b, q), q, bound) <= SAME:
                return k
    return -1


@njit(cache=True, nogil=True)
def slack_holds(state, k):
    """Return True if what motion k had to spare keeps it free of the shapes now."""
    slacks, solids = view(state, "slacks"), view(state, "solids")
    moved = displaced(slacks.rows[k], slacks.kind[k], slacks.count[k], solids)
    return moved + SAME + RESERVE <= slacks.spare[k]


@njit(cache=True, nogil=True)
def keep_slack(state, k, q, dq, slack):
    """Remember at row k, -1: at the oldest, what a motion has to spare now [m]."""
    slacks, solids = view(state, "slacks"), view(state, "solids")
    if k < 0:
        k = slacks.next[0]
        slacks.next[0] = (k + 1) % slacks.spare.shape[0]
    for j in range(q.shape[0]):
        slacks.begin[k, j], slacks.end[k, j] = q[j], q[j] + dq[j]
    count = solids.count[0]
    for s in range(count):
        slacks.kind[k, s] = solids.kind[s]
        for j in range(solids.rows.shape[1]):
            slacks.rows[k, s, j] = solids.rows[s, j]
    slacks.count[k] = count
    slacks.spare[k] = slack
