"""All solutions of a human arm: intervals of the swivel angle, and joints in them.

With the hand held still, the elbow can still go round the line from shoulder to wrist:
the swivel angle phi. Turning by phi makes every direction cosine of the shoulder and of
the wrist a form K + P cos phi + Q sin phi. An end of a joint's range is a half plane of
such cosines, so what it forbids is one arc of phi with ends in closed form. The
solutions are what all arcs leave over, and none is missed.

`work` (WORK_ROWS, 3) is room for one pose:
  rows CIRCLE: the ten forms (K, P, Q), (elbow angle, and the wrist's direction x, z in
    the upper arm), and the axes w (to the wrist), n, m = w x n of the swivel;
  rows SPANS: (first phi, last phi, branch +1 or -1) of each interval;
  rows ARCS: (start, end, -) of forbidden arcs, in quarters of a turn (see `_quarters`).
"""

import math

from numba import njit

from handover.human._human_arm import (
    COS_LOWER,
    COS_UPPER,
    LOWER,
    SIN_LOWER,
    SIN_UPPER,
    UPPER,
)
from roadmap.compiling.jit_options import BARE_INNER

CIRCLE, SPANS, ARCS, WORK_ROWS = 0, 14, 46, 78
MAX_SPANS = ARCS - SPANS
TINY = 1e-12  # ranges are widened by this much against rounding, and joints clipped
# forms: sin a; cos a times (cos f, sin f, cos r, sin r); sin d; cos d times the rest
SIN_A, COS_F, SIN_F, COS_R, SIN_R, SIN_D, COS_W, SIN_W, COS_P, SIN_P = range(10)
ELBOW, AXES = 10, 11


@njit(**BARE_INNER)
def swivel_circle(arm, pose, work):
    """Fill the rows CIRCLE for a hand at `pose` (12,); False if it is out of reach.

    phi is 0 with the elbow straight below the line from shoulder to wrist (behind it
    where that line is nearly upright), and grows clockwise seen from the shoulder.
    """
    upper, fore, grip = arm[0], arm[1], arm[2]
    wx = pose[9] - grip * pose[2]
    wy = pose[10] - grip * pose[5]
    wz = pose[11] - grip * pose[8]
    square = wx * wx + wy * wy + wz * wz
    cos_e = (square - upper * upper - fore * fore) / (2.0 * upper * fore)
    if cos_e > arm[COS_LOWER + 3] + TINY or cos_e < arm[COS_UPPER + 3] - TINY:
        return False
    if cos_e >= 1.0:
        cos_e, sin_e = 1.0, 0.0
    else:
        sin_e = math.sqrt(max(0.0, 1.0 - cos_e * cos_e))
    distance = math.sqrt(square)
    if distance < 1e-9:
        return False
    scale = 1.0 / distance
    wx, wy, wz = wx * scale, wy * scale, wz * scale
    # n: where the elbow's axis points at phi = 0; m = w x n
    if abs(wz) < 0.999:
        scale = 1.0 / math.sqrt(wx * wx + wy * wy)
        nx, ny, nz = -wy * scale, wx * scale, 0.0
    else:
        scale = 1.0 / math.sqrt(wy * wy + wz * wz)
        nx, ny, nz = 0.0, -wz * scale, wy * scale
    mx, my, mz = wy * nz - wz * ny, wz * nx - wx * nz, wx * ny - wy * nx
    # the wrist's direction in the frame of the upper arm, and in that of the forearm
    ux, uz = fore * sin_e, -(upper + fore * cos_e)
    scale = 1.0 / math.sqrt(ux * ux + uz * uz)
    ux, uz = ux * scale, uz * scale
    vx, vz = ux * cos_e + uz * sin_e, uz * cos_e - ux * sin_e
    _form(work, SIN_A, wy * uz, ux * my, -ux * ny)
    _form(work, COS_F, wz * uz, ux * mz, -ux * nz)
    _form(work, SIN_F, -wx * uz, -ux * mx, ux * nx)
    _form(work, COS_R, 0.0, ny, my)
    _form(work, SIN_R, wy * ux, -uz * my, uz * ny)
    _hand_forms(pose, (wx, wy, wz), (nx, ny, nz), (mx, my, mz), (vx, vz), work)
    elbow = math.atan2(sin_e, cos_e)
    elbow = min(max(elbow, arm[LOWER + 3]), arm[UPPER + 3])
    _form(work, ELBOW, elbow, ux, uz)
    _form(work, AXES, wx, wy, wz)
    _form(work, AXES + 1, nx, ny, nz)
    _form(work, AXES + 2, mx, my, mz)
    return True


