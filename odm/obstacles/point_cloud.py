"""Points of a sensor made ready for a frame: transformed, cropped, thinned."""

from collections.abc import Sequence

import numpy as np

from odm.checks import as_floats
from odm.obstacles.shapes import check_pose
from roadmap.errors import BadInput
from roadmap.ranges import check_number

_ROUNDING = 1.0 - 1e-9  # what rounding may take from a side of a cell


def thinned(points: np.ndarray, gap: float) -> tuple[np.ndarray, float]:
    """Return which points to keep so that each is within `gap` of a kept one.

    Space is cut into cubes of diagonal `gap`; of each cube that holds points, the one
    that comes first is kept. Two points of a cube are no farther apart than its
    diagonal.

    Args:
        points: (n, 3) finite [m].
        gap: Distance to a kept point at most [m], above 0.

    Returns:
        (k,) indices, ascending, and the largest distance of a point from the one that
        is kept of its cube [m]: measured, at most `gap`.
    """
    if not len(points):
        return np.zeros(0, np.int64), 0.0
    cells = np.floor((points - points.min(axis=0)) / (gap / np.sqrt(3.0) * _ROUNDING))
    nx, ny = (cells[:, :2].max(axis=0) + 1.0).tolist()
    if nx * ny * (cells[:, 2].max() + 1.0) > 2.0**53:
        raise BadInput(
            f"points spread over {np.ptp(points, axis=0).max():.3g} m are too far "
            f"apart for a distance of {gap:g} m; crop them, or give metres"
        )
    key = (cells[:, 0] + nx * (cells[:, 1] + ny * cells[:, 2])).astype(np.int64)
    _, first, owner = np.unique(key, return_index=True, return_inverse=True)
    apart = points - points[first[owner.ravel()]]
    far = float(np.sqrt(np.einsum("ni,ni->n", apart, apart).max()))
    return np.sort(first), far


class PointCloud:
    """A camera's points for `planner.step`: moved, cropped, thinned, counted.

    NaN, which depth cameras give where nothing came back, is left out and counted: what
    stands there is not seen, so look at `nan`, or use `odm.SeenSpace`. Then points
    are moved to the world, those outside the crop left out, and the others
    thinned so that the surface keeps a covering radius that is proved: every place that
    had a point within `spacing` has one within `covering_radius`.

    Args:
        points: (n, 3) points, camera frame [m]; or (rows, columns, 3).
        T_world_camera: (4, 4) pose of the camera; None: the points are in the world.
        crop: What is left out: None for nothing; (lower, upper), two corners (3,) of a
            box in the world [m]; or a planner or a map: what no motion can reach.
        covering_radius: What the thinned points shall have [m], at most the map's rho;
            None thins nothing.
        spacing: Covering radius of the points as the sensor gives them [m]: no place of
            a seen surface is farther from its nearest point. For a camera of pixels
            `a` rad apart at distance z, about 0.71 z a on a surface that faces it,
            more on a slanting one. See docs/clouds.md.

    Attributes:
        points: (k, 3) what is left, world frame [m].
        covering_radius: Of these: `spacing` and what thinning added, measured [m].
        nan, cropped, thinned: How many points were left out, by reason.

    Raises:
        BadInput: Wrong shape, a pose that is not rigid, or a covering radius that is
            not above the spacing.
    """

    def __init__(
        self,
        points: np.ndarray,
        T_world_camera: np.ndarray | None = None,
        *,
        crop: object = None,
        covering_radius: float | None = None,
        spacing: float = 0.005,
    ) -> None:
        """Do all of it."""
        points = as_floats("points", points)
        if points.ndim not in (2, 3) or points.shape[-1] != 3:
            raise BadInput(
                f"points have shape {points.shape}; give (n, 3), or (rows, columns, 3)"
            )
        points = points.reshape(-1, 3)
        spacing = float(check_number("spacing in m", spacing, 0.0, 0.5))
        seen = np.isfinite(points).all(axis=1)
        self.nan = len(points) - int(seen.sum())
        points = points if not self.nan else points[seen]
        if T_world_camera is not None:
            T = check_pose(T_world_camera)
            points = points @ T[:3, :3].T + T[:3, 3]
        inside = _inside(points, crop)
        self.cropped = len(points) - int(inside.sum())
        points = points if not self.cropped else points[inside]
        self.thinned, self.covering_radius = 0, spacing
        if covering_radius is not None:
            wanted = check_number("covering_radius in m", covering_radius, 0.0, 0.5)
            if not wanted > spacing:
                raise BadInput(
                    f"covering_radius {wanted:g} m is not above spacing {spacing:g} m, "
                    "which the sensor's own points have; give more, or None to thin "
                    "nothing"
                )
            kept, far = thinned(points, wanted - spacing)
            self.thinned = len(points) - len(kept)
            self.covering_radius = min(spacing + far, wanted)
            points = points[kept]
        self.points = np.ascontiguousarray(points)

    def __len__(self) -> int:
        """Return how many points are left."""
        return len(self.points)

    def __repr__(self) -> str:
        """Say what was done."""
        return (
            f"PointCloud({len(self)} points, covering radius "
            f"{self.covering_radius:.4g} m; left out: {self.nan} NaN, {self.cropped} "
            f"cropped, {self.thinned} thinned)"
        )


def _inside(points: np.ndarray, crop: object) -> np.ndarray:
    """Return which points (n, 3) are inside the crop."""
    if crop is None:
        return np.ones(len(points), np.bool_)
    grid, margin, T = _grid_of(crop)
    if grid is None:
        lower, upper = _corners(crop)
        return ((points >= lower) & (points <= upper)).all(axis=1)
    if T is not None:
        points = points @ T[:3, :3].T + T[:3, 3]
    lower, upper = grid.origin - margin, grid.upper + margin
    return ((points >= lower) & (points <= upper)).all(axis=1)


def _grid_of(crop: object) -> tuple:
    """Return grid, margin beyond it and the world's pose of a planner or a map."""
    grid = getattr(crop, "grid", None)
    if grid is not None:
        return grid, 0.0, None
    cell_map, world = getattr(crop, "cell_map", None), getattr(crop, "world", None)
    if cell_map is None or world is None:
        return None, 0.0, None
    # where extra clearance is kept, points so far outside the grid count, too
    extra: float = crop.extra  # type: ignore[attr-defined]
    return cell_map.grid, extra + 1e-6, world.T_base_world


def _corners(crop: object) -> np.ndarray:
    wrong = (
        "give (lower, upper), two corners of 3 numbers in metres, a planner or a map"
    )
    if not isinstance(crop, Sequence | np.ndarray) or len(crop) != 2:
        raise BadInput(f"crop is {crop!r}; {wrong}")
    corners = as_floats("crop", crop)
    if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
        raise BadInput(f"crop is {crop!r}; {wrong}, the first below the second")
    return corners
