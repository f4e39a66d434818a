"""The interaction workspace [Vahrenkamp2016, Algorithm 1] over cells of a robot.

Everything is in the person's canonical shoulder frame. A `Scene` holds what does not
change from cell to cell: the person now, the hands by rotation and grasp, and the
robot's cells. A `Candidate` is one hand on the tool at one place.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from handover.meet._meet_pose import UNREACHED, least_effort, pose_value, wrist_allows
from handover.meet._quality import quality_of
from handover.reach._rotations import rotation_cell
from roadmap.compiling.jit_options import BARE, FULL, WITHIN, WITHIN_INNER

TINY_M = 1e-9
# Qualities are rounded to this. A tool turned by half a turn often offers the same hand
# pose, so equals are common: the key, not the last digit, tells which comes first.
GRAIN = 1e-9
# [rad] A hand is looked up in the person's map turned by this. Person and robot stand
# upright, so hands point straight up often, where cells meet: without it rounding would
# choose among them, another one each frame.
NUDGE = (0.36e-4, 0.48e-4, 0.8e-4)


class Person(NamedTuple):
    """The person at one moment."""

    state: np.ndarray  # (68,) see `handover/meet/_quality.py`; so the settings
    rods: np.ndarray  # (m, 7) own body and surroundings [m]
    settings: np.ndarray  # (19,)
    dexterity: np.ndarray  # (n_positions, n_rotations) uint8 of the person's reach map
    # (9,) of that map: lower corner, cell [m], numbers of cells, 1 / cell, and by how
    # many cells `most` is larger on every side
    box: np.ndarray
    ceiling: np.ndarray  # (n_positions,) uint8: the largest dexterity of each position
    # (nx, ny, nz) uint8: the largest dexterity near a position of the tool
    most: np.ndarray
    # (4,) share of q_online, swivel step, least and largest distance of the wrist [m]
    scales: np.ndarray


class Hands(NamedTuple):
    """Hands by rotation cell of the robot and grasp."""

    pose: np.ndarray  # (r, g, 12) rotation, and offset of the grip from the tool [m]
    wrist: np.ndarray  # (r, g, 3) offset of the wrist from the tool [m]
    cell: np.ndarray  # (r, g) rotation cell in the person's reach map
    far: np.ndarray  # (2,) largest distance of a wrist and of a grip from the tool [m]
    same: np.ndarray  # (g,) whether a grasp has its grip where the one before it has


class Cells(NamedTuple):
    """The robot's cells."""

    points: np.ndarray  # (p, 3) centres of the position cells [m]
    first: np.ndarray  # (p + 1,) first entry of each
    rotation: np.ndarray  # (n,) rotation cell of each entry


class Scene(NamedTuple):
    """Person, hands and cells of one frame."""

    person: Person
    hands: Hands
    cells: Cells


class Candidate(NamedTuple):
    """One hand on the tool at one place."""

    rotation: int  # rotation cell of the tool
    grasp: int  # number of the grasp
    x: float  # place of the tool [m], as are the next two
    y: float
    z: float


class Described(NamedTuple):
    """What a user wants to know of n entries."""

    joints: np.ndarray  # (n, 7) of the person's arm [rad]
    parts: np.ndarray  # (n, 5) qualities
    numbers: np.ndarray  # (n, 3) q_total, q_online, dexterity


class Scratch(NamedTuple):
    """Working memory."""

    work: np.ndarray  # (78, 3) of `_arm_ik.py`
    parts: np.ndarray  # (5,) qualities
    q: np.ndarray  # (7,) joints
    best: np.ndarray  # (7,) the best joints
    pose: np.ndarray  # (12,) a hand
    counts: np.ndarray  # (4,) int64 what a search did


@njit(**FULL)
def fill_hands(turn, tools, grasps, mirror, grip, turns, hands):
    """Fill the tables of hands for a person who has turned.

    `turn` (3, 3) leads from the robot's base into the canonical shoulder frame; `tools`
    (r, 9) are the tool's rotations, `grasps` (g, 12) T_tool_hand. `mirror` is -1 for a
    left arm, 1 for a right one, `grip` wrist to grip [m], `turns` of the person's map.
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
            hands.cell[r, g] = rotation_cell(
                near, turns.n_side, turns.n_roll, turns.pixel_frames
            )
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


@njit(**WITHIN_INNER)
def wrist_of(hands, one):
    """Return the place (3) of a candidate's wrist [m], and its squared distance."""
    r, g = one.rotation, one.grasp
    wx = one.x + hands.wrist[r, g, 0]
    wy = one.y + hands.wrist[r, g, 1]
    wz = one.z + hands.wrist[r, g, 2]
    return (wx, wy, wz), wx * wx + wy * wy + wz * wz


