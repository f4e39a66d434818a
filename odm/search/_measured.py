"""Motions that were measured, and where the shapes were then.

A motion is kept in equal chords, each with what it had to spare in some frame and the
shapes of that frame; see `odm.close_test._slack`. A chord is free while they are not
farther from there than that; only the others are measured anew, and these are near to a
shape. What is too near to be measured by chords is left to the close test.

Only what was proved of the very motion counts, or of one that it is the rest of. The
robot's own distances are those that were kept then: another hand, or other clearance,
forgets all (`Frame.set_sampling`, `Frame.hand_changed`).
"""

from numba import njit

from odm.close_test._arm import Clearance
from odm.close_test._close import motion_clear, prepare_motion, set_point
from odm.close_test._slack import (
    BEND,
    LEAST,
    NEAR,
    SPEED,
    WIDE,
    chord_spare,
    displaced,
    piece_spare,
)
from odm.obstacles._cloud import N_LISTED
from odm.search._off_path import motion_deviation, nearest_share
from odm.search._state import PIECES, view
from roadmap.compiling.jit_options import INNER
from roadmap.kinematics._forward import body_frames, place_of

SAME = 1e-7  # [m] a motion so near to one that was proved is taken for a part of it
# [m] what is left of a slack at least: the ordinary test would free the motion, too
RESERVE = LEAST
UNKNOWN = -1.0  # instead of what a chord has to spare
SAG = 2e-3  # [m] of a chord at most, if there are chords enough


@njit(**INNER)
def has_slack(state):
    """Return True if the frame has shapes alone, and few enough of them."""
    count = view(state, "solids").count[0]
    if count == 0 or view(state, "cloud").counts[N_LISTED] > 0:
        return False
    return count <= view(state, "slacks").kind.shape[1]


@njit(**INNER)
def clearance_of(state):
    """Return what the close test of a frame works with."""
    robot, tolerance = view(state, "robot_state"), view(state, "terms").tolerance[0]
    arm, work = view(state, "arm"), view(state, "work")
    return Clearance(arm, robot.radii, robot.bare, tolerance, work)


@njit(**INNER)
def near_free(state, cloud, q, dq):
    """Run the close test of a motion against points and all of the frame's shapes."""
    view(state, "stats").close[0] += 1
    clearance, solids = clearance_of(state), view(state, "solids")
    return motion_clear(clearance, q, dq, cloud, solids, False)


@njit(**INNER)
def near_free_again(state, cloud, q, dq):
    """Run the close test of a motion that later frames may ask for, too.

    Of shapes alone, not every frame tests all of it anew.
    """
    if not has_slack(state):
        return near_free(state, cloud, q, dq)
    k = find_slack(state, q, dq)
    if k < 0:
        k = keep_motion(state, q, dq)
        if k < 0:
            return near_free(state, cloud, q, dq)
    return rest_clear(state, cloud, k, q, dq)


@njit(**INNER)
def find_slack(state, q, dq):
    """Return the row of a motion that q + dq is the rest of, or all of; or -1."""
    slacks = view(state, "slacks")
    bound = view(state, "certificates").motion_bound
    for k in range(slacks.chords.shape[0]):
        if slacks.chords[k] == 0:
            continue
        off = 0.0
        for j in range(q.shape[0]):
            off += abs(q[j] + dq[j] - slacks.end[k, j]) * bound[j]
            if not off <= SAME:
                break
        if off <= SAME:
            a, b = slacks.begin[k], slacks.end[k]
            share = nearest_share(a, b, q)
            if motion_deviation(a, b, share, q, bound) <= SAME:
                return k
    return -1


