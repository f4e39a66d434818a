"""Arguments of another kind are told in a sentence, not by an error from within."""

import warnings

import numpy as np
import pytest
from rows import each
from small import HOME

import odm
from odm.execution import (
    CloudThreat,
    ExecutionSettings,
    Executor,
    MissingParts,
    RobotSpheres,
    ThreatSettings,
    Watcher,
    intent_of,
    intent_threat,
    limits_threat,
    slowest_stop,
)
from odm.execution.kinematic import KinematicMover
from odm.execution.speed_limit import SpeedLimit
from odm.obstacles.shapes import Sphere
from roadmap.errors import BadInput

HUGE = 10**400  # no float can hold it
NOBODY = np.zeros((0, 7))


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda m, p: odm.load_map("nowhere", robot=3), "robot is 3"),
        (lambda m, p: odm.SeenSpace(m, [], 3), "settings is 3"),
        (lambda m, p: Executor(m.robot, p, HOME, 0.01, 3), "settings is 3"),
        (
            lambda m, p: Executor(m.robot, p, HOME, 0.01).limit_speed("half"),
            "share of the speed is 'half'",
        ),
        (
            lambda m, p: Executor(m.robot, p, HOME, 0.01).limit_speed(np.nan),
            "share of the speed is nan",
        ),
        (lambda m, p: odm.Obstacles.of(3), "shapes is 3"),
        (
            lambda m, p: odm.Obstacles(capsules=1, labels={"capsules": 3}),
            "labels of capsules is 3",
        ),
        (
            lambda m, p: odm.Obstacles(capsules=1, classes={"capsules": 3}),
            "classes of capsules is 3",
        ),
    ],
)
def test_what_is_of_another_kind_is_told(small_map, planner, call, told):
    with pytest.raises(BadInput, match=told):
        call(small_map, planner)


def missing(**how):
    return lambda m, p: MissingParts(**how)


def cloud(points=((0.0, 0.0, 1.0),), age=0.0, settings=ThreatSettings()):
    return lambda m, p: CloudThreat(points, age, settings)


def camera(number=0.0):
    pose = odm.cameras.look_at([0.0, -2.0, 1.0], [0.0, 0.0, 0.5])
    return odm.DepthCamera(320, 240, 300.0, 300.0, 159.5, 119.5, pose)


def limits(m, spheres=None, age=0.0, **how):
    spheres = RobotSpheres(m.robot) if spheres is None else spheres
    pose = how.get("pose", np.eye(4))
    return limits_threat(spheres, pose, HOME, 0.0 * HOME, age)


@each(
    "call, told",
    [
        (missing(kept_s=None), "kept_s [s] is None"),
        (missing(speed=np.zeros(2)), "speed [m/s] is array"),
        (missing(noise=HUGE), "noise [m] is 1000"),
        (missing(most=np.nan), "most is nan, but must be a whole number"),
        (missing(most="all"), "most is 'all'"),
        (
            lambda m, p: MissingParts().complete(NOBODY, [], HUGE),
            "now is 1000",
        ),
        (lambda m, p: Watcher().look(NOBODY, HUGE), "now is 1000"),
        (lambda m, p: Watcher().look(NOBODY, 0.0, HUGE), "capsules is 1000"),
        (cloud(points="points"), "the points of a cloud must be an array"),
        (cloud(points=[1.0, 2.0]), "shape (2,); give (n, 3) [m]"),
        (cloud(age="old"), "the age of the points is 'old'"),
        (cloud(settings=None), "settings is None (NoneType); give ThreatSettings"),
        (lambda m, p: intent_of(m), "executor is"),
        (lambda m, p: intent_threat(m.robot, (), np.eye(4)), "spheres is"),
        (
            lambda m, p: intent_threat(RobotSpheres(m.robot), None, np.eye(4)),
            "intent is None (NoneType); give what intent_of returns",
        ),
        (
            lambda m, p: intent_threat(RobotSpheres(m.robot), (1,), np.eye(4)),
            "a part of intent is 1",
        ),
        (lambda m, p: limits(m, spheres=m.robot), "give RobotSpheres(...)"),
        (lambda m, p: limits(m, age="old"), "joints is 'old'"),
        (lambda m, p: limits(m, pose=np.ones((4, 4))), "T_base_other"),
        (lambda m, p: RobotSpheres(m.robot).moved([1.0]), "dq has shape (1,)"),
        (
            lambda m, p: slowest_stop(
                m.robot, ExecutionSettings(), 0, ThreatSettings()
            ),
            "period [s] is 0, but must be a number from 0.0001 to 10",
        ),
        (lambda m, p: SpeedLimit("panda"), "a robot is 'panda'"),
        (lambda m, p: KinematicMover("panda", p, HOME, 0.01), "a robot is 'panda'"),
        (lambda m, p: KinematicMover(m.robot, p, "home", 0.01), "q must be an array"),
        (lambda m, p: KinematicMover(m.robot, p, HOME[:2], 0.01), "q"),
        (lambda m, p: KinematicMover(m.robot, p, HOME, "x"), "period of a mover"),
        (lambda m, p: camera().from_metres(1.5), "the depths have shape (); give (240"),
        (lambda m, p: odm.SeenSpace(m, np.array("x")), "a camera is"),
        (
            lambda m, p: odm.SeenSpace(m, camera()).update(
                np.full((240, 320), 900, np.uint16), HOME, HUGE
            ),
            "stamp is 1000",
        ),
        (lambda m, p: odm.SeenSettings(policy=np.zeros((2, 2))), "the policy array"),
        (lambda m, p: odm.Obstacles(capsules=HUGE), "give 0 to 1000000"),
        (
            lambda m, p: odm.PointCloud(np.zeros((1, 3)), crop=np.array("x")),
            "crop is array('x'",
        ),
        (lambda m, p: odm.surface_of(Sphere(0.1), 1e300), "at most 1000 m"),
        (lambda m, p: odm.surface_of(Sphere(0.1), label=np.zeros(2)), "label is array"),
        (lambda m, p: odm.robot_surface(m.robot, HOME, spacing=np.inf), "at most 1000"),
    ],
)
def test_what_is_of_another_kind_beside_people_is_told(small_map, planner, call, told):
    with pytest.raises(BadInput) as caught:
        call(small_map, planner)
    assert told in str(caught.value)


def test_numbers_of_numpys_are_as_good_as_pythons(small_map, planner):
    """Whole ones of 8 bits overflowed, and those of 32 bits warned in each frame."""
    points = odm.surface_of(Sphere(0.5), np.int8(1)).points
    assert np.array_equal(points, odm.surface_of(Sphere(0.5), 1).points)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Executor(small_map.robot, planner, HOME, 0.01).limit_speed(np.float32(0.5))
    settings = ExecutionSettings(speed_scale=np.float32(0.5), levels=np.int8(5))
    assert settings == ExecutionSettings(speed_scale=0.5, levels=5)
    assert type(settings.speed_scale) is float and type(settings.levels) is int
