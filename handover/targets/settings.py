"""Settings of the pursuit of targets."""

from dataclasses import dataclass, field, fields

import numpy as np

from roadmap.errors import BadInput
from roadmap.ranges import check_number, check_settings, is_between


@dataclass(frozen=True)
class ChoiceSettings:
    """How targets become goals; a frame is one call.

    Attributes:
        quality_hysteresis: A target replaces the pursued one only if its quality is
            better by this. 0.03: about what a hand that trembles by 2 cm changes.
        max_quality_loss: A target worse than the best one by more than this is no
            fallback: when the pursued one is blocked, better ones are tried first.
        goals: Targets offered to the planner at once.
        max_untried: How many of those may be better than the pursued one, and not
            reached yet.
        untried_frames: Frames after which a better target that the planner does not
            reach is replaced by the next one.
        retry_frames: Frames until such a target may be offered again.
        fallbacks: Worse targets on offer, for when the pursued one is blocked.
        patience_frames: Frames for which a blocked target is waited for before worse
            ones are on offer: a hand that reaches for it is soon gone again. 0: another
            one is pursued at once.
    """

    quality_hysteresis: float = 0.03
    max_quality_loss: float = 0.15
    goals: int = 4
    max_untried: int = 3
    untried_frames: int = 16
    retry_frames: int = 200
    fallbacks: int = 1
    patience_frames: int = 0

    def __post_init__(self) -> None:
        if not is_between(self.quality_hysteresis, 0, 1):
            raise BadInput(
                f"quality_hysteresis is {self.quality_hysteresis}, but must be 0 to 1 "
                "of quality"
            )
        if not is_between(self.max_quality_loss, self.quality_hysteresis, 1):
            raise BadInput(
                f"max_quality_loss is {self.max_quality_loss}, but must be from the "
                f"quality_hysteresis, {self.quality_hysteresis}, to 1"
            )
        counts = {
            "goals": 1,
            "max_untried": 1,
            "untried_frames": 1,
            "retry_frames": 0,
            "fallbacks": 0,
            "patience_frames": 0,
        }
        for name, low in counts.items():
            value = getattr(self, name)
            check_number(name, value, low, 1_000_000, True, "ChoiceSettings")
        if not 0 <= self.fallbacks < self.goals or self.max_untried > self.goals:
            raise BadInput(
                f"max_untried = {self.max_untried} and fallbacks = {self.fallbacks} do "
                f"not fit into {self.goals} goals; give more goals"
            )