@njit(**INNER)
def keep_motion(state, q, dq):
    """Keep a motion of which nothing is known yet; return its row.

    It takes the place of the one that was asked for least lately. -1: its numbers are
    not finite.
    """
    slacks, arm, work = view(state, "slacks"), view(state, "arm"), view(state, "work")
    for j in range(q.shape[0]):
        if not abs(q[j]) + abs(dq[j]) < 1e6:
            return -1
    if not prepare_motion(clearance_of(state), dq):
        return -1
    k = 0
    for i in range(slacks.chords.shape[0]):
        if slacks.asked[i] < slacks.asked[k]:
            k = i
    for j in range(q.shape[0]):
        slacks.begin[k, j], slacks.end[k, j] = q[j], q[j] + dq[j]
    bend = 0.0
    slacks.bound[k, WIDE] = -1.0
    for b in range(1, work.body_speed.shape[0]):
        slacks.bound[k, SPEED, b - 1] = work.body_speed[b]
        slacks.bound[k, BEND, b - 1] = work.body_bend[b]
        if arm.body_ptr[b + 1] > arm.body_ptr[b]:
            slacks.bound[k, WIDE, b - 1] = arm.bound[b, 3] + work.body_bare[b]
        bend = max(bend, work.body_bend[b])
    n = 1
    while n < slacks.nearest.shape[1] and bend > 8.0 * SAG * n * n:
        n *= 2
    slacks.chords[k] = n
    for c in range(n):
        slacks.spare[k, c], slacks.nearest[k, c] = UNKNOWN, -1
    for c in range(slacks.nearest.shape[1], slacks.spare.shape[1]):
        slacks.spare[k, c] = UNKNOWN
    for c in range(n + 1):
        slacks.placed[row_of(slacks, k, c)] = False
    return k


@njit(**INNER)
def row_of(slacks, k, c):
    """Return the row of the configuration that chord c of motion k begins with."""
    return k * (slacks.nearest.shape[1] + 1) + c


@njit(**INNER)
def placed(state, k, c):
    """Return the row of where the bodies are as chord c of motion k begins."""
    slacks, arm, work = view(state, "slacks"), view(state, "arm"), view(state, "work")
    row = row_of(slacks, k, c)
    if slacks.placed[row]:
        return row
    a, share = slacks.begin[k], c / slacks.chords[k]
    for j in range(a.shape[0]):
        slacks.delta[j] = slacks.end[k, j] - a[j]
    set_point(a, slacks.delta, share, work.point)
    frames, balls = slacks.frames[row], slacks.balls[row]
    body_frames(arm.tree_i, arm.tree_f, work.point, frames)
    for b in range(1, frames.shape[0]):
        x, y, z = place_of(frames[b], arm.bound[b])
        balls[0, b - 1], balls[1, b - 1], balls[2, b - 1] = x, y, z
    slacks.placed[row] = True
    work.found[3] += 1
    return row


@njit(**INNER)
def keep_spare(state, k, c, spare):
    """Remember what chord c of motion k has to spare now [m]."""
    slacks = view(state, "slacks")
    slacks.spare[k, c] = max(0.0, spare)
    slacks.since[k, c] = view(state, "numbers").frame[0]
    slacks.at[k, c] = snapshot(state)


@njit(**INNER)
def snapshot(state):
    """Return the place where the frame's shapes are kept."""
    slacks, solids = view(state, "slacks"), view(state, "solids")
    now, n = view(state, "numbers").frame[0], slacks.frame.shape[0]
    last = (slacks.next[0] + n - 1) % n
    if slacks.frame[last] == now:
        return last
    s = slacks.next[0]
    slacks.next[0] = (s + 1) % n
    count = solids.count[0]
    for i in range(count):
        slacks.kind[s, i] = solids.kind[i]
        for j in range(solids.rows.shape[1]):
            slacks.rows[s, i, j] = solids.rows[i, j]
    slacks.count[s], slacks.frame[s] = count, now
    slacks.moved[s], slacks.moved_in[s] = 0.0, now
    return s


@njit(**INNER)
def left_now(state, k, c):
    """Return what is left of what chord c of motion k had to spare [m]; or UNKNOWN."""
    slacks, now = view(state, "slacks"), view(state, "numbers").frame[0]
    s = slacks.at[k, c]
    if slacks.spare[k, c] <= RESERVE or slacks.frame[s] != slacks.since[k, c]:
        return UNKNOWN
    if slacks.moved_in[s] != now:
        rows, kinds, count = slacks.rows[s], slacks.kind[s], slacks.count[s]
        slacks.moved[s] = displaced(rows, kinds, count, view(state, "solids"))
        slacks.moved_in[s] = now
    return slacks.spare[k, c] - slacks.moved[s]


