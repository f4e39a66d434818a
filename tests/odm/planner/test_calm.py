"""New ways keep clear of where the obstacles have been; freed space is free at once."""

from functools import partial

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, POST, ball_at

import odm
from odm import PlannerSettings
from odm.planner.obstacle_history import ObstacleHistory

RATE = 100
NOWHERE_CALM = PlannerSettings(memory_s=0.0)


def trembling(k, place):
    """A ball that trembles 2 cm at 5 Hz; frame k."""
    swing = 0.02 * np.sin(2 * np.pi * 5 * k / RATE)
    return ball_at(np.add(place, [swing, 0.5 * swing, 0.0]), 0.05)


def played(small_map, settings, frames, points_of):
    """Step a robot that stands; return status and path by frame."""
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    answers = []
    for k in range(frames):
        answer = planner.step(points_of(k), q=HOME, now=k / RATE, stamp=k / RATE)
        answers.append((answer.status, answer.path.copy()))
    return answers


def changes(answers, after=30):
    """How often another path is taken; the first frames only look around."""
    paths = [path for status, path in answers[after:] if status != "holding"]
    pairs = zip(paths, paths[1:], strict=False)
    return sum(a.shape != b.shape or not np.allclose(a, b) for a, b in pairs)


@pytest.fixture(scope="module")
def restless(small_map):
    """Places of a trembling ball at which a planner without memory changes often."""
    rng = np.random.default_rng(4)
    places = []
    while len(places) < 3:
        place = rng.uniform([0.65, 0.0, 0.2], [0.85, 0.15, 0.35])
        shake = partial(trembling, place=place)
        answers = played(small_map, NOWHERE_CALM, 120, shake)
        if changes(answers) >= 6:
            places.append(place)
    return places


def test_a_trembling_obstacle_changes_no_path(small_map, restless):
    for place in restless:
        shake = partial(trembling, place=place)
        answers = played(small_map, PlannerSettings(), 200, shake)
        assert changes(answers) == 0


def blocks_the_way(small_map):
    """Return points with which no way leads from HOME to AWAY."""
    wall = [ball_at((0.0, y, z), 0.05) for y in (0.4, 0.8) for z in (0.3, 0.7, 1.1)]
    rng = np.random.default_rng(0)
    for _ in range(60):
        place = rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.6])
        points = np.vstack([*wall, ball_at(place, 0.1)])
        planner = odm.ReactivePlanner(small_map, settings=NOWHERE_CALM)
        planner.set_goals([AWAY])
        if planner.step(points, q=HOME).status == "holding":
            return points
        wall.append(points[-200:])
    raise AssertionError("nothing blocks it")


def test_freed_space_is_used_in_the_same_frame(small_map):
    wall = blocks_the_way(small_map)
    answers = played(small_map, None, 40, lambda k: wall if k < 39 else NOBODY)
    assert {status for status, _ in answers[:39]} == {"holding"}
    assert answers[39][0] != "holding"


def test_a_way_that_is_only_just_free_is_not_tried_again_at_once(small_map):
    """Two gates open in turn, three frames each: what was shut soon is not trusted."""
    wall = blocks_the_way(small_map)

    def taken(settings):
        planner = odm.ReactivePlanner(small_map, settings=settings)
        planner.set_goals([AWAY])
        starts = []
        for k in range(90):
            shut = wall if k % 6 < 3 else NOBODY
            goal = AWAY + [0.0, 0.0, 0.1 * (k // 6 % 2)]
            planner.set_goals([goal])
            starts.append(planner.step(shut, q=HOME, now=k / RATE).status)
        return starts.count("replanned")

    patient, hasty = PlannerSettings(), PlannerSettings(patience=0)
    assert taken(hasty) > 10
    assert taken(patient) < 0.3 * taken(hasty)


def test_recent_points_are_kept_for_the_memory_and_no_longer(small_map):
    recent = ObstacleHistory(small_map.grid, 0.25, 0.03)
    spots = np.array([[0.01 * k, 0.0, 0.5] for k in range(60)])
    for k, spot in enumerate(spots):
        recent.take(spot[None], k / RATE)
        lately = recent.lately()
        there = spots[max(0, k - 24) : k + 1]
        gaps = np.linalg.norm(lately[:, None] - there, axis=2)
        assert (gaps.min(axis=0) < 1e-12).all()  # every frame of the last 0.24 s
        assert lately[:, 0].min() >= 0.01 * (k - 25) - 1e-9  # and nothing older
    around = recent.around()
    for axis in range(3):
        for sign in (-1.0, 1.0):
            shifted = spots[-1] + 0.03 * sign * np.eye(3)[axis]
            assert np.isclose(np.abs(around - shifted).sum(axis=1).min(), 0.0)


def test_a_clock_that_is_set_back_begins_anew(small_map):
    recent = ObstacleHistory(small_map.grid, 0.25, 0.0)
    recent.take(np.array([[0.1, 0.0, 0.5]]), 10.0)
    recent.take(np.array([[0.2, 0.0, 0.5]]), 3.0)
    assert np.allclose(recent.lately()[:, 0], 0.2)


def test_looks_for_a_better_path_come_every_eighth_frame(small_map, monkeypatch):
    """However often a frame takes points, it is one frame."""
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY, HOME + 0.1])
    points = odm.sample_capsules(POST, 0.03)
    looks, frame = [], 0
    around = planner.history.around

    def noted():
        looks.append(frame)
        return around()

    monkeypatch.setattr(planner.history, "around", noted)
    for frame in range(1, 81):
        assert planner.step(points, q=HOME).status != "holding"
    later = [k for k in looks if k > 16]
    assert later
    assert set(later) <= set(range(8, 81, 8))
    assert len(set(later)) >= 7
