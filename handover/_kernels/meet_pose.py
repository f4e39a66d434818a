"""What one hand pose is worth to a person: the best of its swivel representatives."""

import math

from numba import njit

from handover._kernels.arm import arm_axes
from handover._kernels.arm_ik import SPANS, TINY, swivel_circle, swivel_spans
from handover._kernels.arm_solve import swivel_joints
from handover._kernels.quality import (
    BETA,
    CONCERN,
    EFFORT,
    FOREARM,
    HAS_GAZE,
    JOINT,
    OMEGA,
    SAFETY,
    SPATIAL,
    VISIBILITY,
    _cut,
    _off_capsule,
    effort_cost,
    joint_cost,
    spatial_cost,
    visibility_cost,
)

UNREACHED, BELOW = -1.0, -0.5
ROUNDING = 1e-9  # that a bound is raised by


@njit(cache=True, nogil=True)
def tip_parts(state, rods, settings, x, y, z, parts):
    """Write the qualities that the place of the grip alone tells: two and, of safety,
    the one without the forearm. Return the sum of weights in use.
    """
    parts[SPATIAL] = 1.0 - math.tanh(
        settings[BETA + SPATIAL] * spatial_cost(state, x, y, z)
    )
    shares = settings[OMEGA] + settings[OMEGA + SPATIAL] + settings[OMEGA + SAFETY]
    shares += settings[OMEGA + EFFORT]
    parts[VISIBILITY] = 0.0
    if state[HAS_GAZE] != 0.0:
        parts[VISIBILITY] = 1.0 - math.tanh(
            settings[BETA + VISIBILITY] * visibility_cost(state, x, y, z)
        )
        shares += settings[OMEGA + VISIBILITY]
    concern = settings[CONCERN]
    nearest = concern
    for i in range(rods.shape[0]):
        nearest = min(nearest, _off_capsule(rods, i, x, y, z))
    parts[SAFETY] = 0.0
    if nearest > 0.0:
        parts[SAFETY] = 1.0 - math.tanh(
            settings[BETA + SAFETY] * (concern / nearest - 1.0)
        )
    return shares


@njit(cache=True, nogil=True)
def online_sum(settings, parts):
    """Return the weighted sum of five qualities."""
    total = settings[OMEGA] * parts[0]
    for i in range(1, 5):
        total += settings[OMEGA + i] * parts[i]
    return total


@njit(cache=True, nogil=True)
def pose_value(
    state, rods, settings, share, dexterity, step, floor, pose, work, parts, q, best_q
):
    """Return q_total of the best representative of a hand pose, its joints in best_q.

    Args:
        state: Packed arm first, see `quality.py`.
        rods: (m, 7) obstacles.
        settings: (19,).
        share: Of q_online in q_total.
        dexterity: Of the pose, in [0, 1].
        step: Largest swivel between representatives [rad].
        floor: Of no interest below; a pose that cannot reach it is not looked into.
        pose: (12,) the hand in the canonical shoulder frame.
        work: Room of `arm_ik`.
        parts: (5,) room.
        q: (7,) room.
        best_q: (7,) written.

    Returns:
        In [0, 1]; UNREACHED where no joints in their ranges reach the pose, and BELOW
        where they do, but nothing reaches `floor`.
    """
    arm = state
    best = UNREACHED
    if not swivel_circle(arm, pose, work):
        return best
    n_spans = swivel_spans(arm, work)
    if n_spans == 0:
        return best
    x, y, z = pose[9], pose[10], pose[11]
    shares = tip_parts(state, rods, settings, x, y, z, parts)
    grip_safety = parts[SAFETY]
    parts[JOINT], parts[EFFORT] = 1.0, 1.0
    rest = (1.0 - share) * dexterity
    if share * (online_sum(settings, parts) / shares) + rest + ROUNDING < floor:
        return BELOW
    grip = arm[2]
    wx, wy, wz = x - grip * pose[2], y - grip * pose[5], z - grip * pose[8]
    for i in range(n_spans):
        first, last = work[SPANS + i, 0], work[SPANS + i, 1]
        branch = work[SPANS + i, 2]
        pieces = int(math.ceil((last - first - TINY) / step))
        size = (last - first) / max(pieces, 1)
        for k in range(pieces + 1):
            phi = last if k == pieces else first + k * size
            if not swivel_joints(arm, work, phi, branch, q):
                continue
            axes = arm_axes(q)
            parts[JOINT] = 1.0 - math.tanh(
                settings[BETA + JOINT] * joint_cost(state, settings, q)
            )
            parts[EFFORT] = 1.0 - math.tanh(
                settings[BETA + EFFORT] * effort_cost(state, axes)
            )
            parts[SAFETY] = grip_safety
            total = share * (online_sum(settings, parts) / shares) + rest
            if total <= best:
                continue
            if grip_safety > 0.0 and settings[FOREARM] != 0.0:
                u = axes[0]
                ex, ey, ez = arm[0] * u[0], arm[0] * u[1], arm[0] * u[2]
                if _forearm_cut(rods, ex, ey, ez, wx, wy, wz, x, y, z):
                    parts[SAFETY] = 0.0
                    total = share * (online_sum(settings, parts) / shares) + rest
                    if total <= best:
                        continue
            best = total
            for j in range(7):
                best_q[j] = q[j]
    return best


@njit(cache=True, nogil=True)
def _forearm_cut(rods, ex, ey, ez, wx, wy, wz, x, y, z):
    for i in range(rods.shape[0]):
        if _cut(rods, i, ex, ey, ez, wx, wy, wz):
            return True
        if _cut(rods, i, wx, wy, wz, x, y, z):
            return True
    return False
