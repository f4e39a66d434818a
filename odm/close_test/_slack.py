"""How much nearer the shapes may come before a motion that is free may be so no more.

A motion is tested with all spheres grown by a slack. Wherever a sphere has less than
twice that to spare, the slack becomes half of what it has, and the test goes on: what
was found free of more is free of less. So the slack that is left is proved for the
whole motion, and the dichotomy is hardly deeper than that of a test without it.

No point of a shape that was moved, turned or grown is farther than `displaced` from
where the shape was. So no distance from it is less by more than that, and a motion
that was free with more slack than that is free of the shape where it is now.
"""

import math

from numba import njit

from odm.close_test._close import (
    FIRST_SOLID,
    begin_intervals,
    chords_clear,
    is_finite,
    prepare_motion,
    set_point,
    split_interval,
)
from odm.obstacles._solids import BOX, CAPSULE, CYLINDER, solid_distance
from roadmap.kinematics._forward import body_frames

MOST = 0.05  # [m] the slack that is tried at first
SHARE = 0.5  # of what a sphere has to spare
LEAST = 2e-3  # [m] a smaller slack is none
IN_THE_WAY = -1.0  # instead of a slack


@njit(cache=True, nogil=True)
def grow(clearance, bare, slack):
    """Let the spheres of `clearance` keep `slack` more than `bare` (n,) from shapes."""
    arm, grown, work = clearance.arm, clearance.bare, clearance.work
    for b in range(arm.tree_i.shape[0]):
        most = 0.0
        for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
            grown[i] = bare[i] + slack
            most = max(most, grown[i])
        work.body_bare[b] = most


@njit(cache=True, nogil=True)
def motion_slack(clearance, bare, q, dq, cloud, solids, most):
    """Return what all spheres have to spare from all shapes on q + t dq [m], or more.

    0: the motion is free, but with less than LEAST. IN_THE_WAY: it is not, as of
    `motion_clear`, with work.value and work.found. There must be no points.

    Args:
        clearance: Its `bare` (n,) is scratch.
        bare: (n,) what the spheres keep from shapes [m].
        q: (dof,) begin of the motion [rad or m].
        dq: (dof,) its displacement.
        cloud: Without points; the chord test takes it.
        solids: The shapes.
        most: The slack that is tried at first [m].
    """
    arm, work, slack = clearance.arm, clearance.work, most
    work.found[2] += 1
    grow(clearance, bare, 0.0)
    if not (is_finite(q, dq) and prepare_motion(clearance, dq)):
        return IN_THE_WAY
    top = 0
    begin_intervals(arm, work)
    while top >= 0:
        level, index = work.stack[top, 0], work.stack[top, 1]
        dt, mask = 1.0 / (1 << level), work.masks[top]
        t = (index + 0.5) * dt
        set_point(q, dq, t, work.point)
        body_frames(arm.tree_i, arm.tree_f, work.point, work.frames[0])
        work.found[3] += 1
        slack = bodies_spare(arm, bare, work, mask, 0.5 * dt, solids, slack)
        if slack < 0.0:
            work.value[0] = t
            return IN_THE_WAY
        open_, chords = open_bodies(work, mask, level)
        while chords:
            grow(clearance, bare, slack)
            verdict = chords_clear(clearance, q, dq, top, cloud, solids, False)
            if verdict < 2:
                open_ = open_ or verdict == 1
                break
            if slack == 0.0:  # its finest level
                work.value[0] = t
                return IN_THE_WAY
            slack = less(slack)
        if open_:
            split_interval(work, top)
            top += 1
        else:
            top -= 1
    return slack


@njit(cache=True, nogil=True)
def less(spare):
    """Return the slack that is tried where a sphere has so much to spare."""
    return SHARE * spare if SHARE * spare >= LEAST else 0.0


