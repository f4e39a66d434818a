"""Motions that were free with distance to spare, and where the shapes were then.

A motion is kept in equal pieces, each with what it had to spare in some frame and the
shapes of that frame. A piece is free while they are not farther from there than that;
only the others are tested anew, and these are near to a shape.

Only what was proved of the very motion counts, or of one that it is the rest of. The
robot's own distances are those that were kept then: another hand, or other clearance,
forgets all (`Frame.set_sampling`, `Frame.hand_changed`).
"""

from numba import njit

from odm.close_test._arm import Clearance
from odm.close_test._slack import LEAST, MOST, displaced, motion_slack
from odm.obstacles._cloud import N_LISTED
from odm.search._off_path import motion_deviation
from odm.search._state import view
from roadmap.geometry._segments import nearest_share

SAME = 1e-7  # [m] a motion so near to one that was proved is taken for a part of it
# [m] what is left of a slack at least: the ordinary test would free the motion, too
RESERVE = 1e-3
UNKNOWN = -1.0  # instead of what a piece has to spare
PIECE = 0.12  # [m] no point of the robot moves much farther in a piece


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
    for k in range(slacks.pieces.shape[0]):
        if slacks.pieces[k] == 0:
            continue
        off = 0.0
        for j in range(q.shape[0]):
            off += abs(q[j] + dq[j] - slacks.end[k, j]) * bound[j]
            if not off <= SAME:
                break
        if off <= SAME:
            a, b = slacks.begin[k], slacks.end[k]
            share = nearest_share(a, b, q)
            if share < slacks.known_from[k]:
                continue
            if motion_deviation(a, b, share, q, bound) <= SAME:
                return k
    return -1


@njit(cache=True, nogil=True)
def slack_now(state, cloud, q, dq, most):
    """Test a motion; return what it has to spare [m], below 0: it is not free.

    No more than `most` is looked for [m].
    """
    robot, tolerance = view(state, "robot_state"), view(state, "terms").tolerance[0]
    view(state, "stats").close[0] += 1
    clearance = Clearance(
        view(state, "arm"), robot.radii, robot.grown, tolerance, view(state, "work")
    )
    solids = view(state, "solids")
    return motion_slack(clearance, robot.bare, q, dq, cloud, solids, most)


@njit(cache=True, nogil=True)
def keep_motion(state, q, dq):
    """Remember a motion that is free now: if it is asked for again, its slack is found.

    Many motions are asked for once, and a slack takes longer than the plain test.
    """
    slacks, bound = view(state, "slacks"), view(state, "certificates").motion_bound
    k = slacks.next[0]
    slacks.next[0] = (k + 1) % slacks.pieces.shape[0]
    far = 0.0
    for j in range(q.shape[0]):
        slacks.begin[k, j], slacks.end[k, j] = q[j], q[j] + dq[j]
        far += abs(dq[j]) * bound[j]
    n = min(slacks.spare.shape[1], 1 + int(far / PIECE))
    slacks.pieces[k], slacks.known_from[k] = n, 0.0
    for p in range(n):
        slacks.spare[k, p] = UNKNOWN


@njit(cache=True, nogil=True)
def keep_piece(state, k, p, slack):
    """Remember what piece p of motion k has to spare now [m]."""
    slacks = view(state, "slacks")
    slacks.spare[k, p] = slack
    slacks.since[k, p] = view(state, "numbers").frame[0]
    slacks.at[k, p] = snapshot(state)


@njit(cache=True, nogil=True)
def snapshot(state):
    """Return the place where the frame's shapes are kept."""
    slacks, solids = view(state, "slacks"), view(state, "solids")
    now, n = view(state, "numbers").frame[0], slacks.frame.shape[0]
    last = (slacks.next[1] + n - 1) % n
    if slacks.frame[last] == now:
        return last
    s = slacks.next[1]
    slacks.next[1] = (s + 1) % n
    count = solids.count[0]
    for i in range(count):
        slacks.kind[s, i] = solids.kind[i]
        for j in range(solids.rows.shape[1]):
            slacks.rows[s, i, j] = solids.rows[i, j]
    slacks.count[s], slacks.frame[s] = count, now
    slacks.moved[s], slacks.moved_in[s] = 0.0, now
    return s


@njit(cache=True, nogil=True)
def piece_holds(state, k, p):
    """Return True if what piece p of motion k had to spare keeps it free now."""
    slacks, now = view(state, "slacks"), view(state, "numbers").frame[0]
    s = slacks.at[k, p]
    if slacks.spare[k, p] <= RESERVE or slacks.frame[s] != slacks.since[k, p]:
        return False
    if slacks.moved_in[s] != now:
        rows, kinds, count = slacks.rows[s], slacks.kind[s], slacks.count[s]
        slacks.moved[s] = displaced(rows, kinds, count, view(state, "solids"))
        slacks.moved_in[s] = now
    return slacks.moved[s] + SAME + RESERVE <= slacks.spare[k, p]


@njit(cache=True, nogil=True)
def rest_clear(state, cloud, k, q, dq):
    """Test the pieces of q + dq, the rest of motion k, that do not hold.

    Returns False where one is not free; then work.value[0] is the share of q + dq.
    """
    slacks, work = view(state, "slacks"), view(state, "work")
    n = slacks.pieces[k]
    share = nearest_share(slacks.begin[k], slacks.end[k], q)
    rest = 1.0 / (1.0 - share) if share < 1.0 else 0.0
    begin, part = slacks.piece[0], slacks.piece[1]
    first = min(n - 1, int(share * n))
    for p in range(first, n):
        if piece_holds(state, k, p):
            continue
        low = (p / n - share) * rest if p > first else 0.0
        high = ((p + 1) / n - share) * rest if p < n - 1 else 1.0
        for j in range(q.shape[0]):
            begin[j] = q[j] + low * dq[j]
            part[j] = (high - low) * dq[j]
        most = MOST
        if slacks.spare[k, p] != UNKNOWN:  # it is near a shape
            most = min(MOST, 2.0 * slacks.spare[k, p] + 4.0 * LEAST)
        slack = slack_now(state, cloud, begin, part, most)
        if slack < 0.0:
            work.value[0] = low + work.value[0] * (high - low)
            return False
        if p == first:  # of this piece only what lies ahead is known
            slacks.known_from[k] = share
        keep_piece(state, k, p, slack)
    return True
