"""How far away an obstacle is given up: one test after the other along one line."""

import math

import numpy as np
from numba import njit

from odm.audit._audit import (
    FAR,
    approach,
    exact_distance,
    free_at,
    place_solids,
    shifted,
)
from odm.obstacles._occupancy import clear, mark_points

STEP = 1e-3  # [m] of the scan where a test answers yes or no
TIGHT = 1e-5  # [m] where the walk of a distance ends
SOLIDS, SPHERES, SAMPLES = 0, 1, 2  # what the robot and the obstacle are taken for


@njit(cache=True, nogil=True)
def distance_at(s, kind, solids, frames, library, k, local, frame, line, points):
    """Return the distance of robot and obstacle at s [m], by one of three views."""
    for c in range(3):
        frame[9 + c] = line[c] + s * line[3 + c]
    if kind != SAMPLES:
        found = np.empty(1, np.int64)
        return exact_distance(solids, frames, library, k, frame, 2.0 * FAR, found)[0]
    shifted(local, frame, points)
    best = 2.0 * FAR
    for i in range(frames.shape[0]):
        if not solids.used[i]:
            continue
        x, y, z = frames[i, 9], frames[i, 10], frames[i, 11]
        reach = best + solids.parts.margin[i]
        for j in range(points.shape[0]):
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            if d2 < reach * reach:
                reach = math.sqrt(d2)
        best = min(best, reach - solids.parts.margin[i])
    return best


@njit(cache=True, nogil=True)
def walk(limit, kind, solids, frames, library, k, local, frame, line, points):
    """Return where an obstacle coming in from FAR first is `limit` away; NaN: never.

    A step as long as the distance left over can skip nothing.
    """
    s = FAR
    for _ in range(1000):
        d = distance_at(s, kind, solids, frames, library, k, local, frame, line, points)
        if d <= limit + TIGHT:
            return s
        s -= d - limit
        if s < -FAR:
            return np.nan
    return np.nan


@njit(cache=True, nogil=True)
def scan(asked, arm, motion, local, frame, line, points, cloud, work):
    """Return where a motion is first given up, coming in from FAR; NaN: never."""
    s = FAR
    while s > -FAR:
        if not free_at(s, asked, arm, motion, local, frame, line, points, cloud, work):
            return s
        s -= STEP
    return np.nan


@njit(cache=True, nogil=True)
def scan_words(words, local, frame, line, points, cloud):
    """Return where a sample first lies in a cell of `words`, coming in from FAR."""
    s = FAR
    while s > -FAR:
        for c in range(3):
            frame[9 + c] = line[c] + s * line[3 + c]
        shifted(local, frame, points)
        clear(cloud)
        mark_points(points, cloud)
        for k in range(cloud.counts[0]):
            b = cloud.occupied[k]
            if cloud.words[b] & words[b] != 0:
                return s
        s -= STEP
    return np.nan


@njit(cache=True, nogil=True)
def node_taxes(asked, arm, solids, spheres, library, pairs, m, rho, cloud, work, out):
    """Write the exact distances at which four tests give a node up to out (n, 4).

    Solids; spheres against solids; spheres against samples within rho; cells. NaN
    where one of them was in the way at FAR already, or never.
    """
    bodies = np.empty((arm.tree_i.shape[0], 12))
    frames = np.empty((solids.body.shape[0], 12))
    balls = np.empty((spheres.body.shape[0], 12))
    line = np.empty(6)
    where = np.empty(4)
    for k in range(pairs.motion.shape[0]):
        motion, which = pairs.motion[k], pairs.obstacle[k]
        q = asked.nodes[-1 - motion]
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, frames)
        place_solids(arm.tree_i, arm.tree_f, spheres, q, bodies, balls)
        frame = np.empty(12)
        approach(solids, frames, library, pairs, k, frame, line)
        local = library.points[library.point_ptr[which] : library.point_ptr[which + 1]]
        points = np.empty(local.shape)
        view = (library, which, local, frame, line, points)
        where[0] = walk(m, SOLIDS, solids, frames, *view)
        where[1] = walk(m, SPHERES, spheres, balls, *view)
        where[2] = walk(m + rho, SAMPLES, spheres, balls, *view)
        where[3] = scan(asked, arm, motion, local, frame, line, points, cloud, work)
        for test in range(4):
            out[k, test] = np.nan
            if where[test] < FAR - STEP:
                out[k, test] = distance_at(where[test], SOLIDS, solids, frames, *view)
    clear(cloud)


@njit(cache=True, nogil=True)
def distance_along(s, asked, arm, motion, solids, samples, view):
    """Return the smallest exact distance over a whole edge with the obstacle at s."""
    bodies = np.empty((arm.tree_i.shape[0], 12))
    frames = np.empty((solids.body.shape[0], 12))
    best = 2.0 * FAR
    for i in range(samples):
        t = i / (samples - 1.0)
        q = asked.nodes[asked.edges[motion, 0]] + t * asked.dq[motion]
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, frames)
        d = distance_at(s, SOLIDS, solids, frames, *view)
        best = min(best, d)
    return best


@njit(cache=True, nogil=True)
def edge_taxes(
    asked, close, arm, solids, library, pairs, words, samples, cloud, work, out
):
    """Write the exact distances at which three tests give an edge up to out (n, 3).

    The close test; cells of `samples` still configurations, `words` (n, n_blocks);
    the cells of the map.
    """
    bodies = np.empty((arm.tree_i.shape[0], 12))
    frames = np.empty((solids.body.shape[0], 12))
    line = np.empty(6)
    where = np.empty(3)
    for k in range(pairs.motion.shape[0]):
        motion, which = pairs.motion[k], pairs.obstacle[k]
        q = asked.nodes[asked.edges[motion, 0]] + pairs.t[k] * asked.dq[motion]
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, frames)
        frame = np.empty(12)
        approach(solids, frames, library, pairs, k, frame, line)
        local = library.points[library.point_ptr[which] : library.point_ptr[which + 1]]
        points = np.empty(local.shape)
        view = (library, which, local, frame, line, points)
        where[0] = scan(close, arm, motion, local, frame, line, points, cloud, work)
        where[1] = scan_words(words[k], local, frame, line, points, cloud)
        where[2] = scan(asked, arm, motion, local, frame, line, points, cloud, work)
        for test in range(3):
            out[k, test] = np.nan
            if where[test] < FAR - STEP:
                out[k, test] = distance_along(
                    where[test], asked, arm, motion, solids, samples, view
                )
    clear(cloud)
