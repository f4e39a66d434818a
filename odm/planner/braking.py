"""Beside a person who moves: is the path up to the stop free, and which way is out?"""

import math
from collections.abc import Sequence

import numpy as np

from odm.checks import check_path, check_points
from odm.close_test.close_test import CloseTest
from odm.close_test.sorted_clouds import SortedCloud
from odm.obstacles.world_frame import WorldFrame
from odm.planner.last_phase import Cover, LastPhase, check_classes
from odm.planner.retreat import find_way_out
from roadmap.errors import BadInput


class Braking:
    """Methods of `ReactivePlanner`."""

    _ahead: SortedCloud
    close_test: CloseTest
    _world_ahead: WorldFrame
    _last_phase: LastPhase | None
    extra: float
    trouble: str | None

    def blocked_leg(
        self,
        path: np.ndarray,
        extra: float = 0.0,
        points: np.ndarray | None = None,
        phase: str | None = None,
        classes: np.ndarray | None = None,
    ) -> int | None:
        """Return the first leg of a path that points block, or None.

        The close test of braking: the whole path must keep `extra` [m] more than rho
        and m from every point, since the person moves while the robot stops. What is
        not known blocks: a path, an `extra` or a point that is not finite, and a last
        frame that could not be used where no points are given.

        Args:
            path: (k, dof) corners [rad or m]; a single one is a robot at rest.
            extra: Distance the points may have come nearer meanwhile [m]; down to -m
                for a robot that may come as near as touch.
            points: (n, 3) where they are then [m], also outside the grid. None: where
                they are in the frame.
            phase: As in `is_free`.
            classes: (n,) of `points`, where they are given.

        Raises:
            BadInput: No path, points of another shape, an `extra` below -m, a phase
                that cannot be, or bad classes.
        """
        self.memory.owner.check()
        path = check_path(self.robot, path)
        least = -(self.cell_map.safety.m + self.extra)
        if -math.inf < extra < least - 1e-9:
            raise BadInput(
                f"an extra of {extra} m takes away more than the clearance m; give "
                f"{least:.4g} m or more"
            )
        unknown = not math.isfinite(extra)
        if points is None:
            points, classes = self.points, self.classes
            unknown = unknown or self.trouble is not None
        else:
            points = check_points(points, None, None, self.rho)
            classes = check_classes(classes, len(points))
            points = self._world_ahead.points(points)
        if unknown:
            return 0
        if phase is not None:
            if not np.isfinite(points).all():
                return 0
            test = self.last_phase(phase, points, classes)
            cover = self.cover()
            legs = np.diff(path, axis=0) if len(path) > 1 else np.zeros_like(path)
            for k, dq in enumerate(legs):
                if test.hit(cover, path[k], dq, extra) is not None:
                    return k
            return None
        return self._blocked(path, extra, points)

    def way_out(
        self,
        q: np.ndarray,
        coming: Sequence[tuple[float, np.ndarray]],
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return a (2, dof) motion from q that evades what comes, or None.

        See `odm.planner.retreat.find_way_out`.
        """
        self.memory.owner.check()
        return find_way_out(self, q, coming, speed_scale)

    def last_phase(
        self, phase: str, points: np.ndarray, classes: np.ndarray | None
    ) -> LastPhase:
        """Return the close test of a phase, with points in the base frame."""
        self.memory.owner.check()
        if self._last_phase is None:
            self._last_phase = LastPhase(self, self.cell_map.grid)
        self._last_phase.look(phase, points, classes)
        return self._last_phase

    def cover(self) -> Cover:
        """Return the spheres of the map's cover, payload included."""
        self.memory.owner.check()
        m = self.memory
        links = [self.static.link_of(i) for i in range(len(m.arm.spheres))]
        return Cover(m.arm, self.radii, links, m.work)

    def _blocked(
        self, path: np.ndarray, extra: float, points: np.ndarray
    ) -> int | None:
        cloud, bad = self._ahead.of_all(points)
        if bad:
            return 0
        return self.close_test.grown(extra).first_blocked(path, cloud)
