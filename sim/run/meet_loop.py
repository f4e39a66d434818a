"""The loop whose goals are the targets of an interaction workspace."""

from collections.abc import Callable

import numpy as np

from handover import Human, QualitySettings
from handover.meet.constraints import ClearOf
from handover.meet.settings import MeetSettings
from handover.targets.live_targets import THERE, WITHDRAWN, LiveTargets, Pursuit
from odm import CellMap
from roadmap.kinematics.forward import difference, tool_pose
from sim.loop.loop import ARRIVED, Loop, LoopSettings


def meet_settings(
    cell_map: CellMap, side: str, quality: QualitySettings
) -> MeetSettings:
    """Return where a run looks for targets: nowhere in what stands around the robot."""
    clear = (ClearOf(cell_map.scenery),)
    return MeetSettings(side=side, quality=quality, constraints=clear)


class MeetPlanner:
    """A planner for `sim.loop.loop.Loop` that is given the person, not only points.

    It answers `set_goals` by nothing: the targets are the goals. All else is the
    planner's.

    Attributes:
        human: The person of the last frame; None before the first one.
    """

    def __init__(self, live: LiveTargets, human_at: Callable[[float], Human]) -> None:
        self.live, self.human_at = live, human_at
        self.human: Human | None = None

    def __getattr__(self, name: str) -> object:
        """Everything else is the planner's."""
        return getattr(self.live.planner, name)

    def set_goals(self, goals: object, costs: object = None) -> None:
        """Leave the goals to the targets."""

    def step(self, points: np.ndarray, q: np.ndarray, **options: object) -> object:
        """Answer one frame; see `LiveTargets.step`."""
        self.human = self.human_at(options["now"])
        return self.live.step(self.human, points, q, **options)


class MeetLoop(Loop):
    """A loop in which the robot goes where the person can take what it holds.

    A trip is an arrival at a target. `Frame.place` is the target's cell, -1 for none.

    Args:
        live: The targets and the planner.
        rest: (dof,) where the robot begins and waits.
        person: A motion with `human(t)`.
        settings: Rate, duration, speeds.
        dwell_s: For how long it has to be at a target, without a break, for the
            hand-over; then it goes back to `rest`, and comes again [s]. None: it stays.

    Attributes:
        dwell_s: As given.
        handovers: How often it was at a target for `dwell_s`.
        pursuits: One `Pursuit` for every frame so far.
        tools: Where the tool goes for each target pursued so far, by its cell [m].
    """

    def __init__(
        self,
        live: LiveTargets,
        rest: np.ndarray,
        person: object,
        settings: LoopSettings | None = None,
        dwell_s: float | None = None,
    ) -> None:
        planner = MeetPlanner(live, person.human)
        robot, places = live.planner.robot, np.array([rest, rest])
        super().__init__(planner, robot, places, person, settings)
        self.live = live
        self.pursuits: list[Pursuit] = []
        self.tools: dict[int, np.ndarray] = {}
        self.dwell_s, self.handovers = dwell_s, 0
        self._dwell = np.inf  # frames at a target, before it goes back
        if dwell_s is not None:
            self._dwell = max(1, round(dwell_s * self.settings.rate_hz))
        self._there = 0  # frames without a break

    def _goes_to(self) -> int:
        key = self.live.pursuit.key
        return -1 if key is None else key

    def _move(self) -> None:
        pursuit = self.live.pursuit
        self.pursuits.append(pursuit)
        key = pursuit.key
        if key is not None and key not in self.tools:
            goal = next(g for g in self.live.goals if g.key == key)
            self.tools[key] = tool_pose(self.robot, goal.q)[:3, 3]
        self._there = self._there + 1 if pursuit.state == THERE else 0
        self.trips += self._there == 1
        if self._there == self._dwell:
            self.handovers += 1
            self.live.withdraw()
        elif pursuit.state == WITHDRAWN and self.executor.at_rest:
            off = difference(self.robot, self.executor.set_point.q, self.places[0])
            if np.abs(off).max() <= ARRIVED:
                self.live.resume()
        self._advance()
