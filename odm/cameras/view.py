"""View: one camera laid out on a grid, with all arrays its frames need."""

from typing import NamedTuple

import numpy as np

from odm.cameras import _seen as seen
from odm.cameras._depth import TILE
from odm.cameras._windows import COARSE
from odm.cameras.camera import DepthCamera
from odm.obstacles.grid import WorkspaceGrid
from roadmap.errors import BadInput

_LEVELS = 8  # squares of up to 256 pixels
_FEW = 0.03  # share of the blocks in view


class View(NamedTuple):
    """What the compiled loops take of a camera; images are looked at by halves."""

    # (12,) fx, fy, cx, cy, scale, pads of u and v, kappa, noise, width, height, and
    # the reading up to which a clear pixel's ray is free, 0: there are none
    lens: np.ndarray
    pose: np.ndarray  # (12,) base to camera: rotation, row-major, and translation
    to_eighths: np.ndarray  # (12,) camera to eighths of cells from the grid's corner
    near: np.ndarray  # (levels, rows, columns) uint16, see odm/cameras/_depth.py
    seen: np.ndarray
    top_near: np.ndarray  # their largest values, coarse
    top_seen: np.ndarray
    block_kind: np.ndarray  # (blocks) uint8: is its image in the picture
    block_rect: np.ndarray  # (blocks, 5) uint16: where, see odm/cameras/_windows.py
    block_limit: np.ndarray  # (blocks) uint16: reading behind it
    block_low: np.ndarray  # (blocks) uint16: reading in front of it
    cell_kind: np.ndarray  # the same for cells
    cell_rect: np.ndarray
    cell_limit: np.ndarray
    tile_start: np.ndarray  # (tiles + 1,) balls that a point of a tile may lie in
    tile_item: np.ndarray
    tile_depth: np.ndarray  # (tiles + 1, 2) least and largest depth in them [m]
    rect: np.ndarray  # (balls, 4) scratch
    spare: np.ndarray  # (rows, columns) uint16 scratch


