"""Settings that tune are heeded where they are given, not only checked."""

from types import SimpleNamespace

import numpy as np
import pytest

import handover
import odm
from handover.plans.limb import limb_of
from handover.plans.mover import Mover, solver_of
from handover.plans.settings import ProofSettings, SolveSettings
from handover.targets.allowance import Allowance
from handover.targets.settings import AllowanceSettings
from odm.execution.executor import Executor
from odm.execution.lookout import Lookout
from odm.execution.settings import (
    ExecutionSettings,
    FollowSettings,
    LookoutSettings,
    PaceSettings,
    StopTestSettings,
    TrackingSettings,
)
from odm.execution.stop_test import BrakingTest
from odm.execution.threat import Threat, ThreatSettings, Watcher
from odm.execution.tracking import TrackingMonitor
from odm.planner.improve import Cutter, Improver
from odm.planner.settings import ImproveSettings
from odm.planner.smooth import corner_gain
from roadmap.motion.motion import time_path
from sim.story.comfort import comfort_rods
from sim.story.play import Fingers
from sim.story.settings import ComfortRodSettings, ComfortSettings, GripperSettings

PERIOD = 0.01


def test_levels_of_speed_are_those_asked_for(small_map):
    settings = ExecutionSettings(0.8, levels=3, lower=0.5)
    planner = odm.ReactivePlanner(small_map)
    how = settings, PaceSettings(creeps=(0.25,))
    executor = Executor(small_map.robot, planner, np.zeros(3), PERIOD, *how)
    assert executor.scales.tolist() == [0.8, 0.4, 0.2, 0.05]
    assert settings.slowest_scale == 0.2
    executor.limit_speed(0.01)
    assert executor._least_level == 2


def test_a_robot_without_a_map_tracks_as_closely_as_it_is_told(small_map):
    robot, blind = small_map.robot, SimpleNamespace()
    for pace, off in ((PaceSettings(tracking=0.05), False), (PaceSettings(), True)):
        executor = Executor(robot, blind, np.zeros(3), PERIOD, pace=pace)
        executor.locate(np.array([0.003, 0.0, 0.0]))
        assert bool(executor.off) == off


@pytest.mark.parametrize("confirmed", [2, 3, 6])
def test_a_velocity_counts_after_the_frames_that_are_asked_for(confirmed):
    watcher = Watcher(follow=FollowSettings(confirmed=confirmed))
    known = []
    for k in range(8):
        place = np.array([[0.01 * k, 0, 0, 0.01 * k, 0, 0.3, 0.05]])
        known.append(bool(watcher.look(place, PERIOD * k).known.all()))
    assert known.index(True) == confirmed - 1 and all(known[confirmed - 1 :])


def test_who_may_be_too_far_away_may_be_anywhere():
    place, rests = np.array([[0.5, 0, 0, 0.5, 0, 0.3, 0.05]]), np.zeros((1, 2, 3))
    for most, held in ((4.0, True), (0.01, False)):
        follow = FollowSettings(most_growth=most)
        told = place, rests, np.zeros(1), 0.0, ThreatSettings()
        threat = Threat(*told, follow=follow).of(slice(None))
        assert (threat.between(0.0, 0.2)[1] == 0.0) == held


@pytest.mark.parametrize(("slice_s", "pieces"), [(0.04, 10), (0.1, 4)])
def test_a_stop_is_tested_in_pieces_of_the_length_asked_for(small_map, slice_s, pieces):
    asked = []

    def blocked_leg(path, extra, there):
        asked.append(there)
        return 0 if len(asked) == 1 else None  # the whole way at once is not free

    planner = SimpleNamespace(blocked_leg=blocked_leg)
    motion = time_path(small_map.robot, np.array([np.zeros(3), np.ones(3)]))
    still = SimpleNamespace(between=lambda begin, end: ((begin, end), 0.0))
    test = BrakingTest(planner, settings=StopTestSettings(slice_s=slice_s))
    stop = motion.stop(0.4)
    assert test.passes(motion, 0.0, 0.4, stop, still)
    assert len([there for there in asked[1:] if there[1] <= 0.4 + 1e-9]) == pieces


def test_a_robot_is_held_still_after_the_time_asked_for(small_map):
    for held_s, frames in ((0.095, 11), (0.025, 4)):
        how = TrackingSettings(held_s=held_s)
        monitor = TrackingMonitor(small_map.robot, 0.0, PERIOD, how)
        monitor.measure(np.zeros(3), np.full(3, 0.1))
        answers = [monitor.held_still(np.full(3, 0.1)) for _ in range(15)]
        assert answers.index(True) == frames - 1


