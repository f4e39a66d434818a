"""A run to the best reachable hand-over target of a moving person, frame by frame."""

import gc
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from handover import (
    Human,
    QualitySettings,
    ReachMap,
    build_reach_map,
    chain_of,
    load_reach_map,
)
from handover.meet.find import check_same_robot
from handover.meet.held_object import HeldObject
from handover.meet.workspace import InteractionWorkspace
from handover.targets.live_targets import WITHDRAWN, LiveTargets
from handover.targets.node_index import NodeIndex
from handover.targets.settings import ChoiceSettings, LiveSettings
from odm import CellMap, PlannerSettings, ReactivePlanner, load_map
from odm.obstacles.obstacles import Obstacles
from roadmap.builds.chunks import Progress
from roadmap.errors import BadInput, BuildRefused
from roadmap.robot.robot import Robot
from sim.loop.loop import Frame, LoopSettings, run_frames
from sim.loop.run_result import RunResult
from sim.people.whole_person import RecordedPerson, WholePerson, arm_at, scripted_person
from sim.run import places
from sim.run.folders import REACH_MAPS, check_kind_of
from sim.run.meet_audit import TargetAudit, Verdict, shares
from sim.run.meet_loop import MeetLoop, meet_settings
from sim.run.meet_record import TargetColumns
from sim.run.meet_report import print_targets, target_figures
from sim.run.places import find_places, person_of, set_up_scene, warm_up
from sim.run.report import print_report
from sim.run.request import RunRequest, held_object

GRASPS = 8  # of the person, at most
# Fewer motions to a goal than usual: a frame pays for them when the target changes.
# A new path avoids where the person lately was, with no distance beside that: a target
# is near a hand (docs/decisions/0100).
PLANNER = PlannerSettings(
    goal_connections=4, start_connections=4, history_clearance=0.0, cached_goals=32
)
# The way of the hand counts from where the arm rests, else the best places follow it,
# and a ranking goes on over several frames (docs/decisions/0027 and 0049). A hand that
# reaches for a target blocks it for a second or less: it is waited for. A target keeps
# clear of a hand that trembles by 2 cm, where one does (docs/decisions/0100).
QUALITY = QualitySettings()
LIVE = LiveSettings(
    rank_budget=1000,
    from_rest=True,
    near_rest=True,
    spare_m=0.03,
    choice=ChoiceSettings(patience_frames=150),
)


@dataclass(frozen=True, eq=False)
class MeetSetup:
    """What a run needs besides the person."""

    # the robot's map and its reach map
    cell_map: CellMap
    reach: ReachMap
    obj: HeldObject  # what it holds
    index: NodeIndex  # nodes by pose of the tool
    rest: np.ndarray  # (dof,) where it begins and waits
    scene: Path | None = None  # file of what else stands around; None: nothing

    def planner(self) -> ReactivePlanner:
        """Return a planner of the map that knows the scene."""
        planner = ReactivePlanner(self.cell_map, settings=PLANNER)
        set_up_scene(planner, self.scene)
        return planner

    def live(self, human: Human, side: str) -> LiveTargets:
        """Return a live thread that knows nothing yet."""
        planner, meet = self.planner(), self.meet(human, side)
        return LiveTargets(planner, meet, self.rest, self.index, LIVE)

    def meet(self, human: Human, side: str) -> InteractionWorkspace:
        """Return a workspace of its own."""
        settings = meet_settings(self.cell_map, side, QUALITY)
        return InteractionWorkspace(self.reach, human, self.obj, GRASPS, settings)

    def loop(
        self,
        person: WholePerson | RecordedPerson,
        side: str,
        settings: LoopSettings,
        dwell_s: float | None = None,
    ) -> tuple[MeetLoop, TargetAudit]:
        """Return a loop that has not begun, and its audit."""
        human = person.human(0.0)
        live = self.live(human, side)
        loop = MeetLoop(live, self.rest, person, settings, dwell_s)
        args = self.cell_map, self.index, LIVE.from_rest
        audit = TargetAudit(self.meet(human, side), *args)
        set_up_scene(audit.planner, self.scene)
        return loop, audit