@njit(**WITHIN_INNER)
def grip_of(hands, one):
    """Return the place (3) of a candidate's grip [m]."""
    r, g = one.rotation, one.grasp
    return (
        one.x + hands.pose[r, g, 9],
        one.y + hands.pose[r, g, 10],
        one.z + hands.pose[r, g, 11],
    )


@njit(**WITHIN_INNER)
def dexterity_at(person, hands, one, grip):
    """Return the dexterity of a candidate whose grip is at `grip` (3)."""
    at = position_of(person.box, grip[0], grip[1], grip[2])
    if at < 0:
        return 0.0
    return person.dexterity[at, hands.cell[one.rotation, one.grasp]] / 255.0


@njit(**WITHIN_INNER)
def hand_value(person, hands, one, floor, scratch):
    """Return q_total, to the GRAIN, of a candidate.

    UNREACHED where no joints reach it, BELOW where it is below `floor`; else the
    joints are in scratch.best.
    """
    wrist, square = wrist_of(hands, one)
    low, high = person.scales[2], person.scales[3]
    if square < low * low or square > high * high:
        return UNREACHED
    pose, r, g = scratch.pose, one.rotation, one.grasp
    for i in range(9):
        pose[i] = hands.pose[r, g, i]
    hand_y = wrist[0] * pose[1] + wrist[1] * pose[4] + wrist[2] * pose[7]
    hand_z = wrist[0] * pose[2] + wrist[1] * pose[5] + wrist[2] * pose[8]
    if not wrist_allows(person.state, hand_y, hand_z, square):
        return UNREACHED
    grip = grip_of(hands, one)
    pose[9], pose[10], pose[11] = grip
    dexterity = dexterity_at(person, hands, one, grip)
    fingers = pose[2], pose[5], pose[8]
    least = least_effort(person.state, fingers, wrist, square)
    found = pose_value(person, scratch, dexterity, least, floor)
    return math.floor(found / GRAIN + 0.5) * GRAIN if found >= 0.0 else found


@njit(**BARE)
def full_grid(scene, scratch, value, grasp):
    """Write the quality of every entry to value (n,), the grasp it has to grasp (n,).

    UNREACHED and -1 where no grasp can be taken.
    """
    person, hands, cells = scene
    value[:] = UNREACHED
    grasp[:] = -1
    points, first, rotation = cells.points, cells.first, cells.rotation
    low, high = person.scales[2] ** 2, person.scales[3] ** 2
    far = (person.scales[3] + hands.far[0]) ** 2
    for p in range(points.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        if x * x + y * y + z * z > far:
            continue
        for e in range(first[p], first[p + 1]):
            best = UNREACHED
            for g in range(hands.wrist.shape[1]):
                one = Candidate(rotation[e], g, x, y, z)
                _, square = wrist_of(hands, one)
                if square < low or square > high:
                    continue
                found = hand_value(person, hands, one, best, scratch)
                if found > best:
                    best = found
                    value[e], grasp[e] = found, g


@njit(**WITHIN_INNER)
def candidate_of(cells, e, g):
    """Return entry e of the cells with grasp g."""
    p = np.searchsorted(cells.first, e, side="right") - 1
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    return Candidate(cells.rotation[e], g, x, y, z)


@njit(**BARE)
def describe(scene, entries, grasps, scratch, out):
    """Solve entries (n,) once more and write what a user wants to know of them."""
    person, hands, cells = scene
    numbers = out.numbers
    state, rods, settings = person.state, person.rods, person.settings
    for i in range(entries.shape[0]):
        one = candidate_of(cells, entries[i], grasps[i])
        numbers[i, 0] = hand_value(person, hands, one, UNREACHED, scratch)
        for j in range(7):
            out.joints[i, j] = scratch.best[j]
        numbers[i, 1] = quality_of(state, rods, settings, scratch.best, out.parts[i])
        numbers[i, 2] = dexterity_at(person, hands, one, grip_of(hands, one))


@njit(**BARE)
def best_grasps(scene, entries, scratch, value, grasp):
    """Write the best quality and grasp of entries (n,); UNREACHED and -1: none."""
    person, hands, cells = scene
    for i in range(entries.shape[0]):
        value[i], grasp[i] = UNREACHED, -1
        at = candidate_of(cells, entries[i], 0)
        for g in range(hands.wrist.shape[1]):
            one = Candidate(at.rotation, g, at.x, at.y, at.z)
            found = hand_value(person, hands, one, UNREACHED, scratch)
            if found > value[i]:
                value[i], grasp[i] = found, g
