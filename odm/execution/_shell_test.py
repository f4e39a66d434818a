"""Whether what the links sweep stays apart from capsules, by GJK on convex hulls."""

from numba import njit

from roadmap.geometry._gjk import Shell, separation
from roadmap.jit_options import INNER, LEAN


@njit(**LEAN)
def hulls_apart(points, ptr, slack, capsules, least, frame, room):
    """Return whether all hulls are at least `least` + slack from all capsules.

    By a lower bound: rounding can cost a yes, and never bring one.

    Args:
        points: (n + 2, 3) vertices of the hulls [m], finite; the last two rows are work
            space.
        ptr: (k + 1,) first row of each hull, and n.
        slack: (k,) more distance that each has to keep [m].
        capsules: (j, 7) ends a and b and radius [m], finite.
        least: Distance to keep [m].
        frame: (12,) the pose of the base, which is in the origin.
        room: (19, 3) work space.
    """
    n = ptr[-1]
    low, high, v, s = room[0], room[1], room[2], room[3:]
    axis = Shell(n, n + 2, frame)
    for i in range(ptr.shape[0] - 1):
        hull = Shell(ptr[i], ptr[i + 1], frame)
        _box(points, ptr[i], ptr[i + 1], low, high)
        for j in range(capsules.shape[0]):
            need = capsules[j, 6] + least + slack[i]
            if _box_gap(low, high, capsules, j) >= need:
                continue
            for a in range(3):
                points[n, a], points[n + 1, a] = capsules[j, a], capsules[j, 3 + a]
                v[a] = 0.5 * (low[a] + high[a] - capsules[j, a] - capsules[j, 3 + a])
            if not separation(points, hull, axis, v, need, s)[0] >= need:
                return False
    return True


@njit(**INNER)
def _box(points, begin, end, low, high):
    """Write the corners of the box around some points."""
    for a in range(3):
        low[a] = high[a] = points[begin, a]
        for r in range(begin + 1, end):
            low[a] = min(low[a], points[r, a])
            high[a] = max(high[a], points[r, a])


@njit(**INNER)
def _box_gap(low, high, capsules, j):
    """Return how far the boxes of a hull and an axis are apart, along one axis [m]."""
    gap = -1e300
    for k in range(3):
        one = min(capsules[j, k], capsules[j, 3 + k])
        other = max(capsules[j, k], capsules[j, 3 + k])
        gap = max(gap, one - high[k], low[k] - other)
    return gap