@dataclass(frozen=True)
class LiveSettings:
    """How the pursuit of targets shares out its work; a frame is one call.

    Attributes:
        ranked: Targets considered in a frame; more and more while all are blocked.
        deepest: At most this many times `ranked` targets are considered.
        node_tolerance_m: A roadmap node that holds the tool this near to a target [m]
            stands in for it until inverse kinematics has found the pose itself. 7.5 cm:
            half a cell of 15 cm.
        node_tolerance_rad: The same for its rotation [rad]. 30 degrees: half a cell of
            60 degrees.
        connect_every: Least number of frames between two goals that must be connected
            to the roadmap, which takes some milliseconds each.
        choice: Hysteresis and patience, see `ChoiceSettings`.
        before, after: Near nodes that inverse kinematics starts from, before and after
            the reach map's witness. More: harder targets are reached, later.
        steps: Most steps of a start: a frame may pay for one start, not for more.
        configurations: Most that are looked for of one target: where the person blocks
            one, another may be free.
        apart: Least difference of two configurations in some joint [rad or m].
        tests: Configurations tested against the person in a frame, some 13 us each.
        trusted: Frames for which a test that found no free configuration is trusted.
        lookups: Targets in a frame for which near nodes are looked up: slow once.
        goals_each: Configurations of one target that are goals at once.
        rank_budget: Work of the ranking in a frame, about 1 us each: it goes on over
            several frames, of the person as they were when it began. 0: in each frame
            all of it, some milliseconds.
        choices: Frames between two rankings, where it goes on over several: in each
            the targets known are weighed anew, and one costly job is done.
        from_rest: Whether the way of the person's hand counts from where their arm
            rests, not from where it is: else the best place follows a hand that moves.
        spare_m: Distance [m] that a configuration keeps from the person besides the
            clearance when it is offered. At one that has 2 mm more than the clearance
            each tremble of the person stops the robot.
        spare_frames: Frames without a target that can be reached, after which
            configurations are offered that keep the clearance only.
        near_rest: Whether ways from the place of rest are kept short: inverse
            kinematics begins there, in place of the last near node, and of targets
            with the same quality the one that turns the tool least goes first.
        idle: Factor on `choices`, the frames between two rankings, while there is no
            target to go to.
        alike: Targets have the same quality if it is so to this many decimals.
    """

    ranked: int = 10
    node_tolerance_m: float = 0.075
    node_tolerance_rad: float = 0.52
    connect_every: int = 10
    choice: ChoiceSettings = field(default_factory=ChoiceSettings)
    deepest: int = 8
    before: int = 3
    after: int = 4
    steps: int = 25
    configurations: int = 4
    apart: float = 0.3
    tests: int = 16
    trusted: int = 8
    lookups: int = 2
    goals_each: int = 2
    rank_budget: int = 0
    choices: int = 3
    from_rest: bool = False
    near_rest: bool = False
    spare_m: float = 0.0
    spare_frames: int = 400
    idle: int = 3
    alike: int = 6

    def __post_init__(self) -> None:
        lengths = {
            "node_tolerance_m": (0.0, 1.0, "m"),
            "node_tolerance_rad": (0.0, np.pi, "rad"),
            "apart": (0.0, 10.0, "rad or m"),
            "spare_m": (0.0, 1.0, "m"),
        }
        some = (
            "connect_every",
            "deepest",
            "steps",
            "configurations",
            "tests",
            "trusted",
        )
        counts = dict.fromkeys((*some, "lookups", "goals_each"), (1, 1_000_000, ""))
        counts |= {"ranked": (1, 100_000, ""), "choices": (1, 1000, "")}
        counts |= {"idle": (1, 1000, ""), "alike": (0, 15, "")}
        counts |= {"rank_budget": (0, 10**9, ""), "spare_frames": (0, 1_000_000, "")}
        counts |= dict.fromkeys(("before", "after"), (0, 1000, ""))
        check_settings(self, lengths | counts)

    @property
    def starts(self) -> int:
        """Starts of the inverse kinematics for a target, at most."""
        return self.before + 1 + self.after


@dataclass(frozen=True)
class AllowanceSettings:
    """Time that work takes, in units of about a microsecond (`allowance.Allowance`).

    They are measured means: on a machine that is slower by a factor multiply all of
    them by it, or give a frame fewer units.

    Attributes:
        look_out: The executor looks whether somebody comes.
        moves: The stops of a moving robot are tested.
        tell: The planner is told where the person will be.
        set_goals: Goals are set, and the step looks for a path to them.
        rank: A ranking begins.
        solve: A start of the inverse kinematics.
        reach: ... of a place before an object and one at it.
        prepare: A goal is joined to the roadmap.
        test: A test of `improve`.
        join: The step joins the robot to the roadmap.
        time_path: The executor times a new path.
        least: A frame's least share of work that goes on over several frames.
        patience: Frames by which work is put off at most.
    """

    look_out: int = 600
    moves: int = 500
    tell: int = 250
    set_goals: int = 600
    rank: int = 300
    solve: int = 500
    reach: int = 900
    prepare: int = 1500
    test: int = 500
    join: int = 1500
    time_path: int = 900
    least: int = 150
    patience: int = 4

    def __post_init__(self) -> None:
        names = (one.name for one in fields(self))
        check_settings(self, dict.fromkeys(names, (1, 1_000_000, "")))
