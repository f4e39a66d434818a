"""How far hulls that the links sweep are from those of obstacles, by GJK."""

import math

from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.geometry._gjk import Shell, separation


@njit(**LEAN)
def hulls_apart(points, ptr, slack, radii, least, frame, room, free):
    """Return whether each hull of a robot is as far from each obstacle as is asked.

    By a lower bound: rounding can cost a yes, and never bring one.

    Args:
        points: (n, 3) vertices of all hulls [m], finite; the robot's k come first.
        ptr: (k + j + 1,) first row of each hull, and n.
        slack: (k,) what comes off the distances of each of the robot's [m].
        radii: (j,) by which the obstacles are larger than their hulls [m].
        least: (k, j) distance that is asked of each pair [m].
        frame: (12,) the pose of the base, which is in the origin.
        room: (17, 3) work space.
        free: (k, j) gets whether it has that distance.
    """
    k, apart = least.shape[0], True
    v, s = room[0], room[1:]
    for i in range(k):
        hull = Shell(ptr[i], ptr[i + 1], frame)
        low, high = _box(points, hull.begin, hull.end)
        for j in range(least.shape[1]):
            thing = Shell(ptr[k + j], ptr[k + j + 1], frame)
            need = radii[j] + least[i, j] + slack[i]
            lower, upper = _box(points, thing.begin, thing.end)
            gap = -math.inf
            for a in range(3):
                gap = max(gap, lower[a] - high[a], low[a] - upper[a])
                v[a] = 0.5 * (low[a] + high[a] - lower[a] - upper[a])
            free[i, j] = gap >= need
            if free[i, j]:
                continue
            free[i, j] = separation(points, hull, thing, v, need, s)[0] >= need
            apart = apart and free[i, j]
    return apart


@njit(**INNER)
def _box(points, begin, end):
    """Return the low and the high corner of the box around some points."""
    lx = ly = lz = math.inf
    hx = hy = hz = -math.inf
    for r in range(begin, end):
        x, y, z = points[r, 0], points[r, 1], points[r, 2]
        lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
        hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
    return (lx, ly, lz), (hx, hy, hz)
