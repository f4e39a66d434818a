"""HeldObject: what is handed over, how the robot holds it, how a hand may take it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadmap.arrays import as_floats, brief, frozen
from roadmap.errors import BadInput
from roadmap.ranges import check_kind, check_number, is_between, told
from roadmap.transforms import check_pose, pose_with, rotation_rpy

# [rad] order of the rolls about a handle: the first four are the quarters, so that the
# first 4 or 8 grasps of a tool are spread as well as all of them
_ROLLS = tuple(np.radians((0.0, 90.0, 180.0, 270.0, 45.0, 135.0, 225.0, 315.0)))


@dataclass(frozen=True, eq=False)
class HeldObject:
    """An object in the robot's hand.

    Attributes:
        name: What people call it.
        capsules: (k, 7) its shape: a, b, radius in the object's frame [m].
        mass_kg: Its mass.
        T_tool_object: (4, 4) how the robot holds it, g_robot of [Vahrenkamp2016] [m].
        hand_grasps: (n, 4, 4) T_object_hand of the hands that could take it,
            G_human of [Vahrenkamp2016]; `docs/human.md` describes the hand's frame.
        turns: In how many turns about the tool's z, evenly over a whole one, the robot
            may hold it: 4 quarters of a slim tool, 2 or 1 of what fits one way only.
    """

    name: str
    capsules: np.ndarray
    mass_kg: float
    T_tool_object: np.ndarray
    hand_grasps: np.ndarray
    turns: int = 4

    __repr__ = brief

    def __post_init__(self) -> None:
        check_kind("name", self.name, str, "give the object's name as text")
        capsules = as_floats(f"capsules of {self.name}", self.capsules)
        if capsules.ndim != 2 or capsules.shape[1] != 7 or not len(capsules):
            raise BadInput(
                f"capsules of {self.name} have shape {capsules.shape}; give (k, 7): "
                "a, b, radius, at least one"
            )
        if not np.isfinite(capsules).all() or (capsules[:, 6] <= 0).any():
            raise BadInput(
                f"capsules of {self.name} hold NaN, infinity or a radius of 0 or less; "
                "give metres"
            )
        if not (is_between(self.mass_kg, 0.0, 100.0) and 0.0 < self.mass_kg < 100.0):
            raise BadInput(
                f"{self.name} has a mass of {self.mass_kg} kg; give more than 0 and "
                "less than 100"
            )
        check_number("turns", self.turns, 1, 4, True, "HeldObject")
        put = object.__setattr__
        put(self, "capsules", frozen(capsules, np.float64))
        T = check_pose(self.T_tool_object, "T_tool_object")
        put(self, "T_tool_object", frozen(T, np.float64))
        put(self, "hand_grasps", checked_grasps(self.hand_grasps))

    def held_by(self, T_tool_object: np.ndarray) -> "HeldObject":
        """Return the object in another grasp of the robot, (4, 4) [m]."""
        return replace(self, T_tool_object=T_tool_object)


def checked_grasps(grasps: Sequence | np.ndarray) -> np.ndarray:
    """Return grasps T_object_hand as (n, 4, 4), rigid, at least one, read-only."""
    grasps = as_floats("grasps", grasps)
    if grasps.size == 0:
        raise BadInput(
            "there is no human grasp; give at least one T_object_hand, or leave "
            "grasps out for all those of the object"
        )
    if grasps.ndim != 3 or grasps.shape[1:] != (4, 4):
        raise BadInput(
            f"grasps have shape {grasps.shape}; give (n, 4, 4) T_object_hand"
        )
    for k, T in enumerate(grasps):
        check_pose(T, f"grasp {k}, T_object_hand,")
    return frozen(grasps, np.float64)


def fist_grasps(places: Sequence[float]) -> np.ndarray:
    """Return power grasps of a round handle along the object's x axis.

    A closed hand holds a handle along its own y axis, in its grip. It may be turned
    about the handle, and the thumb may point either way along it.

    Args:
        places: Where along x [m]; all grasps at the first come before the next.

    Returns:
        (16 * places, 4, 4) T_object_hand; four turns with the thumb towards
        +x, the same with it towards -x, then the turns between.

    Raises:
        BadInput: No list of finite numbers.
    """
    places = as_floats("places", places)
    if places.ndim != 1 or not np.isfinite(places).all():
        raise BadInput(
            f"places of fists are {told(places.tolist())}; give a list of finite "
            "numbers in m, such as [0.05]"
        )
    grasps = []
    for place in places.tolist():
        for first in (0, 4):
            for thumb in (1.0, -1.0):
                for roll in _ROLLS[first : first + 4]:
                    grasps.append(_fist(place, thumb, roll))
    return np.array(grasps)


def _fist(place: float, thumb: float, roll: float) -> np.ndarray:
    y = np.array([thumb, 0.0, 0.0])
    x = rotation_rpy(roll, 0.0, 0.0) @ [0.0, 0.0, -1.0]  # out of the palm
    return pose_with(np.column_stack([x, y, np.cross(x, y)]), (place, 0.0, 0.0))


def wrench() -> HeldObject:
    """Return an open-ended wrench of 25 cm, held by one jaw, to be taken by the handle.

    Object frame: x along the handle away from the robot's hand, z normal to the flat
    side, the origin in the middle. The tool frame of the robot has z out of its palm;
    the wrench points out of the hand, to the tool's z, its flat side along x of the
    tool. 16 grasps: fists 5 cm beyond the middle, eight turns, the thumb either way.
    """
    capsules = [
        [-0.09, 0.0, 0.0, 0.09, 0.0, 0.0, 0.011],
        [-0.11, -0.016, 0.0, -0.11, 0.016, 0.0, 0.013],
        [0.11, -0.013, 0.0, 0.11, 0.013, 0.0, 0.012],
    ]
    R = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    T = pose_with(R, (0.0, 0.0, 0.10))
    return HeldObject("wrench", capsules, 0.25, T, fist_grasps([0.05]))


def mallet() -> HeldObject:
    """Return a mallet of 32 cm, held at the head, to be taken by the handle.

    Object frame: x along the handle from the head to its end, z along the head's
    axis, the origin in the head's middle. The robot holds the head across its palm; the
    handle points to the tool's x. 16 grasps: fists 22 cm from the head.
    """
    capsules = [
        [0.0, 0.0, 0.0, 0.30, 0.0, 0.0, 0.014],
        [0.0, 0.0, -0.03, 0.0, 0.0, 0.03, 0.035],
    ]
    return HeldObject("mallet", capsules, 0.6, np.eye(4), fist_grasps([0.22]))
