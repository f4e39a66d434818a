"""How far away an obstacle is given up: one test after the other along one line."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.audit._audit import (
    FAR,
    Asked,
    Audited,
    Library,
    Solids,
    approach,
    exact_distance,
    free_at,
    motion_of,
    move_to,
    place_solids,
    point_at,
)
from odm.close_test._arm import Clearance
from odm.close_test._close import motion_clear
from odm.obstacles._occupancy import clear, mark_points
from odm.obstacles._solids import CAPSULE
from odm.obstacles._solids import Solids as Shapes
from roadmap.compiling.jit_options import FULL, FULL_INNER, INNER

STEP = 1e-3  # [m] of the scan where a test answers yes or no
TIGHT = 1e-5  # [m] where the walk of a distance ends
SOLIDS, SPHERES, SAMPLES = 0, 1, 2  # what the robot and the obstacle are taken for


class Placed(NamedTuple):
    """The robot's solids at a configuration."""

    solids: Solids
    frames: np.ndarray  # (n, 12)


class Close(NamedTuple):
    """The close test of points, that of shapes, and what they keep [m]."""

    asked: Asked
    clearance: Clearance
    solids: Shapes  # where the obstacle goes, as shapes
    m: float
    rho: float
    as_frames: Library  # the obstacles, with a frame's samples of their shapes


class StillCells(NamedTuple):
    """Cells of edges without a motion bound."""

    words: np.ndarray  # (n, n_blocks)
    samples: int  # still configurations that stand for an edge


@njit(**FULL_INNER)
def distance_at(s, kind, placed, library, coming):
    """Return the distance of robot and obstacle at s [m], by one of three views."""
    solids, frames = placed
    points = coming.points
    move_to(s, coming)
    if kind != SAMPLES:
        found = np.empty(1, np.int64)
        k, frame = coming.obstacle, coming.frame
        return exact_distance(solids, frames, library, k, frame, 2.0 * FAR, found)[0]
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


@njit(**INNER)
def walk(limit, kind, placed, library, coming):
    """Return where an obstacle coming in from FAR first is `limit` away; NaN: never.

    A step as long as the distance left over can skip nothing.
    """
    s = FAR
    for _ in range(1000):
        d = distance_at(s, kind, placed, library, coming)
        if d <= limit + TIGHT:
            return s
        s -= d - limit
        if s < -FAR:
            return np.nan
    return np.nan


@njit(**INNER)
def scan(audited, motion, coming):
    """Return where a motion is first given up, coming in from FAR; NaN: never."""
    s = FAR
    while s > -FAR:
        if not free_at(s, audited, motion, coming):
            return s
        s -= STEP
    return np.nan


@njit(**INNER)
def place_capsules(library, coming, solids):
    """Write the capsules of an obstacle, where it is, to `solids`."""
    parts, f = library.parts, coming.frame
    n = 0
    for j in range(
        library.part_ptr[coming.obstacle], library.part_ptr[coming.obstacle + 1]
    ):
        a, b = parts.points[parts.ptr[j]], parts.points[parts.ptr[j + 1] - 1]
        row = solids.rows[n]
        begin, end = point_at(f, a), point_at(f, b)
        row[7] = 0.0
        for c in range(3):
            row[c], row[3 + c] = begin[c], end[c] - begin[c]
            row[7] += row[3 + c] * row[3 + c]
        row[6] = parts.margin[j]
        solids.kind[n] = CAPSULE
        n += 1
    solids.count[0] = n


@njit(**FULL_INNER)
def scan_shapes(close, motion, cloud, library, coming):
    """Return where the close test of shapes first gives a motion up; NaN: never."""
    clear(cloud)
    q, dq = motion_of(close.asked, motion)
    s = FAR
    while s > -FAR:
        move_to(s, coming)
        place_capsules(library, coming, close.solids)
        if not motion_clear(close.clearance, q, dq, cloud, close.solids, False):
            return s
        s -= STEP
    return np.nan


