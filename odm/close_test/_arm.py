"""The moving robot and scratch of its close test, as compiled loops take them."""

from typing import NamedTuple

import numpy as np

from odm._groups import FRAME, array, new


class Arm(NamedTuple):
    """The moving robot, its spheres sorted by body."""

    tree_i: np.ndarray = array("i4", "bodies 3")
    tree_f: np.ndarray = array("f8", "bodies 17")
    spheres: np.ndarray = array("f8", "spheres 4")  # centre in body frame, radius
    body: np.ndarray = array("i4", "spheres")
    reach: np.ndarray = array("f8", "spheres bodies")
    body_ptr: np.ndarray = array("i8", "bodies+1")  # spheres of a body
    # ball round the centres of a body's spheres
    bound: np.ndarray = array("f8", "bodies 4")


class Work(NamedTuple):
    """Scratch of the close test, one per planner."""

    frames: np.ndarray = array("f8", "3 bodies 12", FRAME)
    point: np.ndarray = array("f8", "dof", FRAME)
    speed: np.ndarray = array("f8", "spheres", FRAME)
    bend: np.ndarray = array("f8", "spheres", FRAME)
    rates: np.ndarray = array("f8", "2 bodies", FRAME)
    body_speed: np.ndarray = array("f8", "bodies", FRAME)
    body_radius: np.ndarray = array("f8", "bodies", FRAME)
    body_bare: np.ndarray = array("f8", "bodies", FRAME)
    body_bend: np.ndarray = array("f8", "bodies", FRAME)
    # level at which the chord test decides, and from which it may free a body
    bottom: np.ndarray = array("i8", "bodies", FRAME)
    early: np.ndarray = array("i8", "bodies", FRAME)
    stack: np.ndarray = array("i8", "64 2", FRAME)  # level, index
    masks: np.ndarray = array("b1", "64 bodies", FRAME)  # bodies still open
    state: np.ndarray = array("i8", "bodies", FRAME)  # what solids leave of a body
    # what each sphere's centre, or its line, has between it and one shape
    gap: np.ndarray = array("f8", "spheres", FRAME)
    # centres x, y and z of a body's spheres, and squared distances from a box
    places: np.ndarray = array("f8", "4 spheres", FRAME)
    # centres at the start of an escape
    anchor: np.ndarray = array("f8", "spheres 3", FRAME)
    # sphere, point, tests, evaluations
    found: np.ndarray = array("i8", "4", FRAME)
    value: np.ndarray = array("f8", "2", FRAME)  # t and distance of what was found


class Clearance(NamedTuple):
    """What a close test works with: the robot, and the distance it must keep."""

    arm: Arm
    radii: np.ndarray  # (n,) sphere radius + covering radius + clearance [m]
    bare: np.ndarray  # (n,) sphere radius + clearance: kept from solids [m]
    tolerance: float  # no piece of a motion is inflated by more [m]
    work: Work


def make_work(arm: Arm, dof: int) -> Work:
    """Return scratch for a robot with so many moving joints."""
    sizes = {"spheres": len(arm.spheres), "bodies": len(arm.tree_i), "dof": dof}
    return new(Work, sizes)
