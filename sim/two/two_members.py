"""The two robots of one space: one that plans and takes turns, one that is scripted."""

import time
from dataclasses import dataclass

import numpy as np

from odm.answer import HOLDING
from odm.cell_map.cell_map import CellMap
from odm.execution.executor import Executor
from odm.execution.robot_threat import Intent, intent_of
from odm.execution.settings import ExecutionSettings
from odm.obstacles.obstacles import Obstacles
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference
from roadmap.motion.motion import Motion, time_path
from roadmap.ranges import CheckedSettings, setting, told
from sim.loop.loop import ARRIVED
from sim.loop.run_result import STATUS

LEAVE = 0.3  # [s] without a path before it goes and waits
PLANNED, SCRIPTED = "planned", "scripted"


@dataclass(frozen=True)
class TwoSettings(CheckedSettings):
    """How long and how fast two robots run.

    Attributes:
        rate_hz: Frames per second.
        duration_s: Simulated time [s].
        other: "planned": the second robot plans, too, and tells what it will do.
            "scripted": it goes to and fro blindly; only its joints are known.
        speed_scale: Share of the joints' speed limits that they use.
        script_scale: The same for a scripted robot.
        script_rest_s: Time it rests at each of its places [s].
        improve: Motions a planner may test between two frames to shorten its path.
        braking: False takes the braking away: for the test that it is needed.
    """

    rate_hz: float = setting(100.0, 1e-9, 1e9)
    duration_s: float = setting(120.0, 1e-9, 1e9)
    other: str = PLANNED
    speed_scale: float = setting(0.5, 1e-6, 1.0)
    script_scale: float = setting(0.1, 1e-6, 1.0)
    script_rest_s: float = setting(5.0, 0.0, 1e6, "s")
    improve: int = setting(4, 0, 1_000_000)
    braking: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.other, str) or self.other not in (PLANNED, SCRIPTED):
            raise BadInput(
                f"other is {told(self.other)}; choose {PLANNED} or {SCRIPTED}"
            )


class Planned:
    """One robot that plans: its planner and executor, its work places, its trips.

    It works at its places in turn. Where no path leads to the next one for a while it
    goes and waits, and asks now and then whether there is a path again.

    Args:
        planners: One that leads it, one that is asked; the other robot's standing
            links are their scenery.
        places: (n, dof) work places.
        wait: (dof,) where it begins, and waits.
        settings: Rate and speeds.
        ask_again: Time between two questions [s]: not the same for two robots, which
            could wait for each other otherwise.

    Attributes:
        q: (dof,) where it is.
        trips: Times it arrived at a work place.
        arrived: Whether it arrived in this frame.
        waited_s: How long it has had no path to work [s].
        yields: Whether it waits although it has a path.
    """

    def __init__(
        self,
        planners: tuple[ReactivePlanner, ReactivePlanner],
        places: np.ndarray,
        wait: np.ndarray,
        settings: TwoSettings,
        ask_again: float,
    ) -> None:
        self.planner, self._asker = planners
        self.robot, self.settings = self.planner.robot, settings
        self.places, self.wait, self.place, self.trips = places, wait, 0, 0
        self.yields, self.waited_s, self.arrived = False, 0.0, False
        self._period = 1.0 / settings.rate_hz
        self._ask_again = ask_again
        self._held_s = self._since_s = 0.0
        shares = ExecutionSettings(settings.speed_scale)
        if settings.other == PLANNED:  # the other one leaves; no need to back off
            shares = ExecutionSettings(
                settings.speed_scale, min_retreat_separation=np.inf
            )
        self.executor = Executor(
            self.robot, self.planner, wait.copy(), self._period, shares
        )
        self.q = self.executor.set_point.q
        self.status, self.wall_s, self.reason = 0, 0.0, ""
        self.planner.reset()
        self._aim(True)

    def intent(self) -> Intent:
        """Return the intent: all motions it may still make without another test."""
        return intent_of(self.executor)

    def decide(self, other: Obstacles, threat: object, now: float) -> None:
        """Answer a frame: where the other is, and what it may still sweep."""
        commit = self.executor.commit()
        self._since_s += self._period
        asks = not (self.works or self.yields) and self._since_s >= self._ask_again
        if asks:
            self._since_s = 0.0
            self._asker.set_goals([self.places[self.place]])
            if len(self._asker.step(other, q=commit.q).path):
                self._aim(True)
        begun = time.perf_counter()
        dq = self.executor.set_point.dq
        answer = self.planner.step(other, q=commit.q, dq=dq, stamp=now, now=now)
        self.wall_s = time.perf_counter() - begun
        self.executor.update(answer, commit, threat)
        self.status = STATUS.index(answer.status)
        held = answer.status == HOLDING
        self.reason = (answer.reason or "") if held else ""
        self._held_s = self._held_s + self._period if held else 0.0
        lost = not self.yields and (held or not self.works)
        self.waited_s = self.waited_s + self._period if lost else 0.0
        if self.works and self._held_s > LEAVE:
            self._aim(False)

    def set_yields(self, yes: bool) -> None:
        """Leave the work place to the other robot, or go on working."""
        self.yields = yes
        self._aim(not yes)

    def _aim(self, works: bool) -> None:
        """Go to the next work place, or to where it waits."""
        self.works = works
        self.planner.set_goals([self.places[self.place] if works else self.wait])
        self.executor.new_goal()

    def advance(self) -> None:
        """Move on by one period; at a work place, take the next one as the goal."""
        if self.settings.improve:
            self.planner.improve(self.settings.improve)
        self.executor.advance()
        self.q = self.executor.set_point.q
        off = difference(self.robot, self.q, self.places[self.place])
        self.arrived = self.works and self.executor.at_rest
        self.arrived = self.arrived and bool(np.abs(off).max() <= ARRIVED)
        if self.arrived:
            self.trips += 1
            self.place = (self.place + 1) % len(self.places)
            self._aim(True)


class Scripted:
    """A robot that moves to and fro between its places and ignores the other one."""

    status, wall_s, reason = 0, 0.0, ""

    def __init__(self, cell_map: CellMap, paths: list, settings: TwoSettings) -> None:
        """Begin at the first place; `paths` lead from each place to the next one."""
        self.robot, self.settings = cell_map.robot, settings
        scale = settings.script_scale
        self.motions: list[Motion] = [
            time_path(self.robot, path, speed_scale=scale) for path in paths
        ]
        self.place, self.trips, self.t = 1, 0, 0.0
        self.q = self.motions[0].at(0.0).q

    @property
    def motion(self) -> Motion:
        """The motion it is on."""
        return self.motions[(self.place - 1) % len(self.motions)]

    @property
    def dq(self) -> np.ndarray:
        """(dof,) its joint velocities [rad/s or m/s]."""
        return self.motion.at(self.t).dq

    def advance(self) -> None:
        """Move on by one period."""
        self.t += 1.0 / self.settings.rate_hz
        if self.t >= self.motion.duration + self.settings.script_rest_s:
            self.t = 0.0
            self.place = (self.place + 1) % len(self.motions)
            self.trips += 1
        self.q = self.motion.at(self.t).q
