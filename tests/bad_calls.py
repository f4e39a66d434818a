"""Calls that must end in a sentence or in a no; each is made in a process of its own.

Run as a script with the folder of a map and one of its goals: prints one JSON object,
the outcome of each call by its name.
"""

import copy
import json
import os
import pickle
import sys
import threading

import numpy as np
from command_line import ROOT

from odm.answer import Freedom
from roadmap.errors import PlanningError

FREE = "free"
FAR = np.zeros((4, 4))
FAR[:3, 3] = [600.0, 0.0, 500.0]
FACES = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]]


def calls(odm, planner, hand, home):
    """Return the calls by name; each returns what it was told, or raises."""
    import handover
    from odm.execution import ExecutionSettings, slowest_stop
    from odm.execution.stop_test import BrakingTest
    from odm.execution.threat import Threat, ThreatSettings
    from odm.obstacles.scenery import parse_scenery
    from odm.obstacles.shapes import Box
    from roadmap import load_robot, time_path, tool_pose

    nan, robot = np.nan, planner.robot
    far_box = Box([0.1, 0.1, 0.1], Box([1.0, 1.0, 1.0]).T_base_shape + FAR)
    still = time_path(robot, home[None])
    camera = odm.DepthCamera(64, 48, 50.0, 50.0, 32.0, 24.0, np.eye(4))

    def elsewhere(question):
        told = []

        def ask():
            try:
                told.append(question())
            except PlanningError as error:
                told.append(error)

        thread = threading.Thread(target=ask)
        thread.start()
        thread.join()
        if isinstance(told[0], Exception):
            raise told[0]
        return told[0]

    def after(points, question, **how):
        """Ask a question behind a frame of a hand in the arm and another frame."""
        planner.step(hand, q=home, stamp=1.0, now=1.0)
        answer = planner.step(points, q=home, **how)
        return answer.reason if question is None else question()

    def in_motion(points, velocity, age):
        balls = np.hstack([points, points, np.full((len(points), 1), 0.01)])
        known = np.full(len(points), np.inf if velocity is None else 0.0)
        velocity = np.zeros_like(points) if velocity is None else velocity
        rates = np.stack([velocity, velocity], axis=1)
        threat = Threat(balls, rates, known, age, ThreatSettings())
        return BrakingTest(planner).passes(still, 0.0, 0.0, still, threat)

    def refilled():
        mine = hand.copy()
        planner.step(mine, q=home)
        mine[:] = 5.0
        return planner.is_free(home, home)

    huge = 10**400  # no float can hold it
    broken = hand.copy()
    broken[3, 1] = nan
    empty = np.zeros((0, 3))
    late = {"stamp": 0.5}
    return {
        "deepcopy": lambda: copy.deepcopy(planner),
        "copy": lambda: copy.copy(planner),
        "pickle": lambda: pickle.dumps(planner),
        "pickle of its memory": lambda: pickle.dumps(planner.memory),
        "another cloud": lambda: setattr(planner.memory, "cloud", None),
        "is_free in a thread": lambda: elsewhere(lambda: planner.is_free(home, home)),
        "step in a thread": lambda: elsewhere(lambda: planner.step(hand, q=home)),
        "separation in a thread": lambda: elsewhere(lambda: planner.separation(home)),
        "blocked_leg, extra NaN": lambda: planner.blocked_leg(home[None], nan),
        "blocked_leg, extra huge": lambda: planner.blocked_leg(home[None], huge),
        "a huge stamp": lambda: planner.step(hand, q=home, stamp=huge),
        "a huge now": lambda: planner.step(hand, q=home, stamp=1.0, now=huge),
        "a huge rounding": lambda: planner.step(hand, q=home, rounding=huge),
        "huge spheres in the hand": lambda: planner.attach([[huge, 0, 0, 1]]),
        "a huge spacing": lambda: odm.surface_of(odm.Sphere(0.1), huge),
        "blocked_leg, path NaN": lambda: planner.blocked_leg(home[None] * nan),
        "blocked_leg, points (n, 2)": lambda: planner.blocked_leg(
            home[None], 0.0, np.zeros((4, 2))
        ),
        "blocked_leg, points NaN": lambda: planner.blocked_leg(
            home[None], 0.0, np.full((4, 3), nan)
        ),
        "braking, age unknown": lambda: in_motion(hand, None, None),
        "braking, age NaN": lambda: in_motion(hand, np.zeros_like(hand), nan),
        "braking, velocity NaN": lambda: in_motion(hand + 9.0, hand * nan, 0.0),
        "stands_clear, q NaN": lambda: planner.stands_clear(home * nan),
        "separation, q NaN": lambda: planner.separation(home * nan),
        "separation, q short": lambda: planner.separation(home[:-1]),
        "is_free, q of text": lambda: planner.is_free(["a"] * robot.dof, home),
        "separation behind NaN": lambda: after(
            broken * nan, lambda: planner.separation(home) > 0.0
        ),
        "is_free behind NaN": lambda: after(
            broken, lambda: planner.is_free(home, home)
        ),
        "is_free behind a stale frame": lambda: after(
            empty, lambda: planner.is_free(home, home), **late
        ),
        "blocked_leg behind a stale frame": lambda: after(
            empty, lambda: planner.blocked_leg(home[None]), **late
        ),
        "a frame older than the last": lambda: after(empty, None, **late),
        "a frame of no age": lambda: after(empty, None, stamp=nan, now=2.0),
        "millimetres": lambda: after(1000.0 * hand, None),
        "centimetres": lambda: after(100.0 * (hand + 1.0), None),
        "a buffer filled anew": refilled,
        "no goals": lambda: planner.set_goals([]),
        "a goal of NaN": lambda: planner.set_goals([home * nan]),
        "ragged goals": lambda: planner.set_goals([home, home[:-1]]),
        "goals of text": lambda: planner.set_goals("home"),
        "improve of NaN": lambda: planner.improve(nan),
        "a plane of NaN": lambda: parse_scenery(({"type": "plane", "offset": nan},)),
        "a box at NaN": lambda: parse_scenery(
            ({"type": "box", "size": [1, 1, 1], "position": [nan, 0, 0]},)
        ),
        "a shape of NaN": lambda: planner.set_static([Box([1.0, nan, 1.0])]),
        "start_connections 0": lambda: odm.PlannerSettings(start_connections=0),
        "point_capacity -1": lambda: odm.PlannerSettings(point_capacity=-1),
        "cached_goals -1": lambda: odm.PlannerSettings(cached_goals=-1),
        "waypoints beyond the limits": lambda: time_path(
            robot, np.stack([home, home + 9.0])
        ),
        "a base that shears": lambda: planner.set_base(np.triu(np.ones((4, 4)))),
        "clearance NaN": lambda: planner.set_extra_clearance(nan),
        "a stamp of text": lambda: after(hand, None, stamp="now", now=1.0),
        "a tolerance without poses": lambda: planner.set_goals([home], tolerance=0.01),
        "a path before its robot": lambda: time_path(home[None], robot),
        "an answer in place of its path": lambda: time_path(robot, planner),
        "an object before its name": lambda: planner.scene.add(far_box, "box"),
        "a map saved where nothing can be": lambda: planner.cell_map.save("/proc/x/y"),
        "one mesh and no list": lambda: odm.Obstacles(meshes=far_box),
        "a mesh of a kilometre": lambda: odm.Mesh(2e3 * np.eye(4)[:, :3], FACES),
        "an object in millimetres": lambda: planner.scene.add("box", far_box),
        "a planner of a path": lambda: odm.ReactivePlanner("map"),
        "settings that are a dict": lambda: odm.ReactivePlanner(
            planner.cell_map, settings={"hysteresis": 0.1}
        ),
        "a map that is a number": lambda: odm.load_map(5),
        "a recipe that is a dict": lambda: odm.build_map({"robot": {}}),
        "the tool at too many joints": lambda: tool_pose(robot, np.zeros(9)),
        "a set-point at a text": lambda: still.at("end"),
        "samples at a text": lambda: still.sample("x"),
        "a commit point at a text": lambda: still.commit("x"),
        "joined at no commit point": lambda: still.join(0.0, home, home[None]),
        "the tool of a name": lambda: tool_pose("panda", home),
        "the surface of a name": lambda: odm.robot_surface("panda", home),
        "somebody comes, no pairs": lambda: planner.evasion(home, [hand], 0.5),
        "somebody comes at a text": lambda: planner.evasion(home, [("x", hand)], 0.5),
        "a period of text": lambda: slowest_stop(
            robot, ExecutionSettings(), "x", ThreatSettings()
        ),
        "a cover of text": lambda: load_robot(
            ROOT / "maps" / "plain_arm.urdf", tip="tool", cover_excess="x"
        ),
        "a camera's thinnest at a text": lambda: camera.thinnest("x"),
        "a camera's radius at a text": lambda: camera.covering_radius("x"),
        "shapes of an array of none": lambda: odm.Obstacles.of(np.array(1.0)),
        "names of an array of none": lambda: odm.Obstacles(
            capsules=1, labels={"capsules": np.array("arm")}
        ),
        "classes of an array of none": lambda: odm.Obstacles(
            capsules=1, classes={"capsules": np.array(1)}
        ),
        "what a shape of a text is called": lambda: odm.Obstacles(capsules=1).name("x"),
        "a crop by a huge number": lambda: odm.PointCloud(np.eye(3), crop=10**400),
        "a camera at complex numbers": lambda: odm.cameras.look_at(
            np.ones(3) * 1j, np.zeros(3)
        ),
        "a camera as wide as a huge number": lambda: odm.DepthCamera(
            10**400, 48, 50.0, 50.0, 32.0, 24.0, np.eye(4)
        ),
        "masked capsules": lambda: (
            planner.step(
                odm.Obstacles(capsules=np.ma.masked_array(np.full((1, 7), 9.0), True)),
                home,
            ).reason
        ),
        "what is seen of no map": lambda: odm.SeenSpace("map", camera),
        "a person of no place": lambda: handover.Human().placed("x", 0.0, 0.0),
        "a person of text": lambda: handover.human_from_joints("x"),
        "a scene that is a number": lambda: handover.load_scene(5),
        "an object that is a number": lambda: handover.load_object(5),
        "a reach map that is a number": lambda: handover.load_reach_map(5),
        "nobody to meet": lambda: handover.InteractionWorkspace(
            "reach", handover.Human(), handover.wrench()
        ),
        "the quality of nobody": lambda: handover.posture_quality("x", np.zeros(7)),
        "an array as a speed": lambda: time_path(
            robot, home[None], speed_scale=np.eye(3)
        ),
    }


