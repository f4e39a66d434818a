"""Tubes: what proved a motion free, piece by piece, so that a frame only measures anew.

The close test finds a motion free by dichotomy: each body of the robot is free in
intervals of the motion, by its place in the middle or by chords between the ends.
Which intervals these are, and where the body is there, depends on the motion alone, and
little changes from frame to frame. So the pieces (body, interval) of a motion that was
found free are kept with the body's frames, and the next frame measures how far each of
them is from its own points and shapes: no kinematics, no dichotomy.

**Why that proves as much.** The pieces cover the motion: every body at every time of it
is in one. A piece passes by the very inequality of the close test (`_close.py`), with
this frame's obstacles and radii: in the middle of the interval every sphere keeps its
radius and its largest travel in half the interval; or the chord of its centre keeps its
radius and the sag. Nothing of an earlier frame's verdict is used, only *where* it was
looked. A piece that does not pass is divided further by the close test itself, from its
own interval on, and what that finds takes its place.

A motion is found again by its ends. The rest of a motion, from a place on it on, is
found too: pieces that lie behind are left out. Where the asked motion is off the kept
one by `off` at one end at most, it is so everywhere (both are straight in joint space,
and `off` is a bound of what spheres move), and every piece keeps that much more.
"""

from numba import njit

from odm.close_test._arm import Clearance
from odm.close_test._close import (
    body_at,
    body_chord,
    bound_bodies,
    chord_at_solid,
    intervals_clear,
    set_point,
)
from odm.obstacles._cloud import N_LISTED
from odm.obstacles._solids import CAPSULE, rod_distance, rod_of, solid_distance
from odm.search._off_path import motion_deviation
from odm.search._state import view
from roadmap.geometry._segments import nearest_share
from roadmap.kinematics._forward import body_frames

WORTH = 4  # evaluations of a close test that are worth a tube
SAME = 1e-7  # [m] a motion that is off another one by no more is found by that
UNKNOWN, CLEAR, IN_THE_WAY = 0, 1, 2
NOT_KEPT = -1


@njit(cache=True, nogil=True)
def find_tube(state, q, dq):
    """Return (tube, share, off): that of a motion, or one whose rest it is.

    NOT_KEPT where there is none. The motion begins at `share` of the tube's, and is off
    it by at most `off` [m]; of several, the one with the least behind.
    """
    tubes, bound = view(state, "tubes"), view(state, "robot_state").motion_bound
    found, least, off = NOT_KEPT, 2.0, 0.0
    for k in range(tubes.count.shape[0]):
        if tubes.count[k] == 0:
            continue
        at_end = 0.0
        for j in range(q.shape[0]):
            at_end += abs(tubes.end[k, j] - (q[j] + dq[j])) * bound[j]
            if not at_end <= SAME:
                break
        if not at_end <= SAME:
            continue
        share = nearest_share(tubes.begin[k], tubes.end[k], q)
        at_begin = motion_deviation(tubes.begin[k], tubes.end[k], share, q, bound)
        if at_begin <= SAME and share < least:
            found, least, off = k, share, max(at_begin, at_end)
    return found, least, off


@njit(cache=True, nogil=True)
def keep_tube(state, q, dq):
    """Keep the motion that the close test has just found free; the oldest one goes."""
    tubes, work = view(state, "tubes"), view(state, "work")
    n = work.logged[0]
    if n == 0 or n > tubes.piece.shape[1] or n > work.log.shape[0]:
        return
    at, share, _ = find_tube(state, q, dq)
    if at == NOT_KEPT or share > 0.0:  # the whole of a motion stays beside its rest
        at = 0
        for k in range(tubes.count.shape[0]):
            if tubes.count[k] == 0:
                at = k
                break
            if tubes.used[k] < tubes.used[at]:
                at = k
    tubes.clock[0] += 1
    tubes.used[at] = tubes.clock[0]
    for j in range(q.shape[0]):
        tubes.begin[at, j], tubes.dq[at, j] = q[j], dq[j]
        tubes.end[at, j] = q[j] + dq[j]
    for i in range(work.speed.shape[0]):
        tubes.speed[at, i], tubes.bend[at, i] = work.speed[i], work.bend[i]
    for k in range(n):
        write_piece(state, at, k, k)
    tubes.count[at] = n


@njit(cache=True, nogil=True)
def write_piece(state, tube, k, logged):
    """Let piece k of a tube be a piece of the log, with the frames of its body."""
    tubes, work, arm = view(state, "tubes"), view(state, "work"), view(state, "arm")
    b, level, index = work.log[logged, 0], work.log[logged, 1], work.log[logged, 2]
    chord = work.log[logged, 3]
    for i in range(4):
        tubes.piece[tube, k, i] = work.log[logged, i]
    dt = 1.0 / (1 << level)
    # the same place as of the piece before, most often
    anew = k == 0 or logged == 0
    for i in range(1, 3):
        anew = anew or work.log[logged - 1, i] != work.log[logged, i]
    q, dq = tubes.begin[tube], tubes.dq[tube]
    if anew:
        set_point(q, dq, (index + 0.5) * dt, work.point)
        body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
    f, ball, out = work.frames[0, b], arm.bound[b], tubes.ball[tube, k]
    out[0] = f[0] * ball[0] + f[1] * ball[1] + f[2] * ball[2] + f[9]
    out[1] = f[3] * ball[0] + f[4] * ball[1] + f[5] * ball[2] + f[10]
    out[2] = f[6] * ball[0] + f[7] * ball[1] + f[8] * ball[2] + f[11]
    frames = tubes.frame[tube, k]
    if chord == 0:
        for i in range(12):
            frames[i] = f[i]
        return
    set_point(q, dq, index * dt, work.point)
    body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[1])
    set_point(q, dq, (index + 1) * dt, work.point)
    body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[2])
    for i in range(12):
        frames[i], frames[12 + i] = work.frames[1, b, i], work.frames[2, b, i]


