"""The audit's inner loop: place an obstacle, ask the map, measure exactly."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.close_test._arm import Arm, Clearance, Work
from odm.close_test._close import motion_clear
from odm.exact._distances import Convexes, compose, core_distance, point_at
from odm.obstacles._cloud import Cloud
from odm.obstacles._occupancy import clear, item_hit, mark_points, sort_points
from odm.obstacles._solids import Solids as Shapes
from odm.obstacles._surfaces import tube_frame
from roadmap.compiling.jit_options import FULL, FULL_INNER, INNER
from roadmap.geometry._winding import winding
from roadmap.kinematics._forward import body_frames, turned

FAR, NEAR = 0.4, -0.03  # [m] where an approach begins, and where it may end
STEPS = 16  # halvings: the boundary is met to 7 um


class Library(NamedTuple):
    """Obstacles with their samples, each in its own frame."""

    parts: Convexes
    part_ptr: np.ndarray  # (n + 1,) convex parts of an obstacle
    hollow: np.ndarray  # (n,) True: the parts are facets of a mesh
    points: np.ndarray  # (N, 3) samples
    point_ptr: np.ndarray  # (n + 1,)
    aims: np.ndarray  # (A, 6) surface points and outward directions
    aim_ptr: np.ndarray  # (n + 1,)


class Solids(NamedTuple):
    """The robot's exact solids."""

    parts: Convexes
    body: np.ndarray  # (n,)
    pose: np.ndarray  # (n, 12) in the body
    used: np.ndarray  # (n,) False: never moves
    targets: np.ndarray  # (K, 6) surface points and outward normals
    target_part: np.ndarray  # (K,) solid they belong to


class Asked(NamedTuple):
    """The map under audit."""

    ptr: np.ndarray
    block: np.ndarray
    mask: np.ndarray
    nodes: np.ndarray
    edges: np.ndarray
    dq: np.ndarray  # (m, dof) along each edge
    close: bool  # True: ask the close test instead of the cells
    tolerance: float  # of the close test
    radii: np.ndarray  # of the close test


class Audited(NamedTuple):
    """The map under audit, and scratch of one thread."""

    asked: Asked
    arm: Arm
    cloud: Cloud
    work: Work
    shapes: Shapes  # none: the map is asked about points


class Coming(NamedTuple):
    """An obstacle that comes in; at distance s its origin is line[:3] + s line[3:]."""

    obstacle: int  # its row in the library
    local: np.ndarray  # (n, 3) its samples, in its own frame
    frame: np.ndarray  # (12,) its pose where it was looked at last
    line: np.ndarray  # (6,)
    points: np.ndarray  # (n, 3) its samples there


class Pairs(NamedTuple):
    """Random choices, one row a pair."""

    motion: np.ndarray  # (n,) edge, or -1 - node
    t: np.ndarray  # (n,)
    obstacle: np.ndarray  # (n,)
    aim: np.ndarray  # (n,) row of Library.aims
    target: np.ndarray  # (n,) row of Solids.targets
    wobble: np.ndarray  # (n, 6) added to approach and to the obstacle's direction
    spin: np.ndarray  # (n,) [rad]
    shift: np.ndarray  # (n, 3) added to the target point [m]
    start: np.ndarray  # (n,) distance where nothing is bisected; NaN: bisect


class Found(NamedTuple):
    """What came out, one row a pair."""

    free: np.ndarray  # (n,) the map calls the motion free
    boundary: np.ndarray  # (n,) the obstacle lies on the free side of its boundary
    distance: np.ndarray  # (n,) exact, capped; lower bound [m]
    gap: np.ndarray  # (n,) the true one is at most this much larger
    part: np.ndarray  # (n,) solid nearest
    frame: np.ndarray  # (n, 12) pose of the obstacle


@njit(**INNER)
def place_solids(tree_i, tree_f, solids, q, bodies, frames):
    """Write the poses of the robot's solids at q to `frames` (n, 12)."""
    body_frames(tree_i, tree_f, q, bodies)
    for i in range(frames.shape[0]):
        compose(bodies[solids.body[i]], solids.pose[i], frames[i])


