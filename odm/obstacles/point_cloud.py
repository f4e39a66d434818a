"""Points of a sensor made ready for a frame: transformed, cropped, thinned."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from odm.checks import point_floats
from odm.obstacles.unit import (
    FROM_BASE,
    MAX_RANGE_M,
    largest_coordinates,
    not_finite,
    too_far_off,
)
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.ranges import check_number, told
from roadmap.transforms import check_pose, moved_points

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

    A crop makes an empty room of points in a wrong unit, and leaving out NaN one of a
    camera that gives nothing else. So `trouble` is found before, as a planner finds it
    of points that come as they are; `planner.step` holds for it. Without a crop the
    planner itself looks at the unit.

    Args:
        points: (n, 3) points, camera frame [m]; or (rows, columns, 3).
        T_world_camera: (4, 4) pose of the camera; None: the points are in the world.
        crop: What is left out: None for nothing; (lower, upper), two corners (3,) of a
            box in the world [m]; or a planner: what no motion can reach, where its base
            stands and with the distance that it keeps now; or a map: the same where the
            base is the world and nothing more is kept. Questions for more distance, and
            braking, count what is farther out, too: crop nothing for them.
        covering_radius: What the thinned points shall have [m], at most the map's rho;
            None thins nothing.
        spacing: Covering radius of the points as the sensor gives them [m]: no place of
            a seen surface is farther from its nearest point. For a camera of pixels
            `a` rad apart at distance z, about 0.71 z a on a surface that faces it,
            more on a slanting one. See docs/clouds.md.
        max_range_m: Where most points are farther than this from the robot's base
            along an axis, or outside a crop by corners, their unit is wrong [m]; None:
            the setting of the planner that crops, else 20 m.

    Attributes:
        points: (k, 3) what is left, world frame [m].
        covering_radius: Of these: `spacing` and what thinning added, measured [m].
        nan, cropped, thinned: How many points were left out, by reason.
        trouble: Why the sensor's points are of no use, so that `points` must not be
            taken for what is there; None where they are. No points are no trouble.

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
        max_range_m: float | None = None,
    ) -> None:
        points = point_floats(points)
        if points.ndim not in (2, 3) or points.shape[-1] != 3:
            raise BadInput(
                f"points have shape {points.shape}; give (n, 3), or (rows, columns, 3)"
            )
        points = points.reshape(-1, 3)
        spacing = float(check_number("spacing in m", spacing, 0.0, 0.5))
        if max_range_m is not None:
            max_range_m = check_number("max_range_m in m", max_range_m, 0.1, 1e6)
        seen = np.isfinite(points).all(axis=1)
        self.nan = len(points) - int(seen.sum())
        self.trouble: str | None = None
        if self.nan and self.nan == len(points):
            self.trouble = not_finite(self.nan)
        points = points if not self.nan else points[seen]
        if T_world_camera is not None:
            T = check_pose(T_world_camera, "T_world_camera")
            points = moved_points(points, T)
        self.cropped = 0
        self._kept: _Crop | None = None  # by what a planner or a map reaches
        if crop is not None:
            points = self._crop(points, _crop_of(crop), max_range_m)
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

    def _crop(
        self, points: np.ndarray, crop: "_Crop", limit: float | None
    ) -> np.ndarray:
        """Return the points (n, 3) inside; count the others, note what is wrong."""
        there = crop.in_frame(points)
        limit = crop.max_range_m if limit is None else limit
        if self.trouble is None:
            away = crop.away(there)
            n_beyond = int(np.count_nonzero(away > limit))
            self.trouble = too_far_off(
                len(away), n_beyond, limit, lambda: float(np.median(away)), crop.whence
            )
        inside = ((there >= crop.lower) & (there <= crop.upper)).all(axis=1)
        self.cropped = len(points) - int(inside.sum())
        self._kept = crop if self.cropped and crop.whence == FROM_BASE else None
        return points if not self.cropped else points[inside]

    @property
    def is_cut(self) -> bool:
        """Whether a planner or a map cropped some of it."""
        return self._kept is not None

    def holds(
        self, lower: np.ndarray, upper: np.ndarray, T_base_world: np.ndarray
    ) -> bool:
        """Whether no planner or map cropped any of a box, its corners in the base."""
        kept = self._kept
        if kept is None:
            return True
        wide = (kept.lower <= lower).all() and (kept.upper >= upper).all()
        T = np.eye(4) if kept.T is None else kept.T
        return bool(wide and np.array_equal(T, T_base_world))

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        trouble = "" if self.trouble is None else f"; of no use: {self.trouble}"
        return (
            f"PointCloud({len(self)} points, covering radius "
            f"{self.covering_radius:.4g} m; left out: {self.nan} NaN, {self.cropped} "
            f"cropped, {self.thinned} thinned{trouble})"
        )


class _Crop(NamedTuple):
    """What is kept of a cloud, and what its distances are measured from.

    Attributes:
        lower, upper: (3,) corners of the box that is kept [m].
        T: (4, 4) the world's pose in the frame of the corners; None: they are the same.
        whence: From where points are far away.
        max_range_m: How far most of them may be [m].
    """

    lower: np.ndarray
    upper: np.ndarray
    T: np.ndarray | None
    whence: str
    max_range_m: float

    def in_frame(self, points: np.ndarray) -> np.ndarray:
        """Return points (n, 3) of the world in the frame of the corners."""
        if self.T is None:
            return points
        return moved_points(points, self.T)

    def away(self, points: np.ndarray) -> np.ndarray:
        """Return how far placed points (n, 3) are away along an axis, (n,) [m]."""
        if self.whence == FROM_BASE:
            return largest_coordinates(points)
        outside = np.maximum(self.lower - points, points - self.upper)
        return np.maximum(outside, 0.0).max(axis=1)


def _crop_of(crop: object) -> _Crop:
    """Return what a planner, a map or two corners keep."""
    grid = getattr(crop, "grid", None)
    if grid is not None:
        return _Crop(grid.origin, grid.upper, None, FROM_BASE, MAX_RANGE_M)
    cell_map, world = getattr(crop, "cell_map", None), getattr(crop, "world", None)
    if cell_map is None or world is None:
        lower, upper = _corners(crop)
        return _Crop(lower, upper, None, "outside the crop", MAX_RANGE_M)
    # where extra clearance is kept, points so far outside the grid count, too
    extra: float = crop.extra  # type: ignore[attr-defined]
    grid, margin = cell_map.grid, extra + 1e-6
    lower, upper = grid.origin - margin, grid.upper + margin
    limit: float = crop.settings.max_range_m  # type: ignore[attr-defined]
    return _Crop(lower, upper, world.T_base_world, FROM_BASE, limit)


def _corners(crop: object) -> np.ndarray:
    wrong = (
        "give (lower, upper), two corners of 3 numbers in metres, a planner or a map"
    )
    rows = isinstance(crop, Sequence) or isinstance(crop, np.ndarray) and crop.ndim
    if not rows or len(crop) != 2:  # type: ignore[arg-type]
        raise BadInput(f"crop is {told(crop)}; {wrong}")
    corners = as_floats("crop", crop)
    if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
        raise BadInput(f"crop is {told(crop)}; {wrong}, the first below the second")
    return corners
