"""Readings of a depth image: which are the robot's own, where each of the others is.

A reading is the depth along the optical axis of what the ray through the pixel's
centre meets first, in units of the camera's scale; 0 and 65535 mean that there is none.
Where the camera is told how far 65535 means that nothing is there (`clear_m`), such a
pixel is *clear*: its ray is known to be free so far, and no surface is known.
Two tables of half the image's size are made, the least of 2 x 2 readings each:

- `near`: how far the rays are known to be free. Own points count, since the ray went
  as far as the robot, and clear ones up to `clear_m`. No reading counts as 0, but not
  at all where its eight neighbours have one or are clear, and no flying pixels are
  taken out.
- `seen`: where the surfaces of others are. Own points, clear ones and no reading count
  as 65535.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.kinematics._forward import place_of

TILE_BITS = 4
TILE = 1 << TILE_BITS  # pixels: a tile lists the balls that its points may lie in
NOTHING = 65535
N_VALID, N_OWN, N_FLYING, N_OUTSIDE, N_CLEAR = 0, 1, 2, 3, 4


class SelfFilter(NamedTuple):
    """The robot's spheres, whose points go."""

    balls: np.ndarray  # (n, 4) what list_balls wrote
    owner: np.ndarray  # (n,) what counts a removal by each ball
    removed: np.ndarray  # (owners,) own points
    is_on: bool  # False: own points stay


class Hits(NamedTuple):
    """Where points are."""

    hit: np.ndarray  # (cells,) a bit for each eighth of a cell that has a point
    shape: np.ndarray  # (3,) cells of the grid
    # (5,) valid readings, own, flying, points outside the grid, clear
    counts: np.ndarray


@njit(**INNER)
def shadow_edges(along, depth, radius, focal, centre, size):
    """Return the first and last pixel that a ball can cover along one image axis."""
    distance2 = along * along + depth * depth
    if depth <= 0.0 or distance2 <= radius * radius * 1.0001:
        return 0, size - 1
    middle = math.atan2(along, depth)
    width = math.asin(radius / math.sqrt(distance2)) + 1e-9
    first, last = 0.0, size - 1.0
    if middle - width > -1.55:
        first = math.floor(centre + focal * math.tan(middle - width))
    if middle + width < 1.55:
        last = math.ceil(centre + focal * math.tan(middle + width))
    return int(max(0.0, min(first, size))), int(min(size - 1.0, max(last, -1.0)))


@njit(**LEAN)
def list_balls(view, centers, radii, balls, width, height):
    """List for every tile of the image the balls that may cover it.

    The view's `tile_start`, `tile_item` and `tile_depth` are filled; `balls` (n, 4)
    gets the centres in the camera's frame and the squared radii. Returns the ball that
    the camera itself is in, or -1.
    """
    pose, lens = view.pose, view.lens
    start, item, rect = view.tile_start, view.tile_item, view.rect
    across = (width + TILE - 1) // TILE
    for t in range(start.shape[0]):
        start[t] = 0
        view.tile_depth[t, 0], view.tile_depth[t, 1] = math.inf, -math.inf
    inside = -1
    for n in range(centers.shape[0]):
        p = centers[n]
        r = radii[n]
        x, y, z = place_of(pose, p)
        balls[n, 0], balls[n, 1], balls[n, 2], balls[n, 3] = x, y, z, r * r
        if inside < 0 and x * x + y * y + z * z <= r * r:
            inside = n
        left, right = shadow_edges(x, z, r, lens[0], lens[2], width)
        low, high = shadow_edges(y, z, r, lens[1], lens[3], height)
        if z + r <= 0.0:
            right = left - 1
        rect[n, 0], rect[n, 1] = left // TILE, right // TILE
        rect[n, 2], rect[n, 3] = low // TILE, high // TILE
        if right < left or high < low:
            rect[n, 1] = rect[n, 0] - 1
        for i in range(rect[n, 2], rect[n, 3] + 1):
            for j in range(rect[n, 0], rect[n, 1] + 1):
                t = i * across + j
                start[t + 1] += 1
                view.tile_depth[t, 0] = min(view.tile_depth[t, 0], z - r)
                view.tile_depth[t, 1] = max(view.tile_depth[t, 1], z + r)
    for t in range(start.shape[0] - 1):
        start[t + 1] += start[t]
    total = start[start.shape[0] - 1]
    for n in range(centers.shape[0] - 1, -1, -1):
        for i in range(rect[n, 2], rect[n, 3] + 1):
            for j in range(rect[n, 0], rect[n, 1] + 1):
                # filled from behind: start ends where the list begins
                start[i * across + j + 1] -= 1
                item[start[i * across + j + 1]] = n
    for t in range(start.shape[0] - 1):
        start[t] = start[t + 1]
    start[start.shape[0] - 1] = total
    return inside


@njit(**INNER)
def tells(raw, clear):
    """Return True if a pixel is a reading, or is clear to a reading above 0."""
    return raw != 0 and (raw != NOTHING or clear > 0)


@njit(**INNER)
def is_flying(image, v, u, jump, clear):
    """Return True if a reading lies between its neighbours, far from both.

    Left and right are compared, and above and below; a neighbour that tells nothing
    is none, one that is clear is farther than all others.
    """
    here = np.int64(image[v, u])  # unsigned differences would be huge
    if 0 < u < image.shape[1] - 1:
        a, b = np.int64(image[v, u - 1]), np.int64(image[v, u + 1])
        if tells(a, clear) and tells(b, clear) and between(here, a, b, jump):
            return True
    if 0 < v < image.shape[0] - 1:
        a, b = np.int64(image[v - 1, u]), np.int64(image[v + 1, u])
        if tells(a, clear) and tells(b, clear) and between(here, a, b, jump):
            return True
    return False


