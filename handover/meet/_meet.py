"""The interaction workspace [Vahrenkamp2016, Algorithm 1] over cells of a robot.

Everything is in the person's canonical shoulder frame. Three tuples hold what does not
change from cell to cell: who (the person now), how (hands by rotation and grasp), and
where (the robot's cells).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from handover.jit_options import BARE, FULL, WITHIN
from handover.meet._meet_pose import UNREACHED, least_effort, pose_value, wrist_allows
from handover.meet._quality import quality_of
from handover.reach._rotations import rotation_cell

TINY_M = 1e-9
# Qualities are rounded to this. A tool turned by half a turn often offers the same hand
# pose, so equals are common: the key, not the last digit, tells which comes first.
GRAIN = 1e-9
# [rad] A hand is looked up in the person's map turned by this. Person and robot stand
# upright, so hands point straight up often, where cells meet: without it rounding would
# choose among them, another one each frame.
NUDGE = (0.36e-4, 0.48e-4, 0.8e-4)


class Person(NamedTuple):
    """The person at one moment.

    Attributes:
        state: (68,) and settings (19,): see `handover/meet/_quality.py`.
        rods: (m, 7) own body and surroundings [m].
        settings: (19,).
        dexterity: (n_positions, n_rotations) uint8 of the person's reach map.
        box: (9,) of that map: lower corner, cell [m], numbers of cells, 1 / cell, and
            by how many cells `most` is larger on every side.
        ceiling: (n_positions,) uint8: the largest dexterity of each position.
        most: (nx, ny, nz) uint8: the largest dexterity near a position of the tool.
        scales: (4,) share of q_online, swivel step, least and largest distance of the
            wrist [m].
    """

    state: np.ndarray
    rods: np.ndarray
    settings: np.ndarray
    dexterity: np.ndarray
    box: np.ndarray
    ceiling: np.ndarray
    most: np.ndarray
    scales: np.ndarray


class Hands(NamedTuple):
    """Hands by rotation cell of the robot and grasp.

    Attributes:
        pose: (r, g, 12) rotation, and offset of the grip from the tool [m].
        wrist: (r, g, 3) offset of the wrist from the tool [m].
        cell: (r, g) rotation cell in the person's reach map.
        far: (2,) largest distance of a wrist and of a grip from the tool [m].
        same: (g,) whether a grasp has its grip where the one before it has.
    """

    pose: np.ndarray
    wrist: np.ndarray
    cell: np.ndarray
    far: np.ndarray
    same: np.ndarray


class Cells(NamedTuple):
    """The robot's cells.

    Attributes:
        points: (p, 3) centres of the position cells [m].
        first: (p + 1,) first entry of each.
        rotation: (n,) rotation cell of each entry.
    """

    points: np.ndarray
    first: np.ndarray
    rotation: np.ndarray


class Room(NamedTuple):
    """Room to work in.

    Attributes:
        work: (78, 3) of `arm_ik`.
        parts: (5,) qualities.
        q: (7,) joints.
        best: (7,) the best joints.
        pose: (12,) a hand.
        counts: (4,) int64 what a search did.
    """

    work: np.ndarray
    parts: np.ndarray
    q: np.ndarray
    best: np.ndarray
    pose: np.ndarray
    counts: np.ndarray


@njit(**FULL)
def fill_hands(turn, tools, grasps, mirror, grip, n_side, n_roll, frames, hands):
    """Fill the tables of hands for a person who has turned.

    Args:
        turn: (3, 3) from the robot's base into the canonical shoulder frame.
        tools: (r, 9) rotation of the tool at each rotation cell.
        grasps: (g, 12) T_tool_hand.
        mirror: -1 for a left arm, 1 for a right one: the second axis of the hand.
        grip: Wrist to grip [m].
        n_side: Of the rotation grid of the person's map.
        n_roll: Of the same.
        frames: Its pixel frames.
        hands: Written.
    """
    tool, near = np.empty((3, 3)), np.empty(9)
    hands.far[:] = 0.0
    for r in range(tools.shape[0]):
        for i in range(3):
            for j in range(3):
                tool[i, j] = (
                    turn[i, 0] * tools[r, j]
                    + turn[i, 1] * tools[r, 3 + j]
                    + turn[i, 2] * tools[r, 6 + j]
                )
        for g in range(grasps.shape[0]):
            row, hand = grasps[g], hands.pose[r, g]
            for i in range(3):
                for j in range(3):
                    hand[3 * i + j] = (
                        tool[i, 0] * row[j]
                        + tool[i, 1] * row[3 + j]
                        + tool[i, 2] * row[6 + j]
                    )
                hand[3 * i + 1] *= mirror
                hand[9 + i] = (
                    tool[i, 0] * row[9] + tool[i, 1] * row[10] + tool[i, 2] * row[11]
                )
                hands.wrist[r, g, i] = hand[9 + i] - grip * hand[3 * i + 2]
            for j in range(3):
                a, b, c = hand[j], hand[3 + j], hand[6 + j]
                near[j] = a + NUDGE[1] * c - NUDGE[2] * b
                near[3 + j] = b + NUDGE[2] * a - NUDGE[0] * c
                near[6 + j] = c + NUDGE[0] * b - NUDGE[1] * a
            hands.cell[r, g] = rotation_cell(near, n_side, n_roll, frames)
            w = hands.wrist[r, g]
            wrist = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
            there = hand[9] * hand[9] + hand[10] * hand[10] + hand[11] * hand[11]
            hands.far[0] = max(hands.far[0], wrist)
            hands.far[1] = max(hands.far[1], there)
    for i in range(2):
        hands.far[i] = np.sqrt(hands.far[i]) + TINY_M


@njit(**WITHIN)
def position_of(box, x, y, z):
    """Return the position cell of a grip in the person's reach map, -1 outside."""
    i = int(np.floor((x - box[0]) * box[7]))
    j = int(np.floor((y - box[1]) * box[7]))
    k = int(np.floor((z - box[2]) * box[7]))
    nx, ny, nz = int(box[4]), int(box[5]), int(box[6])
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return -1
    return (i * ny + j) * nz + k