@njit(**FULL_INNER)
def turn(a, b, spin, frame):
    """Write to `frame` a rotation that takes a to b, then turns by spin round b."""
    rods, from_, to = np.zeros((2, 6)), np.empty((3, 3)), np.empty((3, 3))
    rods[0, 3:], rods[1, 3:] = a, b
    tube_frame(rods[0], from_)  # two normals, then the direction itself
    tube_frame(rods[1], to)
    c, s = math.cos(spin), math.sin(spin)
    for i in range(3):
        u = c * to[0, i] + s * to[1, i]
        v = -s * to[0, i] + c * to[1, i]
        for j in range(3):
            frame[3 * i + j] = (
                to[2, i] * from_[2, j] + u * from_[0, j] + v * from_[1, j]
            )


@njit(**FULL_INNER)
def motion_of(asked, motion):
    """Return q and dq of a motion: node -1 - motion at rest, or edge `motion`."""
    if motion < 0:
        return asked.nodes[-1 - motion], np.zeros(asked.nodes.shape[1])
    return asked.nodes[asked.edges[motion, 0]], asked.dq[motion]


@njit(**FULL_INNER)
def asked_free(audited, motion, points):
    """Return what the map says of a motion; see `motion_of`."""
    asked, arm, cloud, work, shapes = audited
    clear(cloud)
    mark_points(points, cloud)
    n_nodes = asked.nodes.shape[0]
    if asked.close:
        sort_points(points, cloud)
        q, dq = motion_of(asked, motion)
        clearance = Clearance(arm, asked.radii, asked.radii, asked.tolerance, work)
        return motion_clear(clearance, q, dq, cloud, shapes, False)
    words = cloud.words
    ptr, block, mask = asked.ptr, asked.block, asked.mask
    if motion < 0:
        return item_hit(ptr, block, mask, -1 - motion, words) < 0
    for end in asked.edges[motion]:
        if item_hit(ptr, block, mask, end, words) >= 0:
            return False
    return item_hit(ptr, block, mask, n_nodes + motion, words) < 0


