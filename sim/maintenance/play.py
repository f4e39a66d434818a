"""A cycle played: for each tool a give, a pause in which it is used, and a receive.

Each hand-over is a `sim.story.play.StoryPlay` of its own, with the tool's own place on
the table; the next begins where the one before ended: the robot at rest, the person
where they stand. Between two the person uses the tool; as they have it in their hand by
then, they hold it as they will hold it out.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from roadmap.kinematics.forward import difference
from roadmap.ranges import CheckedSettings, setting
from sim.maintenance.cases import LadderCase, ToolSetup
from sim.story import machine as table
from sim.story.play import RATE, StoryMoment, StoryPlay, StoryResult
from sim.story.settings import patience_with
from sim.story.wrist import Wrist


@dataclass(frozen=True)
class CycleSettings(CheckedSettings):
    """When a cycle goes on, and when it is given up.

    Attributes:
        uses_s: The person uses a tool, or waits before asking for the next, so long
            [s].
        limit_s: A hand-over, put down included, must be over within this [s]; of a slow
            robot, so many times that as `sim.story.settings.patience_with` says.
        at_rest: The next hand-over begins so near to where one ended [rad or m].
        still: An arm that changes by less between two frames rests [rad].
    """

    uses_s: float = setting(1.5, 0.0, 3600.0, "s")
    limit_s: float = setting(45.0, 0.0, 3600.0, "s")
    at_rest: float = setting(1e-3, 1e-9, 0.1, "rad or m")
    still: float = setting(1e-3, 1e-9, 0.1, "rad or m")


@dataclass
class CycleResult:
    """What came of a cycle."""

    case: LadderCase  # who stood where
    # what came of each hand-over: a give and a receive of each tool
    parts: list[StoryResult] = field(default_factory=list)
    # whether every tool was given, given back and put into its place
    whole: bool = False
    reason: str = ""  # what went wrong first; empty where nothing did
    seconds: float = 0.0  # how long it took, pauses included [s]

    @property
    def contacts(self) -> int:
        """Frames in which the robot touched the person, whoever moved."""
        return sum(p.contacts + p.standing_contacts for p in self.parts)


class MaintenancePlay:
    """One cycle that goes on frame by frame.

    Args:
        setups: Of each tool, in the order in which they are asked for.
        case: Who stands where.
        wrist: The sensor of a tool's setup; None: the forces added up.
        settings: When it goes on.

    Attributes:
        run: The hand-over that goes on, or was the last one.
        begun: When each of them began [s].
        ended: Whether the cycle is over.
        result: What came of it.
    """

    def __init__(
        self,
        setups: tuple[ToolSetup, ...],
        case: LadderCase,
        wrist: Callable[[ToolSetup], Wrist] | None = None,
        settings: CycleSettings = CycleSettings(),
    ) -> None:
        self.settings = settings
        self.setups, self.case, self._wrist_of = setups, case, wrist
        self._left = [(k, d) for k in range(len(setups)) for d in table.DIRECTIONS]
        self.begun: list[float] = []
        self.index, self.ended = 0, False
        self.result = CycleResult(case)
        robot = setups[0].cell_map.robot
        self._limit_s = settings.limit_s * patience_with(robot)
        self._wrists: list[Wrist] = []
        self._arm = np.zeros(0)
        self._paused = 0  # frames since a hand-over was over
        self._begin()

    @property
    def now(self) -> float:
        """Time since the cycle began [s]."""
        return self.index / RATE

    def step(self) -> StoryMoment:
        """Go on by one frame."""
        run, s = self.run, self.settings
        moment = run.step()
        self.index += 1
        still = np.abs(run.partner.arm - self._arm).max(initial=0.0) < s.still
        self._arm = np.array(run.partner.arm)
        if run.story.ended:
            self._paused += 1
            if self._paused >= s.uses_s * RATE and still:
                self._next()
        elif run.index >= self._limit_s * RATE:
            self._stop(f"{self._title()} was not over after {self._limit_s:g} s")
        self.result.seconds = self.now
        return moment

    def close(self) -> None:
        """Give the sensors back."""
        for wrist in self._wrists:
            wrist.close()

    def _begin(self) -> None:
        tool, direction = self._left.pop(0)
        setup = self.setups[tool]
        wrist = None if self._wrist_of is None else self._wrist_of(setup)
        if wrist is not None:
            self._wrists.append(wrist)
        gives = direction == "give"
        case = self.case.of(direction)
        # one planner at a time: the one before goes
        self.run = run = StoryPlay(setup, case, wrist=wrist, fetch=gives)
        self._arm, self._paused = np.array(run.partner.arm), 0
        self.begun.append(self.now)
        self.result.parts.append(run.result)

    def _next(self) -> None:
        """Begin the next hand-over if this one came out well; else end."""
        run = self.run
        trouble = trouble_of(run, self.settings.at_rest)
        if trouble:
            self._stop(f"{self._title()}: {trouble}")
            return
        if not self._left:
            self.ended, self.result.whole = True, True
            return
        self._begin()

    def _stop(self, reason: str) -> None:
        self.ended, self.result.reason = True, reason

    def _title(self) -> str:
        run = self.run
        doing = "giving" if run.case.direction == "give" else "taking back"
        return f"{doing} the {run.setup.obj.name}"


def trouble_of(run: StoryPlay, at_rest: float = CycleSettings.at_rest) -> str:
    """Return why a hand-over that is over was none, or the next one cannot begin."""
    story, rest = run.story, run.setup.rest
    if not run.result.handed_over:
        return run.result.outcome or story.reason
    off = difference(run.planner.robot, story.executor.set_point.q, rest)
    if not np.abs(off).max() < at_rest:
        return story.reason or "the robot did not come back"
    placed = any(event.signal == "placed" for event in story.events)
    if run.case.direction == "receive" and not placed:
        return story.reason or "the tool was not put down"
    return ""


def play_cycle(
    cycle: MaintenancePlay, hear: Callable[[StoryPlay, StoryMoment], None] | None = None
) -> CycleResult:
    """Play a cycle to its end; `hear` takes each moment, and the run it is of."""
    while not cycle.ended:
        run = cycle.run
        moment = cycle.step()
        if hear is not None:
            hear(run, moment)
    return cycle.result
