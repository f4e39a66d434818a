"""Best-first search in the interaction workspace, with bounds that always hold.

A hand pose is known exactly before any inverse kinematics, so three of the five
qualities and the dexterity are. What is not known is bounded (decision 0019):

position: the grip is within `far` of the tool, so spatial way and angle to the gaze are at
    least those of the tool less what such a step can change; all else counts as 1.
place: the same for the cell of the person's map that holds the grip, in a table.
byte: the same, with the dexterity of the hand's rotation there, and less what the joints
    must travel to turn the hand.
grip: spatial, visibility, safety of the grip exactly; joint travel at least what the
    elbow angle, the direction of the wrist and the hand's rotation ask for.

A bound below the k-th best known quality ends the matter; equal ones go on, so that ties
are decided by the key as in the full grid.
"""

import math

import numpy as np
from numba import njit

from handover._kernels.arm import LOWER, UPPER, arm_axes
from handover._kernels.meet import dexterity_at, hand_value, position_of
from handover._kernels.meet_pose import (
    ROUNDING,
    UNREACHED,
    least_effort,
    online_sum,
    open_parts,
    safety_part,
    wrist_allows,
)
from handover._kernels.quality import (
    ALPHA,
    BETA,
    EFFORT,
    EYE,
    HAS_GAZE,
    JOINT,
    OMEGA,
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
    shares = _shares(person)
    for p in range(cells.points.shape[0]):
        x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
        online[p], whole[p] = NO_VALUE, NO_VALUE
        if x * x + y * y + z * z > far * far:
            continue
        total = open_bound(state, settings, x, y, z, step)
        online[p] = share * total / shares + ROUNDING
        whole[p] = online[p] + (1.0 - share) * most_dexterity(person, x, y, z)


@njit(cache=True, nogil=True)
def fill_places(person, online, whole):
    """Write bounds of q_online and q_total for a grip in each cell of the person's map.

    They hold in the shoulder frame, so for as long as gaze, grip and eyes stay as they
    are there, wherever the person goes.
    """
    state, settings, box = person.state, person.settings, person.box
    share, shares = person.scales[0], _shares(person)
    cell, half = box[3], 0.5 * math.sqrt(3.0) * box[3] + SLACK
    nx, ny, nz = int(box[4]), int(box[5]), int(box[6])
    far = (person.scales[3] + state[2] + half) ** 2
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                at = (i * ny + j) * nz + k
                x = box[0] + (i + 0.5) * cell
                y = box[1] + (j + 0.5) * cell
                z = box[2] + (k + 0.5) * cell
                online[at], whole[at] = NO_VALUE, NO_VALUE
                if x * x + y * y + z * z > far:
                    continue
                sure = open_bound(state, settings, x, y, z, half)
                online[at] = share * sure / shares + SLACK
                whole[at] = online[at] + (1.0 - share) * person.ceiling[at] / 255.0


@njit(cache=True, nogil=True)
def open_bound(state, settings, x, y, z, step):
    """Return a bound of the weighted qualities of a grip within `step` of a place."""
    total = settings[OMEGA + JOINT] + settings[OMEGA + SAFETY] + settings[OMEGA + EFFORT]
    way = max(0.0, spatial_cost(state, x, y, z) - step)
    total += settings[OMEGA + SPATIAL] * (
        1.0 - math.tanh(settings[BETA + SPATIAL] * way)
    )
    if state[HAS_GAZE] == 0.0:
        return total
    dx, dy, dz = x - state[EYE], y - state[EYE + 1], z - state[EYE + 2]
    away = math.sqrt(dx * dx + dy * dy + dz * dz)
    angle = 0.0
    if away > step:
        angle = visibility_cost(state, x, y, z) - math.asin(step / away)
    return total + settings[OMEGA + VISIBILITY] * (
        1.0 - math.tanh(settings[BETA + VISIBILITY] * max(0.0, angle))
    )


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
    """Write the present wrist's direction, hand's rotation and inner angle to now.

    now (13,): direction (3), rotation by rows (9), angle at the shoulder between
    upper arm and wrist [rad].
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
def fill_spins(person, now, pose, spin, lack):
    """Write how far each hand of `pose` (r, g, 12) has to turn, and what that costs.

    Args:
        person: The person.
        now: Of `now_turn`.
        pose: Hands by rotation and grasp.
        spin: (r, g) written: angle between present and asked rotation [rad].
        lack: (r, g) written: by how many bytes of dexterity the joint travel for that
            angle alone lowers q_total.
    """
    settings, share = person.settings, person.scales[0]
    give = _give(settings, 0, 3) + _give(settings, 3, 4) + _give(settings, 4, 7)
    free = _give(settings, 0, 3) * _give(settings, 3, 4) * _give(settings, 4, 7) <= 0.0
    scale = 0.0
    if share < 1.0:
        scale = 255.0 * share / (1.0 - share) * settings[OMEGA + JOINT]
        scale /= _shares(person)
    for r in range(pose.shape[0]):
        for g in range(pose.shape[1]):
            trace = -1.0
            for i in range(9):
                trace += pose[r, g, i] * now[3 + i]
            angle = math.acos(min(1.0, max(-1.0, 0.5 * trace))) - SLACK
            spin[r, g] = max(0.0, angle)
            cost = 0.0 if free else spin[r, g] * spin[r, g] / give
            lack[r, g] = scale * math.tanh(settings[BETA + JOINT] * cost)


@njit(cache=True, nogil=True)
def _shares(person):
    """Return the sum of the weights in use."""
    settings, total = person.settings, 0.0
    for i in range(5):
        if i != VISIBILITY or person.state[HAS_GAZE] != 0.0:
            total += settings[OMEGA + i]
    return total


@njit(cache=True, nogil=True)
def least_joint_cost(person, now, spin, wx, wy, wz, square):
    """Return what joint travel costs at least, eq. (1), for a hand and its wrist.

    The elbow angle is told by the wrist's distance. The shoulder has to turn the
    wrist's direction; shoulder, elbow, forearm and wrist together the hand by `spin`.
    Each joint turns what hangs on it by its own angle, so angles of rotations are at
    most the sum of the joints'; least squares of such sums are closed forms.
    """
    state, settings = person.state, person.settings
    upper, fore = state[0], state[1]
    away = math.sqrt(square)
    cos_e = (square - upper * upper - fore * fore) / (2.0 * upper * fore)
    elbow = math.acos(min(1.0, max(-1.0, cos_e)))
    elbow = min(max(elbow, state[LOWER + 3]), state[UPPER + 3])
    bend = max(0.0, abs(elbow - state[Q_NOW + 3]) - SLACK)
    cost = settings[ALPHA + 3] * bend * bend
    cos_i = (square + upper * upper - fore * fore) / (2.0 * upper * max(away, 1e-9))
    inner = math.acos(min(1.0, max(-1.0, cos_i)))
    cosine = (wx * now[0] + wy * now[1] + wz * now[2]) / max(away, 1e-9)
    turn = math.acos(min(1.0, max(-1.0, cosine))) - abs(inner - now[12])
    turn = max(0.0, turn - 2.0 * SLACK)
    spin = max(0.0, spin - bend - 2.0 * SLACK)
    a = _give(settings, 0, 3)
    b = _give(settings, 4, 7)
    if a <= 0.0:
        return cost
    if b <= 0.0:
        return cost + turn * turn / a
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
def grip_bound(person, hands, now, spin, r, g, x, y, z, floor, parts):
    """Return a bound of `hand_value`, UNREACHED where forearm and hand cannot fit.

    The distance from obstacles, the dearest part, is left out where the rest is below
    `floor` already.
    """
    wx = x + hands.wrist[r, g, 0]
    wy = y + hands.wrist[r, g, 1]
    wz = z + hands.wrist[r, g, 2]
    square = wx * wx + wy * wy + wz * wz
    low, high = person.scales[2], person.scales[3]
    if square < low * low or square > high * high:
        return UNREACHED
    pose = hands.pose
    hx, hy, hz = pose[r, g, 2], pose[r, g, 5], pose[r, g, 8]
    hand_y = wx * pose[r, g, 1] + wy * pose[r, g, 4] + wz * pose[r, g, 7]
    hand_z = wx * hx + wy * hy + wz * hz
    if not wrist_allows(person.state, hand_y, hand_z, square):
        return UNREACHED
    state, settings, share = person.state, person.settings, person.scales[0]
    px, py, pz = x + pose[r, g, 9], y + pose[r, g, 10], z + pose[r, g, 11]
    rest = (1.0 - share) * dexterity_at(person, hands, r, g, px, py, pz) + ROUNDING
    cost = least_joint_cost(person, now, spin, wx, wy, wz, square)
    parts[JOINT] = 1.0 - math.tanh(settings[BETA + JOINT] * cost)
    cost = least_effort(state, hx, hy, hz, wx, wy, wz, square)
    parts[EFFORT] = 1.0 - math.tanh(settings[BETA + EFFORT] * cost)
    shares = open_parts(state, settings, px, py, pz, parts)
    parts[SAFETY] = 1.0
    bound = share * (online_sum(settings, parts) / shares) + rest
    if bound < floor:
        return bound
    parts[SAFETY] = safety_part(person.rods, settings, px, py, pz)
    return share * (online_sum(settings, parts) / shares) + rest


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
def search(
    person, hands, cells, keys, removed, seen, places, warm, top, bounds, room, counts
):
    """Fill `top` with the best entries that are not removed.

    Args:
        person: The person.
        hands: Hands by rotation and grasp.
        cells: The robot's cells.
        keys: (n,) of the entries.
        removed: (n,) bool.
        seen: (n,) bool, all False; is left so.
        places: Bounds of `fill_places`.
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
    spin, lack = np.empty(hands.cell.shape), np.empty(hands.cell.shape)
    fill_spins(person, now, hands.pose, spin, lack)
    for i in range(warm.shape[0]):
        e = warm[i]
        if removed[e] or seen[e]:
            continue
        p = np.searchsorted(cells.first, e, side="right") - 1
        n = _look(
            person, hands, cells, keys, places, 1.0, p, e, 0, now, spin, lack, top, n,
            room, counts,
        )
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
            person, hands, cells, keys, removed, seen, places, p, online[p], now, spin,
            lack, top, n, room, counts,
        )
    for i in range(warm.shape[0]):
        seen[warm[i]] = False
    return n


