"""The five costs of an arm posture and their qualities [Vahrenkamp2016, III-B].

Everything is in the canonical shoulder frame of `handover/human/_human_arm.py`. Three
flat arrays hold what does not change between candidates, `handover/meet/quality.py`
fills them:

state (STATE_SIZE,): the packed arm [m]; the present joints and grip; eye, direction of
    gaze, and whether there is one; first moments of upper arm, forearm and hand about
    their own near joints with all that hangs on them, their sum being 1; down.
obstacles (m, 7): capsules a, b, radius [m]; a point is one of radius 0.
settings (SETTINGS_SIZE,): alpha, beta, omega, distance of no concern [m], and whether
    the forearm counts.
"""

import math

from numba import njit

from handover.human._human_arm import ARM_SIZE, arm_axes
from roadmap.compiling.jit_options import BARE, BARE_INNER, WITHIN_INNER

Q_NOW, P_NOW = ARM_SIZE, ARM_SIZE + 7
EYE, GAZE, HAS_GAZE = ARM_SIZE + 10, ARM_SIZE + 13, ARM_SIZE + 16
MOMENTS, DOWN, STATE_SIZE = ARM_SIZE + 17, ARM_SIZE + 20, ARM_SIZE + 23
ALPHA, BETA, OMEGA, CONCERN, FOREARM, SETTINGS_SIZE = 0, 7, 12, 17, 18, 19
JOINT, SPATIAL, VISIBILITY, SAFETY, EFFORT = range(5)


@njit(**BARE)
def quality_of(state, obstacles, settings, q, parts):
    """Return q_online of the joints q (7,) and write its five qualities to parts (5,).

    Without a gaze, visibility is left out: its part is NaN and the other weights are
    raised to sum to 1. Joints, weights and axes as in eq. (1)-(4).
    """
    axes = arm_axes(q)
    u, v, h = axes[0], axes[2], axes[5]
    ex, ey, ez = state[0] * u[0], state[0] * u[1], state[0] * u[2]
    wx, wy, wz = ex + state[1] * v[0], ey + state[1] * v[1], ez + state[1] * v[2]
    x, y, z = wx + state[2] * h[0], wy + state[2] * h[1], wz + state[2] * h[2]
    parts[JOINT] = joint_cost(state, settings, q)
    parts[SPATIAL] = spatial_cost(state, x, y, z)
    parts[VISIBILITY] = visibility_cost(state, x, y, z)
    arm = (ex, ey, ez), (wx, wy, wz), (x, y, z)
    parts[SAFETY] = safety_cost(obstacles, settings, *arm)
    parts[EFFORT] = effort_cost(state, axes)
    total = 0.0
    shares = 0.0
    for i in range(5):
        if i == VISIBILITY and state[HAS_GAZE] == 0.0:
            parts[i] = math.nan
            continue
        parts[i] = 1.0 - math.tanh(settings[BETA + i] * parts[i])
        total += settings[OMEGA + i] * parts[i]
        shares += settings[OMEGA + i]
    return total / shares


@njit(**BARE_INNER)
def joint_cost(state, settings, q):
    """Return the sum of alpha (q_now - q)^2 [rad^2], eq. (1)."""
    cost = 0.0
    for i in range(7):
        step = state[Q_NOW + i] - q[i]
        cost += settings[ALPHA + i] * step * step
    return cost


@njit(**BARE_INNER)
def spatial_cost(state, x, y, z):
    """Return how far the grip has to travel [m], eq. (2)."""
    dx, dy, dz = x - state[P_NOW], y - state[P_NOW + 1], z - state[P_NOW + 2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@njit(**BARE_INNER)
def visibility_cost(state, x, y, z):
    """Return the angle between the gaze and the line from the eye to the grip [rad]."""
    dx, dy, dz = x - state[EYE], y - state[EYE + 1], z - state[EYE + 2]
    gx, gy, gz = state[GAZE], state[GAZE + 1], state[GAZE + 2]
    cx, cy, cz = dy * gz - dz * gy, dz * gx - dx * gz, dx * gy - dy * gx
    along = dx * gx + dy * gy + dz * gz
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), along)


@njit(**BARE_INNER)
def safety_cost(obstacles, settings, elbow, wrist, grip):
    """Return concern / distance - 1 of the grip, 0 beyond the distance of no concern.

    Infinite where the grip, or (if the forearm counts) the line from the elbow over
    the wrist to the grip, is inside an obstacle. elbow, wrist, grip: places (3) [m].
    """
    concern = settings[CONCERN]
    nearest = concern
    for i in range(obstacles.shape[0]):
        square = square_to_axis(obstacles, i, grip)
        nearest = min(nearest, math.sqrt(square) - obstacles[i, 6])
    if nearest <= 0.0:
        return math.inf
    if settings[FOREARM] != 0.0:
        for i in range(obstacles.shape[0]):
            if enters(obstacles, i, elbow, wrist) or enters(obstacles, i, wrist, grip):
                return math.inf
    return concern / nearest - 1.0


