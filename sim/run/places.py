"""A run between two work places: what it loads, its loop and its figures."""

import gc
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm import CellMap, Obstacles, ReactivePlanner, load_map
from roadmap.builds.chunks import Progress
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot
from sim.loop.carried import take_ball
from sim.loop.loop import Loop, LoopSettings, run_loop
from sim.loop.run_result import RunResult
from sim.loop.warmup import exercise
from sim.loop.work_places import work_places
from sim.people.arm import HumanArm
from sim.people.arm_path import Person
from sim.people.human_motion import HumanMotion, make_motion
from sim.people.scenes import before_work_places
from sim.run.report import print_report
from sim.run.request import RunRequest
from sim.terminal.progress import Bars

DEMO = LoopSettings(duration_s=30.0, keep_paths=8)
REHEARSAL_S = 3.0  # [s] simulated before time is measured


class PlacesTask:
    """To and fro between two work places, perhaps with a ball in the hand.

    `live`, a `sim.keyboard.KeyboardPerson`, moves the person; None: a script or a
    recording.
    """

    cell_map: CellMap

    def __init__(self, request: RunRequest, live: object | None = None) -> None:
        self.request, self.live = request, live

    def person(self) -> HumanMotion:
        """Return the person; a wrong name or file is refused before any work."""
        if self.live is not None:
            return self.live.arm(Person(HumanArm.sized()))
        return person_of(self.request)

    def open(self, tell: Progress) -> None:
        """Load the map and find the places."""
        self.cell_map = load_map(self.request.map_dir)
        self._planner, _ = self._new_planner()
        self.places = find_places(self._planner)

    def loop(self, person: HumanMotion, settings: LoopSettings) -> Loop:
        """Compile everything, then return a loop whose planner knows nothing of it."""
        if self.live is None:
            person = before_work_places(person, self._planner.robot, self.places)
        stand_in = person if self.live is None else make_motion("reach")
        warm_up(self._planner, self.places, stand_in, settings)
        self._planner, robot = self._new_planner()
        return Loop(self._planner, robot, self.places, person, settings)

    def _new_planner(self) -> tuple[ReactivePlanner, Robot]:
        """Return a planner that knows the scene, and the robot with what it holds."""
        planner = ReactivePlanner(self.cell_map)
        robot = take_ball(planner, self.request.carry)
        set_up_scene(planner, self.request.scene)
        return planner, robot

    def figures(self, loop: Loop, result: RunResult) -> dict:
        """Return the figures of the same run with nobody there, by "alone"."""
        self._alone = None
        if self.live is not None:
            return {}
        bare = replace(loop.settings, keep_paths=0)
        with Bars("the same with nobody there"):
            self._alone = run_loop(loop.planner, loop.robot, self.places, None, bare)
        return {"alone": self._alone.summary()}

    def show(self, result: RunResult, figures: dict) -> None:
        """Print the tables."""
        print_report(result, self._alone, self.cell_map.hash)


def set_up_scene(planner: ReactivePlanner, path: Path | None) -> None:
    """Let the objects of a scene file stand around; None: no file."""
    if path is not None:
        planner.scene.load(path)
        planner.scene.test_waiting()


def person_of(request: RunRequest) -> HumanMotion:
    """Return the scripted or recorded motion of a request."""
    if request.motion != "mocap":
        return make_motion(request.motion, request.seed)
    from sim.people.mocap import MocapSettings, load_mocap

    stand = request.stand
    if stand is not None:
        stand = (stand[0], stand[1], math.radians(stand[2]))
    settings = MocapSettings(
        stand=stand,
        base_height=request.base_height,
        accept_defects=request.accept_defects,
    )
    return load_mocap(request.file, mapping=request.mapping, settings=settings)


def find_places(planner: ReactivePlanner) -> np.ndarray:
    """Return two free work places, (2, dof), left and right in front of the robot."""
    return work_places(planner.robot, planner.cell_map.roadmap, planner.is_free)


def warm_up(
    planner: ReactivePlanner,
    places: np.ndarray,
    human: HumanMotion,
    settings: LoopSettings,
) -> None:
    """Run a few frames so that everything is compiled before time is measured."""
    exercise(planner.cell_map)
    brief = replace(settings, duration_s=REHEARSAL_S, keep_paths=0)
    run_loop(planner, planner.robot, places, human, brief)
    tool = tool_pose(planner.robot, places[0])[:3, 3]
    touching = Obstacles(capsules=np.r_[tool, tool, 0.05][None])
    answer = planner.step(touching, q=places[0])
    planner.separation(places[0])
    _ = answer.reason, answer.retreat
    # what was loaded stays: looking for garbage in it takes 70 ms, in some frame
    gc.collect()
    gc.freeze()
