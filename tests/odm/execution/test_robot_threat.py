"""What another robot may still sweep holds all that it then does."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small import DATA

from odm.exact.distances import ExactRobot
from odm.execution.robot_spheres import RobotSpheres
from odm.execution.robot_threat import (
    Stretch,
    intent_of,
    intent_threat,
    limits_threat,
)
from odm.execution.settings import ExecutionSettings, IntentSettings
from odm.obstacles.shapes import Sphere
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.motion.motion import time_path
from roadmap.transforms import pose_of

T = pose_of((0.9, 0.1, 0.0), (0.0, 0.0, 3.0))


@pytest.fixture(scope="module")
def spheres():
    return RobotSpheres(load_robot(DATA / "arm3.urdf", tip="tool"))


def motion_of(robot, rng, scale=0.7):
    path = rng.uniform(robot.lower, robot.upper, (4, robot.dof))
    return time_path(robot, path, speed_scale=scale)


def held(rows, there):
    """Whether each sphere (n, 4) is inside the one of its number in any of the sets."""
    sets = rows.reshape(-1, len(there), 4)
    off = np.linalg.norm(sets[:, :, :3] - there[:, :3], axis=2) + there[:, 3]
    return bool((off <= sets[:, :, 3] + 1e-9).any(axis=0).all())


def test_a_sphere_is_told_by_the_link_of_the_other_robot(spheres):
    robot = spheres.robot
    found = spheres.obstacles(np.zeros(robot.dof), T)
    links = [robot.link_names[k] for k in robot.sphere_link[robot.moving]]
    told = [found.name(k) for k in range(len(found))]
    assert len(set(links)) > 1 and told == [
        f"sphere {k} ({link} of the other robot)" for k, link in enumerate(links)
    ]


def test_the_spheres_hold_the_links_where_the_joints_bring_them(spheres, rng):
    """A ball that touches no sphere is as far from the exact solids, at least."""
    robot = spheres.robot
    exact, apart = ExactRobot(robot), 0
    for _ in range(60):
        q = rng.uniform(robot.lower, robot.upper)
        p = rng.uniform([-0.9, -0.9, 0.0], [0.9, 0.9, 1.2])
        rows = spheres.at(q)
        gap = (np.linalg.norm(rows[:, :3] - p, axis=1) - rows[:, 3]).min()
        true = exact.distance(q, [Sphere(0.01, pose_of(p, (0.0, 0.0, 0.0)))]).distance
        if gap > 0.01:
            apart += 1
            assert true >= gap - 0.01 - 1e-6
        placed = spheres.at(q, T)
        assert np.allclose(placed[:, :3], rows[:, :3] @ T[:3, :3].T + T[:3, 3])
    assert apart > 20


def test_an_intent_holds_the_whole_motion_at_all_times(spheres, rng):
    for _ in range(6):
        motion = motion_of(spheres.robot, rng)
        begin = rng.uniform(0.0, motion.duration)
        end = min(begin + rng.uniform(0.0, 0.4), motion.duration)
        threat = intent_threat(spheres, (Stretch(motion, begin, end),), T)
        for t in rng.uniform(begin, end, 60):
            assert held(threat.swept.spheres, spheres.at(motion.at(t).q, T))
        # the same at all times: nobody has to be on time
        assert threat.between(0.0, 0.01)[0] is threat.between(0.3, 0.5)[0]
        assert threat.between(0.0, 0.01)[1] == 0.0


def test_an_intent_holds_what_comes_before_its_stop_begins(spheres):
    path = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    motion, t, later = time_path(spheres.robot, path), 0.6, 0.2
    stop = motion.stop(t + later)
    moves = SimpleNamespace(
        motion=motion, t=t, held=stop, held_t=-later, settings=ExecutionSettings()
    )
    threat = intent_threat(spheres, intent_of(moves), T)
    for dt in np.linspace(0.0, later, 9):
        assert held(threat.swept.spheres, spheres.at(motion.at(t + dt).q, T))


def test_who_follows_late_tells_no_intent(spheres):
    late = SimpleNamespace(settings=ExecutionSettings(latency_s=0.02))
    with pytest.raises(BadInput, match=r"up to 0.02 s late .* limits_threat"):
        intent_of(late)


def test_an_intent_holds_a_joint_that_speeds_up_all_the_time(spheres):
    """The elbow alone, by which spheres are moved by all that is reckoned with."""
    motion = time_path(spheres.robot, np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]))
    times = np.linspace(0.0, 0.5 * motion.duration, 400)
    begin = times[np.argmax([motion.at(t).ddq[1] for t in times])]
    end = begin + IntentSettings().step_s
    threat = intent_threat(spheres, (Stretch(motion, begin, end),), T)
    for t in (begin, end):
        assert held(threat.swept.spheres, spheres.at(motion.at(t).q, T))


def test_a_robot_at_rest_intends_to_stay(spheres):
    still = time_path(spheres.robot, np.zeros((1, 3)))
    threat = intent_threat(spheres, (Stretch(still, 0.0, 0.0),), T)
    assert threat.displacement_bound(0.1) == 0.0 and threat.fastest == 0.0
    assert np.allclose(threat.swept.spheres, spheres.at(np.zeros(3), T))


def test_the_limits_hold_what_a_robot_can_do(spheres, rng):
    for _ in range(8):
        motion = motion_of(spheres.robot, rng)
        now = rng.uniform(0.0, motion.duration)
        point = motion.at(now)
        threat = limits_threat(spheres, T, point.q, point.dq, speed_scale=0.7)
        for begin, end in ((0.0, 0.0), (0.0, 0.05), (0.1, 0.13), (0.3, 0.3)):
            there, more = threat.between(begin, end)
            assert more == 0.0
            for t in np.linspace(begin, end, 7):
                assert held(there.spheres, spheres.at(motion.at(now + t).q, T))


def test_the_limits_hold_a_robot_that_turns_round(spheres):
    """Its elbow, which alone can: it goes back at full speed for most of a second."""
    q, dq = np.zeros(3), np.array([0.0, spheres.robot.max_velocity[1], 0.0])
    threat = limits_threat(spheres, T, q, dq)
    threat = replace(threat, acceleration=threat.acceleration * [0.0, 1.0, 0.0])
    there, more = threat.between(1.0, 1.0)
    assert more == 0.0
    assert held(there.spheres, spheres.at(q - 0.5 * dq, T))


def test_old_data_make_the_spheres_larger(spheres):
    q, dq = np.zeros(3), np.full(3, 0.2)
    fresh = limits_threat(spheres, T, q, dq)
    stale = limits_threat(spheres, T, q, dq, age=0.1)
    sizes = [t.between(0.0, 0.1)[0].spheres[:, 3] for t in (fresh, stale)]
    assert (sizes[1] > sizes[0]).any() and (sizes[1] >= sizes[0]).all()
    assert stale.displacement_bound(0.1) > fresh.displacement_bound(0.1)


@pytest.mark.parametrize("age", [None, np.nan, np.inf, -0.1])
def test_data_of_unknown_age_make_it_be_anywhere(spheres, age):
    threat = limits_threat(spheres, T, np.zeros(3), np.zeros(3), age=age)
    assert threat.between(0.0, 0.1)[1] == np.inf


def test_a_robot_whose_joints_are_not_known_is_refused(spheres):
    q = np.array([0.0, np.nan, 0.0])
    for state in ((q, np.zeros(3)), (np.zeros(3), q)):
        with pytest.raises(BadInput, match="of the other robot"):
            limits_threat(spheres, T, *state)


def test_a_robot_faster_than_it_says_is_refused(spheres):
    dq = np.array([10.0, 0.0, 0.0])
    with pytest.raises(BadInput, match="more than"):
        limits_threat(spheres, T, np.zeros(3), dq, speed_scale=0.1)
    with pytest.raises(BadInput, match="3 finite"):
        limits_threat(spheres, T, np.zeros(3), np.zeros(2))
    with pytest.raises(BadInput, match="dq must be an array of real numbers"):
        limits_threat(spheres, T, np.zeros(3), "still")
    for share in (np.nan, -0.1, "half"):
        with pytest.raises(BadInput, match="speed_scale is .* a number from 0"):
            limits_threat(spheres, T, np.zeros(3), np.zeros(3), speed_scale=share)


def test_spheres_are_of_a_robot():
    with pytest.raises(BadInput, match="robot is 'ur5' .str.; give what load_robot"):
        RobotSpheres("ur5")
