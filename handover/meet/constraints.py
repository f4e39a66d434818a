"""What a task asks of the handed object's pose, as plain data: upright, above, inside.

A constraint is anything with `allows(T_world_object, obj)` that takes poses (n, 4, 4)
and returns (n,) bool, so that thousands are judged in one call.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from handover.meet.held_object import HeldObject
from odm.obstacles.scenery import BOX, PLANE, Scenery
from odm.obstacles.shapes import Box
from odm.planner.planner import ReactivePlanner
from roadmap.arrays import as_floats, freeze, frozen
from roadmap.errors import BadInput
from roadmap.geometry.gaps import meet_box, moved_rods
from roadmap.ranges import check_kind, check_number, is_between, told
from roadmap.transforms import check_pose, inverse_pose


class Constraint(Protocol):
    """A predicate on where the object is."""

    def allows(self, T_world_object: np.ndarray, obj: HeldObject) -> np.ndarray:
        """Return (n,) bool: which of the poses (n, 4, 4) [m] the task allows."""


@dataclass(frozen=True, eq=False)
class Upright:
    """An axis of the object stays near a direction of the world: a full cup, a tray.

    Attributes:
        tilt: Largest angle between the two [rad], above 0 and at most pi.
        axis: (3,) of the object; its z axis by default.
        up: (3,) of the world; its z axis by default.
    """

    tilt: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not is_between(self.tilt, 0.0, np.pi) or self.tilt == 0.0:
            raise BadInput(
                f"a tilt of {told(self.tilt)} rad is none; give more than 0 and at "
                "most pi"
            )
        for name in ("axis", "up"):
            axis = _numbers(getattr(self, name), name)
            length = float(np.linalg.norm(axis))
            if length < 1e-9:
                raise BadInput(f"{name} of a constraint is zero; give a direction")
            object.__setattr__(self, name, frozen(axis / length, np.float64))

    def allows(self, T_world_object: np.ndarray, obj: HeldObject) -> np.ndarray:  # noqa: ARG002
        """Return which poses keep the axis within `tilt` of `up`."""
        cosines = T_world_object[:, :3, :3] @ self.axis @ self.up
        return cosines >= np.cos(self.tilt) - 1e-12


@dataclass(frozen=True)
class Above:
    """The whole object stays above a level: a table, the floor.

    Attributes:
        height_m: World height [m] that the object's lowest point does not pass.
    """

    height_m: float

    def __post_init__(self) -> None:
        check_number("the height of Above in m", self.height_m, -100.0, 100.0)

    def allows(self, T_world_object: np.ndarray, obj: HeldObject) -> np.ndarray:
        """Return which poses keep every capsule above the level."""
        row, z = T_world_object[:, 2, :3], T_world_object[:, 2, 3]
        lowest = np.full(len(T_world_object), np.inf)
        for rod in obj.capsules:
            ends = np.minimum(row @ rod[:3], row @ rod[3:6])
            lowest = np.minimum(lowest, ends + z - rod[6])
        return lowest >= self.height_m - 1e-12


@dataclass(frozen=True, eq=False)
class Inside:
    """The object's origin stays in a box of the world, or (outside) out of it.

    Attributes:
        lower: (3,) corner [m]; -inf leaves a side open.
        upper: (3,) opposite corner [m]; inf leaves a side open.
        outside: Whether the box is forbidden instead.
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    outside: bool = False

    def __post_init__(self) -> None:
        check_kind("outside", self.outside, (bool, np.bool_), "give True or False")
        lower, upper = (as_floats("corners", x) for x in (self.lower, self.upper))
        fit = lower.shape == upper.shape == (3,)
        if not (fit and (lower < upper).all()):
            raise BadInput(
                f"a box from {lower.tolist()} to {upper.tolist()} is none; give two "
                "corners (3,), the lower one first"
            )
        freeze(self, lower=float, upper=float)

    def allows(self, T_world_object: np.ndarray, obj: HeldObject) -> np.ndarray:  # noqa: ARG002
        """Return which poses have the origin in the box, or out of it."""
        p = T_world_object[:, :3, 3]
        inside = ((p >= self.lower) & (p <= self.upper)).all(axis=1)
        return ~inside if self.outside else inside


