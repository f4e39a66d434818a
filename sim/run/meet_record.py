"""A run to hand-over targets, recorded and run again."""

from dataclasses import asdict

import numpy as np

from handover import Human, QualitySettings, ReachMap
from handover.meet.workspace import InteractionWorkspace
from handover.targets.live_targets import (
    BLOCKED,
    NOBODY,
    THERE,
    UNDER_WAY,
    WITHDRAWN,
    LiveTargets,
)
from handover.targets.node_index import NodeIndex
from handover.targets.settings import ChoiceSettings, LiveSettings
from odm import CellMap
from roadmap.builds.chunks import Progress
from sim.loop.loop import Frame, LoopSettings
from sim.loop.target_rows import TARGETS_EVERY, target_rows
from sim.record.again import (
    ReplayedPerson,
    check_map,
    known,
    planner_of,
    recorded_again,
)
from sim.record.people import (
    body_told,
    held_of,
    held_told,
    people_arrays,
    person_at,
    person_of,
)
from sim.record.record_check import BadRecord
from sim.record.recorder import Column, Recorder
from sim.record.run_record import TARGETS, RunRecord
from sim.run.meet_loop import MeetLoop, meet_settings

STATES = (THERE, UNDER_WAY, BLOCKED, NOBODY, WITHDRAWN)
PERSON = "person."  # what the arrays of the person begin with


class TargetColumns:
    """What is recorded beside a run to targets.

    Attributes:
        loop: The run's.
        format: The oldest format of a recording that holds it.
    """

    format = TARGETS

    def __init__(self, loop: MeetLoop) -> None:
        self.loop = loop
        self._people: list[Human] = []
        self._state, self._quality = Column(np.uint8), Column(np.float64)
        self._best = Column(np.float64)
        self._shown: list[np.ndarray] = []

    def add(self, frame: Frame) -> None:
        """Take one frame."""
        if frame.index % TARGETS_EVERY == 0:
            self._shown.append(target_rows(self.loop.live))
        pursuit = self.loop.pursuits[-1]
        self._state.add(STATES.index(pursuit.state))
        self._quality.add(pursuit.quality)
        self._best.add(pursuit.best)
        self._people.append(self.loop.planner.human)

    def head(self) -> dict:
        """Return settings and who was met."""
        loop, meet = self.loop, self.loop.live.meet
        told = {
            "states": list(STATES),
            "reach": meet.reach.hash,
            "grasps": len(meet.grasps),
            "dwell_s": loop.dwell_s,
            "side": meet.settings.side,
            "quality": asdict(meet.settings.quality),
            "live": asdict(loop.live.settings),
            "held": held_told(meet.obj),
            "person": body_told(self._people[0]),
        }
        return {"targets": told}

    def arrays(self, n: int) -> dict[str, np.ndarray]:
        """Return the arrays of the first `n` frames."""
        shown = self._shown[: -(-n // TARGETS_EVERY)]
        ends = np.cumsum([0, *map(len, shown)]).astype(np.int64)
        return people_arrays(self._people[:n], PERSON) | {
            "targets.state": self._state.rows(n),
            "targets.quality": self._quality.rows(n),
            "targets.best": self._best.rows(n),
            "targets.shown": np.concatenate(shown),
            "targets.shown_at": ends,
        }


class ReplayedWholePerson(ReplayedPerson):
    """The whole person of a recording, frame by frame."""

    def __init__(self, record: RunRecord) -> None:
        super().__init__(record)
        self._body = person_of(record.head["targets"]["person"])

    def human(self, t: float) -> Human:
        """Return the person at time `t` [s]."""
        return person_at(self._body, self.record.arrays, PERSON, self.frame_at(t))


def targets_again(
    record: RunRecord,
    cell_map: CellMap,
    reach: ReachMap,
    progress: Progress | None = None,
) -> RunRecord:
    """Run a recorded run to targets again, on its maps, and return the recording."""
    check_map(record, cell_map)
    told = record.head["targets"]
    if reach.hash != told["reach"]:
        raise BadRecord(
            f"the run was recorded with the reach map {told['reach'][:12]}, but this "
            f"is {reach.hash[:12]}; give the one it was recorded with (--reach)"
        )
    loop = _loop(record, cell_map, reach)
    recorder = Recorder(loop, cell_map, TargetColumns(loop))
    return recorded_again(record, recorder, progress)


def _loop(record: RunRecord, cell_map: CellMap, reach: ReachMap) -> MeetLoop:
    head, told = record.head, record.head["targets"]
    planner, person = planner_of(record, cell_map), ReplayedWholePerson(record)
    quality = known(QualitySettings, told["quality"])
    settings = meet_settings(cell_map, told["side"], quality)
    obj, someone = held_of(told["held"]), person.human(0.0)
    meet = InteractionWorkspace(reach, someone, obj, told["grasps"], settings)
    choice = known(ChoiceSettings, told["live"]["choice"])
    live = known(LiveSettings, told["live"] | {"choice": choice})
    rest, robot = record.arrays["places"][0], planner.robot
    index = NodeIndex(robot, cell_map.roadmap.nodes)
    targets = LiveTargets(planner, meet, rest, index, live)
    how = known(LoopSettings, head["settings"])
    return MeetLoop(targets, rest, person, how, told["dwell_s"])
