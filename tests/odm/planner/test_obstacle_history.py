"""New ways keep clear of where the obstacles have been; freed space is free at once."""

import re
from functools import partial
from itertools import product

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, ball_at
from wrappers import with_wrapper

import odm
from odm import PlannerSettings
from odm.search import _recent as kernels

lay_out_recent = with_wrapper(kernels.lay_out_recent)

RATE = 100
NO_HISTORY = PlannerSettings(history_s=0.0)


def trembling(k, place):
    """A ball that trembles 2 cm at 5 Hz; frame k."""
    swing = 0.02 * np.sin(2 * np.pi * 5 * k / RATE)
    return ball_at(np.add(place, [swing, 0.5 * swing, 0.0]), 0.05)


def played(small_map, settings, frames, points_of):
    """Step and improve for a robot that stands; return status and path by frame."""
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    answers = []
    for k in range(frames):
        answer = planner.step(points_of(k), q=HOME, now=k / RATE, stamp=k / RATE)
        answers.append((answer.status, answer.path.copy()))
        planner.improve(4)
    return answers


def changes(answers, after=60):
    """How often another path is taken; the first frames only look around.

    Where the roadmap has no path that stays free, a search beyond it goes on between
    these frames until it has found one.
    """
    return sum(status == "replanned" for status, _ in answers[after:])


@pytest.fixture(scope="module")
def restless(small_map):
    """Places of a trembling ball at which a planner without memory changes often."""
    rng = np.random.default_rng(4)
    places = []
    for _ in range(400):
        place = rng.uniform([0.65, 0.0, 0.2], [0.85, 0.15, 0.35])
        shake = partial(trembling, place=place)
        answers = played(small_map, NO_HISTORY, 120, shake)
        if changes(answers) >= 3:
            places.append(place)
        if len(places) == 3:
            return places
    raise AssertionError("nothing makes it restless")


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
        planner = odm.ReactivePlanner(small_map, settings=NO_HISTORY)
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

    patient, hasty = PlannerSettings(), PlannerSettings(persistence_frames=0)
    assert taken(hasty) > 10
    assert taken(patient) < 0.3 * taken(hasty)


