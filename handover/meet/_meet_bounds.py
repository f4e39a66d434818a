"""Bounds of what a hand pose is worth, before any inverse kinematics (decision 0019).

A hand pose is known exactly before any inverse kinematics, so three of the five
qualities and the dexterity are. What is not known is bounded (decision 0019):

position: the grip is within `far` of the tool, so its way and its angle to the gaze are
    at least the tool's less what such a step can change; all else counts as 1.
place: the same for the cell of the person's map that holds the grip, in a table.
byte: the same, with the dexterity of the hand's rotation there, less what the joints
    must travel to turn the hand.
grip: spatial, visibility, safety of the grip exactly; joint travel at least what the
    elbow angle, the direction of the wrist and the hand's rotation ask for, and effort
    at least the torque about the shoulder's y axis.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from handover.human._human_arm import LOWER, UPPER, arm_axes
from handover.meet._meet import dexterity_at, grip_of, position_of, wrist_of
from handover.meet._meet_pose import (
    ROUNDING,
    UNREACHED,
    least_effort,
    online_sum,
    open_parts,
    safety_part,
    wrist_allows,
)
from handover.meet._quality import (
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
from roadmap.compiling.jit_options import BARE, BARE_INNER, WITHIN_INNER

NO_VALUE = -1.0
SLACK = 1e-6  # [rad] what arc functions of rounded numbers may be off
LOOSE_BYTE = 1e-3  # that bytes asked for are lowered by, for rounding


class Bounds(NamedTuple):
    """Bounds, and what they are made of."""

    online: np.ndarray  # (p,) of q_online by position of the tool, times its share
    whole: np.ndarray  # (p,) of q_total by position
    # (m,) the same by cell of the person's map that holds the grip
    place_online: np.ndarray
    place: np.ndarray  # (m,) of q_total by that cell
    now: np.ndarray  # (13,) see `now_turn`
    spin: np.ndarray  # (r, g) angle that the hand has to turn by [rad]
    lack: np.ndarray  # (r, g) bytes of dexterity that the joint travel for it is worth


@njit(**BARE_INNER)
def position_bounds(person, hands, cells, bounds):
    """Write bounds.online and bounds.whole.

    NO_VALUE where no wrist is within reach.
    """
    state, settings = person.state, person.settings
    share = person.scales[0]
    online, whole = bounds.online, bounds.whole
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


@njit(**BARE)
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


@njit(**BARE_INNER)
def open_bound(state, settings, x, y, z, step):
    """Return a bound of the weighted qualities of a grip within `step` of a place."""
    total = settings[OMEGA + JOINT] + settings[OMEGA + EFFORT]
    total += settings[OMEGA + SAFETY]
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


@njit(**BARE_INNER)
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


@njit(**BARE_INNER)
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


@njit(**BARE_INNER)
def fill_spins(person, pose, bounds):
    """Write bounds.spin and bounds.lack for hands of `pose` (r, g, 12).

    Of `person` the present hand is in bounds.now.
    """
    now, spin, lack = bounds.now, bounds.spin, bounds.lack
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


@njit(**BARE_INNER)
def _shares(person):
    """Return the sum of the weights in use."""
    settings, total = person.settings, 0.0
    for i in range(5):
        if i != VISIBILITY or person.state[HAS_GAZE] != 0.0:
            total += settings[OMEGA + i]
    return total


@njit(**BARE_INNER)
def least_joint_cost(person, now, spin, wrist, square):
    """Return what joint travel costs at least, eq. (1), for a hand and its wrist (3).

    The wrist's distance determines the elbow angle. The shoulder has to turn the
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
    cosine = wrist[0] * now[0] + wrist[1] * now[1] + wrist[2] * now[2]
    cosine /= max(away, 1e-9)
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


@njit(**BARE_INNER)
def _give(settings, first, last):
    """Return the sum of 1 / alpha; 0 where a joint is free of cost."""
    total = 0.0
    for i in range(first, last):
        if settings[ALPHA + i] <= 0.0:
            return 0.0
        total += 1.0 / settings[ALPHA + i]
    return total


@njit(**BARE_INNER)
def grip_bound(person, hands, bounds, one, floor, parts):
    """Return a bound of `hand_value`, UNREACHED where forearm and hand cannot fit.

    The distance from obstacles, the dearest part, is left out where the rest is below
    `floor` already.
    """
    wrist, square = wrist_of(hands, one)
    low, high = person.scales[2], person.scales[3]
    if square < low * low or square > high * high:
        return UNREACHED
    pose, r, g = hands.pose, one.rotation, one.grasp
    hx, hy, hz = pose[r, g, 2], pose[r, g, 5], pose[r, g, 8]
    hand_y = wrist[0] * pose[r, g, 1] + wrist[1] * pose[r, g, 4]
    hand_y += wrist[2] * pose[r, g, 7]
    hand_z = wrist[0] * hx + wrist[1] * hy + wrist[2] * hz
    if not wrist_allows(person.state, hand_y, hand_z, square):
        return UNREACHED
    state, settings, share = person.state, person.settings, person.scales[0]
    grip = grip_of(hands, one)
    rest = (1.0 - share) * dexterity_at(person, hands, one, grip) + ROUNDING
    cost = least_joint_cost(person, bounds.now, bounds.spin[r, g], wrist, square)
    parts[JOINT] = 1.0 - math.tanh(settings[BETA + JOINT] * cost)
    cost = least_effort(state, (hx, hy, hz), wrist, square)
    parts[EFFORT] = 1.0 - math.tanh(settings[BETA + EFFORT] * cost)
    shares = open_parts(state, settings, grip[0], grip[1], grip[2], parts)
    parts[SAFETY] = 1.0
    bound = share * (online_sum(settings, parts) / shares) + rest
    if bound < floor:
        return bound
    parts[SAFETY] = safety_part(person.rods, settings, grip[0], grip[1], grip[2])
    return share * (online_sum(settings, parts) / shares) + rest


@njit(**WITHIN_INNER)
def byte_passes(person, hands, bounds, p, one, floor):
    """Return whether the bounds by place and by byte reach `floor`.

    p: number of the candidate's position.
    """
    x, y, z = grip_of(hands, one)
    at = position_of(person.box, x, y, z)
    lack = bounds.lack[one.rotation, one.grasp]
    scale = 255.0 / max(1.0 - person.scales[0], 1e-9)
    if at < 0:
        need = (floor - bounds.online[p]) * scale - LOOSE_BYTE + lack
        return need <= 0.0
    if bounds.place[at] < floor:
        return False
    need = (floor - bounds.place_online[at]) * scale - LOOSE_BYTE + lack
    return person.dexterity[at, hands.cell[one.rotation, one.grasp]] >= need
