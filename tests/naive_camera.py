"""Slow twins of the cameras' loops: no tables, no blocks, one cell and pixel a time."""

import itertools

import numpy as np

from odm.cameras import DepthCamera

UNSEEN, FREE, SHADOW, OCCUPIED = range(4)
CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))


def own_readings(camera: DepthCamera, image, centers, radii) -> np.ndarray:
    """Return (height, width) bool: readings whose point lies in one of the balls."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    z = camera.scale * image
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], -1)
    T = camera.T_base_camera
    own = np.zeros(image.shape, bool)
    points = np.concatenate([rays * z[..., None], z[..., None]], -1)
    points = points @ T[:3, :3].T + T[:3, 3]
    for p, r in zip(centers, radii, strict=True):
        own |= np.linalg.norm(points - p, axis=-1) <= r
    return own & is_valid(image)


def is_valid(image) -> np.ndarray:
    return (image != 0) & (image != 65535)


def lone_holes(image) -> np.ndarray:
    """Return the pixels without a reading whose eight neighbours all have one."""
    lone = np.zeros(image.shape, bool)
    valid = is_valid(image)
    for v in range(1, image.shape[0] - 1):
        for u in range(1, image.shape[1] - 1):
            around = valid[v - 1 : v + 2, u - 1 : u + 2]
            lone[v, u] = not valid[v, u] and around.sum() == 8
    return lone


def cell_states(camera: DepthCamera, image, own, grid, noise=0.0) -> np.ndarray:
    """Return what one camera sees of every cell, by its definition.

    A cell is FREE if all readings of pixels as near to the image of its cube as
    the argument of `odm/cameras/_seen.py` asks exceed what lies behind it.
    """
    T = np.linalg.inv(camera.T_base_camera)
    kappa = 1.0 / min(camera.fx, camera.fy)
    pads = []
    for f, c, n in (
        (camera.fx, camera.cx, camera.width),
        (camera.fy, camera.cy, camera.height),
    ):
        slope = (max(abs(c), abs(n - c)) + 2) / f
        pads.append(1.0 + f * kappa * np.hypot(1, slope) / (1 - 2 * kappa))
    near = np.where(is_valid(image), image, 0).astype(float)
    near[lone_holes(image)] = 65535.0
    seen = np.where(is_valid(image) & ~own, image, 65535).astype(float)
    cells = np.zeros(tuple(4 * grid.blocks), np.uint8)
    for cell in np.ndindex(cells.shape):
        corners = grid.origin + grid.h * (np.array(cell) + CORNERS)
        p = corners @ T[:3, :3].T + T[:3, 3]
        if p[:, 2].min() < 0.02:
            continue
        u = camera.fx * p[:, 0] / p[:, 2] + camera.cx
        v = camera.fy * p[:, 1] / p[:, 2] + camera.cy
        u0, u1 = np.ceil(u.min() - pads[0]), np.floor(u.max() + pads[0])
        v0, v1 = np.ceil(v.min() - pads[1]), np.floor(v.max() + pads[1])
        whole = u0 >= 0 and v0 >= 0 and u1 < camera.width and v1 < camera.height
        part = np.s_[
            int(max(v0, 0)) : int(max(v1, -1)) + 1,
            int(max(u0, 0)) : int(max(u1, -1)) + 1,
        ]
        limit = (p[:, 2].max() / (1 - kappa) + noise) / camera.scale
        if near[part].size == 0:
            continue
        if whole and near[part].min() > limit:
            cells[cell] = FREE
        elif seen[part].min() <= limit:
            cells[cell] = SHADOW
    points = camera.points(np.where(own, 0, image).astype(np.uint16))
    found = grid.locate(points)
    found = found[found[:, 0] >= 0]
    cells[tuple(found.T)] = OCCUPIED
    return cells


def grown(cells: np.ndarray, steps: int) -> np.ndarray:
    """Return (nx, ny, nz) bool cells dilated by `steps` in all 26 directions."""
    out = cells.copy()
    for _ in range(steps):
        padded = np.pad(out, 1)
        out = np.zeros_like(out)
        for shift in itertools.product(range(3), repeat=3):
            part = tuple(
                np.s_[s : s + n] for s, n in zip(shift, out.shape, strict=True)
            )
            out |= padded[part]
    return out
