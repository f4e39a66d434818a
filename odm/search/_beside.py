"""A robot that rounds a corner is beside its way: told exactly, where sums fail.

The joints' ways times the most that each can move any sphere say too much of a robot
on a blend, several times over. Here the spheres themselves are asked.
"""

import math

from numba import njit

from odm.search._state import view
from roadmap.geometry._segments import nearest_share
from roadmap.kinematics._deviation import CoverModel, DeviationWork, legs_deviation

NEARBY = 12.0  # times the share: a robot farther off by the sum is not looked at
_STRAIGHT = 1e-9  # of two legs along one line, no corner can be told


@njit(cache=True, nogil=True)
def locate_beside(state, way, first, q, out):
    """Find q beside a way, from segment `first` on, within tracking and blending.

    The motions from q to both ends of the segment, which answers may begin with, stay
    within that share of it. Writes the share of the segment to out[0]; returns the
    segment, or -1.
    """
    best = -1
    best_off = view(state, "terms").beside[0]
    last = way.count[0] - 2
    for k in range(first, last + 1):
        for corner in range(-1, 2):
            # the nearest place, or that from which the corner k or k + 1 is rounded
            if corner < 0:
                share = nearest_share(way.q[k], way.q[k + 1], q)
            elif 1 <= k + corner <= last:
                share = rounded_share(way, k, k + corner, q)
            else:
                continue
            if not 0.0 <= share <= 1.0:
                continue
            off = stray_at(state, way, k, share, q, NEARBY * best_off)
            if off <= best_off:
                best, best_off = k, off
                out[0] = share
    return best


@njit(cache=True, nogil=True)
def off_motion(a, b, share, q, sway):
    """Bound how far any sphere at q is from where the motion from a to b has it [m].

    That is at `share` of the motion; the bound is sum_j |dq_j| sway_j.
    """
    off = 0.0
    for j in range(q.shape[0]):
        off += abs(a[j] + share * (b[j] - a[j]) - q[j]) * sway[j]
    return off


@njit(cache=True, nogil=True)
def rounded_share(way, k, corner, q):
    """Return the share of segment k that a blend of `corner` through q rounds; or -1.

    On a blend between unit directions u and w, q is off the way by e (w - u): before
    the corner by r, q - corner = -r u + e (w - u); behind it, r w + e (w - u).
    """
    uu = ww = uw = pu = pw = 0.0
    for j in range(q.shape[0]):
        u = way.q[corner, j] - way.q[corner - 1, j]
        w = way.q[corner + 1, j] - way.q[corner, j]
        p = q[j] - way.q[corner, j]
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


@njit(cache=True, nogil=True)
def stray_at(state, way, k, share, q, nearby):
    """Return how far the motions from q to both ends of a segment stray from it [m].

    Infinite where the joints' ways times their reach sum up to more than `nearby`.
    """
    own, arm, work = view(state, "own"), view(state, "arm"), view(state, "work")
    total = 0.0
    for j in range(q.shape[0]):
        own.spot[j] = way.q[k + 1, j] - way.q[k, j]
        work.point[j] = way.q[k, j] + share * own.spot[j]
        own.dq[j] = q[j] - work.point[j]
        total += abs(own.dq[j]) * own.sway[j]
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
    return legs_deviation(cover, work.point, own.spot, share, own.dq, scratch)