@njit(**INNER)
def between(here, a, b, jump):
    """Return True if `here` lies between a and b, farther than `jump` from each."""
    return (a - here > jump and here - b > jump) or (
        b - here > jump and here - a > jump
    )


@njit(**INNER)
def is_lone(image, v, u, clear):
    """Return True if all eight pixels around this one have a reading or are clear."""
    if v == 0 or u == 0 or v + 1 == image.shape[0] or u + 1 == image.shape[1]:
        return False
    for i in range(v - 1, v + 2):
        for j in range(u - 1, u + 2):
            if (i != v or j != u) and not tells(image[i, j], clear):
                return False
    return True


@njit(**INNER)
def own_ball(x, y, z, balls, item, part):
    """Return the first ball of a part of a list that holds a point, or -1."""
    for k in range(part[0], part[1]):
        n = item[k]
        dx, dy, dz = x - balls[n, 0], y - balls[n, 1], z - balls[n, 2]
        if dx * dx + dy * dy + dz * dz <= balls[n, 3]:
            return n
    return -1


@njit(**INNER)
def eighth_at(x, y, z, shape):
    """Return the cell and the eighth of it at a place [eighths]; cell -1: outside."""
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return np.int64(-1), np.int64(0)
    if not (x < 2.0 * shape[0] and y < 2.0 * shape[1] and z < 2.0 * shape[2]):
        return np.int64(-1), np.int64(0)
    ix, iy, iz = int(x), int(y), int(z)
    bit = ((ix & 1) << 2) | ((iy & 1) << 1) | (iz & 1)
    return ((ix >> 1) * shape[1] + (iy >> 1)) * shape[2] + (iz >> 1), bit


@njit(**LEAN)
def read_image(image, fours, view, own, jump, hits):
    """Fill `near[0]` and `seen[0]` of a camera, and mark what its points hit.

    `image` (height, width) is uint16, `fours` the same, four pixels at a time, or
    without rows. Flying pixels are farther than `jump` from their neighbours; 0: kept.
    Where the filter is on, the view's tiles must have been listed.
    """
    height, width = image.shape
    shape = (hits.shape[0], hits.shape[1], hits.shape[2])
    g, slope_x, slope_y = view.to_eighths, 1.0 / view.lens[0], 1.0 / view.lens[1]
    middle_x, middle_y, scale = view.lens[2], view.lens[3], view.lens[4]
    clear = np.uint16(view.lens[11])
    g0, g3, g6, g9, g10, g11 = g[0], g[3], g[6], g[9], g[10], g[11]
    start, item, reach = view.tile_start, view.tile_item, view.tile_depth
    balls, owner, removed, is_filtered = own
    hit, across = hits.hit, (width + TILE - 1) // TILE
    n_valid = n_own = n_flying = n_outside = n_clear = 0
    last_cell, last_bit = np.int64(-1), np.int64(-1)
    all_near, all_seen = view.near[0], view.seen[0]
    all_near[:] = NOTHING
    all_seen[:] = NOTHING
    for v in range(height):
        row, near, seen = image[v], all_near[v >> 1], all_seen[v >> 1]
        y = (v - middle_y) * slope_y
        ax, ay, az = g[1] * y + g[2], g[4] * y + g[5], g[7] * y + g[8]
        tiles = (v >> TILE_BITS) * across
        for begin in range(0, width, 4):
            if v < fours.shape[0] and fours[v, begin >> 2] == 0:
                near[begin >> 1] = 0
                near[(begin >> 1) + 1] = 0
                continue
            for u in range(begin, min(begin + 4, width)):
                raw = row[u]
                j = u >> 1
                if raw == 0 or raw == NOTHING:
                    if raw == NOTHING and clear > 0:
                        n_clear += 1
                        near[j] = min(near[j], clear)
                    elif jump > 0 or not is_lone(image, v, u, clear):
                        near[j] = 0
                    continue
                n_valid += 1
                if jump > 0 and is_flying(image, v, u, jump, clear):
                    n_flying += 1
                    near[j] = 0
                    continue
                if raw < near[j]:
                    near[j] = raw
                z, x = scale * raw, (u - middle_x) * slope_x
                t = tiles + (u >> TILE_BITS)
                if is_filtered and reach[t, 0] <= z <= reach[t, 1]:
                    part = start[t], start[t + 1]
                    ball = own_ball(x * z, y * z, z, balls, item, part)
                    if ball >= 0:
                        n_own += 1
                        removed[owner[ball]] += 1
                        continue
                if raw < seen[j]:
                    seen[j] = raw
                gx, gy = z * (g0 * x + ax) + g9, z * (g3 * x + ay) + g10
                gz = z * (g6 * x + az) + g11
                cell, bit = eighth_at(gx, gy, gz, shape)
                if cell < 0:
                    n_outside += 1
                elif cell != last_cell or bit != last_bit:
                    hit[cell] |= np.uint8(1 << bit)
                    last_cell, last_bit = cell, bit
    counts = hits.counts
    counts[N_VALID], counts[N_OWN] = n_valid, n_own
    counts[N_FLYING], counts[N_OUTSIDE] = n_flying, n_outside
    counts[N_CLEAR] = n_clear
