"""Solids of revolution as profiles: how far points can get from joint axes."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import FULL, INNER
from roadmap.kinematics._forward import place_of, turned

CORNERS = 64  # of the polygon around a circle
_ANGLES = [2.0 * math.pi * k / CORNERS for k in range(CORNERS)]
_COS = np.array([math.cos(angle) for angle in _ANGLES])
_SIN = np.array([math.sin(angle) for angle in _ANGLES])


class Joints(NamedTuple):
    """A robot's bodies and what their joints span."""

    tree_i: np.ndarray  # (n_bodies, 3), as in `Robot`
    tree_f: np.ndarray  # (n_bodies, 17), as in `Robot`
    span: np.ndarray  # (n_bodies, 2) smallest and largest value of each joint


class Directions(NamedTuple):
    """Directions in which a profile is bounded, (n,) each, from 0 to pi."""

    cosines: np.ndarray
    sines: np.ndarray


@njit(**INNER)
def profile_support(circles, n_circles, axis, directions, height):
    """Bound max of cos(a) z + sin(a) rho over circles, for each direction a.

    circles: (n, 7) centre, unit normal, radius, in a frame whose origin lies on the
    axis. z is the height along `axis`, rho >= 0 the distance from it. The circle is
    replaced by a regular polygon around it; the function is convex for sin(a) >= 0,
    so that its corners bound it.
    """
    cosines, sines = directions
    grow = 1.0 / math.cos(math.pi / CORNERS)
    for d in range(cosines.shape[0]):
        height[d] = -1e300
    for i in range(n_circles):
        cx, cy, cz = circles[i, 0], circles[i, 1], circles[i, 2]
        nx, ny, nz = circles[i, 3], circles[i, 4], circles[i, 5]
        r = circles[i, 6] * grow
        # two unit vectors that span the circle's plane
        if abs(nx) < 0.6:
            ux, uy, uz = 0.0, nz, -ny
        else:
            ux, uy, uz = -nz, 0.0, nx
        norm = math.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / norm, uy / norm, uz / norm
        vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        for k in range(CORNERS if r > 0.0 else 1):
            c, s = r * _COS[k], r * _SIN[k]
            x = cx + c * ux + s * vx
            y = cy + c * uy + s * vy
            z = cz + c * uz + s * vz
            h = x * axis[0] + y * axis[1] + z * axis[2]
            x, y, z = x - h * axis[0], y - h * axis[1], z - h * axis[2]
            rho = math.sqrt(x * x + y * y + z * z)
            for d in range(cosines.shape[0]):
                value = cosines[d] * h + sines[d] * rho
                height[d] = max(height[d], value)


@njit(**INNER)
def profile_circles(axis, directions, height, circles):
    """Write the rims of {cos(a) z + sin(a) rho <= height} about `axis`; return n.

    Directions run from a = 0 to a = pi, so that neighbours meet in the profile's
    corners; the polygon through them contains the profile.
    """
    cosines, sines = directions
    n = cosines.shape[0]
    for d in range(n - 1):
        det = cosines[d] * sines[d + 1] - cosines[d + 1] * sines[d]
        z = (height[d] * sines[d + 1] - height[d + 1] * sines[d]) / det
        rho = (cosines[d] * height[d + 1] - cosines[d + 1] * height[d]) / det
        for k in range(3):
            circles[d, k] = z * axis[k]
            circles[d, 3 + k] = axis[k]
        circles[d, 6] = max(rho, 0.0)
    return n - 1


@njit(**FULL)
def axis_reach(joints, body, circles, n_circles, directions, out):
    """Write bounds on the distance from each ancestor's axis to `out` (n_bodies,).

    circles: (n, 7) circles in the frame of `body` whose hull holds the points; it is
    overwritten and must have room for 2 * (k - 1) + 2 * n_circles rows with k
    directions.
    """
    tree_i, tree_f, span = joints
    height = np.empty(directions.cosines.shape[0])
    middle = height.shape[0] // 2
    while body > 0:
        f = tree_f[body]
        axis = f[12:15]
        if tree_i[body, 2] == 1:
            profile_support(circles, n_circles, axis, directions, height)
            out[body] = max(height[middle], 0.0)
            n_circles = profile_circles(axis, directions, height, circles)
        elif tree_i[body, 2] == 2:
            out[body] = 1.0
            for i in range(n_circles):
                for k in range(7):
                    circles[n_circles + i, k] = circles[i, k]
                for k in range(3):
                    circles[i, k] += span[body, 0] * axis[k]
                    circles[n_circles + i, k] += span[body, 1] * axis[k]
            n_circles *= 2
        for i in range(n_circles):
            at = circles[i]
            at[0], at[1], at[2] = place_of(f, at)
            at[3], at[4], at[5] = turned(f, at[3], at[4], at[5])
        body = tree_i[body, 0]