def lay_out_view(
    camera: DepthCamera,
    grid: WorkspaceGrid,
    beyond: np.ndarray,
    n_balls: int,
    noise: float,
    rho: float,
) -> View:
    """Return the arrays of a camera on a grid.

    Args:
        camera: The camera.
        grid: The map's grid.
        beyond: (nx, ny, nz) bool, cells that are not looked at.
        n_balls: Spheres of the self filter.
        noise: A reading may be too large by that [m].
        rho: Of the map; pixels as wide at the far end of the grid are refused [m].

    Raises:
        BadInput: The pixels are too wide, or the grid is not in view.
    """
    blocks = tuple(int(n) for n in grid.blocks)
    cells = tuple(4 * n for n in blocks)
    T = np.linalg.inv(camera.T_base_camera)
    pose = np.r_[T[:3, :3].ravel(), T[:3, 3]]
    lens = _lens(camera, noise)
    rows, columns = (camera.height + 1) // 2, (camera.width + 1) // 2
    levels = max(1, min(_LEVELS, int(np.log2(min(rows, columns))) + 1))
    near, far = (np.zeros((levels, rows, columns), np.uint16) for _ in range(2))
    block_kind, block_rect, block_limit, block_low = _tables(blocks)
    cell_kind, cell_rect, cell_limit, cell_low = _tables(cells)
    origin = np.array(grid.origin)
    sight = seen.Sight(pose, lens, near)
    images = seen.Images(block_kind, block_rect, block_limit)
    seen.place_cubes(sight, origin, 4 * grid.h, images, block_low)
    images = seen.Images(cell_kind, cell_rect, cell_limit)
    seen.place_cubes(sight, origin, grid.h, images, cell_low)
    cell_kind[beyond] = seen.HIDDEN
    nx, ny, nz = blocks
    cut = cell_kind.reshape(nx, 4, ny, 4, nz, 4).any(axis=(1, 3, 5))
    block_kind[~cut] = seen.HIDDEN
    block_kind[cut & (block_kind == seen.HIDDEN)] = seen.CUT
    used = _levels_used(block_rect, block_kind, cell_rect, cell_kind)
    near, far = near[:used], far[:used]
    _check_view(camera, grid, pose, cell_kind, rho)
    coarse = (-(-rows // COARSE), -(-columns // COARSE))
    tiles = -(-camera.height // TILE) * -(-camera.width // TILE)
    return View(
        lens, pose, _to_eighths(camera, grid), near, far,
        np.zeros(coarse, np.uint16), np.zeros(coarse, np.uint16),
        block_kind, block_rect, block_limit, block_low,
        cell_kind, cell_rect, cell_limit,
        np.zeros(tiles + 1, np.int64), np.zeros(tiles * n_balls, np.int32),
        np.zeros((tiles + 1, 2)), np.zeros((n_balls, 4), np.int64),
        np.zeros((rows, columns), np.uint16),
    )  # fmt: skip


def lift(table: np.ndarray, spare: np.ndarray) -> None:
    """Fill levels 1, 2, ... of `table` (levels, rows, columns) from level 0.

    Entries whose squares leave the table are not used, and are left as they are.
    """
    rows, columns = spare.shape
    for k in range(1, len(table)):
        half, below = 1 << (k - 1), table[k - 1]
        wide, tall = columns - 2 * half + 1, rows - 2 * half + 1
        # numpy's minimum of 16-bit numbers is several times as fast as a compiled loop
        pairs = spare[: tall + half, :wide]
        np.minimum(
            below[: tall + half, :wide], below[: tall + half, half : half + wide],
            out=pairs,
        )  # fmt: skip
        np.minimum(pairs[:tall], pairs[half:], out=table[k, :tall, :wide])


def _levels_used(
    block_rect: np.ndarray,
    block_kind: np.ndarray,
    cell_rect: np.ndarray,
    cell_kind: np.ndarray,
) -> int:
    """Return how many levels are worth their time; blocks that need more are cut.

    Cells need theirs. The few blocks next to the camera that fill most of the image
    would need more: they are looked at cell by cell.
    """
    visible = (block_kind == seen.PARTLY) | (block_kind == seen.WHOLE)
    levels = block_rect[..., 0]
    used = int(cell_rect[..., 0][cell_kind != seen.HIDDEN].max(initial=0))
    while (visible & (levels > used)).sum() > _FEW * visible.sum():
        used += 1
    block_kind[visible & (levels > used)] = seen.CUT
    return used + 1


def _tables(shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    limits = np.zeros((2, *shape), np.uint16)
    rect = np.zeros((*shape, 5), np.uint16)
    return np.zeros(shape, np.uint8), rect, limits[0], limits[1]


def _lens(camera: DepthCamera, noise: float) -> np.ndarray:
    pads = []
    for focal, centre, size in (
        (camera.fx, camera.cx, camera.width),
        (camera.fy, camera.cy, camera.height),
    ):
        slope = (max(abs(centre), abs(size - centre)) + 2.0) / focal
        wide = focal * camera.kappa * np.sqrt(1.0 + slope**2)
        pads.append(1.0 + wide / (1.0 - 2.0 * camera.kappa) + 1e-6)
    return np.array(
        [camera.fx, camera.fy, camera.cx, camera.cy, camera.scale, *pads, camera.kappa,
         noise, camera.width, camera.height,
         np.floor((camera.clear_m or 0.0) / camera.scale)]
    )  # fmt: skip


def _to_eighths(camera: DepthCamera, grid: WorkspaceGrid) -> np.ndarray:
    T = camera.T_base_camera
    per_m = 2.0 / grid.h
    return np.r_[per_m * T[:3, :3].ravel(), per_m * (T[:3, 3] - grid.origin)]


def _check_view(
    camera: DepthCamera,
    grid: WorkspaceGrid,
    pose: np.ndarray,
    cell_kind: np.ndarray,
    rho: float,
) -> None:
    if not cell_kind.any():
        raise BadInput(
            f"no cell of the map is in view of {camera.name} at "
            f"{np.round(camera.T_base_camera[:3, 3], 3)} m; check its pose (z is "
            "forward, y down), and cx and cy"
        )
    corners = np.indices((2, 2, 2)).reshape(3, -1).T * (grid.upper - grid.origin)
    depth = ((corners + grid.origin) @ pose[6:9] + pose[11]).max()
    wide = camera.thinnest(float(depth))
    if camera.kappa >= 0.1 or wide > 2.0 * rho:
        raise BadInput(
            f"the pixels of {camera.name} are too wide: at the far end of the grid, "
            f"{depth:.2f} m away, things of {100 * wide:.1f} cm can hide between its "
            f"rays, more than twice rho = {100 * rho:.1f} cm; take a camera of more "
            "pixels or put it nearer"
        )
