"""What an approach is asked with, and what comes back."""

from dataclasses import dataclass

import numpy as np

from roadmap.ranges import check_settings


@dataclass(frozen=True)
class ApproachSettings:
    """What a user may turn.

    Attributes:
        step_m: Legs start with this length of the tool's way [m]; halved where needed.
        line_m, line_rad: Largest deviation of the tool from the line [m], [rad].
        seeds: Descents that look for solutions of the pose, in rounds.
        rounds: Rounds at most; the next one only when no solution was proved.
        motions: Motions that are tested at most.
        fine: Let a finer cover of the tool's links decide where the map's says no.
            Braking tests and `is_free` of the planner go on with the map's cover.
    """

    step_m: float = 0.03
    line_m: float = 0.001
    line_rad: float = 0.01
    seeds: int = 8
    rounds: int = 4
    motions: int = 200
    fine: bool = True

    def __post_init__(self) -> None:
        """Check every number.

        Raises:
            BadInput: One out of range.
        """
        ranges = {
            "step_m": (1e-4, 1.0, "m"),
            "line_m": (1e-6, 0.1, "m"),
            "line_rad": (1e-6, 1.0, "rad"),
            "seeds": (1, 10_000, ""),
            "rounds": (1, 1000, ""),
            "motions": (1, 1_000_000, ""),
        }
        check_settings(self, ranges, ("seeds", "rounds", "motions"))


@dataclass(frozen=True)
class Obstruction:
    """What is in the way of a leg.

    Attributes:
        leg: Number of the leg, counted from the start of the approach; -1 where the
            start itself is not free.
        legs: Number of legs.
        failed: "limits", "self-collision", "scenery" or "frame".
        link: Link of the arm, None where that is not known.
        point: Index of the frame's point, -1 where it is none.
        missing_m: How much farther away the point should be [m].
    """

    leg: int
    legs: int
    failed: str
    link: str | None = None
    point: int = -1
    missing_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Approach:
    """A proved straight tool motion, or why there is none.

    Attributes:
        path: (k, dof) corners from the pre-pose to the pose [rad or m]; (0, dof)
            where none was proved. Backwards it is proved, too.
        error_m, error_rad: Largest deviation of the tool from the straight line [m],
            [rad]: a bound over the whole motion, not a sample.
        reason: One sentence where none was proved: what blocks, and what would help.
        blocker: The same as data; None where no leg was blocked.
        fine: True where a leg needed the finer cover; the planner's own `is_free`,
            which uses the map's cover, refuses such a leg.
        descents, motions: Counted work: descents of inverse kinematics, motions tested.
    """

    path: np.ndarray
    error_m: float = 0.0
    error_rad: float = 0.0
    reason: str | None = None
    blocker: Obstruction | None = None
    fine: bool = False
    descents: int = 0
    motions: int = 0

    def __bool__(self) -> bool:
        """Return True where a motion was proved."""
        return self.reason is None

    @property
    def q_pre(self) -> np.ndarray | None:
        """(dof,) where the approach begins: a goal for `planner.set_goals`."""
        return self.path[0].copy() if len(self.path) else None

    @property
    def q_end(self) -> np.ndarray | None:
        """(dof,) where it ends: the tool is at the pose."""
        return self.path[-1].copy() if len(self.path) else None
