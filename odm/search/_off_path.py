"""Locates a robot that is off its path, since it rounds a corner or was pushed.

On a blend the sum of joint displacements times motion bounds overestimates the
deviation several times. Here the displacement of the spheres themselves is bounded.
"""

import math

from numba import njit

from odm.search._state import view
from roadmap.compiling.jit_options import INNER
from roadmap.kinematics._deviation import CoverModel, DeviationWork, legs_deviation

NEARBY = 12.0  # times path_tolerance: farther off by the sum is not on the path
_STRAIGHT = 1e-9  # sine squared below which two legs are one line: no corner


@njit(**INNER)
def locate_off_path(state, path, first, q, out):
    """Find the segment of a path, from `first` on, that q is off by the least.

    The motions from q to both ends of the segment, which answers may begin with, stay
    within tracking and blending of it. Writes the share of the segment to out[0];
    returns the segment, or -1.
    """
    best = -1
    best_off = view(state, "terms").path_tolerance[0]
    last = path.count[0] - 2
    for k in range(first, last + 1):
        for corner in range(-1, 2):
            # the nearest place, or that from which the corner k or k + 1 is rounded
            if corner < 0:
                share = nearest_share(path.q[k], path.q[k + 1], q)
            elif 1 <= k + corner <= last:
                share = rounded_share(path, k, k + corner, q)
            else:
                continue
            if not 0.0 <= share <= 1.0:
                continue
            off = deviation_at(state, path, k, share, q, NEARBY * best_off)
            if off <= best_off:
                best, best_off = k, off
                out[0] = share
    return best


@njit(**INNER)
def motion_deviation(a, b, share, q, motion_bound):
    """Bound how far any sphere at q is from where the motion from a to b has it [m].

    That is at `share` of the motion; the bound is sum_j |dq_j| motion_bound_j.
    """
    off = 0.0
    for j in range(q.shape[0]):
        off += abs(a[j] + share * (b[j] - a[j]) - q[j]) * motion_bound[j]
    return off


@njit(**INNER)
def rounded_share(path, k, corner, q):
    """Return the share of segment k that a blend of `corner` through q rounds; or -1.

    On a blend between unit directions u and w, q is off the path by e (w - u): before
    the corner by r, q - corner = -r u + e (w - u); behind it, r w + e (w - u).
    """
    uu = ww = uw = pu = pw = 0.0
    for j in range(q.shape[0]):
        u = path.q[corner, j] - path.q[corner - 1, j]
        w = path.q[corner + 1, j] - path.q[corner, j]
        p = q[j] - path.q[corner, j]
        uu, ww, uw = uu + u * u, ww + w * w, uw + u * w
        pu, pw = pu + p * u, pw + p * w
    if uu == 0.0 or ww == 0.0:
        return -1.0
    # q - corner = a u + b w, with both of unit length, as nearly as can be
    long_u, long_w = math.sqrt(uu), math.sqrt(ww)
    pu, pw, uw = pu / long_u, pw / long_w, uw / (long_u * long_w)
    det = 1.0 - uw * uw
    if det < _STRAIGHT:
        return -1.0
    r = ((pu - uw * pw) + (pw - uw * pu)) / det  # a + b
    if corner == k + 1:
        return 1.0 + r / long_u if r <= 0.0 else -1.0
    return r / long_w if r >= 0.0 else -1.0


@njit(**INNER)
def deviation_at(state, path, k, share, q, nearby):
    """Bound how far the motions from q to both ends of a segment are off it [m].

    Infinite where joint displacements times motion bounds sum up to more than `nearby`.
    """
    robot, arm = view(state, "robot_state"), view(state, "arm")
    work = view(state, "work")
    total = 0.0
    for j in range(q.shape[0]):
        robot.scratch_q[j] = path.q[k + 1, j] - path.q[k, j]
        work.point[j] = path.q[k, j] + share * robot.scratch_q[j]
        robot.dq[j] = q[j] - work.point[j]
        total += abs(robot.dq[j]) * robot.motion_bound[j]
    if total > nearby:
        return math.inf
    cover = CoverModel(arm.tree_i, arm.tree_f, arm.spheres, arm.body, arm.reach)
    scratch = DeviationWork(
        work.frames[0],
        work.frames[1],
        work.rates[0],
        work.rates[1],
        work.body_speed,
        work.speed,
    )
    return legs_deviation(cover, work.point, robot.scratch_q, share, robot.dq, scratch)


@njit(**INNER)
def nearest_share(a, b, p):
    """Return the share of the segment from a to b that is nearest to p, (n,) each."""
    along = 0.0
    length2 = 0.0
    for j in range(p.shape[0]):
        d = b[j] - a[j]
        along += (p[j] - a[j]) * d
        length2 += d * d
    return min(1.0, max(0.0, along / length2)) if length2 > 0.0 else 0.0
