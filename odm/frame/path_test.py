"""Whether a path up to the stop is free of all places where the person may be."""

import math

import numpy as np

from odm._groups import new
from odm.checks import (
    OBJECT,
    check_classes,
    check_distance,
    check_path,
    check_points,
)
from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.sorted_clouds import SortedCloud
from odm.frame._path_test import NOTHING, Keepers, Room, blocked_by_shapes
from odm.frame.frame import Frame
from odm.frame.last_phase import TOUCHED, LastPhase
from odm.obstacles._solids import Solids
from odm.obstacles.obstacles import Obstacles, SolidRoom, lent_arrays, some_of
from roadmap.errors import BadInput
from roadmap.kinematics._limits import MOST_TURNED
from roadmap.kinematics.forward import turns, unwrapped
from roadmap.ranges import check_number, told


class PathTest:
    """Tests whole paths, corner to corner, against obstacles that come nearer."""

    def __init__(self, frame: Frame, last_phase: LastPhase) -> None:
        self.frame, self.last_phase = frame, last_phase
        self._ahead = SortedCloud(frame.cell_map.grid)
        self._nothing = SortedCloud(frame.cell_map.grid)  # no points
        self._shapes = SolidRoom()
        self._room = self._room_for(32)

    def _room_for(self, shapes: int) -> Room:
        """Return room for so many shapes beside the frame's robot."""
        sizes, memory = {"shapes": shapes, "faces": 0}, self.frame.memory
        solids = new(Solids, sizes), new(Solids, sizes)
        n, dof = len(memory.arm.spheres), self.frame.robot.dof
        rows = np.empty(n), np.empty(n), np.empty(dof)
        return Room(*solids, self._nothing.cloud, *rows)

    def blocked_leg(
        self,
        path: np.ndarray,
        extra: float,
        points: np.ndarray | Obstacles | None,
        phase: str | None,
        classes: np.ndarray | None,
        escape: bool,
        nearer: float,
    ) -> int | None:
        """Return the first blocked leg or None; see `ReactivePlanner.blocked_leg`."""
        frame = self.frame
        path = check_path(frame.robot, path)
        if turns(frame.robot):
            known = np.where(np.abs(path) > MOST_TURNED, np.nan, path)
            path = unwrapped(frame.robot, known)
        self._check_extra(extra, nearer, phase)
        few = None if phase is None else self.last_phase.keepers(phase)
        unknown = not math.isfinite(extra)
        if not unknown and isinstance(points, Obstacles) and self._are_plain(points):
            if extra - nearer >= 0.0 or frame.sampled[1] is None:
                leg = self._blocked_by(path, (extra, nearer), points, phase, few)
                if leg is None or not escape:
                    return leg  # what keeps its whole distance is an escape, too
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
            return self._blocked(path, (extra, nearer), points, solids, kinds)
        if not np.isfinite(points).all():
            return 0
        self.last_phase.look(phase, points, classes, solids, kinds)
        return self.last_phase.first_hit(frame.cover(), path, extra, escape)

    def _check_extra(self, extra: object, nearer: float, phase: str | None) -> None:
        """Refuse what is no distance, or takes away more than the clearance."""
        if not (type(nearer) is float and nearer == 0.0):
            if phase is not None:
                raise BadInput(
                    f"nearer is {told(nearer)} in the phase {phase!r}, which tells "
                    "itself what may touch; leave one of them out"
                )
            check_number("nearer [m]", nearer, 0.0, 100.0)
        check_distance(extra)
        least = nearer - (self.frame.cell_map.safety.m + self.frame.extra)
        if -math.inf < extra < least - 1e-9:
            raise BadInput(
                f"an extra of {extra} m takes away more than the clearance m; give "
                f"{least:.4g} m or more"
            )

    def _blocked(
        self,
        path: np.ndarray,
        extra: tuple[float, float],
        points: np.ndarray,
        solids: Solids,
        kinds: np.ndarray | None,
    ) -> int | None:
        """Return the first leg that anything blocks, where no phase is asked for."""
        cloud, bad = self._ahead.of_all(points)
        if bad:
            return 0
        more, nearer = extra
        if not nearer or kinds is None:
            return self.frame.close_test_with(more).first_blocked(path, cloud, solids)
        held_out = kinds == OBJECT
        others, there = some_of(solids, ~held_out), some_of(solids, held_out)
        first = self.frame.close_test_with(more).first_blocked(path, cloud, others)
        test, nothing = self.frame.close_test_with(more - nearer), self._nothing.cloud
        also = test.first_blocked(path, nothing, there)
        return min((leg for leg in (first, also) if leg is not None), default=None)

    def _are_plain(self, obstacles: Obstacles) -> bool:
        """Whether obstacles are shapes alone, of other kinds than meshes."""
        plain = not (obstacles.meshes or len(obstacles.points))
        known = len(obstacles.shape_classes) == len(obstacles)
        return plain and known and obstacles.classes is None

    def _blocked_by(
        self,
        path: np.ndarray,
        extra: tuple[float, float],
        shapes: Obstacles,
        phase: str | None,
        few: Keepers | None,
    ) -> int | None:
        """Return the first leg that shapes alone block, as `blocked_leg` does."""
        memory, n, (more, nearer) = self.frame.memory, len(shapes), extra
        spheres = len(memory.arm.spheres)  # another number with another hand
        if n > len(self._room.others.kind) or spheres > len(self._room.radii):
            self._room = self._room_for(max(32, 2 * n))
        touched = NOTHING
        if phase is not None:
            touched = TOUCHED[phase]
        elif nearer:
            touched = OBJECT
        if few is None:
            robot = memory.robot_state
            few = Keepers(memory.arm, robot.radii, robot.bare)
        keeps = float(more), float(more - nearer)
        kinds = np.ascontiguousarray(shapes.shape_classes, np.int8), touched
        told = lent_arrays(shapes), kinds, few, self._room
        leg: int = blocked_by_shapes(memory.table, path, keeps, *told)
        return None if leg < 0 else leg
