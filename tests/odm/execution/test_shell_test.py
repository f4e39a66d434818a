"""What the shells of the links let pass is apart from the person by exact geometry."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from carrying import BALLS, HIGH

import odm
import roadmap
from odm.exact.distances import ExactRobot
from odm.execution.shell_test import ShellTest
from odm.execution.stop_test import BrakingTest
from odm.execution.threat import Threat, ThreatSettings
from odm.obstacles.shapes import Capsule
from roadmap.kinematics.forward import sphere_centers, tool_pose

PERIOD = 0.01


@pytest.fixture(scope="module")
def lean(small_map):
    return odm.ReactivePlanner(small_map)


def case_of(robot, rng, near):
    """Return a motion, when its stop begins, that, and a capsule that moves."""
    q = rng.uniform(-1.0, 1.0, robot.dof)
    path = np.stack([q, q + rng.normal(0.0, 0.5, robot.dof)])
    path = np.clip(path, robot.lower, robot.upper)
    scale = rng.uniform(0.02, 0.2)
    motion = roadmap.time_path(robot, path, blend=0.0, speed_scale=scale)
    t = rng.uniform(0.0, 0.5 * motion.duration)
    begin = min(t + PERIOD, motion.duration)
    centers = sphere_centers(robot, motion.at(t).q)[robot.moving]
    radii = robot.spheres[robot.moving, 3]
    k, side = int(rng.integers(len(centers))), rng.normal(size=3)
    side /= np.linalg.norm(side)
    a = centers[k] + (radii[k] + 0.05 + near) * side
    ends = np.array([a, a + rng.uniform(0.0, 0.2) * side])
    rates = rng.uniform(-0.2, 0.2) * side + rng.normal(0.0, 0.1, (2, 3))
    return motion, t, begin, motion.stop(begin), ends, rates


def test_what_passes_keeps_its_distance_from_whoever_keeps_to_the_bounds(lean, rng):
    robot, settings = lean.robot, ThreatSettings()
    shells, cover = ShellTest(lean), BrakingTest(lean)
    exact, m = ExactRobot(robot), lean.cell_map.safety.m
    passed = within = 0
    for _ in range(700):
        case = case_of(robot, rng, rng.uniform(-0.01, 0.06))
        motion, t, begin, stop, ends, rates = case
        rows = np.r_[ends.ravel(), 0.05][None]
        # as the mean over 10 ms, of somebody who may speed up
        error = np.full(1, 0.5 * settings.acceleration * PERIOD)
        threat = Threat(rows, rates[None], error, 0.0, settings)
        least = 0.004
        if not shells.passes(motion, t, begin, stop, threat, least):
            continue
        passed += 1
        within += not cover.passes(motion, t, begin, stop, threat, closer=m)
        a = rng.normal(size=(2, 3))
        a *= settings.acceleration / np.linalg.norm(a, axis=1, keepdims=True)
        off = error[0] * a / settings.acceleration
        for s in np.linspace(0.0, begin - t + stop.duration, 12):
            before = s <= begin - t
            q = motion.at(t + s).q if before else stop.at(s - begin + t).q
            now = ends + s * (rates + off) + 0.5 * s * s * a
            there = [Capsule.between(*now, 0.05)]
            assert exact.distance(q, there).distance > least - 1e-6
    assert passed > 60 and within > 15


@pytest.mark.parametrize("what", ["age", "place", "base", "corner"])
def test_what_is_not_known_does_not_pass(lean, rng, what):
    robot, settings = lean.robot, ThreatSettings()
    motion, t, begin, stop, *_ = case_of(robot, rng, 0.0)
    rows = np.array([[3.0, 0, 0, 3.0, 0, 0.3, 0.05]])
    still, sure = np.zeros((1, 2, 3)), np.zeros(1)
    threat = Threat(rows, still, sure, 0.0, settings)
    assert ShellTest(lean).passes(motion, t, begin, stop, threat, 0.0)
    planner = lean
    if what == "age":
        threat = Threat(rows, still, sure, None, settings)
    if what == "place":
        threat = Threat(rows + [np.nan, 0, 0, 0, 0, 0, 0], still, sure, 0.0, settings)
    if what == "base":  # the person stands in the world; the base does, too
        frame = SimpleNamespace(base_world=np.eye(4))
        frame.base_world[0, 3] = -3.0
        planner = SimpleNamespace(static=lean.static, frame=frame)
        threat = Threat(rows - [0, 0, -0.2, 0, 0, -0.2, 0], still, sure, 0.0, settings)
    if what == "corner":
        q = np.zeros(robot.dof)
        path = np.stack([q, q + 0.4, q + np.r_[0.8, np.full(robot.dof - 1, 0.4)]])
        motion = roadmap.time_path(robot, path, blend=0.02)
        corner = next(p for p in motion.path.pieces if p.d > 0.0)
        times = np.linspace(0.0, motion.duration, 500)
        t = float(times[[motion.place(x) > corner.begin for x in times].index(True)])
        begin = t + PERIOD
        stop = motion.stop(begin)
    assert not ShellTest(planner).passes(motion, t, begin, stop, threat, 0.0)


def test_a_robot_some_links_of_which_have_no_shell_does_not_pass(lean, rng):
    """What its other links sweep says nothing of them."""
    robot, still = lean.robot, stays(np.array([3.0, 0, 0, 3.0, 0, 0.3, 0.05]))
    how = *case_of(robot, rng, 0.0)[:4], still, 0.0
    assert ShellTest(lean).passes(*how)
    last = len(robot.shell_link) - 1
    ptr = np.delete(robot.shell_ptr, last)
    assert robot.shell_link[last] in robot.sphere_link[robot.moving]
    bare = replace(
        robot,
        shell_link=robot.shell_link[:last],
        shell_ptr=ptr,
        shell_points=robot.shell_points[: ptr[-1]],
        shell_reach=robot.shell_reach[:last],
    )
    planner = SimpleNamespace(static=SimpleNamespace(robot=bare), frame=lean.frame)
    assert not ShellTest(planner).passes(*how)


def stays(rows, rates=0.0):
    """Return the threat of one capsule (7,) that goes on at rates (2, 3) for sure."""
    velocity = np.zeros((1, 2, 3)) + rates
    calm = ThreatSettings(acceleration=0.0, jerk=0.0)
    return Threat(np.array([rows]), velocity, np.zeros(1), 0.0, calm)


def test_the_stop_is_tested_at_its_own_times(lean):
    """Somebody comes from above, and is where the robot comes to rest by then."""
    robot = lean.robot
    motion = roadmap.time_path(robot, np.array([[-1.0, 0.6, 0.0], [1.0, 0.6, 0.0]]))
    t = 0.4 * motion.duration
    begin = t + 0.2
    stop = motion.stop(begin)
    k = np.flatnonzero(robot.moving)[-1]
    x, y, z = sphere_centers(robot, stop.q_end)[k]
    high = z + 0.2 + stop.duration  # at 1 m/s down to the middle of the sphere
    for rate, free in ((0.0, True), (-1.0, False)):
        threat = stays([x, y, high, x, y, high, 0.05], [0.0, 0.0, rate])
        how = motion, t, begin, stop, threat, 0.0
        assert ShellTest(lean).passes(*how) == free
    assert stop.duration > 0.1


def test_what_is_held_is_tested_from_then_on(carrying_map):
    planner = odm.ReactivePlanner(carrying_map)
    test, motion = ShellTest(planner), roadmap.time_path(planner.robot, HIGH[None])
    x, y, z = tool_pose(planner.robot, HIGH)[:3] @ [*BALLS[1, :3], 1.0]
    how = motion, 0.0, 0.0, motion.stop(0.0), stays([x, y, z, x, y, z, 0.01]), 0.0
    assert test.passes(*how)
    planner.attach(BALLS)
    assert not test.passes(*how)
    planner.detach()
    assert test.passes(*how)
