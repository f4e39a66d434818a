"""Backing off and escape: a motion to offer while no way to a goal is free."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from odm.checks import check_numbers, check_points
from odm.close_test import _close as close
from odm.obstacles._cloud import N_OCCUPIED
from roadmap.errors import BadInput

if TYPE_CHECKING:
    from odm.planner.planner import ReactivePlanner

NEAR = 0.15  # [m] farther points are no reason to move
_GAIN = 0.01  # [m] a retreat must gain this much separation
_TRIED = 12  # directions: to the nearest nodes
_SHARES = (1.0, 0.5, 0.25)  # of the way to the node
_AMPLE = 0.12  # [m] who keeps so much more than the planner asks is out of the way
_WORTH = 0.03  # [m] what a motion gains, against standing there
_DIRECTIONS = 24
_SETS_OFF = 0.06  # [s] that it takes to be on the way


def find_retreat(planner: "ReactivePlanner", q: np.ndarray) -> np.ndarray | None:
    """Return a (2, dof) motion from q that gets away from the frame's points.

    Where no sphere is nearer than its radius + rho + m, the motion is free as any
    other (back off). Where one is, the motion is one along which no sphere comes
    nearer to any such point than it is now (escape). It is also free of limits,
    self-collision and scenery. None where nothing is near or nothing helps.
    """
    m = planner.memory
    if m.cloud.counts[N_OCCUPIED] == 0:
        return None
    now = planner._nearest(q)
    if now > NEAR:
        return None
    planner._sort()
    best, found = now + _GAIN, None
    escape = _place_anchor(planner, q)
    for node in planner.attacher.nearest(q, _TRIED):
        dq = planner._difference(q, planner.cell_map.roadmap.nodes[node])
        for share in _SHARES:
            end = q + share * dq
            gap = planner._nearest(end)
            if gap <= best:
                continue
            if _is_clear(planner, q, share * dq, escape):
                best, found = gap, np.stack([q, end])
                break
    return found


def find_way_out(
    planner: "ReactivePlanner",
    q: np.ndarray,
    coming: Sequence[tuple[float, np.ndarray]],
    speed_scale: float,
) -> np.ndarray | None:
    """Return a (2, dof) motion from q that evades what comes, or None.

    It is free of the frame's points, or an escape from them, as in `find_retreat`.
    Of those to the near nodes it is the one on which the robot, as far as it gets
    by then, keeps most distance from where the points will be at each of the times;
    the first that keeps plenty is as good as any. It must keep clearly more than a
    robot that stays. None, too, where it is not known where the points are or will
    be: the last frame could not be used, or one of `coming` is not finite.

    Args:
        planner: A planner that was asked for a frame.
        q: (dof,) where the robot stands.
        coming: Times from now [s], each with the points (n, 3) float64 that are
            expected then [m].
        speed_scale: Share of the joints' speed limits that it will use, (0, 1].

    Raises:
        BadInput: Wrong shape, dtype or length, a q or a time that is not finite, or a
            share outside (0, 1].
    """
    if not 0.0 < speed_scale <= 1.0:
        raise BadInput(
            f"speed_scale is {speed_scale}; give a share in (0, 1] of the limits"
        )
    robot = planner.robot
    q = check_numbers(robot, q)
    coming = [(t, check_points(p, None, None, planner.rho)) for t, p in coming]
    if not np.isfinite([t for t, _ in coming]).all():
        raise BadInput("the points come at a time that is not finite; give seconds")
    if planner.trouble is not None or not all(np.isfinite(p).all() for _, p in coming):
        return None
    # not in the room of the frame's points, which stay as they are
    ahead = planner._world_ahead
    clouds = planner.coming.of([ahead.points(p).copy() for _, p in coming])
    times = [max(0.0, t - _SETS_OFF) for t, _ in coming]
    ample = planner.keep + _AMPLE
    test = planner.close_test

    def duration(way: np.ndarray) -> float:
        return max(np.abs(way / (speed_scale * robot.max_velocity)).max(), 1e-9)

    def kept(way: np.ndarray, least: float) -> float:
        """Return the least distance on a way, or some value below `least` [m]."""
        needed = duration(way)
        gap = ample
        for t, cloud in zip(times, clouds, strict=True):
            at = q + min(1.0, t / needed) * way
            gap = min(gap, test.separation(at, cloud, gap))
            if gap <= least:
                break
        return gap

    best, found = kept(np.zeros_like(q), -np.inf) + _WORTH, None
    if best >= ample:
        return None
    planner._sort()
    escape = _place_anchor(planner, q)
    for node in planner.attacher.nearest(q, _DIRECTIONS):
        dq = planner._difference(q, planner.cell_map.roadmap.nodes[node])
        dq = min(1.0, max(times, default=0.0) / duration(dq)) * dq  # no farther
        gap = kept(dq, best)
        if gap > best and _is_clear(planner, q, dq, escape):
            best, found = gap, np.stack([q, q + dq])
            if best >= ample:
                break
    return found


def _place_anchor(planner: "ReactivePlanner", q: np.ndarray) -> bool:
    """Remember where the spheres are at q; return whether a point is too near."""
    m = planner.memory
    close.place_anchor(m.arm, q, m.work)
    return bool(planner._nearest(q) < planner.keep)


def _is_clear(
    planner: "ReactivePlanner", q: np.ndarray, way: np.ndarray, escape: bool
) -> bool:
    way = np.ascontiguousarray(way)
    cloud = planner.memory.cloud
    free = planner.close_test.clear(q, way, cloud, escape)
    return free and planner.static.motion_free(q, way)
