"""Joint values that a user gives are judged here: numbers, limits, degrees."""

import math

import numpy as np

from roadmap.errors import BadConfiguration
from roadmap.kinematics._limits import LIMIT_TOLERANCE
from roadmap.kinematics.joint_tree import PRISMATIC
from roadmap.robot.robot import Robot

TURN = 2 * math.pi
DEGREES = "this looks like degrees; give radians"


def check_values(
    robot: Robot, q: np.ndarray, what: str, *, typed: bool = False
) -> np.ndarray:
    """Return q, (dof,) or (k, dof), where all is finite and within the limits.

    Args:
        robot: Whose joints they are; continuous ones have no limits.
        q: Joint values [rad or m].
        what: What q is called in a message, as "--q" or "the path"; of many rows the
            number is named, too.
        typed: A person wrote it: then more than a turn of any joint is no radians.

    Raises:
        BadConfiguration: A value is not finite or too far outside; names joint, value
            and limits.
    """
    rows = np.atleast_2d(q)
    low = np.where(robot.continuous, -np.inf, robot.lower) - LIMIT_TOLERANCE
    high = np.where(robot.continuous, np.inf, robot.upper) + LIMIT_TOLERANCE
    if typed:
        low = np.where(robot.continuous, -TURN - LIMIT_TOLERANCE, low)
        high = np.where(robot.continuous, TURN + LIMIT_TOLERANCE, high)
    bad = ~((rows >= low) & (rows <= high) & np.isfinite(rows))
    if bad.any():
        row, j = np.argwhere(bad)[0]
        where = what if np.ndim(q) == 1 else f"corner {row} of {what}"
        raise BadConfiguration(f"{where} {_trouble(robot, int(j), rows[row, j])}")
    return q


def looks_like_degrees(value: float, prismatic: bool) -> bool:
    """Return whether a value outside its limits [rad] was meant in degrees."""
    return not prismatic and abs(value) > TURN


def slides(robot: Robot, j: int) -> bool:
    """Return whether a joint is prismatic, its values metres."""
    return bool(PRISMATIC in robot.tree_i[robot.tree_i[:, 1] == j, 2])


def _trouble(robot: Robot, j: int, value: float) -> str:
    name = robot.joint_names[j]
    if not math.isfinite(value):
        return f"has {name} = {value}, which is not finite; give real numbers"
    prismatic = slides(robot, j)
    unit = "m" if prismatic else "rad"
    low, high = robot.lower[j], robot.upper[j]
    limits = f"outside its limits {low:.6g} to {high:.6g}"
    if robot.continuous[j]:
        limits = "more than a turn"
    remedy = "give one within them"
    if looks_like_degrees(value, prismatic):
        remedy = DEGREES
    return f"has {name} = {value:.6g} {unit}, {limits}; {remedy}"