@njit(**FULL_INNER)
def swallowed(solids, frames, library, k, frame):
    """Return a solid that lies inside hollow obstacle k, or -1.

    Only asked where no facet is touched: then one point of a solid speaks for it all.
    """
    b = library.parts
    start, end = b.ptr[library.part_ptr[k]], b.ptr[library.part_ptr[k + 1]]
    triangles = b.points[start:end].copy().reshape((end - start) // 3, 3, 3)
    for i in range(frames.shape[0]):
        if not solids.used[i]:
            continue
        f, ball = frames[i], solids.parts.ball[i]
        px, py, pz = point_at(f, ball)
        px, py, pz = px - frame[9], py - frame[10], pz - frame[11]
        x = frame[0] * px + frame[3] * py + frame[6] * pz
        y = frame[1] * px + frame[4] * py + frame[7] * pz
        z = frame[2] * px + frame[5] * py + frame[8] * pz
        if abs(winding(triangles, x, y, z)) > 0.5:
            return i
    return -1


@njit(**FULL_INNER)
def exact_distance(solids, frames, library, k, frame, cap, found):
    """Return (distance, gap) of the moving solids from obstacle k; see nearest_pair."""
    best, gap = cap, 0.0
    found[0] = -1
    a, b = solids.parts, library.parts
    first, last = library.part_ptr[k], library.part_ptr[k + 1]
    centers = np.empty((last - first, 3))
    for j in range(first, last):
        at = centers[j - first]
        at[0], at[1], at[2] = point_at(frame, b.ball[j])
    for i in range(frames.shape[0]):
        if not solids.used[i]:
            continue
        f, ball = frames[i], a.ball[i]
        x, y, z = point_at(f, ball)
        for j in range(first, last):
            c = centers[j - first]
            reach = best + ball[3] + b.ball[j, 3]
            d2 = (x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2
            if reach <= 0.0 or d2 >= reach * reach:
                continue
            margin = a.margin[i] + b.margin[j]
            low, high = core_distance(a, i, f, b, j, frame, best + margin)
            if low - margin < best:
                best, gap = low - margin, high - low
                found[0] = i
    if library.hollow[k] and best > 0.0:
        inside = swallowed(solids, frames, library, k, frame)
        if inside >= 0:
            found[0] = inside
            return 0.0, 0.0
    return best, gap


@njit(**INNER)
def shifted(local, frame, out):
    """Write the samples `local` (n, 3), placed by `frame`, to out."""
    for i in range(local.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = point_at(frame, local[i])


@njit(**FULL_INNER)
def approach(solids, frames, library, pairs, k, frame):
    """Return the obstacle of pair k as it comes in; its pose is kept in `frame`.

    At distance s its aim point is at the robot's target point, s along the approach.
    """
    which = pairs.obstacle[k]
    local = library.points[library.point_ptr[which] : library.point_ptr[which + 1]]
    line = np.empty(6)
    target = solids.targets[pairs.target[k]]
    f = frames[solids.target_part[pairs.target[k]]]
    aim = library.aims[pairs.aim[k]]
    normal = turned(f, target[3], target[4], target[5])
    facing = np.empty(3)
    size = 0.0
    for c in range(3):
        line[3 + c] = normal[c] + pairs.wobble[k, c]
        facing[c] = -normal[c] + pairs.wobble[k, 3 + c]
        size += line[3 + c] ** 2
    size = math.sqrt(size)
    turn(aim[3:6], facing, pairs.spin[k], frame)
    place, offset = point_at(f, target), turned(frame, aim[0], aim[1], aim[2])
    for c in range(3):
        line[3 + c] /= size
        line[c] = place[c] + pairs.shift[k, c] - offset[c]
    return Coming(which, local, frame, line, np.empty(local.shape))


@njit(**INNER)
def move_to(s, coming):
    """Move an obstacle to distance s of its line."""
    for c in range(3):
        coming.frame[9 + c] = coming.line[c] + s * coming.line[3 + c]
    shifted(coming.local, coming.frame, coming.points)


@njit(**INNER)
def free_at(s, audited, motion, coming):
    """Move the obstacle to distance s of its line and ask the map."""
    move_to(s, coming)
    return asked_free(audited, motion, coming.points)


@njit(**FULL)
def audit_pairs(audited, solids, library, pairs, cap, found):
    """Ask and measure all pairs; results go to `found`."""
    asked, arm, cloud = audited.asked, audited.arm, audited.cloud
    bodies = np.empty((arm.tree_i.shape[0], 12))
    frames = np.empty((solids.body.shape[0], 12))
    q = np.empty(asked.nodes.shape[1])
    nearest = np.empty(1, np.int64)
    for k in range(pairs.motion.shape[0]):
        motion, which = pairs.motion[k], pairs.obstacle[k]
        begin, dq = motion_of(asked, motion)
        for j in range(q.shape[0]):
            q[j] = begin[j] + pairs.t[k] * dq[j]
        place_solids(arm.tree_i, arm.tree_f, solids, q, bodies, frames)
        frame = found.frame[k]
        coming = approach(solids, frames, library, pairs, k, frame)
        bisect = math.isnan(pairs.start[k])
        s = FAR if bisect else pairs.start[k]
        free = free_at(s, audited, motion, coming)
        found.boundary[k] = False
        if bisect and free and not free_at(NEAR, audited, motion, coming):
            low, high = NEAR, FAR
            for _ in range(STEPS):
                middle = 0.5 * (low + high)
                if free_at(middle, audited, motion, coming):
                    high = middle
                else:
                    low = middle
            found.boundary[k] = free_at(high, audited, motion, coming)
        found.free[k] = free
        found.part[k] = -1
        found.distance[k], found.gap[k] = np.nan, 0.0
        if free:
            found.distance[k], found.gap[k] = exact_distance(
                solids, frames, library, which, frame, cap, nearest
            )
            found.part[k] = nearest[0]
    clear(cloud)
