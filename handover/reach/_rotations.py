"""Rotation -> cell of the Hopf grid on HEALPix pixels, without twist.

A pose is a row of 12 numbers here: rotation (9, row-major) and origin (3).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import BARE, WITHIN_INNER

_HALF_PI = 0.5 * math.pi
_TURN = 2.0 * math.pi


class RotationArrays(NamedTuple):
    """What the kernels need to know of a rotation grid."""

    n_side: int  # HEALPix resolution
    n_roll: int  # rolls about the z axis
    # (n_pixels, 9) columns e1, e2 and centre of each pixel, row-major
    pixel_frames: np.ndarray


@njit(**WITHIN_INNER)
def pixel_of(x, y, z, n_side):
    """Return the HEALPix pixel (ring order) of a unit vector [Gorski2005, 5.2]."""
    t = math.atan2(y, x) / _HALF_PI
    if t < 0.0:
        t += 4.0
    if t >= 4.0:
        t -= 4.0
    height = abs(z)
    if height <= 2.0 / 3.0:
        rising = int(math.floor(n_side * (0.5 + t - 0.75 * z)))
        falling = int(math.floor(n_side * (0.5 + t + 0.75 * z)))
        ring = n_side + 1 + rising - falling
        shift = 1 - (ring & 1)
        k = ((rising + falling - n_side + shift + 1) // 2) % (4 * n_side)
        return 2 * n_side * (n_side - 1) + (ring - 1) * 4 * n_side + k
    part = t - math.floor(t)
    # 1 - |z| from x and y, which keep the digits near the poles
    root = n_side * math.sqrt(3.0 * (x * x + y * y) / (1.0 + height))
    rising = min(n_side - 1, int(part * root))
    falling = min(n_side - 1, int((1.0 - part) * root))
    ring = rising + falling + 1
    k = min(int(t * ring), 4 * ring - 1)
    if z > 0.0:
        return 2 * ring * (ring - 1) + k
    return 12 * n_side * n_side - 2 * ring * (ring + 1) + k


@njit(**WITHIN_INNER)
def rotation_cell(T, n_side, n_roll, pixel_frames):
    """Return the cell of the rotation of pose `T`.

    The frame is carried to the pixel's centre c by the smallest rotation that takes
    its z axis a there, x' = x - (x.c) / (1 + a.c) (a + c); the roll is then measured
    against the pixel's own frame and binned.

    pixel_frames: (n_pixels, 9) columns e1, e2 and c of each pixel, row-major.
    """
    ax, ay, az = T[2], T[5], T[8]
    pixel = pixel_of(ax, ay, az, n_side)
    f = pixel_frames[pixel]
    cx, cy, cz = f[2], f[5], f[8]
    scale = (T[0] * cx + T[3] * cy + T[6] * cz) / (1.0 + ax * cx + ay * cy + az * cz)
    x = T[0] - scale * (ax + cx)
    y = T[3] - scale * (ay + cy)
    z = T[6] - scale * (az + cz)
    roll = math.atan2(x * f[1] + y * f[4] + z * f[7], x * f[0] + y * f[3] + z * f[6])
    if roll < 0.0:
        roll += _TURN
    bin_ = int(roll / _TURN * n_roll)
    return pixel * n_roll + min(bin_, n_roll - 1)


@njit(**BARE)
def rotation_cells(poses, n_side, n_roll, pixel_frames, out):
    """Write the cell of each row of `poses` (n, >= 9) to `out` (n,)."""
    for i in range(poses.shape[0]):
        out[i] = rotation_cell(poses[i], n_side, n_roll, pixel_frames)
