"""MeetSettings: on which grid to look for a hand-over, and what is asked of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from handover.human.human_arm import check_side
from handover.meet.constraints import Constraint
from handover.meet.quality import QualitySettings
from handover.reach.rotations import SIZES
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.transforms import check_pose


@dataclass(frozen=True, eq=False)
class MeetSettings:
    """Where, how finely and for what to look.

    Attributes:
        side: The person's arm, "right" or "left".
        T_world_base: (4, 4) pose of the robot's base [m]; None: it is the world's.
        cell: Side of a position cell [m]; not finer than the reach map's.
        rotations: Rotation cells: 72 (60 deg apart), 576 (30 deg)...; not more than
            the reach map has.
        marked_share: A cell of this grid holds many of the reach map's. It counts as
            reachable when more than this share of them is marked. 0: any of them, as
            in a map built on the coarse grid itself, like the paper's; 0.5: most, so
            that the robot fails less often at the centre.
        quality: What is comfortable, `online_weight` too.
        swivel_step: Largest swivel between the representatives of one hand pose [rad].
            30 degrees: the best of those was 0.0004 below that of 5 degrees in the
            mean, 0.015 at most.
        constraints: Predicates on T_world_object, see `handover.meet.constraints`.
        obstacles: (k, 7) capsules of the surroundings, world frame [m], for the
            person's safety; None: none.
    """

    side: str = "right"
    T_world_base: np.ndarray | None = None
    cell: float = 0.15
    rotations: int = 72
    marked_share: float = 0.0
    quality: QualitySettings = field(default_factory=QualitySettings)
    swivel_step: float = math.radians(30.0)
    constraints: Sequence[Constraint] = ()
    obstacles: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Refuse what is no setting."""
        check_side(self.side)
        T = np.eye(4) if self.T_world_base is None else self.T_world_base
        T = frozen(check_pose(T, "T_world_base"), np.float64)
        object.__setattr__(self, "T_world_base", T)
        if not 0.01 <= self.cell <= 1.0:
            raise BadInput(
                f"a cell of {self.cell} m is none to meet in; give 0.01 to 1 m, like "
                "0.15 or 0.1"
            )
        if self.rotations not in SIZES:
            known = ", ".join(map(str, SIZES))
            raise BadInput(
                f"no grid has {self.rotations} rotations; choose one of {known}"
            )
        if not 0 <= self.marked_share < 1:
            raise BadInput(
                f"marked_share is {self.marked_share}; give a share from 0 (any cell) "
                "to below 1"
            )
        if not math.radians(1.0) <= self.swivel_step <= math.pi:
            raise BadInput(
                f"a swivel step of {self.swivel_step} rad is none; give 0.018 to pi"
            )
        object.__setattr__(self, "constraints", tuple(self.constraints))
        for c in self.constraints:
            if not callable(getattr(c, "allows", None)):
                raise BadInput(
                    f"{c!r} is no constraint; give objects with "
                    "allows(T_world_object, obj), like Upright, Above, Inside"
                )
