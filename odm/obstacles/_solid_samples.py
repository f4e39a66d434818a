"""Shapes of a frame into solids and into the samples that mark their cells.

A ball of radius b or more that meets a shape K must have a sample within b + rho of its
centre, b being the map's smallest sphere plus m. Samples on the surface do that, rho
apart; but they mark cells nearer to the robot than they must. So they lie deeper, on a
smaller shape K' within K. Let no point of K be farther than `deep` from K', c be a
point at most b from K, and x the nearest point of K' to c: |c - x| <= far = b + deep.
Where a sample p is at most t from x,

    |p - c|^2 = |c - x|^2 + |p - x|^2 - 2 (p - x).(c - x) <= far^2 + t^2 (1 + far / a)

if K' is a union of balls of radius a (as `surfaces.rounded_covering` shows), or x and p
are on one circle of radius a, as on a cylinder's rim. Where x and p are on one flat
face, or one straight edge, 1 / a is 0. So t^2 (1 + far / a) <= (b + rho)^2 - far^2 is
enough, for larger balls, too, if t^2 <= 2 a (rho - deep); or simply t <= rho - deep. A
mesh has its samples on its surface, rho apart.

Patterns of points around a rod depend on its radius alone, so they are kept from frame
to frame; they are a function of the frame all the same.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm._groups import FRAME, array
from odm.obstacles._solids import BOX, CAPSULE, CYLINDER, MESH, solid_distance
from odm.obstacles._surfaces import SHRINK, tube_frame, tube_step, walk_cap
from roadmap.compiling._rows import in_line
from roadmap.compiling.jit_options import INNER, LEAN

# what can be wrong with a shape
FINE, NOT_FINITE, NO_RADIUS, NO_LENGTH, NO_SIZE, NO_POSE, TOO_LARGE = range(7)
TOO_ROUND, NO_ROOM = 7, 8
# rows of each kind, in the order in which they are given
N_CAPSULES, N_SPHERES, N_CYLINDERS, N_BOXES, N_MESHES = range(5)
WIDTHS = (7, 4, 7, 15, 12)
LARGEST = 1000.0  # [m] a size beyond is in another unit
POSED = 2.0  # key of what has no pattern
WIDEST = 5.0  # [m] a radius beyond is in another unit, or a wall
RIGID = 1e-5  # a rotation may be off by so much; it is made exact
DEPTH = 0.5  # share of rho by which samples lie below the surface of a shape
THIN = 0.8  # a rod whose radius is no larger share of rho has them on its axis
ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)


class Patterns(NamedTuple):
    """What the samples of the shapes are made from."""

    # flat ends?, radius, covering radius: what a rod's pattern was made for
    key: np.ndarray = array("f8", "shapes 3", FRAME, -1)
    begin: np.ndarray = array("i8", "shapes+1", FRAME)  # of its rows
    size: np.ndarray = array("i8", "shapes 2", FRAME)  # points of a ring, of a cap
    # between two rings, at most; and how far within its ends a cylinder's are
    step: np.ndarray = array("f8", "shapes 2", FRAME)
    rows: np.ndarray = array("f8", "patterns 3", FRAME)  # two rings, and a cap
    rod: np.ndarray = array("f8", "6", FRAME)  # from 0 along an axis
    frame: np.ndarray = array("f8", "3 3", FRAME)  # its normals and axis
    # of a rod: where its two rings are, but for how far along the axis
    rings: np.ndarray = array("f8", "patterns 3", FRAME)
    # of a mesh: first and last face, first and last sample
    mesh: np.ndarray = array("i8", "shapes 4", FRAME)
    ball: np.ndarray = array("f8", "shapes 4", FRAME)  # around it, in its own frame
    samples: np.ndarray = array("f8", "samples 3", FRAME)  # of meshes, in their frames
    # pose of the frame in which shapes are given, in the base frame
    base_world: np.ndarray = array("f8", "4 4", FRAME)
    near: np.ndarray = array("f8", "4", FRAME)  # ball in which samples count
    # which shape is wrong: its kind, its number there
    wrong: np.ndarray = array("i8", "2", FRAME)
    rho: np.ndarray = array("f8", "1", FRAME)  # covering radius of the map
    ball_least: np.ndarray = array("f8", "1", FRAME)  # least sphere and clearance m


# of the patterns: what stays when there is more room
KEPT = ("base_world", "near", "wrong", "rho", "ball_least")


@njit(**LEAN)
def take_solids(data, counts, T, solids, patterns):
    """Write the shapes of `data` to `solids`, in the base frame; or say what is wrong.

    `counts` (5,) is how many rows there are of each kind, kind after kind, in the frame
    of T (4, 4). Where one is wrong none is written, and `patterns` says which.
    """
    solids.count[0] = 0
    at, n = 0, 0
    for kind in range(5):
        width = WIDTHS[kind]
        for i in range(counts[kind]):
            given = data[at : at + width]
            at += width
            code = FINE
            for j in range(width):
                if not abs(given[j]) < math.inf:
                    code = NOT_FINITE
            if code == FINE:
                if kind == N_BOXES or kind == N_MESHES:
                    code = take_posed(given, T, kind, solids, n, patterns, i)
                else:
                    code = take_rod(given, T, kind, solids, n)
            if code != FINE:
                patterns.wrong[0], patterns.wrong[1] = kind, i
                return code
            n += 1
    solids.count[0] = n
    return FINE


@njit(**INNER)
def take_rod(given, T, kind, solids, n):
    """Write a capsule, a sphere or a cylinder; FINE or what is wrong with it."""
    row = solids.rows[n]
    radius = given[3] if kind == N_SPHERES else given[6]
    if radius <= 0.0:
        return NO_RADIUS
    length2 = 0.0
    for a in range(3):
        row[a] = T[a, 3]
        row[3 + a] = 0.0
        for j in range(3):
            row[a] += T[a, j] * given[j]
            if kind != N_SPHERES:
                row[3 + a] += T[a, j] * (given[3 + j] - given[j])
        length2 += row[3 + a] * row[3 + a]
    if not radius <= WIDEST:
        return TOO_ROUND
    if not length2 <= LARGEST * LARGEST:
        return TOO_LARGE
    row[6] = radius
    if kind != N_CYLINDERS:
        solids.kind[n] = CAPSULE
        row[7] = length2
        return FINE
    length = math.sqrt(length2)
    if not length > 1e-9:
        return NO_LENGTH
    solids.kind[n] = CYLINDER
    row[7] = 0.5 * length
    for a in range(3):
        row[a] += 0.5 * row[3 + a]
        row[3 + a] /= length
    return FINE


@njit(**INNER)
def take_posed(given, T, kind, solids, n, patterns, i):
    """Write a box, or mesh number i; FINE or what is wrong with it."""
    row = solids.rows[n]
    if not is_rotation(given):
        return NO_POSE
    for a in range(3):
        row[a] = T[a, 3]
        for j in range(3):
            row[a] += T[a, j] * given[4 * j + 3]
            row[3 + 3 * a + j] = 0.0
            for m in range(3):
                row[3 + 3 * a + j] += T[a, m] * given[4 * m + j]
    make_rotation(row)
    if kind == N_BOXES:
        for a in range(3):
            if given[12 + a] <= 0.0:
                return NO_SIZE
            if given[12 + a] > LARGEST:
                return TOO_LARGE
            row[12 + a] = 0.5 * given[12 + a]
        solids.kind[n] = BOX
        return FINE
    solids.kind[n] = MESH
    row[12], row[13] = patterns.mesh[i, 0], patterns.mesh[i, 1]
    ball = patterns.ball[i]
    for a in range(3):
        row[14 + a] = row[a]
        for j in range(3):
            row[14 + a] += row[3 + 3 * a + j] * ball[j]
    row[17], row[18] = ball[3], i
    return FINE


@njit(**INNER)
def is_rotation(given):
    """Return True if the left (3, 3) of a pose (12,), row by row, is a rotation."""
    for a in range(3):
        for b in range(3):
            dot = -1.0 if a == b else 0.0
            for j in range(3):
                dot += given[4 * j + a] * given[4 * j + b]
            if not abs(dot) <= RIGID:
                return False
    g = given
    det = g[0] * (g[5] * g[10] - g[6] * g[9]) - g[1] * (g[4] * g[10] - g[6] * g[8])
    det += g[2] * (g[4] * g[9] - g[5] * g[8])
    return det > 0.0


@njit(**INNER)
def make_rotation(row):
    """Make the columns of a row's rotation unit and upright to each other."""
    for a in range(3):
        for b in range(a):
            dot = 0.0
            for j in range(3):
                dot += row[3 + 3 * j + a] * row[3 + 3 * j + b]
            for j in range(3):
                row[3 + 3 * j + a] -= dot * row[3 + 3 * j + b]
        size = 0.0
        for j in range(3):
            size += row[3 + 3 * j + a] ** 2
        size = math.sqrt(size)
        for j in range(3):
            row[3 + 3 * j + a] /= size