@njit(**WITHIN)
def dexterity_at(person, hands, r, g, x, y, z):
    """Return the dexterity of a hand in rotation r of grasp g at x, y, z."""
    at = position_of(person.box, x, y, z)
    if at < 0:
        return 0.0
    return person.dexterity[at, hands.cell[r, g]] / 255.0


@njit(**WITHIN)
def hand_value(person, hands, r, g, x, y, z, floor, room):
    """Return q_total, to the GRAIN, of grasp g with the tool at x, y, z, rotation r.

    UNREACHED where no joints reach it, BELOW where it is below `floor`; else the
    joints are in room.best.
    """
    wx = x + hands.wrist[r, g, 0]
    wy = y + hands.wrist[r, g, 1]
    wz = z + hands.wrist[r, g, 2]
    square = wx * wx + wy * wy + wz * wz
    low, high = person.scales[2], person.scales[3]
    if square < low * low or square > high * high:
        return UNREACHED
    pose = room.pose
    for i in range(9):
        pose[i] = hands.pose[r, g, i]
    hand_y = wx * pose[1] + wy * pose[4] + wz * pose[7]
    hand_z = wx * pose[2] + wy * pose[5] + wz * pose[8]
    if not wrist_allows(person.state, hand_y, hand_z, square):
        return UNREACHED
    pose[9] = x + hands.pose[r, g, 9]
    pose[10] = y + hands.pose[r, g, 10]
    pose[11] = z + hands.pose[r, g, 11]
    dexterity = dexterity_at(person, hands, r, g, pose[9], pose[10], pose[11])
    found = pose_value(
        person.state,
        person.rods,
        person.settings,
        person.scales[0],
        dexterity,
        person.scales[1],
        floor,
        least_effort(person.state, pose[2], pose[5], pose[8], wx, wy, wz, square),
        pose,
        room.work,
        room.parts,
        room.q,
        room.best,
    )
    return math.floor(found / GRAIN + 0.5) * GRAIN if found >= 0.0 else found


@njit(**BARE)
def full_grid(person, hands, cells, room, value, grasp):
    """Write the quality of every entry to value (n,), the grasp it has to grasp (n,).

    UNREACHED and -1 where no grasp can be taken.
    """
    value[:] = UNREACHED
    grasp[:] = -1
    wrist, n_grasps = hands.wrist, hands.wrist.shape[1]
    points, first, rotation = cells.points, cells.first, cells.rotation
    low, high = person.scales[2] ** 2, person.scales[3] ** 2
    far = (person.scales[3] + hands.far[0]) ** 2
    for p in range(points.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        if x * x + y * y + z * z > far:
            continue
        for e in range(first[p], first[p + 1]):
            r = rotation[e]
            best = UNREACHED
            for g in range(n_grasps):
                wx, wy, wz = x + wrist[r, g, 0], y + wrist[r, g, 1], z + wrist[r, g, 2]
                square = wx * wx + wy * wy + wz * wz
                if square < low or square > high:
                    continue
                found = hand_value(person, hands, r, g, x, y, z, best, room)
                if found > best:
                    best = found
                    value[e], grasp[e] = found, g


@njit(**BARE)
def describe(person, hands, cells, entries, grasps, room, joints, parts, numbers):
    """Solve entries once more and write what a user wants to know of them.

    Args:
        person: The person.
        hands: Hands by rotation and grasp.
        cells: The robot's cells.
        entries: (n,) entries.
        grasps: (n,) the grasp of each.
        room: To work in.
        joints: (n, 7) written.
        parts: (n, 5) written.
        numbers: (n, 3) written: q_total, q_online, dexterity.
    """
    for i in range(entries.shape[0]):
        e, g = entries[i], grasps[i]
        p = np.searchsorted(cells.first, e, side="right") - 1
        r = cells.rotation[e]
        x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
        numbers[i, 0] = hand_value(person, hands, r, g, x, y, z, UNREACHED, room)
        for j in range(7):
            joints[i, j] = room.best[j]
        state, rods, settings = person.state, person.rods, person.settings
        numbers[i, 1] = quality_of(state, rods, settings, room.best, parts[i])
        px, py = x + hands.pose[r, g, 9], y + hands.pose[r, g, 10]
        pz = z + hands.pose[r, g, 11]
        numbers[i, 2] = dexterity_at(person, hands, r, g, px, py, pz)


@njit(**BARE)
def best_grasps(person, hands, cells, entries, room, value, grasp):
    """Write the best quality and grasp of entries (n,); UNREACHED and -1: none."""
    for i in range(entries.shape[0]):
        e = entries[i]
        value[i], grasp[i] = UNREACHED, -1
        p = np.searchsorted(cells.first, e, side="right") - 1
        x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
        for g in range(hands.wrist.shape[1]):
            r = cells.rotation[e]
            found = hand_value(person, hands, r, g, x, y, z, UNREACHED, room)
            if found > value[i]:
                value[i], grasp[i] = found, g
