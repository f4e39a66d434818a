"""A whole path against shapes: taken, told apart and tested in one compiled call."""

from typing import NamedTuple

import numpy as np
from numba import njit

from odm.close_test._arm import Arm, Clearance
from odm.close_test._close import first_blocked
from odm.obstacles._cloud import Cloud
from odm.obstacles._solid_samples import FINE, take_solids
from odm.obstacles._solids import Solids
from odm.search._state import view
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER, LEAN

NOTHING = -1  # no class of shapes


class Keepers(NamedTuple):
    """Spheres of a robot, and what they keep from points and from shapes [m]."""

    arm: Arm
    radii: np.ndarray  # (n,)
    bare: np.ndarray  # (n,)


class Room(NamedTuple):
    """Room for the shapes that are tested, and for numbers."""

    others: Solids  # what nothing may touch
    touched: Solids  # what some spheres may touch
    no_points: Cloud
    radii: np.ndarray  # (n,) of all spheres [m]
    bare: np.ndarray  # (n,)
    leg: np.ndarray  # (dof,)


@njit(**LEAN)
def blocked_by_shapes(state, path, extra, shapes, kinds, few, room):
    """Return the first leg of a path (k, dof) that shapes block, -1 for none.

    All spheres keep more than their distance from shapes, but from those of one class
    only some do. A shape that is wrong is anywhere: it blocks the first leg.

    Args:
        state: The planner's table.
        path: Corners; a single one is a robot at rest.
        extra: More distance, and that from shapes of that class [m]; less where
            negative.
        shapes: Their numbers, and how many of each kind; see `take_solids`.
        kinds: The class of each (k,), and the one that only `few` keep off; or NOTHING.
        few: These spheres.
        room: For so many shapes, and for all spheres.
    """
    others, patterns = room.others, view(state, "patterns")
    if take_solids(*shapes, patterns.base_world, others, patterns) != FINE:
        return 0
    robot = view(state, "robot_state")
    every = Keepers(view(state, "arm"), robot.radii, robot.bare)
    if kinds[1] == NOTHING:
        return first_leg(state, path, extra[0], every, others, room)
    part(kinds, others, room.touched)
    found = first_leg(state, path, extra[0], every, others, room)
    also = first_leg(state, path, extra[1], few, room.touched, room)
    if found < 0 or also < 0:
        return max(found, also)
    return min(found, also)


@njit(**INNER)
def first_leg(state, path, extra, keepers, solids, room):
    """Return the first leg on which some spheres do not keep off solids, or -1."""
    n = keepers.radii.shape[0]
    radii, bare = room.radii[:n], room.bare[:n]
    for i in range(n):
        radii[i] = keepers.radii[i] + extra
        bare[i] = keepers.bare[i] + extra
    tolerance, work = view(state, "terms").tolerance[0], view(state, "work")
    clearance = Clearance(keepers.arm, radii, bare, tolerance, work)
    return first_blocked(clearance, path, room.no_points, solids, room.leg)


@njit(**INNER)
def part(kinds, others, touched):
    """Move solids of one class from `others` to `touched`; see `blocked_by_shapes`."""
    n, kept = others.count[0], 0
    for k in range(n):
        chosen = kinds[0][k] == kinds[1]
        to, at = (touched, k - kept) if chosen else (others, kept)
        copy_row(others.rows[k], to.rows[at])
        to.kind[at] = others.kind[k]
        kept += 0 if chosen else 1
    others.count[0], touched.count[0] = kept, n - kept