@njit(cache=True, nogil=True)
def bodies_spare(arm, bare, work, mask, half, solids, slack):
    """Test the bodies of `mask` at one configuration; return the slack that is left.

    work.state says of each whether it has that to spare in the whole interval, 0, or is
    open, 1. Below 0: one is in the way.
    """
    for b in range(1, mask.shape[0]):
        work.state[b] = 0
        if not mask[b]:
            continue
        f, ball = work.frames[0, b], arm.bound[b]
        reach = ball[3] + work.body_bare[b] + work.body_speed[b] * half
        wx = f[0] * ball[0] + f[1] * ball[1] + f[2] * ball[2] + f[9]
        wy = f[3] * ball[0] + f[4] * ball[1] + f[5] * ball[2] + f[10]
        wz = f[6] * ball[0] + f[7] * ball[1] + f[8] * ball[2] + f[11]
        open_ = False
        for k in range(solids.count[0]):
            far = reach + slack
            if solid_distance(solids, k, wx, wy, wz, far) >= far:
                continue
            for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
                s = arm.spheres[i]
                cx = f[0] * s[0] + f[1] * s[1] + f[2] * s[2] + f[9]
                cy = f[3] * s[0] + f[4] * s[1] + f[5] * s[2] + f[10]
                cz = f[6] * s[0] + f[7] * s[1] + f[8] * s[2] + f[11]
                # of a body that is open, only what lessens the slack is news
                travel = 0.0 if open_ else work.speed[i] * half
                far = bare[i] + max(slack + travel, slack / SHARE)
                d = solid_distance(solids, k, cx, cy, cz, far)
                if d >= far:
                    continue
                if d < bare[i]:
                    work.found[0] = i
                    work.found[1] = FIRST_SOLID - k
                    work.value[1] = d
                    return IN_THE_WAY
                slack = min(slack, less(d - bare[i]))
                # it stays open, though the slack may be less later
                open_ = open_ or d - bare[i] - travel < slack
        work.state[b] = 1 if open_ else 0
    return slack


@njit(cache=True, nogil=True)
def open_bodies(work, mask, level):
    """Leave in `mask` what is open; return whether for halves, whether for chords."""
    open_ = chords = False
    for b in range(1, mask.shape[0]):
        mask[b] = mask[b] and work.state[b] == 1
        if mask[b]:
            chords = chords or level >= work.early[b]
            open_ = open_ or level < work.early[b]
    return open_, chords


@njit(cache=True, nogil=True)
def displaced(rows, kinds, count, solids):
    """Bound how far any place of the shapes is from where its shape was before [m].

    Infinite where there are more or fewer shapes, others, or a mesh.

    Args:
        rows: (k, 19) the shapes before; see `Solids`.
        kinds: (k,) of each.
        count: How many there were.
        solids: The shapes now.
    """
    if count != solids.count[0]:
        return math.inf
    most = 0.0
    for k in range(count):
        kind = solids.kind[k]
        if kind != kinds[k]:
            return math.inf
        if kind == CAPSULE:
            moved = rod_displaced(rows[k], solids.rows[k])
        elif kind == CYLINDER:
            moved = cylinder_displaced(rows[k], solids.rows[k])
        elif kind == BOX:
            moved = box_displaced(rows[k], solids.rows[k])
        else:
            return math.inf
        if not moved <= most:  # a NaN stays one
            most = moved
    return most


@njit(cache=True, nogil=True)
def apart(a, b, first, last):
    """Return the distance of two places: numbers first to last - 1 of two rows."""
    total = 0.0
    for j in range(first, last):
        total += (a[j] - b[j]) ** 2
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def rod_displaced(old, new):
    """Bound the displacement of a capsule's places: an end's, and what it grew by."""
    first = apart(old, new, 0, 3)
    total = 0.0
    for j in range(3):
        total += (new[j] + new[3 + j] - old[j] - old[3 + j]) ** 2
    return max(first, math.sqrt(total)) + max(0.0, new[6] - old[6])


@njit(cache=True, nogil=True)
def cylinder_displaced(old, new):
    """Bound the displacement of a cylinder's places; its axis turns rim and ends."""
    turned = apart(old, new, 3, 6) * (new[6] + new[7])
    grown = max(0.0, new[6] - old[6]) + max(0.0, new[7] - old[7])
    return apart(old, new, 0, 3) + turned + grown


@njit(cache=True, nogil=True)
def box_displaced(old, new):
    """Bound the displacement of a box's places; its rotation turns the corners."""
    half2 = new[12] * new[12] + new[13] * new[13] + new[14] * new[14]
    turned = apart(old, new, 3, 12) * math.sqrt(half2)
    grown = 0.0
    for j in range(12, 15):
        grown += max(0.0, new[j] - old[j]) ** 2
    return apart(old, new, 0, 3) + turned + math.sqrt(grown)
