"""Where new paths had better not pass: between hand and face, and behind the person."""

from types import SimpleNamespace

import numpy as np
from small import AWAY, HOME, NOBODY

import odm
from handover import Human
from handover.human.body import Part
from odm.execution.settings import ExecutionSettings
from odm.execution.threat import ThreatSettings, Watcher
from odm.obstacles.obstacles import Obstacles
from roadmap.kinematics.forward import sphere_centers
from sim.story.comfort import Berth, comfort_rods
from sim.story.handover import Handover
from sim.story.machine import Step
from sim.story.settings import ComfortSettings, ConductSettings


def told(human, gaze, **settings):
    labels = human.labels
    hand = np.flatnonzero(labels == Part.RIGHT_HAND)
    return comfort_rods(
        human.capsules(), labels, hand, gaze, ComfortSettings(**settings)
    )


def test_the_rod_goes_from_the_face_toward_the_hand_and_ends_before_it():
    human = Human(1.75).placed(1.0, 0.2, np.pi)
    rods = told(human, None)
    assert rods.shape == (1, 7) and rods[0, 6] == 0.06
    rows = human.capsules()
    head = rows[human.labels == Part.HEAD, :6].reshape(-1, 3).mean(axis=0)
    hand = rows[human.labels == Part.RIGHT_HAND, :6].reshape(-1, 3).mean(axis=0)
    assert np.allclose(rods[0, :3], head)
    left = np.linalg.norm(hand - rods[0, 3:6])
    assert np.isclose(left, 0.12)
    assert np.isclose(
        left + np.linalg.norm(rods[0, 3:6] - head), np.linalg.norm(hand - head)
    )


def test_what_is_behind_the_person_is_avoided_where_the_gaze_is_known():
    human = Human(1.75).placed(1.0, 0.2, np.pi)
    gaze = np.array([-0.8, 0.0, -0.6])
    rods = told(human, gaze, face_to_hand=0.0)
    head = human.capsules()[human.labels == Part.HEAD, :6].reshape(-1, 3).mean(axis=0)
    assert rods.shape == (1, 7)
    assert np.allclose(rods[0, :3], head + [0.35, 0.0, 0.0])
    assert not len(told(human, np.array([0.0, 0.0, -1.0]), face_to_hand=0.0))
    assert not len(told(human, gaze, face_to_hand=0.0, unseen=0.0))


def gap_of(robot, path, rod):
    """Return how near the cover's centres come to an upright rod on a path [m]."""
    gaps = []
    for a, b in zip(path, path[1:], strict=False):
        for s in np.linspace(0.0, 1.0, 20):
            centers = sphere_centers(robot, a + s * (b - a))[robot.moving]
            off = centers - np.clip(centers, rod[:3], rod[3:6])
            gaps.append(np.linalg.norm(off, axis=1).min())
    return min(gaps)


def test_new_paths_keep_off_what_is_avoided_where_they_can(small_map):
    rng, gaps = np.random.default_rng(8), []
    for _ in range(30):
        low = rng.uniform([0.3, -0.4, 0.2], [0.8, 0.4, 0.6])
        rod = np.array([*low, *(low + [0.0, 0.0, 0.3]), 0.06])
        paths = []
        for rods in (np.zeros((0, 7)), rod[None]):
            planner = odm.ReactivePlanner(small_map)
            planner.set_goals([-AWAY])
            planner.step(NOBODY, q=HOME, now=0.0, stamp=0.0)
            planner.set_goals([AWAY])
            planner.expect(odm.Obstacles(capsules=rods))
            answer = planner.step(NOBODY, q=HOME, now=0.01, stamp=0.01)
            assert answer.status == "replanned"  # nothing is blocked by it
            paths.append(answer.path)
        if not np.array_equal(*paths):
            gaps.append([gap_of(small_map.robot, path, rod) for path in paths])
    assert len(gaps) > 3
    gained = np.diff(np.array(gaps), axis=1)
    assert gained.min() > -0.02 and gained.max() > 0.05 and gained.mean() > 0.005


def test_a_hand_over_tells_its_planner_what_the_person_shuns():
    told = []
    story = Handover.__new__(Handover)
    story.planner, story.conduct = (
        SimpleNamespace(expect=told.append),
        ConductSettings(),
    )
    story._steps, story._at = [Step("targets")], 0
    seen = np.array([[0.5, 0.0, 0.5, 0.5, 0.0, 0.8, 0.05]])
    watcher = Watcher()
    for k in range(3):
        threat = watcher.look(seen, 0.01 * k)
    story._expect(threat, np.zeros(0, int), 2.0 * seen)
    story._expect(threat, np.array([0]), 2.0 * seen)
    story._expect(threat, np.zeros(0, int), np.zeros((0, 7)))  # nothing to tell
    assert [len(what) for what in told] == [1, 5]
    assert np.array_equal(told[1].capsules[-1:], 2.0 * seen)
    assert np.allclose(told[1].capsules[:4], seen)


