"""What one hand pose is worth to a person: the best of its swivel representatives."""

import math
from typing import NamedTuple

from numba import njit

from handover.human._arm_ik import (
    AXES,
    COS_F,
    SIN_A,
    SIN_F,
    SPANS,
    TINY,
    swivel_circle,
    swivel_spans,
)
from handover.human._arm_solve import swivel_joints
from handover.human._human_arm import (
    COS_LOWER,
    COS_UPPER,
    SIN_LOWER,
    SIN_UPPER,
    arm_axes,
)
from handover.meet._quality import (
    BETA,
    CONCERN,
    DOWN,
    EFFORT,
    FOREARM,
    HAS_GAZE,
    JOINT,
    MOMENTS,
    OMEGA,
    SAFETY,
    SPATIAL,
    VISIBILITY,
    effort_cost,
    enters,
    joint_cost,
    spatial_cost,
    square_to_axis,
    visibility_cost,
)
from roadmap.compiling.jit_options import WITHIN_INNER

UNREACHED, BELOW = -1.0, -0.5
ROUNDING = 2e-9  # that a bound is raised by, more than qualities are rounded by
_LOOSE = 1e-6  # of cosines, for the rounding of roots near 0


@njit(**WITHIN_INNER)
def open_parts(state, settings, x, y, z, parts):
    """Write the spatial and visibility qualities of a grip; return the weights' sum."""
    parts[SPATIAL] = 1.0 - math.tanh(
        settings[BETA + SPATIAL] * spatial_cost(state, x, y, z)
    )
    shares = settings[OMEGA] + settings[OMEGA + SPATIAL]
    parts[VISIBILITY] = 0.0
    if state[HAS_GAZE] != 0.0:
        parts[VISIBILITY] = 1.0 - math.tanh(
            settings[BETA + VISIBILITY] * visibility_cost(state, x, y, z)
        )
        shares += settings[OMEGA + VISIBILITY]
    return shares + settings[OMEGA + SAFETY] + settings[OMEGA + EFFORT]


@njit(**WITHIN_INNER)
def safety_part(rods, settings, x, y, z):
    """Return the quality of safety of a grip, without the forearm."""
    concern = settings[CONCERN]
    nearest = concern
    for i in range(rods.shape[0]):
        # roots are drawn only of those that are nearer than the nearest so far
        square = square_to_axis(rods, i, (x, y, z))
        near = nearest + rods[i, 6]
        if near > 0.0 and square < near * near:
            nearest = math.sqrt(square) - rods[i, 6]
    if nearest >= concern:
        return 1.0
    if nearest <= 0.0:
        return 0.0
    return 1.0 - math.tanh(settings[BETA + SAFETY] * (concern / nearest - 1.0))


@njit(**WITHIN_INNER)
def wrist_allows(arm, hand_y, hand_z, square):
    """Return False only where forearm and hand cannot fit together at any swivel.

    The forearm makes a fixed angle with the line from shoulder to wrist, so its cosine
    with a direction of the hand is at most (least) that of the difference (sum) of two
    known angles. The deviation's range bounds its cosine with the hand's y axis, the
    ranges of deviation and flexion that with the z axis.

    Args:
        arm: Packed arm.
        hand_y: Component of the hand's y axis along that line, times its length [m].
        hand_z: The same of its z axis.
        square: Squared length of that line [m^2].
    """
    upper, fore = arm[0], arm[1]
    away = math.sqrt(square)
    cosine = (square + fore * fore - upper * upper) / (2.0 * fore * away)
    cosine = min(1.0, max(-1.0, cosine))
    sine = math.sqrt(1.0 - cosine * cosine)
    y = -hand_y / away  # the thumb turns towards the forearm's back
    spread = sine * math.sqrt(max(0.0, 1.0 - y * y)) + _LOOSE
    if cosine * y + spread < arm[SIN_LOWER + 5]:
        return False
    if cosine * y - spread > arm[SIN_UPPER + 5]:
        return False
    z = hand_z / away
    spread = sine * math.sqrt(max(0.0, 1.0 - z * z)) + _LOOSE
    least = min(arm[COS_LOWER + 6], arm[COS_UPPER + 6])
    if least > 0.0:
        least *= min(arm[COS_LOWER + 5], arm[COS_UPPER + 5])
    return cosine * z + spread >= least


@njit(**WITHIN_INNER)
def online_sum(settings, parts):
    """Return the weighted sum of five qualities."""
    total = settings[OMEGA] * parts[0]
    for i in range(1, 5):
        total += settings[OMEGA + i] * parts[i]
    return total


