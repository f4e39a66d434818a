"""A robot begins to hold a moment after its planner, while its stop stays free."""

from types import SimpleNamespace

import numpy as np
import pytest

import odm
from odm.execution.executor import BRAKED, STANDING, Executor
from odm.execution.settings import ExecutionSettings, PaceSettings
from odm.execution.threat import Watcher
from roadmap.kinematics.forward import cover_balls
from roadmap.transforms import pose_of

START, END = np.array([-1.2, 0.6, 0.0]), np.array([1.2, 0.6, 0.0])
PERIOD, UNTIL = 0.01, 40  # [s], frames in which there is a path
FAR = np.array([[0.0, 0.0, 3.0, 0.0, 0.0, 3.2, 0.05]])  # somebody is about, and rests
NOWHERE = SimpleNamespace(status="holding", path=START[:0], retreat=None, reason="")


class Scene:
    """A robot half-way along a path, whose planner says what a test wants."""

    def __init__(self, cell_map, **settings):
        self.planner = odm.ReactivePlanner(cell_map)
        how = ExecutionSettings(**settings)
        self.executor = Executor(cell_map.robot, self.planner, START, PERIOD, how)
        self.watcher, self.frame = Watcher(), 0
        self.obstacles = odm.Obstacles(capsules=FAR)
        self.play(UNTIL)

    def play(self, frames, holding=False):
        """Answer some frames; return the fastest joint's speed in each [rad/s]."""
        speeds, executor = [], self.executor
        for _ in range(frames):
            commit = executor.commit()
            self.planner.step(self.obstacles, q=commit.q)
            path = np.array([commit.q, END])
            found = SimpleNamespace(status="following", path=path, reason="")
            threat = self.watcher.look(FAR, self.frame * PERIOD)
            executor.update(NOWHERE if holding else found, commit, threat)
            executor.advance()
            self.frame += 1
            speeds.append(float(np.abs(executor.set_point.dq).max()))
        return speeds

    def ahead(self):
        """Return where the tip is soon, on the way to a stop [m]."""
        executor = self.executor
        q = executor.motion.stop(executor.t).q_end
        return cover_balls(executor.robot, q)[executor.robot.moving][-1][:3]


@pytest.fixture
def scene(small_map):
    return Scene(small_map)


def test_a_path_that_is_lost_for_a_moment_is_followed_on(scene):
    before = scene.play(1)[-1]
    assert before > 0.1
    assert min(scene.play(15, holding=True)) >= before - 1e-9
    assert min(scene.play(5)) >= before - 1e-9  # as if nothing had been


def test_one_that_stays_lost_is_not(scene):
    scene.play(20, holding=True)
    assert scene.executor.state != STANDING
    speeds = scene.play(40, holding=True)
    assert scene.executor.state == STANDING
    assert speeds[-1] == 0.0


def test_each_time_it_is_lost_counts_anew(scene):
    for _ in range(3):
        scene.play(12, holding=True)
        assert scene.executor.state != STANDING
        scene.play(1)


def test_it_can_begin_to_hold_at_once(small_map):
    scene = Scene(small_map, hold_delay_s=0.0)
    scene.play(1, holding=True)
    assert scene.executor.state == STANDING


def test_what_the_frame_has_on_the_way_to_the_stop_stops_it_at_once(scene):
    at = scene.ahead()
    scene.obstacles = odm.Obstacles(capsules=FAR, points=at[None])
    scene.play(1, holding=True)
    assert scene.executor.state == STANDING


def test_what_stands_there_from_now_on_stops_it_at_once(scene):
    scene.planner.scene.add("pole", odm.Sphere(0.03, pose_of(scene.ahead())))
    scene.play(1, holding=True)
    assert scene.executor.state == STANDING


def test_a_frame_that_cannot_be_used_stops_it_at_once(scene):
    scene.obstacles = np.full((1, 3), np.nan)
    scene.play(1, holding=True)
    assert scene.executor.state == STANDING


def test_nobody_is_told_of_how_another_robot_would_go_on(scene):
    """Robots tell each other their stops: that is what they must take."""
    commit = scene.executor.commit()
    scene.planner.step(scene.obstacles, q=commit.q)
    scene.executor.update(NOWHERE, commit, None)
    assert scene.executor.state == STANDING


@pytest.mark.parametrize(
    "tremble, pace", [(0.0, {}), (0.005, {}), (0.0, dict(creeps=(1.0,), rests_s=0.0))]
)
def test_a_robot_that_brakes_at_a_person_does_not_start_and_stop(
    small_map, tremble, pace
):
    """It creeps on, or rests; it had stopped 40 times and got no farther."""
    planner = odm.ReactivePlanner(small_map)
    told = dict(pace=PaceSettings(**pace))
    executor = Executor(small_map.robot, planner, START, PERIOD, **told)
    *tip, radius = cover_balls(executor.robot, END)[executor.robot.moving][-1]
    aside = np.array([-tip[1], tip[0], 0.0]) / np.hypot(*tip[:2])
    watcher, states = Watcher(), []
    for k in range(500):
        far = radius + 0.064 + tremble * np.sin(10.0 * np.pi * k * PERIOD)
        hand = np.add(tip, far * aside)
        rows = np.array([[*hand, *hand + [0.0, 0.0, 0.2], 0.05]])
        commit = executor.commit()
        planner.step(odm.Obstacles(capsules=rows), q=commit.q)
        path = np.array([commit.q, END])
        found = SimpleNamespace(status="following", path=path, reason="")
        executor.update(found, commit, watcher.look(rows, k * PERIOD))
        executor.advance()
        states.append(executor.state == BRAKED)
    starts = np.flatnonzero(np.diff(np.array(states, int)) < 0)
    far = np.abs(executor.set_point.q - END).max()
    assert (len(starts) <= 8 and far < 0.38) != bool(pace), (len(starts), far)
