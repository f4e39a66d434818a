"""How far hulls that the links sweep are from those of obstacles, by GJK."""

from numba import njit

from roadmap.geometry._gjk import Shell, separation
from roadmap.jit_options import INNER, LEAN


@njit(**LEAN)
def hulls_apart(points, ptr, slack, radii, least, frame, room, free):
    """Return whether each hull of a robot is as far from each obstacle as is asked.

    By a lower bound: rounding can cost a yes, and never bring one.

    Args:
        points: (n, 3) vertices of all hulls [m], finite; the robot's come first.
        ptr: (k + j + 1,) first row of each hull, and n.
        slack: (k,) what comes off the distances of each of the robot's [m].
        radii: (j,) by which the obstacles are larger than their hulls [m].
        least: (k, j) distance that is asked of each pair [m].
        frame: (12,) the pose of the base, which is in the origin.
        room: (21, 3) work space.
        free: (k, j) gets whether it has that distance.
    """
    k, apart = least.shape[0], True
    box, other, v, s = room[:2], room[2:4], room[4], room[5:]
    for i in range(k):
        hull = Shell(ptr[i], ptr[i + 1], frame)
        _box(points, hull.begin, hull.end, box)
        for j in range(least.shape[1]):
            thing = Shell(ptr[k + j], ptr[k + j + 1], frame)
            need = radii[j] + least[i, j] + slack[i]
            _box(points, thing.begin, thing.end, other)
            free[i, j] = _box_gap(box, other) >= need
            if free[i, j]:
                continue
            for a in range(3):
                v[a] = 0.5 * (box[0, a] + box[1, a] - other[0, a] - other[1, a])
            free[i, j] = separation(points, hull, thing, v, need, s)[0] >= need
            apart = apart and free[i, j]
    return apart


@njit(**INNER)
def _box(points, begin, end, box):
    """Write the corners (2, 3) of the box around some points."""
    for a in range(3):
        box[0, a] = box[1, a] = points[begin, a]
        for r in range(begin + 1, end):
            box[0, a] = min(box[0, a], points[r, a])
            box[1, a] = max(box[1, a], points[r, a])


@njit(**INNER)
def _box_gap(one, other):
    """Return how far two boxes (2, 3) are apart along one axis [m]."""
    gap = -1e300
    for a in range(3):
        gap = max(gap, other[0, a] - one[1, a], one[0, a] - other[1, a])
    return gap