def test_the_lookout_looks_as_often_as_it_is_told(small_map):
    planner = SimpleNamespace(cell_map=small_map)
    nobody = SimpleNamespace(leads_on=False)
    for between, due in ((0.02, [True, False]), (0.04, [True, False, False, False])):
        lookout = Lookout(planner, PERIOD, LookoutSettings(between_looks=between))
        seen = []
        for _ in range(8):
            seen.append(lookout.is_due)
            lookout.evasion(None, 0.0, nobody, 1.0)
        assert seen == due * (8 // len(due))


def test_an_allowance_takes_what_work_is_said_to_take():
    takes = AllowanceSettings(patience=1, least=40, rank=7)
    allowance = Allowance(100, takes)
    allowance.spend(allowance.takes.rank)
    assert allowance.left == 93
    allowance.spend(93)
    assert not allowance.grants(50) and allowance.grants(50)
    assert allowance.share(90) == 40


def test_an_arm_keeps_the_margin_and_tries_the_angles_asked_for():
    scene = handover.load_scene("varied", 43)
    placed, giver = scene.receiver, scene.giver
    limb = limb_of(placed.agent, placed.arms[0])
    other = limb_of(giver.agent, giver.arms[0])
    proof = ProofSettings(margin=0.01, self_margin=0.002)
    space = Mover(scene, placed, limb, giver, other, proof).space
    assert set(space.margin[space.margin > 0.0].tolist()) == {0.01, 0.002}
    few, many = (solver_of(limb, SolveSettings(free_angles=n)).free for n in (3, 9))
    assert len(few) == 3 and len(many) == 9


def test_fingers_close_as_quickly_and_let_go_as_late_as_they_are_told():
    how = GripperSettings(closing_s=0.5, held=0.3, loose=0.8)
    fingers, T = Fingers(None, np.eye(4), how), np.eye(4)[None]
    assert fingers.share == 0.3
    fingers.step("open", 0.1, np.eye(4), T)
    assert fingers.share == pytest.approx(0.5) and fingers.T_tool_object is not None
    fingers.step("open", 0.2, np.eye(4), T)
    assert fingers.share == pytest.approx(0.9) and fingers.T_tool_object is None


def test_comfort_rods_lie_where_they_are_told_to():
    human = handover.Human(1.75).looking([1.0, 0.0, 0.0])
    hand = np.flatnonzero(human.labels == handover.Part.RIGHT_HAND)
    told = human.capsules(), human.labels, hand, human.gaze
    for behind in (0.2, 0.5):
        rods = ComfortRodSettings(behind=behind, down=0.4)
        *_, rod = comfort_rods(*told, ComfortSettings(), rods)
        assert rod[2] - rod[5] == pytest.approx(0.4)
        head = human.capsules()[human.labels == handover.Part.HEAD, :6]
        face = head.reshape(-1, 3).mean(axis=0)
        assert np.linalg.norm(rod[:2] - face[:2]) == pytest.approx(behind)


@pytest.mark.parametrize(("every", "takes"), [(8, 3), (2, 1), (5, 4)])
def test_a_better_path_is_looked_for_as_often_as_asked(every, takes, small_map):
    planner = odm.ReactivePlanner(small_map)
    looked, left = [], []
    smoother = SimpleNamespace(
        reset=lambda: None,
        cut=lambda budget, ahead: (0, budget),
        go_straight=lambda ahead: -1,
        run=lambda budget, ahead: left.append(budget) or 0,
    )
    cutter = SimpleNamespace(run=lambda budget: (0, 0))
    frame = SimpleNamespace(number=0, memory=planner.memory)
    candidate = SimpleNamespace(begin=lambda: None, end=lambda: None)
    settings = ImproveSettings(look_every=every, join_takes=takes)
    told = frame, None, candidate, cutter, smoother, lambda: True, settings
    improver = Improver(*told)
    improver._look = lambda ahead: looked.append(frame.number) or 0
    for number in range(20):
        frame.number = number
        improver.run(20, None)
    assert looked == list(range(0, 20, every))
    rest = 20 - 1 - takes  # half of it for cuts
    assert left[:2] == [rest - rest // 2, 10]


@pytest.mark.parametrize(("saves", "shorter"), [(0.02, True), (0.5, False)])
def test_a_cut_saves_what_is_asked(small_map, saves, shorter):
    frame = odm.ReactivePlanner(small_map).frame
    corners = np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 0.0], [0.6, 0.0, 0.0]])
    cutter = Cutter(
        frame,
        SimpleNamespace(q=corners),
        None,
        None,
        ImproveSettings(min_cut_saving=saves),
    )
    assert cutter._shorter(corners[0], corners[2] - corners[0], 0, 2) == shorter


def test_what_rounding_gains_is_measured_at_as_many_corners_as_asked(small_map):
    robot, roadmap = small_map.robot, small_map.roadmap
    few, many = (corner_gain(robot, roadmap, n) for n in (1, 100_000))
    assert few != many > 0.0 and corner_gain(robot, roadmap) > 0.0