def berth_of(room, noise=0.0):
    """Return the berth of a robot that lets people come so far while it stops [m]."""
    robot = SimpleNamespace(
        max_velocity=np.ones(1),
        max_acceleration=np.full(1, 1e9),
        max_jerk=np.full(1, 1e9),
    )
    planner = SimpleNamespace(cell_map=SimpleNamespace(safety=SimpleNamespace(m=0.01)))
    # a stop is one period long then: with 4 m/s2 somebody comes a = 4 * period^2 far
    period = (room / 4.0) ** 0.5
    executor = SimpleNamespace(
        robot=robot, planner=planner, period=period, settings=ExecutionSettings()
    )
    return Berth(executor, ThreatSettings(noise=noise, jerk=0.0))


BALLS = np.array([[0.0, 0.0, 0.0, 0.1]])
TWO = np.array([[1.0, 0, 0, 1, 0, 1, 0.1], [0.3, 0, 0, 0.3, 0, 1, 0.05]])


def test_a_slow_robot_is_told_of_a_larger_person_and_of_no_larger_object():
    berth = berth_of(0.03)
    assert np.isclose(berth.room, 0.03, atol=1e-4)
    there = Obstacles(capsules=TWO)
    around = berth.around(there, 1, BALLS, held=False, hindered=False)
    grown = around.capsules[:, 6] - TWO[:, 6]
    assert np.allclose(grown, [berth.room, 0.0]) and berth.told == berth.room
    assert np.array_equal(around.capsules[:, :6], TWO[:, :6])
    assert np.array_equal(there.capsules, TWO)  # the executor brakes for these
    # distances in the planner's reasons are to the larger person
    named = [around.name(k) for k in range(2)]
    assert named == ["capsule 0 (with 3.0 cm of room around it)", "capsule 1"]
    there.labels = {"capsules": ["torso", "the object"]}
    around = berth.around(there, 1, BALLS, held=False, hindered=False)
    named = [around.name(k) for k in range(2)]
    assert named[0] == "capsule 0 (torso with 3.0 cm of room around it)"
    assert named[1] == "capsule 1 (the object)"


def test_a_quick_robot_and_one_beside_nobody_are_told_of_what_there_is():
    there = Obstacles(capsules=TWO)
    quick = berth_of(0.004)
    assert quick.room == 0.0 and quick.around(there, 2, BALLS, False, False) is there
    slow = berth_of(0.03)
    assert slow.around(there, 0, BALLS, False, False) is there and slow.told == 0.0
    assert berth_of(0.03, noise=0.5).room == 0.1


def test_a_quick_robot_that_was_hindered_keeps_room_until_it_has_another_goal():
    quick, there = berth_of(0.004), Obstacles(capsules=TWO)
    quick.widen(0.02)
    around = quick.around(there, 1, BALLS, False, False)
    assert np.allclose(around.capsules[:, 6] - TWO[:, 6], [0.02, 0.0])
    quick.begin()
    assert quick.around(there, 1, BALLS, False, False) is there
    slow = berth_of(0.03)
    slow.widen(0.02)
    assert np.isclose(slow.room, 0.03, atol=1e-4)  # it keeps more than that


def test_who_stands_in_the_berth_already_comes_no_nearer_where_there_is_a_way():
    berth, near = berth_of(0.03), TWO.copy()
    near[1, 6] = 0.15  # 5 cm away
    for gap, larger in ((0.045, 0.03), (0.027, 0.015), (0.002, 0.0), (-0.1, 0.0)):
        near[0, [0, 3]] = 0.2 + gap
        around = berth.around(Obstacles(capsules=near), 2, BALLS, False, False)
        grown = around.capsules[:, 6] - near[:, 6]
        assert np.allclose(grown, [larger, berth.room], atol=1e-4)
        assert np.isclose(berth.told, larger, atol=1e-4)  # of all of its parts


def told_to(berth, frames, held, hindered):
    """Return how much larger the person is told to be in some frames [m]."""
    told, there = [], Obstacles(capsules=TWO)
    for _ in range(frames):
        around = berth.around(there, 1, BALLS, held, hindered)
        told.append(around.capsules[0, 6] - TWO[0, 6])
    return np.round(np.array(told) / berth.room, 3)


def test_a_berth_that_leaves_no_way_is_halved_once_the_search_has_had_its_time():
    berth = berth_of(0.03)
    assert (told_to(berth, 1, False, False) == 1.0).all()
    assert (told_to(berth, 24, True, False) == 1.0).all()
    assert (told_to(berth, 25, True, False) == 0.5).all()
    assert (told_to(berth, 25, True, False) == 0.25).all()
    assert (told_to(berth, 50, True, False) == 0.0).all()


def test_the_whole_berth_is_tried_again_by_a_robot_that_is_hindered_and_no_other():
    berth = berth_of(0.03)
    told_to(berth, 1, False, False)
    assert told_to(berth, 25, True, True)[-1] == 0.5
    assert (told_to(berth, 500, False, False) == 0.5).all()  # its way is good enough
    assert (told_to(berth, 99, False, True) == 0.5).all()
    assert (told_to(berth, 25, False, True) == 1.0).all()
    assert told_to(berth, 25, True, True)[-1] == 0.5
    assert (told_to(berth, 199, False, True) == 0.5).all()  # twice as long now
    assert told_to(berth, 1, False, True) == 1.0
    told_to(berth, 100, True, True)
    berth.begin()
    assert told_to(berth, 1, False, True) == 1.0