class PoseTerms(NamedTuple):
    """What all swivel angles of one hand pose have in common."""

    shares: float  # sum of the weights in use
    rest: float  # share of the dexterity in q_total
    effort: float  # upper bound of the quality of effort
    safety: float  # quality of safety of the grip
    forearm: bool  # whether the line from elbow to wrist can still spoil it
    wrist: tuple[float, float, float]  # place (3) of the wrist [m]


@njit(**WITHIN_INNER)
def pose_value(person, scratch, dexterity, least, floor):
    """Return q_total of the best representative of the hand pose in scratch.pose.

    Args:
        person: `Person` of `_meet.py`.
        scratch: `Scratch` of `_meet.py`; the joints are written to its `best`.
        dexterity: Of the pose, in [0, 1].
        least: Lower bound of the cost of effort.
        floor: Of no interest below; a pose that cannot reach it is not looked into.

    Returns:
        In [0, 1]; UNREACHED where no joints in their ranges reach the pose, and BELOW
        where they do, but nothing reaches `floor`.
    """
    arm, rods, settings = person.state, person.rods, person.settings
    share, pose, work, parts = (
        person.scales[0],
        scratch.pose,
        scratch.work,
        scratch.parts,
    )
    if not swivel_circle(arm, pose, work):
        return UNREACHED
    n_spans = swivel_spans(arm, work)
    if n_spans == 0:
        return UNREACHED
    x, y, z = pose[9], pose[10], pose[11]
    shares = open_parts(arm, settings, x, y, z, parts)
    safety = safety_part(rods, settings, x, y, z)
    effort = 1.0 - math.tanh(settings[BETA + EFFORT] * least) + ROUNDING
    parts[SAFETY], parts[JOINT], parts[EFFORT] = safety, 1.0, effort
    rest = (1.0 - share) * dexterity
    if share * (online_sum(settings, parts) / shares) + rest + ROUNDING < floor:
        return BELOW
    grip = arm[2]
    wrist = x - grip * pose[2], y - grip * pose[5], z - grip * pose[8]
    forearm = safety > 0.0 and settings[FOREARM] != 0.0
    if forearm and line_enters(rods, wrist, (x, y, z)):
        safety, forearm = 0.0, False
    terms = PoseTerms(shares, rest, effort, safety, forearm, wrist)
    return _best_swivel(person, scratch, n_spans, terms)


@njit(**WITHIN_INNER)
def _best_swivel(person, scratch, n_spans, terms):
    """Return q_total of the best swivel representative; its joints: scratch.best."""
    arm, settings, work, parts = (
        person.state,
        person.settings,
        scratch.work,
        scratch.parts,
    )
    share, step, q = person.scales[0], person.scales[1], scratch.q
    shares, rest = terms.shares, terms.rest
    best = UNREACHED
    for i in range(n_spans):
        first, last = work[SPANS + i, 0], work[SPANS + i, 1]
        branch = work[SPANS + i, 2]
        pieces = int(math.ceil((last - first - TINY) / step))
        size = (last - first) / max(pieces, 1)
        for k in range(pieces + 1):
            phi = last if k == pieces else first + k * size
            if not swivel_joints(arm, work, phi, branch, q):
                continue
            parts[JOINT] = 1.0 - math.tanh(
                settings[BETA + JOINT] * joint_cost(arm, settings, q)
            )
            parts[SAFETY], parts[EFFORT] = terms.safety, terms.effort
            if share * (online_sum(settings, parts) / shares) + rest <= best:
                continue
            parts[EFFORT] = 1.0 - math.tanh(
                settings[BETA + EFFORT] * swivel_effort(arm, work, phi, scratch.pose, q)
            )
            total = share * (online_sum(settings, parts) / shares) + rest
            if total <= best:
                continue
            if terms.forearm:
                elbow = elbow_at(arm, work, phi)
                if line_enters(person.rods, elbow, terms.wrist):
                    parts[SAFETY] = 0.0
                    total = share * (online_sum(settings, parts) / shares) + rest
                    if total <= best:
                        continue
            best = total
            for j in range(7):
                scratch.best[j] = q[j]
    return best


@njit(**WITHIN_INNER)
def line_enters(rods, a, b):
    """Return whether the line between the points a (3) and b (3) enters a capsule."""
    for i in range(rods.shape[0]):
        if enters(rods, i, a, b):
            return True
    return False