@njit(cache=True, nogil=True)
def _open(
    person, hands, cells, keys, removed, seen, places, p, online, now, spin, lack, top,
    n, room, counts,
):
    """Look at the entries of a position whose bound by the byte passes."""
    counts[POSITIONS] += 1
    counts[BYTES] += (cells.first[p + 1] - cells.first[p]) * hands.pose.shape[1]
    k = top.value.shape[0]
    box, dexterity = person.box, person.dexterity
    pose, turned, rotation = hands.pose, hands.cell, cells.rotation
    same, at = hands.same, -1
    n_grasps, share = pose.shape[1], person.scales[0]
    inverse = box[7]
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    nx, ny, nz = int(box[4]), int(box[5]), int(box[6])
    floor = top.value[k - 1] if n == k else 0.0
    far = (floor - online) * 255.0 / max(1.0 - share, 1e-9) - 1e-3
    place_online, place = places
    need, dead = 0.0, False
    scale = 255.0 / max(1.0 - share, 1e-9)
    for e in range(cells.first[p], cells.first[p + 1]):
        r = rotation[e]
        for g in range(n_grasps):
            if not same[g]:
                at = -1
                i = int(math.floor((x + pose[r, g, 9] - box[0]) * inverse))
                j = int(math.floor((y + pose[r, g, 10] - box[1]) * inverse))
                m = int(math.floor((z + pose[r, g, 11] - box[2]) * inverse))
                need, dead = far, far > 0.0
                if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz:
                    at = (i * ny + j) * nz + m
                    dead = place[at] < floor
                    need = (floor - place_online[at]) * scale - 1e-3
            if dead:
                continue
            byte = 0
            if at >= 0:
                byte = dexterity[at, turned[r, g]]
            if byte >= need + lack[r, g]:
                if not removed[e] and not seen[e]:
                    n = _look(
                        person, hands, cells, keys, places, online, p, e, g, now, spin,
                        lack, top, n, room, counts,
                    )
                    floor = top.value[k - 1] if n == k else 0.0
                    far = (floor - online) * scale - 1e-3
                break
    return n