class MeetTask:
    """To the targets of a person; the target pursued is audited from time to time.

    Args:
        request: What was asked for.
        live: The `sim.keyboard.KeyboardPerson` who moves the person; None: a script or
            a recording.

    Attributes:
        cell_map: The map, once it was opened.
        side: Hand that takes, once the person is known.
        verdicts: Of the audit so far.
    """

    cell_map: CellMap

    def __init__(self, request: RunRequest, live: object | None = None) -> None:
        self.request, self.live, self.side = request, live, "right"
        self.verdicts: list[Verdict] = []

    def person(self) -> WholePerson | RecordedPerson:
        """Return the whole person, checked."""
        asked = self.request
        if self.live is not None:
            return WholePerson(self.live.arm(arm_at(float(np.mean(asked.distances)))))
        if asked.motion != "mocap":
            person = scripted_person(asked.motion, asked.seed, asked.distances)
            if asked.side == "left":
                raise BadInput(
                    "a scripted person moves the right arm only; leave --side out, or "
                    "play a recording with --motion mocap"
                )
            return person
        person = RecordedPerson(person_of(asked))
        self.side = asked.side or person.sides[0]
        if self.side not in person.sides:
            raise BadInput(
                f"the {self.side} arm is not in {person.name}; choose {person.sides[0]}"
            )
        return person

    def open(self, tell: Progress) -> None:
        """Load the maps; build the reach map if there is none and none was named."""
        self.cell_map = load_map(self.request.map_dir)
        robot = self.cell_map.robot
        reach = reach_map_of(robot, self.request.reach, tell)
        bare = ReactivePlanner(self.cell_map)
        set_up_scene(bare, self.request.scene)
        rest = find_places(bare)[0]
        tell("nodes by pose of the tool", 0, 1)
        index = NodeIndex(robot, self.cell_map.roadmap.nodes)
        tell("nodes by pose of the tool", 1, 1)
        obj = held_object(self.request.obj)
        scene = self.request.scene
        self.setup = MeetSetup(self.cell_map, reach, obj, index, rest, scene)

    def loop(
        self, person: WholePerson | RecordedPerson, settings: LoopSettings
    ) -> MeetLoop:
        """Compile everything, then return a loop whose planner knows nothing of it."""
        self._rehearse(person, settings)
        gc.collect()
        gc.freeze()  # else a collection of all that was loaded takes 80 ms of a frame
        dwell_s = self.request.dwell
        loop, self._audit = self.setup.loop(person, self.side, settings, dwell_s)
        self._loop = loop
        return loop

    def columns(self) -> TargetColumns:
        """Return what a recording of the loop holds beside the run."""
        return TargetColumns(self._loop)

    def _rehearse(
        self, person: WholePerson | RecordedPerson, settings: LoopSettings
    ) -> None:
        """Run some seconds, audit included, beside somebody else where keys move."""
        if self.live is not None:
            person = scripted_person("reach", 0, self.request.distances)
        setup = self.setup
        planner = setup.planner()
        ends = np.array([setup.rest, self.cell_map.roadmap.nodes[0]])
        warm_up(planner, ends, person, settings)
        brief = replace(settings, duration_s=places.REHEARSAL_S)
        loop, audit = setup.loop(person, self.side, brief)
        run_frames(loop, lambda frame: judge_sometimes(loop, audit, frame, 1.0))
        exercise_choice(loop.live)

    def hear(self, frame: Frame) -> None:
        """Audit the target pursued, from time to time; not where keys move the arm."""
        if self.live is None:
            every_s = self.request.audit_s
            self.verdicts += judge_sometimes(self._loop, self._audit, frame, every_s)

    def figures(self, loop: MeetLoop, result: RunResult) -> dict:
        """Return what became of the targets, by "targets"."""
        margin = loop.live.settings.choice.quality_hysteresis
        audit = {"margin": margin, "audit": shares(self.verdicts, margin)}
        return {"targets": target_figures(loop, result) | audit}

    def show(self, result: RunResult, figures: dict) -> None:
        """Print the tables."""
        print_report(result, None, self.cell_map.hash)
        print_targets(figures["targets"])


def exercise_choice(live: LiveTargets) -> None:
    """Do what the live choice does at times only."""
    target = next(iter(live.meet.best(1)), None)
    if target is not None:
        live.meet.rated([target.key])
        live.meet.reach.witness(target.T_world_tool)
        live.finder.near_node(target)
        live.finder.work(target)
    _ = live.meet.missing_m


def reach_map_of(robot: Robot, folder: Path | None, tell: Progress) -> ReachMap:
    """Return the robot's reach map; one that was not named is built where missing.

    Robots of one name may have another tool, or other joints: each gets a folder.
    """
    if folder is not None:
        reach = load_reach_map(folder)
        check_same_robot(reach, robot)
        return reach
    for name in _folder_names(robot):
        folder = REACH_MAPS / name
        check_kind_of(folder, "reach map")
        if not folder.exists():
            told = f"no reach map of {robot.name} yet: building it into {folder}"
            print(told, file=sys.stderr)  # what is asked for may be JSON
            try:
                build_reach_map(chain_of(robot), progress=tell).save(folder)
            except BuildRefused as error:
                how = f"odm workspace build URDF --tip {robot.tip_name} --cell 0.1"
                raise BuildRefused(f"{error}: `{how} --out {folder}`") from error
        reach = load_reach_map(folder)
        with suppress(BadInput):
            check_same_robot(reach, robot)
            break
    return reach


def _folder_names(robot: Robot) -> Iterator[str]:
    yield robot.name
    name = f"{robot.name}_{robot.tip_name}".replace("/", "_")
    yield name
    yield from (f"{name}_{k}" for k in count(2))


def judge_sometimes(
    loop: MeetLoop, audit: TargetAudit, frame: Frame, every_s: float
) -> list[Verdict]:
    """Audit the pursued target every `every_s` seconds; 0: never."""
    rate = loop.settings.rate_hz
    if not every_s or not frame.index or frame.index % max(1, round(every_s * rate)):
        return []
    if loop.pursuits[-1].state == WITHDRAWN:
        return []  # it is to pursue none
    now = frame.index / rate
    person = Obstacles(capsules=frame.capsules)
    key = loop.pursuits[-1].key
    human = loop.motion.human(now)
    return [audit.look(human, person, frame.q, key, now)]
