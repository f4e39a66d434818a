"""Settings of the pursuit of targets."""

from dataclasses import dataclass, field

import numpy as np

from roadmap.errors import BadInput
from roadmap.ranges import check_number, check_settings, is_between


@dataclass(frozen=True)
class ChoiceSettings:
    """How targets become goals; a frame is one call.

    Attributes:
        margin: A target replaces the pursued one only if its quality is better by this.
            0.03: about what a hand that trembles by 2 cm changes.
        drop: A target this much worse than the best one is no spare: when the pursued
            one is blocked, better ones are tried first.
        goals: Targets offered to the planner at once.
        ahead: Of those, better ones than the pursued that were not reached yet.
        patience: So many frames a better target is given to be found reachable, before
            it makes room for the next one.
        retry: So many frames later one that was never reached may be offered again.
        spares: Worse targets behind the pursued one, for the moment it is blocked.
    """

    margin: float = 0.03
    drop: float = 0.15
    goals: int = 4
    ahead: int = 3
    patience: int = 16
    retry: int = 200
    spares: int = 1

    def __post_init__(self) -> None:
        """Refuse what is no setting."""
        if not is_between(self.margin, 0, 1):
            raise BadInput(f"a margin of {self.margin} is none; give 0 to 1 of quality")
        if not is_between(self.drop, self.margin, 1):
            raise BadInput(
                f"a drop of {self.drop} is none; give the margin, {self.margin}, to 1"
            )
        counts = {"goals": 1, "ahead": 1, "patience": 1, "retry": 0, "spares": 0}
        for name, low in counts.items():
            value = getattr(self, name)
            check_number(name, value, low, 1_000_000, True, "ChoiceSettings")
        if not 0 <= self.spares < self.goals or self.ahead > self.goals:
            raise BadInput(
                f"{self.ahead} ahead and {self.spares} spares do not fit into "
                f"{self.goals} goals; give more goals"
            )


@dataclass(frozen=True)
class LiveSettings:
    """How the pursuit of targets shares out its work; a frame is one call.

    Attributes:
        ranked: Targets looked at in every frame; more and more while all are blocked.
        deepest: As many times more of them at most.
        near_m, near_rad: A roadmap node that holds the tool this near to a target [m],
            [rad] serves it until inverse kinematics has found the pose itself. 7.5 cm
            and 30 degrees: half a cell of 15 cm and 60 degrees.
        attach_every: Frames from one goal that must be attached to the roadmap to the
            next; some milliseconds each.
        choice: Margin and patience, see `ChoiceSettings`.
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
    """

    ranked: int = 10
    near_m: float = 0.075
    near_rad: float = 0.52
    attach_every: int = 10
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

    def __post_init__(self) -> None:
        """Refuse what is no setting."""
        lengths = {
            "near_m": (0.0, 1.0, "m"),
            "near_rad": (0.0, np.pi, "rad"),
            "apart": (0.0, 10.0, "rad or m"),
        }
        some = (
            "attach_every",
            "deepest",
            "steps",
            "configurations",
            "tests",
            "trusted",
        )
        counts = dict.fromkeys((*some, "lookups", "goals_each"), (1, 1_000_000, ""))
        counts |= {"ranked": (1, 100_000, "")}
        counts |= dict.fromkeys(("before", "after"), (0, 1000, ""))
        check_settings(self, lengths | counts, tuple(counts))

    @property
    def starts(self) -> int:
        """Starts of the inverse kinematics for a target, at most."""
        return self.before + 1 + self.after
