"""Motions against the frame by the links' own hulls, where the cover refuses them."""

from itertools import pairwise

import numpy as np

from odm.close_test._close import place_anchor
from odm.close_test.shells import Hulls, Shells
from odm.frame.frame import Frame
from roadmap.kinematics._forward import motion_bounds


class LinkTest:
    """Tests motions by the hulls of the links (`odm.close_test.shells`).

    These stick out of the links by a millimetre, the spheres of the cover by one or two
    centimetres; a test takes some hundred times as long.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self._shells = Shells(frame.static.robot)

    def clear(self, q: np.ndarray, dq: np.ndarray) -> bool:
        """Whether all links keep their distance on q + t dq, t in [0, 1]; proved.

        As `Frame.motion_clear`: from shapes the clearance, from points the covering
        radius more, those outside the grid, too. The rounding of what was sampled saves
        nothing here: a hull may be flat.
        """
        frame = self.frame
        bare, declared = frame.keep_from_shapes, frame.sampled[0]
        keep = bare + (frame.rho if declared is None else declared)
        shells = self.shells
        if not (shells.complete and np.isfinite(q).all() and np.isfinite(dq).all()):
            return False
        arm, work = frame.memory.arm, frame.memory.work
        motion_bounds(
            arm.tree_i, arm.tree_f, arm.reach, dq, work.rates, work.speed, work.bend
        )
        n = self.show_near(q + 0.5 * dq, arm.spheres[:, 3] + keep + 0.5 * work.speed)
        least = np.full(n + int(frame.solids.count[0]), bare)
        least[:n] = keep
        return shells.leave(q, dq, least)

    @property
    def shells(self) -> Shells:
        """The hulls of the robot, with what it holds now."""
        if self._shells.robot is not self.frame.static.robot:
            self._shells = Shells(self.frame.static.robot)
        return self._shells

    def show_near(self, q: np.ndarray, radii: np.ndarray) -> int:
        """Show the shells the frame's shapes, and the points that are near at q.

        Returns how many points these are, which come first: those within `radii` (n,)
        of the spheres' centres there [m]. The centres stay in `work.anchor`.
        """
        frame, work = self.frame, self.frame.memory.work
        place_anchor(frame.memory.arm, q, work)
        points, balls = frame.points[: frame.n_given], work.anchor
        if len(points):
            points = _near(points, balls, radii, frame.memory.arm.body_ptr.tolist())
        self.shells.show(Hulls.of(points, frame.solids))
        return len(points)


def _near(
    points: np.ndarray, balls: np.ndarray, radii: np.ndarray, body_ptr: list[int]
) -> np.ndarray:
    """Return the points (n, 3) that are within `radii` (k,) of `balls` (k, 3) [m].

    Those of body b are number body_ptr[b] to body_ptr[b + 1] - 1.
    """
    low, high = balls - radii[:, None], balls + radii[:, None]
    points = points[_in_box(points.T, low, high)]
    columns, near = np.ascontiguousarray(points.T), np.zeros(len(points), bool)
    for a, b in pairwise(body_ptr):
        if a < b:
            some = _in_box(columns, low[a:b], high[a:b])
            off = points[some, None] - balls[a:b]
            away = np.einsum("ijk,ijk->ij", off, off)
            near[some] |= (away < radii[a:b] ** 2).any(axis=1)
    return points[near]


def _in_box(columns: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return which of the points (3, n) are in the box around boxes (k, 3) [m]."""
    some = np.arange(columns.shape[1])
    for x, a, b in zip(columns, low.min(axis=0), high.max(axis=0), strict=True):
        some = some[(a <= x[some]) & (x[some] <= b)]
    return some
