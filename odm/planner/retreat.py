"""Backing off and escape: a motion to offer while no path to a goal is free."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from odm.checks import check_numbers, check_points
from odm.close_test import _close as close
from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.sorted_clouds import SortedClouds
from odm.frame.frame import Frame
from odm.obstacles._cloud import N_OCCUPIED
from odm.obstacles._solids import Solids
from odm.obstacles.obstacles import Obstacles, SolidRoom
from odm.planner.attaching import Attacher
from roadmap.errors import BadInput

NEAR = 0.15  # [m] farther points are no reason to move
_GAIN = 0.01  # [m] a retreat must gain this much separation
_TRIED = 12  # directions: to the nearest nodes
_SHARES = (1.0, 0.5, 0.25)  # of the motion to the node
_AMPLE = 0.12  # [m] with so much more distance than is asked it has evaded
_WORTH = 0.03  # [m] what a motion gains, against standing there
_DIRECTIONS = 24
_SETS_OFF = 0.06  # [s] that it takes to begin to move


class Retreat:
    """Finds motions away from the frame's points, or from what comes.

    Args:
        frame: Its points and what stands still count.
        attacher: Knows the nodes that are near.
    """

    def __init__(self, frame: Frame, attacher: Attacher) -> None:
        """Have no room for what comes yet."""
        self.frame, self.attacher = frame, attacher
        self._coming = SortedClouds(frame.cell_map.grid)
        self._shapes: list[SolidRoom] = []

    def back_off(self, q: np.ndarray) -> np.ndarray | None:
        """Return a (2, dof) motion from q that gets away from the frame's points.

        Where no sphere is nearer than its radius + rho + m, the motion is free as any
        other (back off). Where one is, the motion is one along which no sphere comes
        nearer to any such point than it is now (escape). It is also free of limits,
        self-collision and scenery. None where nothing is near or nothing helps.
        """
        frame = self.frame
        if frame.memory.cloud.counts[N_OCCUPIED] == 0:
            return None
        now = frame.separation(q)
        if now > NEAR:
            return None
        best, found = now + _GAIN, None
        escape = self._place_anchor(q)
        for node in self.attacher.nearest(q, _TRIED):
            dq = frame.difference(q, frame.cell_map.roadmap.nodes[node])
            for share in _SHARES:
                end = q + share * dq
                gap = frame.separation(end)
                if gap <= best:
                    continue
                if self._is_clear(q, share * dq, escape):
                    best, found = gap, np.stack([q, end])
                    break
        return found

    def evasion(
        self,
        q: np.ndarray,
        coming: Sequence[tuple[float, np.ndarray | Obstacles]],
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return a (2, dof) motion from q that evades what comes, or None.

        It is free of what is in the frame, or an escape from that, as in `back_off`. Of
        those to the near nodes it is the one on which the robot, as far as it gets by
        then, keeps most distance from what will be there at each of the times; the
        first that keeps plenty is as good as any. It must keep clearly more than a
        robot that stays. None, too, where it is not known what is there or will be: the
        last frame could not be used, or one of `coming` is not finite.

        Args:
            q: (dof,) where the robot stands.
            coming: Times from now [s], each with the shapes, or the points (n, 3)
                float64, that are expected then [m].
            speed_scale: Share of the joints' speed limits that it will use, (0, 1].

        Raises:
            BadInput: Wrong shape, dtype or length, a q or a time that is not finite, or
                a share outside (0, 1].
        """
        if not 0.0 < speed_scale <= 1.0:
            raise BadInput(
                f"speed_scale is {speed_scale}; give a share in (0, 1] of the limits"
            )
        frame = self.frame
        q = check_numbers(frame.robot, q)
        if not np.isfinite([t for t, _ in coming]).all():
            raise BadInput("somebody comes at a time that is not finite; give seconds")
        there = self._laid_out([what for _, what in coming])
        if frame.trouble is not None or there is None:
            return None
        times = [max(0.0, t - _SETS_OFF) for t, _ in coming]
        keep = frame.keep
        ample = keep + _AMPLE
        fastest = speed_scale * frame.robot.max_velocity
        expected = _Expected(frame, times, there, fastest, ample)
        best, found = expected.gap(q, np.zeros_like(q), -np.inf) + _WORTH, None
        if best >= ample:
            return None
        escape = self._place_anchor(q)
        for node in self.attacher.nearest(q, _DIRECTIONS):
            dq = frame.difference(q, frame.cell_map.roadmap.nodes[node])
            # no farther than it gets by then
            dq = min(1.0, max(times, default=0.0) / expected.duration(dq)) * dq
            gap = expected.gap(q, dq, best)
            if gap > best and self._is_clear(q, dq, escape):
                best, found = gap, np.stack([q, q + dq])
                if best >= ample:
                    break
        return found

    def _laid_out(
        self, sets: Sequence[np.ndarray | Obstacles]
    ) -> list[tuple[object, Solids]] | None:
        """Return each set as a cloud and solids; None where one is nowhere.

        They are not in the room of the frame's, which stay as they are.
        """
        frame, points, solids = self.frame, [], []
        while len(self._shapes) < len(sets):
            self._shapes.append(SolidRoom())
        for given, room in zip(sets, self._shapes, strict=False):
            shapes = NO_SOLIDS
            if isinstance(given, Obstacles):
                shapes = room.of(given, frame.base_world)
                given = given.points
            given = check_points(given, None, None, frame.rho)
            if shapes is None or not np.isfinite(given).all():
                return None
            points.append(frame.world_ahead.points(given).copy())
            solids.append(shapes)
        return list(zip(self._coming.of(points), solids, strict=True))

    def _place_anchor(self, q: np.ndarray) -> bool:
        """Remember where the spheres are at q; return whether a point is too near."""
        m = self.frame.memory
        close.place_anchor(m.arm, q, m.work)
        return bool(self.frame.separation(q) < self.frame.keep)

    def _is_clear(self, q: np.ndarray, dq: np.ndarray, escape: bool) -> bool:
        dq = np.ascontiguousarray(dq)
        clear = self.frame.motion_clear(q, dq, escape=escape)
        return clear and self.frame.static.motion_free(q, dq)


class _Expected(NamedTuple):
    """What is expected where, and how fast the robot may evade it."""

    frame: Frame
    times: list[float]  # from now [s]
    there: list[tuple[object, Solids]]  # points and solids at each of them
    fastest: np.ndarray  # (dof,) speed of the joints [rad or m per s]
    ample: float  # more distance is no better [m]

    def duration(self, dq: np.ndarray) -> float:
        """Return how long a motion takes [s]."""
        return max(np.abs(dq / self.fastest).max(), 1e-9)

    def gap(self, q: np.ndarray, dq: np.ndarray, least: float) -> float:
        """Return the least distance on a motion, or some value below `least` [m]."""
        needed = self.duration(dq)
        gap = self.ample
        test = self.frame.close_test
        # the last is the nearest, mostly: what is too near is known after one look
        for t, (cloud, solids) in list(zip(self.times, self.there, strict=True))[::-1]:
            at = q + min(1.0, t / needed) * dq
            gap = min(gap, test.separation(at, cloud, gap, solids))
            if gap <= least:
                break
        return gap