@njit(cache=True, nogil=True)
def tube_clear(state, cloud, tube, share, off):
    """Test what a tube holds of a motion from `share` on; keep `off` more.

    CLEAR; IN_THE_WAY, then work.value has the share of the asked motion where that is;
    or UNKNOWN: a piece that begins behind the robot is not free as a whole.
    """
    tubes, work, robot = (
        view(state, "tubes"),
        view(state, "work"),
        view(state, "robot_state"),
    )
    view(state, "stats").close[0] += 1
    tubes.clock[0] += 1
    tubes.used[tube] = tubes.clock[0]
    for i in range(work.speed.shape[0]):
        work.speed[i], work.bend[i] = tubes.speed[tube, i], tubes.bend[tube, i]
        robot.grown[i], robot.grown_bare[i] = robot.radii[i] + off, robot.bare[i] + off
    clearance = Clearance(
        view(state, "arm"),
        robot.grown,
        robot.grown_bare,
        view(state, "terms").tolerance[0],
        work,
    )
    if not bound_bodies(clearance):
        return UNKNOWN
    count = tubes.count[tube]  # those added meanwhile have been tested
    full = False
    for k in range(count):
        level, index = tubes.piece[tube, k, 1], tubes.piece[tube, k, 2]
        dt = 1.0 / (1 << level)
        if (index + 1) * dt <= share:
            continue
        if piece_clear(state, clearance, cloud, tube, k):
            continue
        if index * dt < share:
            return UNKNOWN
        if not divide(state, clearance, cloud, tube, k):
            t = (work.value[0] - share) / (1.0 - share)
            work.value[0] = min(1.0, max(0.0, t))
            return IN_THE_WAY
        full = full or not replace(state, tube, k)
    if full:  # the next frame begins anew, with larger pieces
        tubes.count[tube] = 0
    return CLEAR


@njit(cache=True, nogil=True)
def piece_clear(state, clearance, cloud, tube, k):
    """Measure one piece of a tube against the frame's points and shapes."""
    tubes, work, arm = view(state, "tubes"), clearance.work, clearance.arm
    solids, bare = view(state, "solids"), clearance.bare
    b, by_chord = tubes.piece[tube, k, 0], tubes.piece[tube, k, 3] != 0
    frames, ball = tubes.frame[tube, k], tubes.ball[tube, k]
    dt = 1.0 / (1 << tubes.piece[tube, k, 1])
    half = 0.5 * dt
    if by_chord:
        for i in range(12):
            work.frames[1, b, i], work.frames[2, b, i] = frames[i], frames[12 + i]
    reach = arm.bound[b, 3] + work.body_bare[b] + work.body_speed[b] * half
    if by_chord:
        reach += work.body_bend[b] * dt * dt / 8.0
    x, y, z = ball[0], ball[1], ball[2]
    for s in range(solids.count[0]):
        rod, is_rod = rod_of(solids.rows[s]), solids.kind[s] == CAPSULE
        if is_rod:
            d = rod_distance(rod, x, y, z)
        else:
            d = solid_distance(solids, s, x, y, z, reach)
        if d >= reach:
            continue
        if by_chord:
            if not chord_at_solid(clearance, b, dt, solids, s, False):
                return False
            continue
        f = frames
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            c = arm.spheres[i]
            cx = f[0] * c[0] + f[1] * c[1] + f[2] * c[2] + f[9]
            cy = f[3] * c[0] + f[4] * c[1] + f[5] * c[2] + f[10]
            cz = f[6] * c[0] + f[7] * c[1] + f[8] * c[2] + f[11]
            far = bare[i] + work.speed[i] * half
            if is_rod:
                d = rod_distance(rod, cx, cy, cz)
            else:
                d = solid_distance(solids, s, cx, cy, cz, far)
            if not d >= far:
                return False
    if cloud.counts[N_LISTED] == 0:
        return True
    if by_chord:
        f, g = work.frames[1, b], work.frames[2, b]
        return body_chord(clearance, b, f, g, dt, cloud, False)
    return body_at(clearance, b, frames, half, cloud, False) == 0


@njit(cache=True, nogil=True)
def divide(state, clearance, cloud, tube, k):
    """Run the close test of a piece's body in its interval; proof to work.log."""
    tubes, work = view(state, "tubes"), clearance.work
    for b in range(work.masks.shape[1]):
        work.masks[0, b] = False
    work.masks[0, tubes.piece[tube, k, 0]] = True
    work.stack[0, 0] = tubes.piece[tube, k, 1]
    work.stack[0, 1] = tubes.piece[tube, k, 2]
    work.logged[0] = 0
    q, dq = tubes.begin[tube], tubes.dq[tube]
    return intervals_clear(clearance, q, dq, cloud, view(state, "solids"), False)


@njit(cache=True, nogil=True)
def replace(state, tube, k):
    """Let the pieces of the log stand for piece k; False where there is no room."""
    tubes, n = view(state, "tubes"), view(state, "work").logged[0]
    count = tubes.count[tube]
    if count + n - 1 > tubes.piece.shape[1] or n > view(state, "work").log.shape[0]:
        return False
    for i in range(n):
        write_piece(state, tube, k if i == 0 else count + i - 1, i)
    tubes.count[tube] = count + n - 1
    return True
