"""Best-first search in the interaction workspace, with bounds that always hold.

A hand pose is known exactly before any inverse kinematics, so three of the five
qualities and the dexterity are. What is not known is bounded (decision 0019):

position: the grip is within `far` of the tool, so spatial way and angle to the gaze are at
    least those of the tool less what such a step can change; all else counts as 1.
byte: the same, with the dexterity of the hand pose's own cell.
grip: spatial, visibility, safety of the grip exactly; joint travel at least what the
    elbow angle, the direction of the wrist and the hand's rotation ask for.

A bound below the k-th best known quality ends the matter; equal ones go on, so that ties
are decided by the key as in the full grid.
"""

import math

import numpy as np
from numba import njit

from handover._kernels.arm import LOWER, UPPER, arm_axes
from handover._kernels.meet import dexterity_at, hand_value
from handover._kernels.meet_pose import ROUNDING, UNREACHED, online_sum, tip_parts
from handover._kernels.quality import (
    ALPHA,
    BETA,
    EFFORT,
    EYE,
    GAZE,
    HAS_GAZE,
    JOINT,
    OMEGA,
    P_NOW,
    Q_NOW,
    SAFETY,
    SPATIAL,
    VISIBILITY,
    spatial_cost,
    visibility_cost,
)

NO_VALUE = -1.0
SLACK = 1e-6  # [rad] what arc functions of rounded numbers may be off
# numbers counted: positions opened, bytes compared, grips bounded, hand poses solved
POSITIONS, BYTES, GRIPS, SOLVED = range(4)


@njit(cache=True, nogil=True)
def position_bounds(person, hands, cells, online, whole):
    """Write bounds of q_online and of q_total to online (p,) and whole (p,).

    NO_VALUE where no wrist is within reach.
    """
    state, settings = person.state, person.settings
    share = person.scales[0]
    far = person.scales[3] + hands.far[0]
    step = hands.far[1]
    shares = 0.0
    for i in range(5):
        if i != VISIBILITY or state[HAS_GAZE] != 0.0:
            shares += settings[OMEGA + i]
    sure = settings[OMEGA + JOINT] + settings[OMEGA + SAFETY] + settings[OMEGA + EFFORT]
    for p in range(cells.points.shape[0]):
        x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
        online[p], whole[p] = NO_VALUE, NO_VALUE
        if x * x + y * y + z * z > far * far:
            continue
        way = max(0.0, spatial_cost(state, x, y, z) - step)
        total = sure
        total += settings[OMEGA + SPATIAL] * (
            1.0 - math.tanh(settings[BETA + SPATIAL] * way)
        )
        if state[HAS_GAZE] != 0.0:
            dx, dy, dz = x - state[EYE], y - state[EYE + 1], z - state[EYE + 2]
            away = math.sqrt(dx * dx + dy * dy + dz * dz)
            angle = 0.0
            if away > step:
                angle = visibility_cost(state, x, y, z) - math.asin(step / away)
            total += settings[OMEGA + VISIBILITY] * (
                1.0 - math.tanh(settings[BETA + VISIBILITY] * max(0.0, angle))
            )
        online[p] = share * total / shares + ROUNDING
        whole[p] = online[p] + (1.0 - share) * most_dexterity(person, x, y, z)


@njit(cache=True, nogil=True)
def most_dexterity(person, x, y, z):
    """Return the largest dexterity of any grip that the tool at x, y, z can offer."""
    box, most = person.box, person.most
    margin = int(box[8])
    i = int(math.floor((x - box[0]) * box[7])) + margin
    j = int(math.floor((y - box[1]) * box[7])) + margin
    k = int(math.floor((z - box[2]) * box[7])) + margin
    if i < 0 or j < 0 or k < 0:
        return 0.0
    if i >= most.shape[0] or j >= most.shape[1] or k >= most.shape[2]:
        return 0.0
    return most[i, j, k] / 255.0


@njit(cache=True, nogil=True)
def now_turn(person, now):
    """Write the present wrist's direction, hand's rotation and elbow's share to now.

    now (14,): direction (3), rotation by rows (9), angle at the shoulder [rad],
    weight sums are taken from the settings.
    """
    q = person.state[Q_NOW : Q_NOW + 7]
    axes = arm_axes(q)
    u, v, w, h = axes[0], axes[2], axes[4], axes[5]
    upper, fore = person.state[0], person.state[1]
    size = 0.0
    for i in range(3):
        now[i] = upper * u[i] + fore * v[i]
        size += now[i] * now[i]
    size = math.sqrt(size)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        now[i] /= max(size, 1e-9)
        now[3 + 3 * i] = w[j] * h[k] - w[k] * h[j]
        now[4 + 3 * i] = w[i]
        now[5 + 3 * i] = h[i]
    now[12] = math.atan2(fore * math.sin(q[3]), upper + fore * math.cos(q[3]))