@njit(**WITHIN_INNER)
def elbow_at(arm, work, phi):
    """Return the place of the elbow at a swivel angle."""
    c, s = math.cos(phi), math.sin(phi)
    x = work[SIN_F, 0] + c * work[SIN_F, 1] + s * work[SIN_F, 2]
    y = work[SIN_A, 0] + c * work[SIN_A, 1] + s * work[SIN_A, 2]
    z = work[COS_F, 0] + c * work[COS_F, 1] + s * work[COS_F, 2]
    return arm[0] * x, -arm[0] * y, -arm[0] * z


@njit(**WITHIN_INNER)
def swivel_effort(state, work, phi, pose, q):
    """Return `effort_cost` at a swivel angle of a pose, whose joints are q.

    The arm's directions are read off the swivel circle, without the joints' sines;
    only where the upper arm points nearly to the side, or the hand nearly along its
    axis of flexion, the circle determines them badly.
    """
    c, s = math.cos(phi), math.sin(phi)
    sin_f = work[SIN_F, 0] + c * work[SIN_F, 1] + s * work[SIN_F, 2]
    sin_a = work[SIN_A, 0] + c * work[SIN_A, 1] + s * work[SIN_A, 2]
    cos_f = work[COS_F, 0] + c * work[COS_F, 1] + s * work[COS_F, 2]
    lateral = cos_f * cos_f + sin_f * sin_f
    ux, uy, uz = sin_f, -sin_a, -cos_f
    upper, fore, grip = state[0], state[1], state[2]
    hx, hy, hz = pose[2], pose[5], pose[8]
    ax, ay, az = pose[1], pose[4], pose[7]
    vx = (pose[9] - grip * hx - upper * ux) / fore
    vy = (pose[10] - grip * hy - upper * uy) / fore
    vz = (pose[11] - grip * hz - upper * uz) / fore
    # the axis of deviation is square to forearm and axis of flexion
    dx, dy, dz = vy * az - vz * ay, vz * ax - vx * az, vx * ay - vy * ax
    long = dx * dx + dy * dy + dz * dz
    if lateral < 0.01 or long < 0.01:
        return effort_cost(state, arm_axes(q))
    gx, gy, gz = state[DOWN], state[DOWN + 1], state[DOWN + 2]
    mu, mv, mh = state[MOMENTS], state[MOMENTS + 1], state[MOMENTS + 2]
    x, y, z = mh * hx, mh * hy, mh * hz
    tx, ty, tz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    total = abs(vx * tx + vy * ty + vz * tz) + abs(ax * tx + ay * ty + az * tz)
    total += abs(dx * tx + dy * ty + dz * tz) / math.sqrt(long)
    x, y, z = x + mv * vx, y + mv * vy, z + mv * vz
    tx, ty, tz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    ex = c * work[AXES + 1, 0] + s * work[AXES + 2, 0]
    ey = c * work[AXES + 1, 1] + s * work[AXES + 2, 1]
    ez = c * work[AXES + 1, 2] + s * work[AXES + 2, 2]
    total += abs(ex * tx + ey * ty + ez * tz)
    x, y, z = x + mu * ux, y + mu * uy, z + mu * uz
    tx, ty, tz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    total += abs(ty) + abs(cos_f * tx + sin_f * tz) / math.sqrt(lateral)
    return total + abs(ux * tx + uy * ty + uz * tz)


@njit(**WITHIN_INNER)
def least_effort(state, fingers, wrist, square):
    """Return what the effort of a hand pose costs at least, whatever the swivel.

    One of its seven terms is the torque about the shoulder's y axis, m . k with the
    arm's first moment m and k = down x y. With the upper arm's direction u and the
    wrist W, m = a W + b u + c h, and u keeps its angle to W: all but b times its part
    across W is known, and that part is at most as long as k's own across W.

    Args:
        state: See `_quality.py`; the arm first.
        fingers: (3) direction of the fingers h.
        wrist: (3) place of the wrist W [m].
        square: Squared length of W [m^2].
    """
    upper, fore = state[0], state[1]
    a = state[MOMENTS + 1] / fore
    b = state[MOMENTS] - a * upper
    c = state[MOMENTS + 2]
    kx, kz = -state[DOWN + 2], state[DOWN]
    along = wrist[0] * kx + wrist[2] * kz
    # W . u: the triangle of shoulder, elbow and wrist
    inward = (square + upper * upper - fore * fore) / (2.0 * upper)
    known = along * (a + b * inward / square) + c * (fingers[0] * kx + fingers[2] * kz)
    across = max(0.0, kx * kx + kz * kz - along * along / square)
    side = max(0.0, 1.0 - inward * inward / square)
    return max(0.0, abs(known) - abs(b) * math.sqrt(across * side) - ROUNDING)
