"""A recorded run, run again: the same person, places and settings."""

from dataclasses import fields
from shlex import quote

import numpy as np

from odm import CellMap, PlannerSettings, ReactivePlanner, Recipe, build_map
from odm.cell_map.recipe import recipe_of_map
from roadmap.builds.chunks import Progress
from roadmap.errors import BadInput
from roadmap.loading.held_link import with_payload
from roadmap.robot.robot import Robot
from sim.loop.loop import Loop, LoopSettings
from sim.record.record_check import BadRecord
from sim.record.recorder import Recorder
from sim.record.run_record import NOBODY, RunRecord
from sim.record.standing import set_up


class ReplayedPerson:
    """The person of a recording, frame by frame, as a `HumanMotion`.

    Where the recording tells what was seen from what was guessed, it has `guess` too.
    """

    def __init__(self, record: RunRecord) -> None:
        motion = record.head["motion"]
        self.record, self.name = record, motion["name"]
        self.max_speed, self.notes = motion["max_speed"], tuple(motion["notes"])
        if "guess" in record.arrays:
            self.guess = lambda t: self.record.person("guess", self.frame_at(t))

    def capsules(self, t: float) -> np.ndarray:
        """Return the (k, 7) capsules of the frame at time `t` [s], in m."""
        return self.record.person("capsules", self.frame_at(t))

    def frame_at(self, t: float) -> int:
        """Return the number of the frame at time `t` [s]."""
        frame = round(t * self.record.rate_hz)
        if not 0 <= frame < self.record.frames:
            last = self.record.arrays["time_s"][-1]
            raise BadInput(
                f"the recorded person was asked for at {t:g} s, but the recording "
                f"goes from 0 to {last:g} s; run no longer than it"
            )
        return frame


def run_again(
    record: RunRecord, cell_map: CellMap, progress: Progress | None = None
) -> RunRecord:
    """Run a recorded run again on its map, and return the recording of that."""
    check_map(record, cell_map)
    return recorded_again(record, Recorder(_loop(record, cell_map), cell_map), progress)


def recorded_again(
    record: RunRecord, recorder: Recorder, progress: Progress | None = None
) -> RunRecord:
    """Run the loop of a recorder, not begun, for as many frames as a recording has."""
    for i in range(1, record.frames + 1):
        recorder.add(recorder.loop.frame())
        if progress is not None and (i % 50 == 0 or i == record.frames):
            progress("frames", i, record.frames)
    return recorder.record()


def planner_of(record: RunRecord, cell_map: CellMap) -> ReactivePlanner:
    """Return the planner of a recording: its settings, its hand, what stands around."""
    told = record.head["planner"]
    settings = known(PlannerSettings, told["settings"])
    planner = ReactivePlanner(cell_map, told["always_replan"], settings)
    if "payload" in record.arrays:
        planner.attach(record.arrays["payload"])
    set_up(planner, record.scene)
    return planner


def check_map(
    record: RunRecord, cell_map: CellMap, path: object = "FILE", folder: object = ""
) -> None:
    """Refuse another map than the recorded one; tell how to build the right one.

    `path` and `folder`, of recording and map, are named in the sentence.
    """
    wanted = record.head["map"]
    if cell_map.hash == wanted["hash"]:
        return
    raise BadRecord(
        f"the run was recorded on map {wanted['name']} {wanted['hash'][:12]}, but the "
        f"map{folder and f' in {folder}'} is {cell_map.recipe.name} "
        f"{cell_map.hash[:12]}; build the right one with `odm replay "
        f"{quote(str(path))} --build DIR`, or write its recipe with --recipe-out"
    )


def check_built(record: RunRecord, cell_map: CellMap, folder: object) -> None:
    """Refuse a map built from a recording where this version builds another one."""
    wanted, written = record.head["map"]["hash"], record.head["versions"]
    if cell_map.hash != wanted:
        raise BadRecord(
            f"the map built in {folder} has the hash {cell_map.hash[:12]}, not "
            f"{wanted[:12]}: these versions, or this processor, build another one from "
            "the same recipe; use odm-planner "
            f"{written.get('odm-planner', '')} with numpy {written.get('numpy', '')}, "
            "which recorded the run, or ask for the map's folder"
        )


def recipe_of(record: RunRecord) -> Recipe:
    """Return the recipe of the map of a recording."""
    return recipe_of_map(record.head["map"]["recipe"])


def robot_of(record: RunRecord) -> Robot:
    """Return the robot of a recording: no URDF is needed."""
    arrays = record.arrays.items()
    robot = {k.removeprefix("robot."): a for k, a in arrays if k.startswith("robot.")}
    return Robot.from_store(record.head["robot"], robot)


def build_again(
    record: RunRecord, threads: int = 0, progress: Progress | None = None
) -> CellMap:
    """Return the map of a recording, built anew; it has a hash once it was saved."""
    return build_map(recipe_of(record), threads, progress, robot_of(record))


def _loop(record: RunRecord, cell_map: CellMap) -> Loop:
    head, planner = record.head, planner_of(record, cell_map)
    nobody, robot = head["motion"]["name"] == NOBODY, planner.robot
    if planner.attached is not None:
        robot = with_payload(robot, planner.attached)
    return Loop(
        planner,
        robot,
        record.arrays["places"],
        None if nobody else ReplayedPerson(record),
        known(LoopSettings, head["settings"]),
    )


def known(kind: type, table: dict) -> object:
    """Return settings of a kind from a recording; none may be unknown here."""
    unknown = sorted(set(table) - {f.name for f in fields(kind)})
    if unknown:
        raise BadRecord(
            f"the recording sets {unknown[0]} = {table[unknown[0]]}, which this "
            "version of odm-planner does not know; replay it with the one that wrote it"
        )
    rows = {k: tuple(v) for k, v in table.items() if isinstance(v, list)}
    return kind(**table | rows)