@njit(**LEAN)
def move_solids(solids, T):
    """Move all shapes by a rigid T (4, 4)."""
    for n in range(solids.count[0]):
        row, kind = solids.rows[n], solids.kind[n]
        turn(T, row, 0, 1.0)
        if kind == CAPSULE or kind == CYLINDER:
            turn(T, row, 3, 0.0)
            continue
        for a in range(3):
            x, y, z = row[3 + a], row[6 + a], row[9 + a]
            for j in range(3):
                row[3 + 3 * j + a] = T[j, 0] * x + T[j, 1] * y + T[j, 2] * z
        make_rotation(row)
        if kind == MESH:
            turn(T, row, 14, 1.0)


@njit(**INNER)
def turn(T, row, at, whole):
    """Let three numbers of a row be T times them; `whole` is 0 for a direction."""
    x, y, z = row[at], row[at + 1], row[at + 2]
    for j in range(3):
        row[at + j] = T[j, 0] * x + T[j, 1] * y + T[j, 2] * z + whole * T[j, 3]


@njit(**INNER)
def inset_rod(flat, radius, rho, ball):
    """Return how deep a rod's samples lie below its side, and how far apart [m].

    The second is their covering radius on the smaller rod, `flat`-ended or round.
    """
    if radius <= THIN * rho:
        return radius, SHRINK * math.sqrt((ball + rho) ** 2 - (ball + radius) ** 2)
    depth = DEPTH * rho
    deep = math.sqrt(2.0) * depth if flat else depth
    inner, far = radius - depth, ball + deep
    reach2 = ((ball + rho) ** 2 - far * far) / (1.0 + far / inner)
    reach = math.sqrt(min(reach2, 2.0 * inner * (rho - deep)))
    return depth, SHRINK * max(rho - deep, reach)


