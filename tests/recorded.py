"""A small map and runs on it, for the tests of recordings."""

import io
import json
import zipfile
from dataclasses import replace

import numpy as np

from odm import ReactivePlanner
from odm.cell_map.recipe import Recipe, RobotRecipe
from roadmap.graph.connecting import RoadmapSettings
from sim.loop.loop import Loop, LoopSettings
from sim.people.arm import HumanArm
from sim.people.arm_path import Person
from sim.people.human_motion import make_motion
from sim.record import Recorder, write_record

PLACES = np.array([[0.9, 0.0], [-0.9, 0.3]])
NEAR = Person(HumanArm.sized(), (0.85, 0.0, 0.5))  # in the way of the crane


def crane_recipe(urdf, name="crane", nodes=150):
    """Return the recipe of a quick map of the crane."""
    robot = RobotRecipe(source=str(urdf), tip="jib")
    return Recipe(name, robot, RoadmapSettings(nodes=nodes, neighbors=8))


def new_loop(cell_map, motion="sweep", **settings):
    """Return a loop that was not begun; a motion's name puts it within reach."""
    planner = ReactivePlanner(cell_map)
    if isinstance(motion, str):
        motion = make_motion(motion, 0, NEAR)
    asked = LoopSettings(**({"duration_s": 3.0} | settings))
    return Loop(planner, planner.robot, PLACES, motion, asked)


def recorded(loop, cell_map):
    """Run a loop for its whole duration and return its recording."""
    recorder = Recorder(loop, cell_map)
    for _ in range(round(loop.settings.duration_s * loop.settings.rate_hz)):
        recorder.add(loop.frame())
    return recorder.record()


def with_array(record, **arrays):
    """Return a recording with other arrays, as if it had been made that way."""
    return replace(record, arrays=record.arrays | arrays)


def tampered(path, out, member, change):
    """Copy a recording and change one member: an array, or the head as a dict."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    if member.endswith(".json"):
        value = json.loads(members[member])
        members[member] = json.dumps(change(value) or value).encode()
    else:
        value = np.load(io.BytesIO(members[member]))
        stream = io.BytesIO()
        found = change(value)
        np.save(stream, value if found is None else found)
        members[member] = stream.getvalue()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out


def same_bytes(a, b, folder):
    """Return whether two recordings make the same file."""
    files = [write_record(r, folder / f"{k}.npz") for k, r in enumerate((a, b))]
    return files[0].read_bytes() == files[1].read_bytes()
