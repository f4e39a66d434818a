"""The interaction workspace [Vahrenkamp2016, Algorithm 1] over cells of a robot.

Everything is in the person's canonical shoulder frame. Three tuples hold what does not
change from cell to cell: who (the person now), how (hands by rotation and grasp), and
where (the robot's cells).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from handover._kernels.meet_pose import UNREACHED, pose_value
from handover._kernels.rotations import rotation_cell

TINY_M = 1e-9


class Person(NamedTuple):
    """The person at one moment.

    Attributes:
        state: (68,) and settings (19,): see `handover/_kernels/quality.py`.
        rods: (m, 7) own body and surroundings [m].
        settings: (19,).
        dexterity: (n_positions, n_rotations) uint8 of the person's reach map.
        box: (8,) of that map: lower corner, cell [m], numbers of cells, its roll bins.
        scales: (4,) share of q_online, swivel step, least and largest distance of the
            wrist [m].
    """

    state: np.ndarray
    rods: np.ndarray
    settings: np.ndarray
    dexterity: np.ndarray
    box: np.ndarray
    scales: np.ndarray


class Hands(NamedTuple):
    """Hands by rotation cell of the robot and grasp.

    Attributes:
        pose: (r, g, 12) rotation, and offset of the grip from the tool [m].
        wrist: (r, g, 3) offset of the wrist from the tool [m].
        cell: (r, g) rotation cell in the person's reach map.
    """

    pose: np.ndarray
    wrist: np.ndarray
    cell: np.ndarray


class Cells(NamedTuple):
    """The robot's cells.

    Attributes:
        points: (p, 3) centres of the position cells [m].
        first: (p + 1,) first entry of each.
        rotation: (n,) rotation cell of each entry.
        removed: (n,) whether an entry is out.
    """

    points: np.ndarray
    first: np.ndarray
    rotation: np.ndarray
    removed: np.ndarray


class Room(NamedTuple):
    """Room to work in: work (78, 3), parts (5,), q (7,), best (7,), pose (12,)."""

    work: np.ndarray
    parts: np.ndarray
    q: np.ndarray
    best: np.ndarray
    pose: np.ndarray


@njit(cache=True, nogil=True)
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
    tool = np.empty((3, 3))
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
            hands.cell[r, g] = rotation_cell(hand, n_side, n_roll, frames)


@njit(cache=True, nogil=True)
def position_of(box, x, y, z):
    """Return the position cell of a grip in the person's reach map, -1 outside."""
    i = int(np.floor((x - box[0]) / box[3]))
    j = int(np.floor((y - box[1]) / box[3]))
    k = int(np.floor((z - box[2]) / box[3]))
    nx, ny, nz = int(box[4]), int(box[5]), int(box[6])
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return -1
    return (i * ny + j) * nz + k


@njit(cache=True, nogil=True)
def hand_value(person, hands, r, g, x, y, z, room):
    """Return q_total of grasp g with the tool at x, y, z in rotation r.

    UNREACHED where no joints reach it; else the joints are in room.best.
    """
    wrist = hands.wrist[r, g]
    wx, wy, wz = x + wrist[0], y + wrist[1], z + wrist[2]
    square = wx * wx + wy * wy + wz * wz
    low, high = person.scales[2], person.scales[3]
    if square < low * low or square > high * high:
        return UNREACHED
    pose, hand = room.pose, hands.pose[r, g]
    for i in range(9):
        pose[i] = hand[i]
    pose[9], pose[10], pose[11] = x + hand[9], y + hand[10], z + hand[11]
    at = position_of(person.box, pose[9], pose[10], pose[11])
    dexterity = 0.0
    if at >= 0:
        dexterity = person.dexterity[at, hands.cell[r, g]] / 255.0
    return pose_value(
        person.state,
        person.rods,
        person.settings,
        person.scales[0],
        dexterity,
        person.scales[1],
        pose,
        room.work,
        room.parts,
        room.q,
        room.best,
    )


@njit(cache=True, nogil=True)
def full_grid(person, hands, cells, room, value, grasp):
    """Write the quality of every entry to value (n,), the grasp it has to grasp (n,).

    UNREACHED and -1 where no grasp can be taken.
    """
    for p in range(cells.points.shape[0]):
        x, y, z = cells.points[p]
        for e in range(cells.first[p], cells.first[p + 1]):
            value[e], grasp[e] = UNREACHED, -1
            if cells.removed[e]:
                continue
            r = cells.rotation[e]
            for g in range(hands.wrist.shape[1]):
                found = hand_value(person, hands, r, g, x, y, z, room)
                if found > value[e]:
                    value[e], grasp[e] = found, g