@njit(**BARE_INNER)
def _hand_forms(pose, w, n, m, v, work):
    """Write the forms of forearm and wrist; w, n, m: axes of the swivel.

    v: (x, z) of the wrist's direction in the frame of the forearm.
    """
    wx, wy, wz = w
    nx, ny, nz = n
    mx, my, mz = m
    vx, vz = v
    # columns of the hand in the order of the joints: thumb, palm, minus fingers
    w0 = wx * pose[1] + wy * pose[4] + wz * pose[7]
    n0 = nx * pose[1] + ny * pose[4] + nz * pose[7]
    m0 = mx * pose[1] + my * pose[4] + mz * pose[7]
    w1 = wx * pose[0] + wy * pose[3] + wz * pose[6]
    n1 = nx * pose[0] + ny * pose[3] + nz * pose[6]
    m1 = mx * pose[0] + my * pose[3] + mz * pose[6]
    w2 = -(wx * pose[2] + wy * pose[5] + wz * pose[8])
    n2 = -(nx * pose[2] + ny * pose[5] + nz * pose[8])
    m2 = -(mx * pose[2] + my * pose[5] + mz * pose[8])
    _form(work, SIN_D, vz * w0, vx * m0, -vx * n0)
    _form(work, SIN_W, vz * w1, vx * m1, -vx * n1)
    _form(work, COS_W, vz * w2, vx * m2, -vx * n2)
    _form(work, COS_P, vx * w0, -vz * m0, vz * n0)
    _form(work, SIN_P, 0.0, n0, m0)


@njit(**BARE_INNER)
def _form(work, row, k, p, q):
    work[row, 0], work[row, 1], work[row, 2] = k, p, q


@njit(**BARE_INNER)
def swivel_spans(arm, work):
    """Write the intervals of phi in which all joints keep their ranges to rows SPANS.

    Returns:
        How many; each is closed, may be a single angle, and begins in (-pi, pi].
    """
    n = _forbid_wrist(arm, work)
    if n < 0:
        return 0
    n_spans = 0
    # an upper arm direction has two readings: |a| <= 90 deg, or a beyond 90 deg
    wide = arm[COS_UPPER + 1] < 0.0
    n = _forbid_sine(arm, work, n, 1, SIN_A, 1.0)
    if not wide:
        n = _forbid_sine(arm, work, n, 1, SIN_A, -1.0)
    n = _forbid_hinge(arm, work, n, 0, COS_F, SIN_F, 1.0)
    n = _forbid_hinge(arm, work, n, 2, COS_R, SIN_R, 1.0)
    if n >= 0:
        n_spans = _allowed(work, n, n_spans, 1.0)
    if not wide:
        return n_spans
    k, p, q = work[SIN_A, 0] - arm[SIN_UPPER + 1], work[SIN_A, 1], work[SIN_A, 2]
    if k + TINY < 0.0 and (k + TINY) ** 2 >= p * p + q * q:
        return n_spans  # most poses: the arm is never that far out
    n = _forbid(work, _forbid_wrist(arm, work), k, p, q)
    n = _forbid_hinge(arm, work, n, 0, COS_F, SIN_F, -1.0)
    n = _forbid_hinge(arm, work, n, 2, COS_R, SIN_R, -1.0)
    if n >= 0:
        n_spans = _allowed(work, n, n_spans, -1.0)
    return n_spans


@njit(**BARE_INNER)
def _forbid_wrist(arm, work):
    """Start the list of arcs with those of forearm and wrist; -1 if nothing is left."""
    n = _forbid_sine(arm, work, 0, 5, SIN_D, 1.0)
    n = _forbid_sine(arm, work, n, 5, SIN_D, -1.0)
    n = _forbid_hinge(arm, work, n, 4, COS_P, SIN_P, 1.0)
    return _forbid_hinge(arm, work, n, 6, COS_W, SIN_W, 1.0)


@njit(**BARE_INNER)
def _forbid_sine(arm, work, n, joint, row, side):
    """Forbid where the joint, within 90 deg of 0, is below (1) or above its range."""
    if n < 0:
        return n
    end = arm[SIN_LOWER + joint] if side > 0.0 else -arm[SIN_UPPER + joint]
    return _forbid(
        work, n, side * work[row, 0] - end, side * work[row, 1], side * work[row, 2]
    )