def outcome(odm, call):
    """Return what a user learns: a sentence, "no", or FREE."""
    try:
        told = call()
    except PlanningError as error:
        return str(error)
    if isinstance(told, str):
        return told  # the reason of a hold
    if isinstance(told, Freedom) and not told:
        return told.reason
    # a leg's number, or False: blocked
    blocked = isinstance(told, int) and (told is not True) and told == 0
    return "no" if blocked else f"{FREE}: {told!r}"


def main(folder, home):
    """Make each call in a fork of this process; print the outcomes."""
    import odm

    planner = odm.ReactivePlanner(odm.load_map(folder, verify=False))
    home = np.array(home)
    planner.set_goals([home])
    centers = planner.robot.spheres[planner.robot.moving][:1, :3] * 0.0
    hand = odm.sample_capsules(np.array([[*centers[0], 0.0, 0.0, 1.6, 0.2]]), 0.03)
    planner.step(hand, q=home)
    outcomes = {}
    for name in calls(odm, planner, hand, home):
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            text = outcome(odm, calls(odm, planner, hand, home)[name])
            os.write(write, text.encode())
            os._exit(0)
        os.close(write)
        with os.fdopen(read, "rb") as stream:
            text = stream.read().decode()
        _, status = os.waitpid(child, 0)
        code = os.waitstatus_to_exitcode(status)
        outcomes[name] = text if code == 0 else f"ended with {code}"
    print(json.dumps(outcomes))


if __name__ == "__main__":
    main(sys.argv[1], [float(x) for x in sys.argv[2:]])
