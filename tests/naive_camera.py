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


def lone_holes(image, clear: int = 0) -> np.ndarray:
    """Return the pixels that tell nothing and whose eight neighbours all tell."""
    lone = np.zeros(image.shape, bool)
    valid = image != 0 if clear else is_valid(image)
    for v in range(1, image.shape[0] - 1):
        for u in range(1, image.shape[1] - 1):
            around = valid[v - 1 : v + 2, u - 1 : u + 2]
            lone[v, u] = not valid[v, u] and around.sum() == 8
    return lone


def seen_parts(camera: DepthCamera, corners, noise=0.0) -> tuple:
    """Return which pixels tell of cubes with these corners (n, 8, 3).

    For each the first and last row and column (n, 4), those beyond the image left out;
    whether that is all of them; and the reading that they must exceed. A cube too near
    to be looked at has no pixels.
    """
    T = np.linalg.inv(camera.T_base_camera)
    kappa = 1.0 / min(camera.fx, camera.fy)
    p = corners @ T[:3, :3].T + T[:3, 3]
    deep, seen = p[..., 2].max(axis=1), p[..., 2].min(axis=1) >= 0.02
    parts, whole = np.zeros((len(p), 4), int), seen.copy()
    for k, f, c, n in (
        (1, camera.fy, camera.cy, camera.height),
        (0, camera.fx, camera.cx, camera.width),
    ):
        slope = (max(abs(c), abs(n - c)) + 2) / f
        pad = 1.0 + f * kappa * np.hypot(1, slope) / (1 - 2 * kappa)
        at = f * p[seen, :, k] / p[seen, :, 2] + c
        first = np.ceil(at.min(axis=1) - pad)
        last = np.floor(at.max(axis=1) + pad)
        whole[seen] &= (first >= 0) & (last < n)
        column = 2 * (1 - k)
        parts[seen, column] = np.clip(first, 0, n)
        parts[seen, column + 1] = np.clip(last, -1, n - 1)
    parts[~seen] = 0, -1, 0, -1
    return parts, whole, (deep / (1 - kappa) + noise) / camera.scale


def near_readings(camera: DepthCamera, image) -> np.ndarray:
    """Return how far rays are free, as readings; 0 where that is not known."""
    clear = int((camera.clear_m or 0.0) / camera.scale)
    near = np.where(is_valid(image), image, 0).astype(float)
    near[image == 65535] = clear
    near[lone_holes(image, clear)] = 65535.0
    return near


def are_seen_free(camera: DepthCamera, image, corners) -> np.ndarray:
    """Return which cubes with these corners (n, 8, 3) are seen to be free."""
    near, free = near_readings(camera, image), np.zeros(len(corners), bool)
    rows = zip(*seen_parts(camera, corners), strict=True)
    for k, ((top, bottom, left, right), whole, limit) in enumerate(rows):
        part = near[top : bottom + 1, left : right + 1]
        free[k] = whole and part.size > 0 and part.min() > limit
    return free


def cell_states(camera: DepthCamera, image, own, grid, noise=0.0) -> np.ndarray:
    """Return what one camera sees of every cell, by its definition.

    A cell is FREE if all readings of pixels as near to the image of its cube as
    the argument of `odm/cameras/_seen.py` asks exceed what lies behind it.
    """
    near = near_readings(camera, image)
    seen = np.where(is_valid(image) & ~own, image, 65535).astype(float)
    cells = np.zeros(tuple(4 * grid.blocks), np.uint8)
    at = np.argwhere(cells == 0)
    corners = grid.origin + grid.h * (at[:, None] + CORNERS)
    found = np.zeros(len(at), np.uint8)
    rows = zip(*seen_parts(camera, corners, noise), strict=True)
    for k, ((top, bottom, left, right), whole, limit) in enumerate(rows):
        part = np.s_[top : bottom + 1, left : right + 1]
        if bottom < top or right < left:
            continue
        if whole and near[part].min() > limit:
            found[k] = FREE
        elif seen[part].min() <= limit:
            found[k] = SHADOW
    cells[tuple(at.T)] = found
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