@njit(cache=True, nogil=True)
def least_joint_cost(person, now, hand, wx, wy, wz):
    """Return what joint travel costs at least, eq. (1), for a hand and its wrist.

    The elbow angle is told by the wrist's distance. The shoulder has to turn the
    wrist's direction; shoulder, elbow, forearm and wrist together the hand. Each joint
    turns what hangs on it by its own angle, so angles of rotations are at most
    the sum of the joints'; least squares of such sums are closed forms.
    """
    state, settings = person.state, person.settings
    upper, fore = state[0], state[1]
    square = wx * wx + wy * wy + wz * wz
    away = math.sqrt(square)
    cos_e = (square - upper * upper - fore * fore) / (2.0 * upper * fore)
    elbow = math.acos(min(1.0, max(-1.0, cos_e)))
    elbow = min(max(elbow, state[LOWER + 3]), state[UPPER + 3])
    bend = abs(elbow - state[Q_NOW + 3])
    bend = max(0.0, bend - SLACK)
    cost = settings[ALPHA + 3] * bend * bend
    inner = math.atan2(fore * math.sin(elbow), upper + fore * math.cos(elbow))
    cosine = (wx * now[0] + wy * now[1] + wz * now[2]) / max(away, 1e-9)
    turn = math.acos(min(1.0, max(-1.0, cosine))) - abs(inner - now[12])
    turn = max(0.0, turn - SLACK)
    trace = 0.0
    for i in range(9):
        trace += hand[i] * now[3 + i]
    spin = math.acos(min(1.0, max(-1.0, 0.5 * (trace - 1.0))))
    spin -= bend + 2.0 * SLACK
    a = _give(settings, 0, 3)
    b = _give(settings, 4, 7)
    if a <= 0.0 or b <= 0.0:
        return cost if a <= 0.0 else cost + turn * turn / a
    first = max(turn, spin * a / (a + b))
    rest = max(0.0, spin - first)
    return cost + first * first / a + rest * rest / b


@njit(cache=True, nogil=True)
def _give(settings, first, last):
    """Return the sum of 1 / alpha; 0 where a joint is free of cost."""
    total = 0.0
    for i in range(first, last):
        if settings[ALPHA + i] <= 0.0:
            return 0.0
        total += 1.0 / settings[ALPHA + i]
    return total


@njit(cache=True, nogil=True)
def grip_bound(person, hands, now, r, g, x, y, z, parts):
    """Return a bound of `hand_value`, UNREACHED where the wrist is out of reach."""
    wx = x + hands.wrist[r, g, 0]
    wy = y + hands.wrist[r, g, 1]
    wz = z + hands.wrist[r, g, 2]
    square = wx * wx + wy * wy + wz * wz
    low, high = person.scales[2], person.scales[3]
    if square < low * low or square > high * high:
        return UNREACHED
    settings, share = person.settings, person.scales[0]
    cost = least_joint_cost(person, now, hands.pose[r, g], wx, wy, wz)
    px, py = x + hands.pose[r, g, 9], y + hands.pose[r, g, 10]
    pz = z + hands.pose[r, g, 11]
    dexterity = dexterity_at(person, hands, r, g, px, py, pz)
    shares = tip_parts(person.state, person.rods, settings, px, py, pz, parts)
    parts[JOINT] = 1.0 - math.tanh(settings[BETA + JOINT] * cost)
    parts[EFFORT] = 1.0
    total = share * (online_sum(settings, parts) / shares)
    return total + (1.0 - share) * dexterity + ROUNDING


@njit(cache=True, nogil=True)
def put(top, key, e, g, value, n):
    """Insert an entry into the best n so far, ordered by value, then by key."""
    k = top.value.shape[0]
    at = n
    while at > 0 and (
        value > top.value[at - 1]
        or (value == top.value[at - 1] and key < top.key[at - 1])
    ):
        at -= 1
    if at >= k:
        return n
    last = min(n, k - 1)
    for i in range(last, at, -1):
        top.value[i], top.key[i] = top.value[i - 1], top.key[i - 1]
        top.entry[i], top.grasp[i] = top.entry[i - 1], top.grasp[i - 1]
    top.value[at], top.key[at], top.entry[at], top.grasp[at] = value, key, e, g
    return min(n + 1, k)