@dataclass(frozen=True, eq=False)
class ClearOf:
    """Nothing is handed over in or through what stands still: ground, table, wall.

    Half-spaces and boxes count for the object, boxes for the arm that takes it: who
    stands beside a table has its half-space about their legs. What else is in the
    robot's way the planner finds out, place by place. Where a planner ranks or chooses
    (`LiveTargets`, `find_handover`), the boxes of its `scene` count, too, as they stand
    by then.

    Attributes:
        scenery: Base frame, as `odm.CellMap.scenery`.
        T_world_base: (4, 4) where the base is [m], as `MeetSettings.T_world_base`.
    """

    scenery: Scenery
    T_world_base: np.ndarray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        check_kind("scenery", self.scenery, Scenery, "give odm.CellMap.scenery")
        T = frozen(check_pose(self.T_world_base, "T_world_base"), np.float64)
        object.__setattr__(self, "T_world_base", T)

    @classmethod
    def of_scene(cls, planner: ReactivePlanner, T_world_base: np.ndarray) -> "ClearOf":
        """Return the same of the boxes in a planner's `scene`, where they stand now."""
        T = inverse_pose(planner.world.T_world_base)
        boxes = [
            (name, shape.moved(T))
            for name, shape in planner.scene.shapes()
            if isinstance(shape, Box)
        ]
        return cls(Scenery.of_boxes(boxes), T_world_base)

    def allows(self, T_world_object: np.ndarray, obj: HeldObject) -> np.ndarray:
        """Return which poses keep every capsule out of all of it."""
        T = inverse_pose(self.T_world_base) @ T_world_object
        clear = np.ones(len(T), bool)
        for rod in obj.capsules:
            rods = np.empty((len(T), 7))
            rods[:, 6] = rod[6]
            for at in (slice(0, 3), slice(3, 6)):
                ends = rods[:, at] = T[:, :3, :3] @ rod[at] + T[:, :3, 3]
                for row in self._solids(PLANE):
                    clear &= ends @ row[1:4] > row[4] + rod[6]
            clear &= ~self._in_boxes(rods)
        return clear

    def allows_arms(self, rods: np.ndarray) -> np.ndarray:
        """Return (n,) bool: which arms, capsules (n, k, 7) in the world [m], are clear.

        An arm is in a box where the axis of a capsule passes through it: one that rests
        on the edge of a table touches it, and may.
        """
        here = moved_rods(rods.reshape(-1, 7), inverse_pose(self.T_world_base))
        here[:, 6] = 0.0
        return ~self._in_boxes(here).reshape(rods.shape[:2]).any(axis=1)

    def _in_boxes(self, rods: np.ndarray) -> np.ndarray:
        """Return which capsules (n, 7), base frame [m], meet a box."""
        meets = np.zeros(len(rods), bool)
        for row in self._solids(BOX):
            meets |= meet_box(rods, row[1:4], row[4:13].reshape(3, 3), row[13:16])
        return meets

    def _solids(self, kind: float) -> np.ndarray:
        solids = self.scenery.solids
        return solids[solids[:, 0] == kind]


def allowed(
    constraints: tuple[Constraint, ...], T_world_object: np.ndarray, obj: HeldObject
) -> np.ndarray:
    """Return (n,) bool: which poses (n, 4, 4) every constraint allows."""
    keep = np.ones(len(T_world_object), bool)
    for constraint in constraints:
        answer = np.asarray(constraint.allows(T_world_object, obj))
        if answer.shape != keep.shape or answer.dtype != bool:
            raise BadInput(
                f"the constraint {constraint!r} answers {answer.dtype} of shape "
                f"{answer.shape} to {len(keep)} poses; it must return ({len(keep)},) "
                "bool"
            )
        keep &= answer
    return keep


def _numbers(values: tuple, name: str) -> np.ndarray:
    values = as_floats(name, values)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise BadInput(f"{name} is {values.tolist()}; give three finite numbers")
    return values
