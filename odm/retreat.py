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
    planner._sort()
    now = planner._nearest(q)
    if now > NEAR:
        return None
    radii = planner.radii
    keep = planner.keep
    escape = bool(now < keep)
    kinematics_door.place_anchor(m.arm, q, m.work)
    best, found = now + _GAIN, None
    for node in _near_nodes(planner, q):
        dq = planner._difference(q, planner.cell_map.roadmap.nodes[node])
        for share in _SHARES:
            end = q + share * dq
            gap = planner._nearest(end)
            if gap <= best:
                continue
            way = np.ascontiguousarray(share * dq)
            tolerance = planner.cell_map.motion_tolerance
            if not close.motion_clear(
                m.arm, radii, q, way, tolerance, m.cloud, escape, m.work
            ):
                continue
            if planner.static.motion_free(q, way):
                best, found = gap, np.stack([q, end])
                break
    return found


def _near_nodes(planner: "ReactivePlanner", q: np.ndarray) -> np.ndarray:
    planner.attacher._measure(q)
    return np.argsort(planner.attacher.near, kind="stable")[:_TRIED]
