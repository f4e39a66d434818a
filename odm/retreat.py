"""Backing off and escape: a motion to offer while no way to a goal is free."""

from typing import TYPE_CHECKING

import numpy as np

from odm._kernels import close, kinematics_door
from odm._kernels.types import N_OCCUPIED

if TYPE_CHECKING:
    from odm.planner import ReactivePlanner

NEAR = 0.15  # [m] farther points are no reason to move
_GAIN = 0.01  # [m] a retreat must gain this much separation
_TRIED = 12  # directions: to the nearest nodes
_SHARES = (1.0, 0.5, 0.25)  # of the way to the node
_AMPLE = 0.12  # [m] so far from where the points will be, the shortest way is best
_AHEAD_GAIN = 0.05  # [m] what a retreat gains from where they will be
_AHEAD_TRIED = 24


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
    return _best(planner, q, m.cloud, now + _GAIN, np.inf, _TRIED)


def find_way_out(
    planner: "ReactivePlanner", q: np.ndarray, points: np.ndarray
) -> np.ndarray | None:
    """Return a (2, dof) motion from q away from where points will be.

    It is free of the frame's points, or an escape from them, as in `find_retreat`.
    Only its end is judged by `points`: what comes may pass where the robot still is.
    Whoever takes it tests it against the person's motion as it goes. Of those that
    lead far enough the one to the nearest node is taken.

    Args:
        planner: A planner that was asked for a frame.
        q: (dof,) where the robot stands.
        points: (n, 3) all the places where obstacles will be soon [m].
    """
    cloud = planner._ahead.of(points)
    if cloud.counts[N_OCCUPIED] == 0:
        return None
    planner._sort()
    m = planner.memory
    ample = planner.keep + _AMPLE
    now = close.separation(m.arm, q, cloud, ample, m.work)
    return _best(planner, q, cloud, now + _AHEAD_GAIN, ample, _AHEAD_TRIED)


def _best(
    planner: "ReactivePlanner",
    q: np.ndarray,
    cloud: object,
    least: float,
    ample: float,
    tried: int,
) -> np.ndarray | None:
    """Return the motion whose end is farthest from a cloud, more than `least` [m].

    The first one that ends at `ample` or more [m] is as good as any.
    """
    m = planner.memory
    escape = bool(planner._nearest(q) < planner.keep)
    kinematics_door.place_anchor(m.arm, q, m.work)
    best, found = least, None
    for node in _near_nodes(planner, q, tried):
        dq = planner._difference(q, planner.cell_map.roadmap.nodes[node])
        for share in _SHARES:
            end = q + share * dq
            gap = close.separation(m.arm, end, cloud, ample, m.work)
            if gap <= best:
                continue
            way = np.ascontiguousarray(share * dq)
            if _is_clear(planner, q, way, escape):
                best, found = gap, np.stack([q, end])
                break
        if best >= ample:
            break
    return found


def _is_clear(
    planner: "ReactivePlanner", q: np.ndarray, way: np.ndarray, escape: bool
) -> bool:
    m, tolerance = planner.memory, planner.cell_map.motion_tolerance
    return close.motion_clear(
        m.arm, planner.radii, q, way, tolerance, m.cloud, escape, m.work
    ) and planner.static.motion_free(q, way)


def _near_nodes(planner: "ReactivePlanner", q: np.ndarray, tried: int) -> np.ndarray:
    planner.attacher._measure(q)
    return np.argsort(planner.attacher.near, kind="stable")[:tried]