@njit(cache=True, nogil=True)
def search(person, hands, cells, keys, removed, seen, warm, top, bounds, room, counts):
    """Fill `top` with the best entries that are not removed.

    Args:
        person: The person.
        hands: Hands by rotation and grasp.
        cells: The robot's cells.
        keys: (n,) of the entries.
        removed: (n,) bool.
        seen: (n,) bool, all False; is left so.
        warm: (m,) entries to begin with: the last best.
        top: Written; its size is k.
        bounds: Room (p,) and (p,).
        room: To work in.
        counts: (4,) how much was done.

    Returns:
        How many there are.
    """
    n = 0
    k = top.value.shape[0]
    now = np.empty(13)
    now_turn(person, now)
    for i in range(warm.shape[0]):
        e = warm[i]
        if removed[e] or seen[e]:
            continue
        p = np.searchsorted(cells.first, e, side="right") - 1
        n = _look(person, hands, cells, keys, p, e, now, top, n, room, counts)
        seen[e] = True
    online, whole = bounds
    position_bounds(person, hands, cells, online, whole)
    n_open = 0
    floor = top.value[k - 1] if n == k else 0.0
    order = np.empty(whole.shape[0], np.int64)
    for p in range(whole.shape[0]):
        if whole[p] >= floor:
            order[n_open] = p
            n_open += 1
    order = order[:n_open]
    order = order[np.argsort(-whole[order])]
    for p in order:
        floor = top.value[k - 1] if n == k else 0.0
        if whole[p] < floor:
            break
        n = _open(
            person, hands, cells, keys, removed, seen, p, online[p], now, top, n,
            room, counts,
        )
    for i in range(warm.shape[0]):
        seen[warm[i]] = False
    return n


@njit(cache=True, nogil=True)
def _open(
    person, hands, cells, keys, removed, seen, p, online, now, top, n, room, counts
):
    """Look at the entries of a position whose bound by the byte passes."""
    counts[POSITIONS] += 1
    counts[BYTES] += (cells.first[p + 1] - cells.first[p]) * hands.pose.shape[1]
    k = top.value.shape[0]
    box, dexterity = person.box, person.dexterity
    pose, turned = hands.pose, hands.cell
    n_grasps, share = pose.shape[1], person.scales[0]
    inverse = box[7]
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    nx, ny, nz = int(box[4]), int(box[5]), int(box[6])
    floor = top.value[k - 1] if n == k else 0.0
    need = _least_byte(floor, online, share)
    for e in range(cells.first[p], cells.first[p + 1]):
        r = cells.rotation[e]
        for g in range(n_grasps):
            byte = 0
            i = int(math.floor((x + pose[r, g, 9] - box[0]) * inverse))
            j = int(math.floor((y + pose[r, g, 10] - box[1]) * inverse))
            m = int(math.floor((z + pose[r, g, 11] - box[2]) * inverse))
            if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz:
                byte = dexterity[(i * ny + j) * nz + m, turned[r, g]]
            if byte >= need:
                if not removed[e] and not seen[e]:
                    n = _look(person, hands, cells, keys, p, e, now, top, n, room, counts)
                    floor = top.value[k - 1] if n == k else 0.0
                    need = _least_byte(floor, online, share)
                break
    return n


@njit(cache=True, nogil=True)
def _least_byte(floor, online, share):
    """Return the least byte of dexterity with which `floor` can be reached; 0 to 256."""
    if share >= 1.0:
        return 0 if online >= floor else 256
    need = (floor - online) / (1.0 - share) * 255.0
    return int(min(256.0, max(0.0, math.ceil(need - 1e-6))))


@njit(cache=True, nogil=True)
def _look(person, hands, cells, keys, p, e, now, top, n, room, counts):
    """Bound each grasp of an entry, solve those that may count, and keep the best."""
    k = top.value.shape[0]
    r = cells.rotation[e]
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    best, best_g = UNREACHED, -1
    for g in range(hands.wrist.shape[1]):
        floor = best
        if n == k:
            floor = max(floor, top.value[k - 1])
        counts[GRIPS] += 1
        bound = grip_bound(person, hands, now, r, g, x, y, z, room.parts)
        if bound < max(floor, 0.0):
            continue
        counts[SOLVED] += 1
        found = hand_value(person, hands, r, g, x, y, z, floor, room)
        if found > best:
            best, best_g = found, g
    if best >= 0.0:
        n = put(top, keys[e], e, best_g, best, n)
    return n