@njit(**INNER)
def lay_patterns(solids, patterns):
    """Make the patterns of rods that are not those of the last frame; or NO_ROOM."""
    rows, begin = patterns.rows, patterns.begin
    valid = True
    begin[0] = 0
    for n in range(solids.count[0]):
        kind, radius = solids.kind[n], solids.rows[n, 6]
        if kind == BOX or kind == MESH:
            if not (valid and patterns.key[n, 0] == POSED):
                valid = forget_patterns(patterns, n)
                patterns.key[n, 0] = POSED
                begin[n + 1] = begin[n]
            continue
        flat = kind == CYLINDER
        depth, rho = inset_rod(flat, radius, patterns.rho[0], patterns.ball_least[0])
        key = patterns.key[n]
        told = 1.0 if flat else 0.0
        if valid and key[0] == told and key[1] == radius and key[2] == rho:
            continue
        valid = forget_patterns(patterns, n)
        inner = radius - depth
        k, step = best_ring(inner, rho)
        start, cap = begin[n] + 2 * k, 0
        if inner > 0.0:
            cap = walk_cap(flat, k, rho / inner, rows[:0], 0)
        if start + cap > rows.shape[0]:
            return NO_ROOM
        for j in range(2 * k):
            # the second ring is turned by half a step against the first
            angle = math.pi * (2.0 * j / k if j < k else (2.0 * (j - k) + 1.0) / k)
            rows[begin[n] + j, 0] = inner * math.cos(angle)
            rows[begin[n] + j, 1] = inner * math.sin(angle)
            rows[begin[n] + j, 2] = 0.0
        if cap > 0:
            walk_cap(flat, k, rho / inner, rows, start)
        for j in range(start, start + cap):
            for a in range(3):
                rows[j, a] *= inner
        patterns.size[n, 0], patterns.size[n, 1] = k, cap
        patterns.step[n, 0] = step
        patterns.step[n, 1] = depth if flat and inner > 0.0 else 0.0
        begin[n + 1] = start + cap
        key[0], key[1], key[2] = told, radius, rho
    return FINE


@njit(**INNER)
def forget_patterns(patterns, first):
    """Forget the patterns from the first on, whose rows will be written over."""
    for n in range(first, patterns.key.shape[0]):
        patterns.key[n, 0] = -1.0
    return False


@njit(**INNER)
def best_ring(radius, rho):
    """Return (k, d): points of a ring and distance of rings with the fewest points."""
    k = 1
    if 2.0 * radius > rho:
        k = max(1, int(math.pi / (2.0 * math.asin(rho / (2.0 * radius)))) - 1)
    while tube_step(radius, k, rho) < 0.0:
        k += 1
    best = k
    for more in range(k + 1, k + 4):
        if more * tube_step(radius, best, rho) < best * tube_step(radius, more, rho):
            best = more
    return best, tube_step(radius, best, rho)


