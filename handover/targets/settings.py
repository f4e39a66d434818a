"""Settings of the pursuit of targets."""

from dataclasses import dataclass, field

import numpy as np

from roadmap.errors import BadInput
from roadmap.ranges import CheckedSettings, setting


@dataclass(frozen=True)
class ChoiceSettings(CheckedSettings):
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

    quality_hysteresis: float = setting(0.03, 0.0, 1.0)
    max_quality_loss: float = setting(0.15, 0.0, 1.0)
    goals: int = setting(4, 1, 1_000_000)
    max_untried: int = setting(3, 1, 1_000_000)
    untried_frames: int = setting(16, 1, 1_000_000)
    retry_frames: int = setting(200, 0, 1_000_000)
    fallbacks: int = setting(1, 0, 1_000_000)
    patience_frames: int = setting(0, 0, 1_000_000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_quality_loss < self.quality_hysteresis:
            raise BadInput(
                f"max_quality_loss is {self.max_quality_loss}, but must be from the "
                f"quality_hysteresis, {self.quality_hysteresis}, to 1"
            )
        if not 0 <= self.fallbacks < self.goals or self.max_untried > self.goals:
            raise BadInput(
                f"max_untried = {self.max_untried} and fallbacks = {self.fallbacks} do "
                f"not fit into {self.goals} goals; give more goals"
            )


@dataclass(frozen=True)
class LiveSettings(CheckedSettings):
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
        far: Where no node has its tool this near to a target, as so many times from one
            node's tool to the next, the robot hardly ever gets there, as below a table:
            one start has to do. Of 189 places that a Panda reaches beside tables all
            had one within 1.7 times; of 1011 others half had none within 3.
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

    ranked: int = setting(10, 1, 100_000)
    node_tolerance_m: float = setting(0.075, 0.0, 1.0, "m")
    node_tolerance_rad: float = setting(0.52, 0.0, np.pi, "rad")
    connect_every: int = setting(10, 1, 1_000_000)
    choice: ChoiceSettings = field(default_factory=ChoiceSettings)
    deepest: int = setting(8, 1, 1_000_000)
    before: int = setting(3, 0, 1000)
    after: int = setting(4, 0, 1000)
    far: float = setting(3.0, 0.0, 1e6)
    steps: int = setting(25, 1, 1_000_000)
    configurations: int = setting(4, 1, 1_000_000)
    apart: float = setting(0.3, 0.0, 10.0, "rad or m")
    tests: int = setting(16, 1, 1_000_000)
    trusted: int = setting(8, 1, 1_000_000)
    lookups: int = setting(2, 1, 1_000_000)
    goals_each: int = setting(2, 1, 1_000_000)
    rank_budget: int = setting(0, 0, 10**9)
    choices: int = setting(3, 1, 1000)
    from_rest: bool = False
    near_rest: bool = False
    spare_m: float = setting(0.0, 0.0, 1.0, "m")
    spare_frames: int = setting(400, 0, 1_000_000)
    idle: int = setting(3, 1, 1000)
    alike: int = setting(6, 0, 15)

    @property
    def starts(self) -> int:
        """Starts of the inverse kinematics for a target, at most."""
        return self.before + 1 + self.after


@dataclass(frozen=True)
class AllowanceSettings(CheckedSettings):
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

    look_out: int = setting(600, 1, 1_000_000)
    moves: int = setting(500, 1, 1_000_000)
    tell: int = setting(250, 1, 1_000_000)
    set_goals: int = setting(600, 1, 1_000_000)
    rank: int = setting(300, 1, 1_000_000)
    solve: int = setting(500, 1, 1_000_000)
    reach: int = setting(900, 1, 1_000_000)
    prepare: int = setting(1500, 1, 1_000_000)
    test: int = setting(500, 1, 1_000_000)
    join: int = setting(1500, 1, 1_000_000)
    time_path: int = setting(900, 1, 1_000_000)
    least: int = setting(150, 1, 1_000_000)
    patience: int = setting(4, 1, 1_000_000)