def test_a_robot_that_waits_for_a_path_to_stay_free_says_so(small_map):
    wall = blocks_the_way(small_map)
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    told = []
    for k in range(90):
        shut = wall if k % 6 < 3 else NOBODY
        planner.set_goals([AWAY + [0.0, 0.0, 0.1 * (k // 6 % 2)]])
        answer = planner.step(shut, q=HOME, now=k / RATE)
        if answer.status == "holding":
            told.append((k % 6, answer.reason))
    waits = [(k, why) for k, why in told if "a path that is free now" in why]
    assert waits and all(k >= 3 for k, _ in waits)  # never while the wall is there
    words = r"stays so for ([0-9]+) more frames \(PlannerSettings.persistence_frames"
    left = [int(re.search(words, why)[1]) for _, why in waits]
    assert 0 < min(left) and max(left) < planner.settings.persistence_frames


def cells_of(planner, words):
    """The occupied cells of words by block, as a set of (block, bit)."""
    found = np.flatnonzero(words)
    return {(int(b), k) for b in found for k in range(64) if int(words[b]) >> k & 1}


def cell_at(planner, p):
    """(block, bit) of the cell that a point lies in."""
    cloud = planner.memory.cloud
    at = ((p - cloud.origin) * (1.0 / cloud.h)).astype(int)
    _, ny, nz = cloud.shape.tolist()
    bx, by, bz = (int(v) for v in at >> 2)
    x, y, z = (int(v) for v in at & 3)
    return (bx * ny + by) * nz + bz, x << 4 | y << 2 | z


def seen(planner, points, now):
    """Take a frame and lay out what was occupied lately: (lately, wary) as sets."""
    planner.step(np.atleast_2d(points), q=HOME, now=now, stamp=now)
    lay_out_recent(planner.memory.table)
    recent = planner.memory.recent
    return cells_of(planner, recent.occupied), cells_of(planner, recent.avoided)


def test_cells_are_remembered_for_the_memory_and_hardly_longer(small_map):
    """A spot that goes through many blocks, and one that comes back now and then."""
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    spots = np.array([[0.6 - 0.012 * k, 0.31, 0.5] for k in range(90)])
    memory = planner.settings.history_s
    for k, spot in enumerate(spots):
        lately, wary = seen(planner, spot, k / RATE)
        must = {cell_at(planner, p) for p in spots[max(0, k - 24) : k + 1]}
        may = range(max(0, k - int(memory * RATE * 4 / 3) - 1), k + 1)
        assert must <= lately <= {cell_at(planner, spots[i]) for i in may}
        assert lately <= wary


def test_what_is_to_be_wary_of_is_grown_by_calm(small_map):
    """As many rings of cells as calm is long: every shift of a point by it is in."""
    rng = np.random.default_rng(3)
    for calm, rings in ((0.0, 0), (0.03, 1), (0.05, 1), (0.12, 3)):
        settings = PlannerSettings(history_clearance=calm)
        planner = odm.ReactivePlanner(small_map, settings=settings)
        planner.set_goals([AWAY])
        p = rng.uniform([0.3, -0.3, 0.3], [0.6, 0.3, 0.7])
        lately, wary = seen(planner, p, 0.0)
        shifted = [p, *(p + calm * s for s in np.vstack([np.eye(3), -np.eye(3)]))]
        assert lately == {cell_at(planner, p)}
        assert {cell_at(planner, x) for x in shifted} <= wary
        h = planner.cell_map.grid.h
        near = np.array(list(product(range(-rings, rings + 1), repeat=3)))
        ball = near[np.abs(near).sum(axis=1) <= rings]
        assert wary == {cell_at(planner, p + h * d) for d in ball}


def test_cells_that_will_be_occupied_are_remembered_as_if_they_were(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    p, here = np.array([[0.5, 0.3, 0.5], [0.4, -0.3, 0.6]]), np.array([0.6, 0.1, 0.4])
    seen(planner, here, 0.0)
    planner.expect(np.vstack([p, [9.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]))
    must = {cell_at(planner, x) for x in (*p, here)}
    lately, wary = seen(planner, here, 0.01)
    assert lately == must and must <= wary
    lately, _ = seen(planner, here, 0.4)
    assert lately == {cell_at(planner, here)}
    rod = np.array([[0.5, 0.2, 0.5, 0.5, 0.4, 0.5, 0.04]])
    planner.expect(odm.Obstacles(capsules=rod))
    lately, _ = seen(planner, here, 0.41)
    rim = {cell_at(planner, x) for x in ([0.5, 0.3, 0.541], [0.459, 0.3, 0.5])}
    assert rim <= lately
    with pytest.raises(odm.planner.planner.BadInput):
        planner.expect(np.zeros((3, 2)))


def test_a_new_path_heeds_who_will_be_somewhere_as_who_has_been_there(small_map):
    """What is expected ranks paths; it blocks none, and the path in use is kept."""
    rng, other = np.random.default_rng(8), 0
    for _ in range(30):
        place = rng.uniform([0.3, -0.4, 0.2], [0.8, 0.4, 0.6])
        ball, paths = ball_at(place, 0.08), []
        for first, soon in ((NOBODY, NOBODY), (ball, NOBODY), (NOBODY, ball)):
            planner = odm.ReactivePlanner(small_map)
            planner.set_goals([-AWAY])
            planner.step(first, q=HOME, now=0.0, stamp=0.0)
            planner.attacher.sweep_cells(8)  # as `improve` does: cells are tolled
            planner.set_goals([AWAY])
            planner.expect(soon)
            answer = planner.step(NOBODY, q=HOME, now=0.01, stamp=0.01)
            paths.append(answer.path)
            planner.expect(ball_at(HOME, 0.1))
            after = planner.step(NOBODY, q=HOME, now=0.02, stamp=0.02)
            assert after.status == "following"
        assert np.array_equal(*paths[1:])
        other += not np.array_equal(*paths[:2])
    assert other > 3


def test_a_clock_that_is_set_back_begins_anew(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    seen(planner, [0.5, 0.3, 0.5], 10.0)
    lately, _ = seen(planner, [0.5, -0.3, 0.5], 3.0)
    assert lately == {cell_at(planner, np.array([0.5, -0.3, 0.5]))}


def test_a_frame_searches_once_and_a_free_path_is_not_searched_for(small_map):
    """Whatever the obstacles did lately; improving between frames is another matter."""
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    rng, searched = np.random.default_rng(5), 0
    for k in range(200):
        place = rng.uniform([0.3, -0.3, 0.2], [0.8, 0.3, 0.6])
        answer = planner.step(
            ball_at(place, 0.06), q=HOME, now=k / RATE, stamp=k / RATE
        )
        # one more where the close test opened a way; both anew by nodes joined since
        assert answer.work.searches <= (4 if planner.joined else 2)
        if answer.status == "following":
            assert answer.work.searches == 0
        searched += answer.work.searches > 0
    assert searched > 10


def test_always_replan_heeds_no_history(small_map):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    planner.set_goals([AWAY])
    planner.step(ball_at((0.6, 0.1, 0.4), 0.05), q=HOME)
    assert planner.memory.recent.listed[-1] == 0
