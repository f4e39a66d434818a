"""How hard a hand-over is looked for; every number counts work, none counts seconds."""

from dataclasses import dataclass, fields

from roadmap.ranges import check_row, check_settings

_RANGES = {
    "voxels": (1, 200, ""),
    "turns": (1, 36, ""),
    "tuples": (1, 100_000, ""),
    "near": (0.05, 1.0, "m"),
    "back": (0.02, 0.3, "m"),
    "lift": (0.005, 0.3, "m"),
    "line": (0.002, 0.05, "m"),
    "budget": (10, 1_000_000, ""),
    "shorten": (0, 10_000, ""),
    "tries": (1, 10_000, ""),
    "first_budget": (10, 1_000_000, ""),
    "postures": (0, 100, ""),
    "starts": (1, 20, ""),
    "meetings": (1, 100, ""),
}


@dataclass(frozen=True)
class ProofSettings:
    """What is proved of a plan's motions (`mover.Mover`, `grasps.line_clear`).

    Attributes:
        margin: Proved between what must stay apart [m]; scenes leave gaps of 1 mm.
        self_margin: The same between links of one arm [m].
        tolerance: A motion is given up where a pair is nearer than it moves, by this
            [m]. Less: narrower passages, more time.
        kept: Proved between an open hand and the object on the line to a grasp [m].
        longest, shortest: Steps along such a line [m].
    """

    margin: float = 2e-4
    self_margin: float = 1e-4
    tolerance: float = 2e-4
    kept: float = 5e-5
    longest: float = 0.02
    shortest: float = 5e-4

    def __post_init__(self) -> None:
        names = tuple(one.name for one in fields(self))
        check_settings(self, dict.fromkeys(names, (1e-6, 0.1, "m")))


@dataclass(frozen=True)
class SolveSettings:
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

    free_angles: int = 12
    restarts: int = 12
    steps: int = 60
    error: float = 1e-5
    samples: int = 100_000
    cell: float = 0.05
    shorter: tuple[float, ...] = (1.0, 0.6, 0.35)

    def __post_init__(self) -> None:
        counts = ("free_angles", "restarts", "steps", "samples")
        ranges: dict = dict.fromkeys(counts, (1, 50_000_000, ""))
        ranges |= {"error": (1e-9, 1.0, ""), "cell": (0.005, 0.5, "m")}
        check_settings(self, ranges)
        check_row(self, "shorter", 0.01, 1.0)


@dataclass(frozen=True)
class PlanSettings:
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

    voxels: int = 24
    turns: int = 8
    tuples: int = 40
    near: float = 0.25
    back: float = 0.08
    lift: float = 0.05
    line: float = 0.01
    budget: int = 4000
    shorten: int = 16
    tries: int = 4000
    first_budget: int = 300
    postures: int = 12
    starts: int = 3
    meetings: int = 8

    def __post_init__(self) -> None:
        check_settings(self, _RANGES)
