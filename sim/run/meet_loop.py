"""The loop whose goals are the targets of an interaction workspace."""

from collections.abc import Callable

import numpy as np

from handover import Human
from handover.targets.live_targets import THERE, LiveTargets, Pursuit
from roadmap.kinematics.forward import tool_pose
from sim.loop.loop import Audit, Loop, LoopSettings


class MeetPlanner:
    """A planner for `sim.loop.loop.Loop` that is given the person, not only points.

    It answers `set_goals` by nothing: the targets are the goals. All else is the
    planner's.

    Args:
        live: The targets and the planner.
        human_at: Time [s] -> the person.
    """

    def __init__(self, live: LiveTargets, human_at: Callable[[float], Human]) -> None:
        """Keep both."""
        self.live, self.human_at = live, human_at

    def __getattr__(self, name: str) -> object:
        """Everything else is the planner's."""
        return getattr(self.live.planner, name)

    def set_goals(self, goals: object, costs: object = None) -> None:
        """Leave the goals to the targets."""

    def step(self, points: np.ndarray, q: np.ndarray, **options: object) -> object:
        """Answer one frame; see `LiveTargets.step`."""
        human = self.human_at(options["now"])
        return self.live.step(human, points, q, **options)


class MeetLoop(Loop):
    """A loop in which the robot goes where the person can take what it holds.

    A trip is an arrival at a target. `Frame.place` is the target's cell, -1 for none.

    Args:
        live: The targets and the planner.
        rest: (dof,) where the robot begins and waits.
        person: A motion with `human(t)`.
        settings: Rate, duration, speeds.
        audit: As of `Loop`.

    Attributes:
        pursuits: One `Pursuit` for every frame so far.
        tools: Where the tool goes for each target pursued so far, by its cell [m].
    """

    def __init__(
        self,
        live: LiveTargets,
        rest: np.ndarray,
        person: object,
        settings: LoopSettings | None = None,
        audit: Audit | None = None,
    ) -> None:
        """Put the robot at rest."""
        planner = MeetPlanner(live, person.human)
        robot, places = live.planner.robot, np.array([rest, rest])
        super().__init__(planner, robot, places, person, settings, audit)
        self.live = live
        self.pursuits: list[Pursuit] = []
        self.tools: dict[int, np.ndarray] = {}
        self._there = False
        self.place = -1

    def _move(self) -> None:
        pursuit = self.live.pursuit
        self.pursuits.append(pursuit)
        self.place = -1 if pursuit.key is None else pursuit.key
        if self.place >= 0 and self.place not in self.tools:
            goal = next(g for g in self.live.goals if g.key == self.place)
            self.tools[self.place] = tool_pose(self.robot, goal.q)[:3, 3]
        there = pursuit.state == THERE
        self.trips += there and not self._there
        self._there = there
        self._advance()