@njit(**BARE_INNER)
def _forbid_hinge(arm, work, n, joint, row_c, row_s, sign):
    """Forbid where the angle of sign * (cos, sin) is outside the joint's range.

    Up to half a turn the range is the intersection of two half planes, beyond it
    their union.
    """
    if n < 0:
        return n
    width = arm[UPPER + joint] - arm[LOWER + joint]
    if width >= 2.0 * math.pi:
        return n
    cl, sl = sign * arm[COS_LOWER + joint], sign * arm[SIN_LOWER + joint]
    cu, su = sign * arm[COS_UPPER + joint], sign * arm[SIN_UPPER + joint]
    # sin(angle - lower) >= 0 and sin(upper - angle) >= 0
    k1 = cl * work[row_s, 0] - sl * work[row_c, 0]
    p1 = cl * work[row_s, 1] - sl * work[row_c, 1]
    q1 = cl * work[row_s, 2] - sl * work[row_c, 2]
    k2 = su * work[row_c, 0] - cu * work[row_s, 0]
    p2 = su * work[row_c, 1] - cu * work[row_s, 1]
    q2 = su * work[row_c, 2] - cu * work[row_s, 2]
    if width <= math.pi:
        n = _forbid(work, n, k1, p1, q1)
        if n < 0:
            return n
        return _forbid(work, n, k2, p2, q2)
    first = _forbid(work, n, k1, p1, q1)
    if first == n:
        return n
    second = _forbid(work, n if first < 0 else first, k2, p2, q2)
    if first < 0:
        return second
    if second < 0:
        return first
    if second == first:
        return n
    return _overlap(work, n)


@njit(**BARE_INNER)
def _forbid(work, n, k, p, q):
    """Add the arc where k + p cos phi + q sin phi < 0.

    Returns:
        The new number of arcs; -1 if it is the whole circle.
    """
    k += TINY
    square, rest = p * p + q * q, k * k
    if rest >= square:
        return n if k >= 0.0 else -1
    root = math.sqrt(square - rest)
    row = ARCS + n
    work[row, 0] = _quarters(-p * k - q * root, -q * k + p * root)
    work[row, 1] = _quarters(-p * k + q * root, -q * k - p * root)
    return n + 1


@njit(**BARE_INNER)
def _overlap(work, n):
    """Replace the two arcs from row n on by what both cover: none, one or two arcs."""
    a, b = work[ARCS + n, 0], work[ARCS + n, 1]
    c, d = work[ARCS + n + 1, 0], work[ARCS + n + 1, 1]
    second = (b - a) % 4.0, (d - c) % 4.0
    into_first, into_second = (c - a) % 4.0, (a - c) % 4.0
    if into_first <= second[0]:
        work[ARCS + n, 0] = c
        work[ARCS + n, 1] = (c + min(second[1], second[0] - into_first)) % 4.0
        n += 1
    if into_second <= second[1] and into_second > 0.0:
        work[ARCS + n, 0] = a
        work[ARCS + n, 1] = (a + min(second[0], second[1] - into_second)) % 4.0
        n += 1
    return n


@njit(**BARE_INNER)
def _quarters(c, s):
    """Return a number in [0, 4) that grows with the angle of (c, s), without trig."""
    t = s / (abs(c) + abs(s))
    if c < 0.0:
        return 2.0 - t
    return t if t >= 0.0 else min(4.0 + t, 4.0 - 1e-15)


@njit(**BARE_INNER)
def _angle(t):
    """Return the angle (-pi, pi] of a number of quarters in [0, 8)."""
    if t >= 4.0:
        t -= 4.0
    if t < 1.0:
        return math.atan2(t, 1.0 - t)
    if t < 3.0:
        return math.atan2(2.0 - t, 1.0 - t if t < 2.0 else t - 3.0)
    return math.atan2(t - 4.0, t - 3.0)


@njit(**BARE_INNER)
def _allowed(work, n, n_spans, branch):
    """Append what the first n arcs leave of the circle to the rows SPANS.

    Arcs are sorted by their start; those through 4 also cover the beginning.
    """
    if n == 0:
        _span(work, n_spans, -math.pi, math.pi, branch)
        return n_spans + 1
    for i in range(1, n):
        start, end = work[ARCS + i, 0], work[ARCS + i, 1]
        j = i - 1
        while j >= 0 and work[ARCS + j, 0] > start:
            work[ARCS + j + 1, 0] = work[ARCS + j, 0]
            work[ARCS + j + 1, 1] = work[ARCS + j, 1]
            j -= 1
        work[ARCS + j + 1, 0], work[ARCS + j + 1, 1] = start, end
    first = work[ARCS, 0]
    covered = first
    for i in range(n):
        if work[ARCS + i, 1] < work[ARCS + i, 0]:
            covered = max(covered, work[ARCS + i, 1])
    for i in range(n + 1):
        start = work[ARCS + i, 0] if i < n else first + 4.0
        if start >= covered and i > 0 and n_spans < MAX_SPANS:
            a = _angle(covered)
            b = _angle(start)
            if start - covered < 1e-9:
                b = max(a, b) if abs(b - a) < 1e-6 else a
            elif b < a:
                b += 2.0 * math.pi
            _span(work, n_spans, a, b, branch)
            n_spans += 1
        if i < n:
            end = work[ARCS + i, 1]
            if end < start:
                end += 4.0
            covered = max(covered, end)
    return n_spans


@njit(**BARE_INNER)
def _span(work, i, first, last, branch):
    row = SPANS + i
    work[row, 0], work[row, 1], work[row, 2] = first, last, branch