@njit(**INNER)
def measure(state, k, c):
    """Measure chord c of motion k, or the piece that begins with it.

    Returns:
        How many chords are free from here on; 0: this one may not be.
    """
    slacks, solids = view(state, "slacks"), view(state, "solids")
    arm, bound = view(state, "arm"), slacks.bound[k]
    n, known = slacks.chords[k], slacks.spare[k, c]
    size = n // PIECES
    if size >= 2 and c % size == 0 and (known == UNKNOWN or known >= 2.0 * NEAR):
        middle = slacks.balls[placed(state, k, c + size // 2)]
        spare = piece_spare(middle, bound, 0.5 * size / n, solids, slacks.near)
        if spare >= NEAR:
            for i in range(c, c + size):
                slacks.nearest[k, i] = -1
                keep_spare(state, k, i, spare)
            return size
    lengths = view(state, "robot_state").bare, view(state, "work").gap, slacks.near
    size, first = 1, slacks.nearest[k, c]
    if c % 2 == 0 and c + 2 <= n and known >= 1.5 * NEAR:
        size = 4 if c % 4 == 0 and c + 4 <= n and known >= 3.0 * NEAR else 2
    while True:
        at, to = placed(state, k, c), placed(state, k, c + size)
        ends, dt = (slacks.frames[at], slacks.frames[to]), size / n
        balls = slacks.balls[at], slacks.balls[to]
        spare, least = chord_spare(arm, lengths, ends, balls, bound, dt, solids, first)
        if size == 1 or spare >= NEAR:
            break
        size //= 2
    for i in range(c, c + size):
        slacks.nearest[k, i] = least
        keep_spare(state, k, i, spare)
    return size if spare >= RESERVE + SAME else 0


@njit(**INNER)
def rest_clear(state, cloud, k, q, dq):
    """Test the chords of q + dq, the rest of motion k, that do not hold.

    Returns False where one is not free; then work.value[0] is the share of q + dq.
    """
    slacks = view(state, "slacks")
    slacks.asked[k] = view(state, "numbers").frame[0]
    n = slacks.chords[k]
    share = nearest_share(slacks.begin[k], slacks.end[k], q)
    c = min(n - 1, int(share * n))
    size, pieces = n // PIECES, slacks.nearest.shape[1]
    first = c  # of chords in a row that may not be free
    least = UNKNOWN  # what all chords of a piece have to spare, up to here
    while c < n:
        whole = size >= 2 and c % size == 0
        if whole and left_now(state, k, pieces + c // size) >= RESERVE + SAME:
            more = size
        else:
            left = left_now(state, k, c)
            more = 1 if left >= RESERVE + SAME else measure(state, k, c)
            if size >= 2:
                left = left if left >= RESERVE + SAME else slacks.spare[k, c]
                least = left if whole else min(least, left)
                if least >= RESERVE + SAME and (c + more) % size == 0:
                    keep_spare(state, k, pieces + c // size, least)
        if more > 0 and first < c:
            if not chords_clear(state, cloud, k, (first, c, share), q, dq):
                return False
        c += max(1, more)
        if more > 0:
            first = c
    return first == n or chords_clear(state, cloud, k, (first, n, share), q, dq)


@njit(**INNER)
def chords_clear(state, cloud, k, which, q, dq):
    """Run the close test of some chords of motion k, which are a part of q + dq.

    `which` has the first chord, the one after the last, and the share that q (dof,) is
    at.
    """
    slacks, work = view(state, "slacks"), view(state, "work")
    (first, last, share), n = which, slacks.chords[k]
    rest = 1.0 / (1.0 - share) if share < 1.0 else 0.0
    low = max(0.0, (first / n - share) * rest)
    high = (last / n - share) * rest if last < n else 1.0
    begin, part = slacks.piece[0], slacks.piece[1]
    for j in range(q.shape[0]):
        begin[j] = q[j] + low * dq[j]
        part[j] = (high - low) * dq[j]
    if near_free(state, cloud, begin, part):
        return True
    work.value[0] = low + work.value[0] * (high - low)
    return False