@njit(**WITHIN_INNER)
def square_to_axis(rods, i, point):
    """Return the squared distance of a point (3) from the axis of capsule i [m^2]."""
    x, y, z = point
    dx, px = rods[i, 3] - rods[i, 0], x - rods[i, 0]
    dy, py = rods[i, 4] - rods[i, 1], y - rods[i, 1]
    dz, pz = rods[i, 5] - rods[i, 2], z - rods[i, 2]
    square = dx * dx + dy * dy + dz * dz
    t = 0.0
    if square > 0.0:
        t = min(max((px * dx + py * dy + pz * dz) / square, 0.0), 1.0)
    px, py, pz = px - t * dx, py - t * dy, pz - t * dz
    return px * px + py * py + pz * pz


@njit(**BARE_INNER)
def enters(rods, i, a, b):
    """Return whether the line between the points a (3) and b (3) enters capsule i."""
    rx, ry = rods[i, 3] - rods[i, 0], rods[i, 4] - rods[i, 1]
    rz = rods[i, 5] - rods[i, 2]
    sx, sy, sz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    # balls around both lines first: most are far apart
    cx = 0.5 * (a[0] + b[0]) - rods[i, 0] - 0.5 * rx
    cy = 0.5 * (a[1] + b[1]) - rods[i, 1] - 0.5 * ry
    cz = 0.5 * (a[2] + b[2]) - rods[i, 2] - 0.5 * rz
    rr = rx * rx + ry * ry + rz * rz
    ss = sx * sx + sy * sy + sz * sz
    near = rods[i, 6] + 0.5 * (math.sqrt(rr) + math.sqrt(ss))
    if cx * cx + cy * cy + cz * cz >= near * near:
        return False
    offset = a[0] - rods[i, 0], a[1] - rods[i, 1], a[2] - rods[i, 2]
    square = _square_between(offset, (rx, ry, rz), (sx, sy, sz), rr, ss)
    return square <= rods[i, 6] * rods[i, 6]


@njit(**BARE_INNER)
def _square_between(offset, r, s, rr, ss):
    """Return the squared distance of a segment s, which begins at `offset`, from r.

    The nearest points of the two lines where both are inside, else the best clamp.

    Args:
        offset: (3) from the beginning of r to that of s [m].
        r: (3) from one end of the first segment to the other [m].
        s: (3) the same of the second.
        rr: r . r [m^2].
        ss: s . s [m^2].
    """
    ox, oy, oz = offset
    rx, ry, rz = r
    sx, sy, sz = s
    rs = rx * sx + ry * sy + rz * sz
    ro = rx * ox + ry * oy + rz * oz
    so = sx * ox + sy * oy + sz * oz
    det = rr * ss - rs * rs
    t = 0.0
    if det > 1e-12 * rr * ss:
        t = min(max((ro * ss - so * rs) / det, 0.0), 1.0)
    k = 0.0
    if ss > 0.0:
        k = (rs * t - so) / ss
    k = min(max(k, 0.0), 1.0)
    t = 0.0
    if rr > 0.0:
        t = min(max((ro + k * rs) / rr, 0.0), 1.0)
    dx, dy, dz = ox + k * sx - t * rx, oy + k * sy - t * ry, oz + k * sz - t * rz
    return dx * dx + dy * dy + dz * dz


@njit(**WITHIN_INNER)
def effort_cost(state, axes):
    """Return the sum of the seven gravity torques, each without its sign.

    1 is the torque of the whole arm held straight out and level about the shoulder.
    """
    u, elbow, v, d, w, h, (cf, sf) = axes
    mu, mv, mh = state[MOMENTS], state[MOMENTS + 1], state[MOMENTS + 2]
    gx, gy, gz = state[DOWN], state[DOWN + 1], state[DOWN + 2]
    # moments of gravity about wrist, elbow and shoulder: first moment x down
    x, y, z = mh * h[0], mh * h[1], mh * h[2]
    tx, ty, tz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    total = abs(v[0] * tx + v[1] * ty + v[2] * tz)
    total += abs(d[0] * tx + d[1] * ty + d[2] * tz)
    total += abs(w[0] * tx + w[1] * ty + w[2] * tz)
    x, y, z = x + mv * v[0], y + mv * v[1], z + mv * v[2]
    tx, ty, tz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    total += abs(elbow[0] * tx + elbow[1] * ty + elbow[2] * tz)
    x, y, z = x + mu * u[0], y + mu * u[1], z + mu * u[2]
    tx, ty, tz = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
    total += abs(ty) + abs(cf * tx + sf * tz)
    return total + abs(u[0] * tx + u[1] * ty + u[2] * tz)
