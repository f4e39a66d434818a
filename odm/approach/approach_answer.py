"""What an approach is asked with, and what comes back."""

from dataclasses import dataclass

import numpy as np

from roadmap.ranges import CheckedSettings, setting


@dataclass(frozen=True)
class ApproachSettings(CheckedSettings):
    """Settings of the search for an approach.

    Attributes:
        step_m: Length of a leg, measured at the tool [m]; halved where needed.
        max_deviation_m: Largest distance of the tool from the line [m].
        max_deviation_rad: Largest angle of the tool from its pose on the line [rad].
        ik_starts: Starts of the inverse kinematics in a round.
        rounds: Rounds at most; the next one only when no solution was proved.
        max_tests: Motions that are tested at most.
        use_fine_cover: Let a finer cover of the tool's links decide where the map's
            says no.
            Braking tests and `is_free` of the planner go on with the map's cover.
        same: Solutions nearer than this in all joints count as one [rad or m].
        class_m: Clearances within this are equal: the better posture goes first [m].
        ample_m: More clearance than this is no better [m].
    """

    step_m: float = setting(0.03, 1e-4, 1.0, "m")
    max_deviation_m: float = setting(0.001, 1e-6, 0.1, "m")
    max_deviation_rad: float = setting(0.01, 1e-6, 1.0, "rad")
    ik_starts: int = setting(8, 1, 10_000)
    rounds: int = setting(4, 1, 1000)
    max_tests: int = setting(200, 1, 1_000_000)
    use_fine_cover: bool = True
    same: float = setting(0.1, 0.0, 10.0, "rad or m")
    class_m: float = setting(0.01, 1e-4, 1.0, "m")
    ample_m: float = setting(0.06, 0.0, 1.0, "m")


@dataclass(frozen=True)
class Obstruction:
    """What blocks a leg.

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
        return self.reason is None

    @property
    def q_pre(self) -> np.ndarray | None:
        """(dof,) where the approach begins: a goal for `planner.set_goals`."""
        return self.path[0].copy() if len(self.path) else None

    @property
    def q_end(self) -> np.ndarray | None:
        """(dof,) where it ends: the tool is at the pose."""
        return self.path[-1].copy() if len(self.path) else None
