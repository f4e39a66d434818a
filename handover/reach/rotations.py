"""RotationGrid: equal cells of SO(3), twist-free Hopf coordinates on HEALPix."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from handover.reach import _rotations as kernels
from roadmap.arrays import freeze, frozen, writable
from roadmap.errors import BadInput

# Cells of the family: 12 k^2 pixels for the tool's z axis, 6 k rolls about it.
SIZES = tuple(72 * k**3 for k in range(1, 7))
# Cells whose centres are nearer than this many times the nearest are neighbours.
_NEAR = 1.35


@dataclass(frozen=True, eq=False)
class RotationGrid:
    """Cells of equal volume in SO(3).

    A rotation's cell is the HEALPix pixel [Gorski2005] of its z axis, and the bin of
    its roll once the frame was carried to the pixel's centre by the smallest rotation
    (parallel transport). The usual Hopf coordinates bin the roll without that, so
    that their cells are twisted by up to half a turn near the south pole.

    Attributes:
        n_side: HEALPix resolution k; 12 k^2 pixels and 6 k rolls, 72 k^3 cells.
        centers: (n, 3, 3) rotation at the centre of each cell.
        pixel_frames: (n_pixels, 9) frame of each pixel, z axis at its centre.
    """

    n_side: int
    centers: np.ndarray = field(repr=False)
    pixel_frames: np.ndarray = field(repr=False)

    def __post_init__(self) -> None:
        freeze(self, centers=float, pixel_frames=float)

    @cached_property
    def neighbors(self) -> np.ndarray:
        """(n, k) int32 cells around each cell, nearest first, filled with -1."""
        return frozen(_neighbors(self.centers), np.int32)

    @property
    def arrays(self) -> kernels.RotationArrays:
        """The grid for the kernels."""
        return kernels.RotationArrays(self.n_side, self.n_roll, self.pixel_frames)

    @property
    def n_roll(self) -> int:
        """Number of rolls about the z axis."""
        return 6 * self.n_side

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return 72 * self.n_side**3

    @property
    def step(self) -> float:
        """Width of a roll bin [rad]: about the distance between neighbours."""
        return 2 * np.pi / self.n_roll

    def cell_of(self, rotations: np.ndarray) -> np.ndarray:
        """Return the (n,) int32 cells of rotations (n, 3, 3), or of one (3, 3).

        Raises:
            BadInput: Another shape, not finite, or not rotations.
        """
        R = np.asarray(rotations, float)
        if R.shape[-2:] != (3, 3) or R.ndim > 3:
            raise BadInput(f"rotations have the shape {R.shape}; give (n, 3, 3)")
        stack = R.reshape(-1, 3, 3)
        if not np.isfinite(stack).all():
            raise BadInput("rotations hold NaN or infinity; give finite numbers")
        off = np.abs(stack @ stack.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
        if off > 1e-6 or (np.linalg.det(stack) < 0).any():
            raise BadInput(
                f"rotations are not orthonormal (error {off:.2g}, limit 1e-6) or "
                "mirror; normalise them"
            )
        out = np.empty(len(stack), np.int32)
        flat = writable(stack.reshape(-1, 9))
        kernels.rotation_cells(flat, self.n_side, self.n_roll, self.pixel_frames, out)
        return out if R.ndim == 3 else out[0]


@lru_cache(maxsize=8)
def rotation_grid(n_cells: int = 576) -> RotationGrid:
    """Return the grid of that many cells: 72 (60 deg), 576 (30 deg), 1944 (20 deg)...

    Raises:
        BadInput: The family has no grid of that size; lists the sizes.
    """
    if n_cells not in SIZES:
        known = ", ".join(map(str, SIZES))
        raise BadInput(f"no grid has {n_cells} rotations; choose one of {known}")
    n_side = SIZES.index(n_cells) + 1
    frames = np.array([_pixel_frame(p, n_side) for p in range(12 * n_side**2)])
    rolls = (np.arange(6 * n_side) + 0.5) * (2 * np.pi / (6 * n_side))
    c, s = np.cos(rolls), np.sin(rolls)
    turns = np.zeros((len(rolls), 3, 3))
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = c, -s, s, c
    turns[:, 2, 2] = 1.0
    centers = (frames[:, None] @ turns[None]).reshape(-1, 3, 3)
    return RotationGrid(n_side, centers, frames.reshape(-1, 9))


def _pixel_frame(pixel: int, k: int) -> np.ndarray:
    """Return the frame whose z axis is the centre of a HEALPix pixel (ring order)."""
    cap, n = 2 * k * (k - 1), 12 * k * k
    if cap <= pixel < n - cap:
        ring, at = divmod(pixel - cap, 4 * k)
        ring += k
        z, shift = (2 * k - ring) * 2 / (3 * k), 1.0 if (ring + k) % 2 else 0.5
        phi = (at + 1 - shift) * np.pi / (2 * k)
    else:
        south = pixel >= n - cap
        at = n - 1 - pixel if south else pixel
        ring = int(1 + np.sqrt(1 + 2 * at)) // 2
        z = 1 - ring**2 / (3 * k * k)
        at -= 2 * ring * (ring - 1)
        at = 4 * ring - 1 - at if south else at
        z, phi = (-z if south else z), (at + 0.5) * np.pi / (2 * ring)
    s = np.sqrt(1 - z * z)
    e1 = [z * np.cos(phi), z * np.sin(phi), -s]
    e2 = [-np.sin(phi), np.cos(phi), 0.0]
    return np.array([e1, e2, [s * np.cos(phi), s * np.sin(phi), z]]).T


def _neighbors(centers: np.ndarray) -> np.ndarray:
    n = len(centers)
    lists = []
    flat = centers.reshape(n, 9)
    # trace(A^T B) = 1 + 2 cos(angle)
    nearest = np.sort(flat @ flat[0])[-2]
    nearest_angle = np.arccos(np.clip((nearest - 1) / 2, -1, 1))
    bound = 1 + 2 * np.cos(_NEAR * nearest_angle)
    for i in range(n):
        trace = flat @ flat[i]
        near = np.flatnonzero(trace > bound)
        near = near[near != i]
        lists.append(near[np.argsort(-trace[near], kind="stable")])
    out = np.full((n, max(map(len, lists))), -1)
    for i, near in enumerate(lists):
        out[i, : len(near)] = near
    return out