@njit(cache=True, nogil=True, forceinline=True)
def _byte_passes(person, hands, places, online, lack, r, g, x, y, z, floor):
    """Return whether the bounds by place and by byte reach `floor`."""
    px, py = x + hands.pose[r, g, 9], y + hands.pose[r, g, 10]
    pz = z + hands.pose[r, g, 11]
    at = position_of(person.box, px, py, pz)
    scale = 255.0 / max(1.0 - person.scales[0], 1e-9)
    if at < 0:
        return (floor - online) * scale - 1e-3 + lack[r, g] <= 0.0
    if places[1][at] < floor:
        return False
    need = (floor - places[0][at]) * scale - 1e-3 + lack[r, g]
    return person.dexterity[at, hands.cell[r, g]] >= need


@njit(cache=True, nogil=True)
def _look(
    person, hands, cells, keys, places, online, p, e, first, now, spin, lack, top, n,
    room, counts,
):
    """Bound the grasps of an entry from `first` on, solve those that may count."""
    k = top.value.shape[0]
    r = cells.rotation[e]
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    best, best_g = UNREACHED, -1
    floor = top.value[k - 1] if n == k else 0.0
    for g in range(first, hands.wrist.shape[1]):
        if not _byte_passes(person, hands, places, online, lack, r, g, x, y, z, floor):
            continue
        counts[GRIPS] += 1
        bound = grip_bound(
            person, hands, now, spin[r, g], r, g, x, y, z, floor, room.parts
        )
        if bound < floor:
            continue
        counts[SOLVED] += 1
        found = hand_value(person, hands, r, g, x, y, z, floor, room)
        if found > best:
            best, best_g = found, g
            floor = max(floor, found)
    if best >= 0.0:
        n = put(top, keys[e], e, best_g, best, n)
    return n
