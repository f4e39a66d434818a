"""Joints of a human arm at a swivel angle, and all swivels of poses, one by one."""

import math

from numba import njit

from handover.human._arm_ik import (
    AXES,
    COS_F,
    COS_P,
    COS_R,
    COS_W,
    ELBOW,
    SIN_A,
    SIN_D,
    SIN_F,
    SIN_P,
    SIN_R,
    SIN_W,
    SPANS,
    TINY,
    swivel_circle,
    swivel_spans,
)
from handover.human._human_arm import LOWER, UPPER
from roadmap.compiling.jit_options import BARE, BARE_INNER

# cos^2 of abduction below which flexion and rotation are solved together, and below
# which each is free
_NEAR_LATERAL, _LATERAL = 0.01, 1e-21


@njit(**BARE_INNER)
def swivel_joints(arm, work, phi, branch, q):
    """Write the joints q (7,) at the swivel angle phi of `branch`, inside the ranges.

    The rows CIRCLE of `work` are those of the pose.

    Returns:
        True; False only where the upper arm points exactly to the side, which says
        nothing of flexion and rotation alone, and no pair of them is in the ranges.
    """
    c, s = math.cos(phi), math.sin(phi)
    sin_a = _at(work, SIN_A, c, s)
    cos_r, sin_r = _at(work, COS_R, c, s), _at(work, SIN_R, c, s)
    cos_f, sin_f = _at(work, COS_F, c, s), _at(work, SIN_F, c, s)
    square = cos_r * cos_r + sin_r * sin_r
    q[0] = _inside(arm, 0, math.atan2(branch * sin_f, branch * cos_f))
    q[1] = _inside(arm, 1, math.atan2(sin_a, branch * math.sqrt(square)))
    q[2] = _inside(arm, 2, math.atan2(branch * sin_r, branch * cos_r))
    q[3] = work[ELBOW, 0]
    cos_p, sin_p = _at(work, COS_P, c, s), _at(work, SIN_P, c, s)
    cos_d = math.sqrt(cos_p * cos_p + sin_p * sin_p)
    cos_w, sin_w = _at(work, COS_W, c, s), _at(work, SIN_W, c, s)
    q[4] = _inside(arm, 4, math.atan2(sin_p, cos_p))
    q[5] = _inside(arm, 5, math.atan2(_at(work, SIN_D, c, s), cos_d))
    q[6] = _inside(arm, 6, math.atan2(sin_w, cos_w))
    return square >= _NEAR_LATERAL or _solve_lateral(arm, work, c, s, square, q)


@njit(**BARE_INNER)
def _at(work, row, c, s):
    return work[row, 0] + c * work[row, 1] + s * work[row, 2]


@njit(**BARE_INNER)
def _inside(arm, joint, angle):
    """Return the angle, plus whole turns, nearest to the joint's range, inside it."""
    lower, upper = arm[LOWER + joint], arm[UPPER + joint]
    if angle < lower:
        turned = angle + 2.0 * math.pi
        angle = turned if turned - upper < lower - angle else lower
    elif angle > upper:
        turned = angle - 2.0 * math.pi
        angle = turned if lower - turned < angle - upper else upper
    return min(max(angle, lower), upper)


@njit(**BARE_INNER)
def _solve_lateral(arm, work, c, s, square, q):
    """Solve flexion and rotation together where the upper arm points to the side.

    There each of the two is ill-defined, but what they do together is not: one is
    computed from the other, the one at an end of its range first.
    """
    corner = _corners(work, c, s)
    q[2] = _inside(arm, 2, _rotation(corner, q[0]))
    q[0] = _inside(arm, 0, _flexion(corner, q[2]))
    if _agree(corner, q):
        return True
    if square > _LATERAL:
        return False
    # only their difference counts: it has a pair in the ranges iff it has one with an
    # end of a range
    for k in range(4):
        if k < 2:
            q[0] = arm[LOWER] if k == 0 else arm[UPPER]
            q[2] = _inside(arm, 2, _rotation(corner, q[0]))
        else:
            q[2] = arm[LOWER + 2] if k == 2 else arm[UPPER + 2]
            q[0] = _inside(arm, 0, _flexion(corner, q[2]))
        if _agree(corner, q):
            return True
    return False


@njit(**BARE_INNER)
def _agree(corner, q):
    """Return whether flexion and rotation fit together to 5e-11 rad."""
    off = abs(_rotation(corner, q[0]) - q[2])
    return min(off, 2.0 * math.pi - off) < 5e-11


@njit(**BARE_INNER)
def _rotation(row, f):
    cf, sf = math.cos(f), math.sin(f)
    return math.atan2(-(cf * row[1] + sf * row[3]), cf * row[0] + sf * row[2])


@njit(**BARE_INNER)
def _flexion(row, r):
    cr, sr = math.cos(r), math.sin(r)
    return math.atan2(row[2] * cr - row[3] * sr, row[0] * cr - row[1] * sr)


@njit(**BARE_INNER)
def _corners(work, c, s):
    """Return R00, R01, R20, R21 of the shoulder's rotation R at cos and sin of phi."""
    ux, uz = work[ELBOW, 1], work[ELBOW, 2]
    w, n, m = work[AXES], work[AXES + 1], work[AXES + 2]
    return (
        w[0] * ux - uz * (c * m[0] - s * n[0]),
        c * n[0] + s * m[0],
        w[2] * ux - uz * (c * m[2] - s * n[2]),
        c * n[2] + s * m[2],
    )


@njit(**BARE)
def solve_arm(arm, pose, step, work, q, swivels):
    """Write representatives of all solutions of `pose` to q (m, 7).

    Each interval gives both of its ends and evenly spaced angles between them, at most
    `step` [rad] apart; an interval narrower than TINY gives one. swivels (m, 2) gets
    the swivel angle and the number of the interval of each.

    Returns:
        (number of solutions, number of intervals, in the rows SPANS of `work`); no
        more solutions than q has rows.
    """
    if not swivel_circle(arm, pose, work):
        return 0, 0
    n_spans = swivel_spans(arm, work)
    count = 0
    for i in range(n_spans):
        first, last = work[SPANS + i, 0], work[SPANS + i, 1]
        pieces = int(math.ceil((last - first - TINY) / step))
        size = (last - first) / max(pieces, 1)
        for k in range(pieces + 1):
            if count == q.shape[0]:
                return count, n_spans
            phi = last if k == pieces else first + k * size
            if swivel_joints(arm, work, phi, work[SPANS + i, 2], q[count]):
                swivels[count, 0], swivels[count, 1] = phi, i
                count += 1
    return count, n_spans


@njit(**BARE_INNER)
def is_solvable(arm, pose, work, q):
    """Return whether the arm can put its hand at `pose`, and write a solution to q."""
    if not swivel_circle(arm, pose, work):
        return False
    for i in range(swivel_spans(arm, work)):
        first, last, branch = work[SPANS + i]
        if swivel_joints(arm, work, 0.5 * (first + last), branch, q):
            return True
    return False


@njit(**BARE)
def solvable_poses(arm, poses, work, q, answer):
    """Write `is_solvable` of every row of poses (n, 12) to answer (n,)."""
    for i in range(poses.shape[0]):
        answer[i] = is_solvable(arm, poses[i], work, q)
