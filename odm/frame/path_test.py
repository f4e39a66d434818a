"""Whether a path up to the stop is free of all places where the person may be."""

import math

import numpy as np

from odm.checks import check_classes, check_path, check_points
from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.sorted_clouds import SortedCloud
from odm.frame.frame import Frame
from odm.frame.last_phase import LastPhase
from odm.obstacles._solids import Solids
from odm.obstacles.obstacles import Obstacles, SolidRoom
from roadmap.errors import BadInput
from roadmap.kinematics.forward import turns, unwrapped
from roadmap.ranges import is_real, told


class PathTest:
    """Tests whole paths, corner to corner, against obstacles that come nearer."""

    def __init__(self, frame: Frame, last_phase: LastPhase) -> None:
        self.frame, self.last_phase = frame, last_phase
        self._ahead = SortedCloud(frame.cell_map.grid)
        self._shapes = SolidRoom()

    def blocked_leg(
        self,
        path: np.ndarray,
        extra: float,
        points: np.ndarray | Obstacles | None,
        phase: str | None,
        classes: np.ndarray | None,
        escape: bool,
    ) -> int | None:
        """Return the first blocked leg or None; see `ReactivePlanner.blocked_leg`."""
        frame = self.frame
        path = check_path(frame.robot, path)
        if turns(frame.robot):
            path = unwrapped(frame.robot, path)
        if not is_real(extra):
            if np.ndim(extra) > 0:
                raise BadInput("extra is an array; give metres, and points after it")
            if not isinstance(extra, np.ndarray):
                raise BadInput(f"extra is {told(extra)}; give metres, 0 for none")
        least = -(frame.cell_map.safety.m + frame.extra)
        if -math.inf < extra < least - 1e-9:
            raise BadInput(
                f"an extra of {extra} m takes away more than the clearance m; give "
                f"{least:.4g} m or more"
            )
        if phase is not None:
            self.last_phase.links_that_may(phase)
        unknown = not math.isfinite(extra)
        if points is None:
            points, classes = frame.points[: frame.n_given], frame.classes
            solids, kinds = frame.solids, frame.solid_classes
            unknown = unknown or frame.trouble is not None
        else:
            solids, kinds = NO_SOLIDS, None
            if isinstance(points, Obstacles):
                solids = self._shapes.of(points, frame.base_world)
                unknown = unknown or solids is None
                kinds, classes = points.shape_classes, points.classes
                points = points.points
            points = check_points(points, None, None, frame.rho)
            classes = check_classes(classes, len(points))
            points = frame.world_ahead.points(points)
        if unknown:
            return 0
        if phase is None:
            return self._blocked(path, extra, points, solids)
        if not np.isfinite(points).all():
            return 0
        self.last_phase.look(phase, points, classes, solids, kinds)
        return self.last_phase.first_hit(frame.cover(), path, extra, escape)

    def _blocked(
        self, path: np.ndarray, extra: float, points: np.ndarray, solids: Solids
    ) -> int | None:
        cloud, bad = self._ahead.of_all(points)
        if bad:
            return 0
        return self.frame.close_test_with(extra).first_blocked(path, cloud, solids)