@njit(**INNER)
def write_samples(solids, patterns, points, n):
    """Write the samples of all shapes behind row n of `points`; return the next row.

    Only as many as there is room for; the number goes on. What lies wholly outside
    the ball `patterns.near`, where no cell is, has one sample.
    """
    center, reach = patterns.near[:3], patterns.near[3]
    for k in range(solids.count[0]):
        kind = solids.kind[k]
        if out_of_reach(solids, k, center, reach):
            if n < points.shape[0]:
                for a in range(3):
                    points[n, a] = solids.rows[k, a]
            n += 1
        elif kind == BOX:
            n = write_box(solids.rows[k], patterns, points, n)
        elif kind == MESH:
            n = write_mesh(solids, k, patterns, points, n)
        else:
            n = write_rod(solids, k, patterns, center, reach, points, n)
    return n


@njit(**INNER)
def out_of_reach(solids, k, center, reach):
    """Return True if solid k, or the ball around a mesh, is farther than `reach`."""
    x, y, z = center[0], center[1], center[2]
    if solids.kind[k] != MESH:
        return solid_distance(solids, k, x, y, z, math.inf) > reach
    ball = solids.rows[k, 14:18]
    d2 = (ball[0] - x) ** 2 + (ball[1] - y) ** 2 + (ball[2] - z) ** 2
    return d2 > (reach + ball[3]) ** 2


@njit(**INNER)
def write_rod(solids, k, patterns, center, reach, points, n):
    """Write the samples of a capsule or cylinder, in reach; see `write_samples`."""
    row, frame = solids.rows[k], patterns.frame
    length, radius = axis_of(solids, k, patterns), row[6]
    ring, cap = patterns.size[k, 0], patterns.size[k, 1]
    first = patterns.begin[k]
    ax, ay, az = row[0], row[1], row[2]
    if solids.kind[k] == CYLINDER:
        length = max(0.0, length - 2.0 * patterns.step[k, 1])
        ax -= 0.5 * length * row[3]
        ay -= 0.5 * length * row[4]
        az -= 0.5 * length * row[5]
    wx, wy, wz = center[0] - ax, center[1] - ay, center[2] - az
    middle = wx * frame[2, 0] + wy * frame[2, 1] + wz * frame[2, 2]
    rest = wx * wx + wy * wy + wz * wz - middle * middle
    # what is in reach is no farther along the axis, and its samples hardly farther
    wide = math.sqrt(max(0.0, (reach + radius) ** 2 - rest))
    wide += patterns.step[k, 0] + radius
    gaps = 0
    if length > 0.0:
        gaps = max(1, int(math.ceil(length / patterns.step[k, 0])))
    gap = length / max(1, gaps)
    low, high = 0, gaps
    # of a rod that is in reach as a whole, which most are, neither is asked
    if middle > wide and gap > 0.0:
        low = int(math.ceil((middle - wide) / gap))
    if middle + wide < 1.001 * length:
        high = min(high, int(math.floor(max(0.0, middle + wide) / gap)))
    # the groups cost more to hand on than a place: here are the arrays alone, flat
    rows, rings, flat = in_line(patterns.rows), patterns.rings, in_line(points)
    rings, origin, room = in_line(rings), (ax, ay, az), points.shape[0]
    write_places(rows, first, 2 * ring, (1.0, 0.0), origin, frame, rings, 0)
    for r in range(low, high + 1):
        more = min(ring, room - n)
        write_ring(rings, ring * (r % 2), more, gap * r, frame, flat, n)
        n += ring
    first += 2 * ring
    for end in range(2):
        z, sign = (0.0, -1.0) if end == 0 else (length, 1.0)
        if abs(z - middle) <= wide:
            more = min(cap, room - n)
            write_places(rows, first, more, (sign, z), origin, frame, flat, n)
            n += cap
    return n


@njit(**INNER)
def axis_of(solids, k, patterns):
    """Write normals and axis of a rod to `patterns.frame`; return its length."""
    row, rod = solids.rows[k], patterns.rod
    rod[3], rod[4], rod[5] = row[3], row[4], row[5]
    length = tube_frame(rod, patterns.frame)
    return 2.0 * row[7] if solids.kind[k] == CYLINDER else length


@njit(**INNER)
def write_places(rows, first, count, height, origin, frame, points, n):
    """Write places of a pattern, up or down (sign) from a height, behind row n.

    All arrays are flat, three numbers a place, and their indices unsigned: no index is
    counted from the end. A `count` below 1 writes none.
    """
    sign, up = height
    ax, ay, az = origin
    ux, uy, uz = frame[0, 0], frame[0, 1], frame[0, 2]
    vx, vy, vz = frame[1, 0], frame[1, 1], frame[1, 2]
    tx, ty, tz = frame[2, 0], frame[2, 1], frame[2, 2]
    k, i = np.uint64(3 * first), np.uint64(3 * n)
    for _ in range(count):
        x, y, z = rows[k], rows[k + ONE], up + sign * rows[k + TWO]
        points[i] = ax + x * ux + y * vx + z * tx
        points[i + ONE] = ay + x * uy + y * vy + z * ty
        points[i + TWO] = az + x * uz + y * vz + z * tz
        k, i = k + THREE, i + THREE