@njit(**INNER)
def scan_words(words, coming, cloud):
    """Return where a sample first lies in a cell of `words`, coming in from FAR."""
    s = FAR
    while s > -FAR:
        move_to(s, coming)
        clear(cloud)
        mark_points(coming.points, cloud)
        for k in range(cloud.counts[0]):
            b = cloud.occupied[k]
            if cloud.words[b] & words[b] != 0:
                return s
        s -= STEP
    return np.nan


@njit(**FULL)
def node_overheads(audited, solids, spheres, library, pairs, close, out):
    """Write the exact distances at which six tests give a node up to out (n, 6).

    Solids; spheres against solids; spheres against samples within rho; cells; the close
    test of shapes; cells of shapes. NaN where one of them was in the way at FAR
    already, or never.
    """
    asked, arm, cloud = audited.asked, audited.arm, audited.cloud
    m, rho = close.m, close.rho
    bodies = np.empty((arm.tree_i.shape[0], 12))
    placed = Placed(solids, np.empty((solids.body.shape[0], 12)))
    cover = Placed(spheres, np.empty((spheres.body.shape[0], 12)))
    where = np.empty(6)
    for k in range(pairs.motion.shape[0]):
        q = asked.nodes[-1 - pairs.motion[k]]
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, placed.frames)
        place_solids(arm.tree_i, arm.tree_f, spheres, q, bodies, cover.frames)
        coming = approach(solids, placed.frames, library, pairs, k, np.empty(12))
        where[0] = walk(m, SOLIDS, placed, library, coming)
        where[1] = walk(m, SPHERES, cover, library, coming)
        where[2] = walk(m + rho, SAMPLES, cover, library, coming)
        where[3] = scan(audited, pairs.motion[k], coming)
        where[4] = scan_shapes(close, pairs.motion[k], cloud, library, coming)
        told = approach(solids, placed.frames, close.as_frames, pairs, k, np.empty(12))
        where[5] = scan(audited, pairs.motion[k], told)
        for test in range(6):
            out[k, test] = np.nan
            if where[test] < FAR - STEP:
                out[k, test] = distance_at(where[test], SOLIDS, placed, library, coming)
    clear(cloud)


@njit(**FULL_INNER)
def distance_along(s, audited, motion, solids, samples, library, coming):
    """Return the smallest exact distance over a whole edge with the obstacle at s."""
    asked, arm = audited.asked, audited.arm
    bodies = np.empty((arm.tree_i.shape[0], 12))
    placed = Placed(solids, np.empty((solids.body.shape[0], 12)))
    best, (begin, dq) = 2.0 * FAR, motion_of(asked, motion)
    for i in range(samples):
        q = begin + i / (samples - 1.0) * dq
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, placed.frames)
        best = min(best, distance_at(s, SOLIDS, placed, library, coming))
    return best


@njit(**FULL)
def edge_overheads(audited, close, solids, library, pairs, still, out):
    """Write the exact distances at which five tests give an edge up to out (n, 5).

    The close test, which `close` asks; cells of `still` configurations; the cells of
    the map; the close test of shapes; the cells of shapes.
    """
    asked, arm, cloud, work, shapes = audited
    other = Audited(close.asked, arm, cloud, work, shapes)
    bodies = np.empty((arm.tree_i.shape[0], 12))
    frames = np.empty((solids.body.shape[0], 12))
    where = np.empty(5)
    for k in range(pairs.motion.shape[0]):
        motion = pairs.motion[k]
        q = asked.nodes[asked.edges[motion, 0]] + pairs.t[k] * asked.dq[motion]
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, frames)
        coming = approach(solids, frames, library, pairs, k, np.empty(12))
        where[0] = scan(other, motion, coming)
        where[1] = scan_words(still.words[k], coming, cloud)
        where[2] = scan(audited, motion, coming)
        where[3] = scan_shapes(close, motion, cloud, library, coming)
        told = approach(solids, frames, close.as_frames, pairs, k, np.empty(12))
        where[4] = scan(audited, motion, told)
        for test in range(5):
            out[k, test] = np.nan
            if where[test] < FAR - STEP:
                out[k, test] = distance_along(
                    where[test], audited, motion, solids, still.samples, library, coming
                )
    clear(cloud)
