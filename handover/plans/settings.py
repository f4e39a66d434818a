"""How hard a hand-over is looked for; every number counts work, none counts seconds."""

from dataclasses import dataclass

from roadmap.ranges import CheckedSettings, setting


@dataclass(frozen=True)
class ProofSettings(CheckedSettings):
    """What is proved of a plan's motions (`mover.Mover`, `grasps.line_clear`).

    Attributes:
        margin: Proved between what must stay apart [m]; scenes leave gaps of 1 mm.
        self_margin: The same between links of one arm [m].
        tolerance: A motion is given up where a pair is nearer than it moves, by this
            [m]. Less: narrower passages, more time.
        kept: Proved between an open hand and the object on the line to a grasp [m].
        longest, shortest: Steps along such a line [m].
    """

    margin: float = setting(2e-4, 1e-6, 0.1, "m")
    self_margin: float = setting(1e-4, 1e-6, 0.1, "m")
    tolerance: float = setting(2e-4, 1e-6, 0.1, "m")
    kept: float = setting(5e-5, 1e-6, 0.1, "m")
    longest: float = setting(0.02, 1e-6, 0.1, "m")
    shortest: float = setting(5e-4, 1e-6, 0.1, "m")


@dataclass(frozen=True)
class SolveSettings(CheckedSettings):
    """How finely an arm's joints are looked for (`mover`, `prune`, `choose`).

    Attributes:
        free_angles: Values of the free angle of an arm of seven joints. More: more
            postures for each grasp, and more time.
        restarts: Random starts of a descent, for arms without a closed form.
        steps: Steps of each at most.
        error: What a descent aims at, of 0.1 m or rad: 1e-5 is 1 um.
        samples: Configurations behind an arm's reachability.
        cell: Side of its voxels [m].
        shorter: Shares of the straight line to a grasp that are tried, where the whole
            is blocked.
    """

    free_angles: int = setting(12, 1, 50_000_000)
    restarts: int = setting(12, 1, 50_000_000)
    steps: int = setting(60, 1, 50_000_000)
    error: float = setting(1e-5, 1e-9, 1.0)
    samples: int = setting(100_000, 1, 50_000_000)
    cell: float = setting(0.05, 0.005, 0.5, "m")
    shorter: tuple[float, ...] = setting((1.0, 0.6, 0.35), 0.01, 1.0)


SOLVE = SolveSettings()


@dataclass(frozen=True)
class PlanSettings(CheckedSettings):
    """Settings of `plan_handover`.

    Attributes:
        voxels: Places for the hand-over that are tried where the best common voxel
            gives nothing.
        turns: Rotations of the object about the line between the shoulders tried then.
        tuples: Tuples of H that are looked for; the first is the most dexterous one.
        near: Voxels up to this far from the middle between the shoulders count [m].
        back: Length of the straight line to a grasp and away from it [m].
        lift: The object goes straight up by this much after the pick [m].
        line: Longest piece of a straight line of the palm [m].
        budget: Motions that a search between two configurations tests.
        shorten: Motions tested to shorten a path that was found.
        tries: Tuples whose motions are looked for before the planner gives up.
        first_budget: Motions that a search tests at first. A tuple that it is not
            enough for is put off until others were tried, then gets `budget`.
        postures: Other postures of an arm, the palm where it was, that are tried where
            no straight line to or from a grasp is free.
        starts: Postures of the giver at the start, and as many where it hands over,
            that a carry is looked for between.
        meetings: Postures of each that are tried where the object changes hands, if
            the first ones, with `first_budget`, were not enough.
    """

    voxels: int = setting(24, 1, 200)
    turns: int = setting(8, 1, 36)
    tuples: int = setting(40, 1, 100_000)
    near: float = setting(0.25, 0.05, 1.0, "m")
    back: float = setting(0.08, 0.02, 0.3, "m")
    lift: float = setting(0.05, 0.005, 0.3, "m")
    line: float = setting(0.01, 0.002, 0.05, "m")
    budget: int = setting(4000, 10, 1_000_000)
    shorten: int = setting(16, 0, 10_000)
    tries: int = setting(4000, 1, 10_000)
    first_budget: int = setting(300, 10, 1_000_000)
    postures: int = setting(12, 0, 100)
    starts: int = setting(3, 1, 20)
    meetings: int = setting(8, 1, 100)