@njit(**INNER)
def write_ring(rings, first, count, height, frame, points, n):
    """Write places of a ring, moved along the axis by a height, behind row n."""
    x, y, z = height * frame[2, 0], height * frame[2, 1], height * frame[2, 2]
    k, i = np.uint64(3 * first), np.uint64(3 * n)
    for _ in range(count):
        points[i] = rings[k] + x
        points[i + ONE] = rings[k + ONE] + y
        points[i + TWO] = rings[k + TWO] + z
        k, i = k + THREE, i + THREE


@njit(**INNER)
def write_mesh(solids, k, patterns, points, n):
    """Write the samples of a mesh; see `write_samples`."""
    row = solids.rows[k]
    mesh = patterns.mesh[int(row[18])]
    for j in range(mesh[2], mesh[3]):
        if n < points.shape[0]:
            x, y, z = patterns.samples[j]
            for a in range(3):
                turned = row[3 + 3 * a] * x + row[4 + 3 * a] * y + row[5 + 3 * a] * z
                points[n, a] = row[a] + turned
        n += 1
    return n


@njit(**INNER)
def box_step(rho, ball):
    """Return how far apart samples of a box may be along its edges [m].

    They are the places of a grid on a box that is smaller by DEPTH rho on each side:
    its corners, those of its edges, at most half a step from any place of them, and
    those of its faces, at most half a diagonal.
    """
    far = ball + rho
    edge2 = far * far - (ball + math.sqrt(2.0) * DEPTH * rho) ** 2
    face2 = far * far - (ball + DEPTH * rho) ** 2
    return SHRINK * math.sqrt(min(4.0 * edge2, 2.0 * face2))


@njit(**INNER)
def write_box(row, patterns, points, n):
    """Write the samples of a box, in reach; see `write_samples` and `box_step`.

    A place on several faces is one of the first of these.
    """
    center, reach, rho = patterns.near[:3], patterns.near[3], patterns.rho[0]
    step = box_step(rho, patterns.ball_least[0])
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        half, ends, _ = box_places(row, axis, rho, step)
        half_u, n_u, gap_u = box_places(row, u, rho, step)
        half_v, n_v, gap_v = box_places(row, v, rho, step)
        along = u_at = v_at = 0.0  # the centre, seen from the box
        for a in range(3):
            off = center[a] - row[a]
            along += off * row[3 + 3 * a + axis]
            u_at += off * row[3 + 3 * a + u]
            v_at += off * row[3 + 3 * a + v]
        for side in range(min(2, 1 + ends)):
            height = half if side == 1 else -half
            slack = reach * reach - (height - along) ** 2
            if slack <= 0.0:
                continue
            wide = math.sqrt(slack)
            # what belongs to the faces of an axis before this one is left out
            first_u, last_u = in_reach(u_at + half_u, wide, gap_u, n_u, u < axis)
            first_v, last_v = in_reach(v_at + half_v, wide, gap_v, n_v, v < axis)
            for i in range(first_u, last_u + 1):
                x = i * gap_u - half_u
                for j in range(first_v, last_v + 1):
                    if n < points.shape[0]:
                        y = j * gap_v - half_v
                        for a in range(3):
                            at = 3 + 3 * a
                            points[n, a] = row[a] + height * row[at + axis]
                            points[n, a] += x * row[at + u] + y * row[at + v]
                    n += 1
    return n


@njit(**INNER)
def box_places(row, axis, rho, step):
    """Return half the length of a box's samples along an axis, gaps, and one gap."""
    half = max(0.0, row[12 + axis] - DEPTH * rho)
    gaps = int(math.ceil(2.0 * half / step))
    return half, gaps, 2.0 * half / max(1, gaps)


@njit(**INNER)
def in_reach(middle, wide, gap, n, within):
    """Return the first and the last of places 0 to n, `gap` apart, in middle +- wide.

    `within`: of those between the two ends alone.
    """
    low, high = (1, n - 1) if within else (0, n)
    if gap > 0.0:
        low = max(low, int(math.ceil(max(-1.0, (middle - wide) / gap))))
        high = min(high, int(math.floor(min(n + 1.0, (middle + wide) / gap))))
    return low, high
