"""Smoothing between frames: shorter in time, free all the way, and never behind."""

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, draw_arm, draw_valid, on_its_way

import odm
from odm.planner.settings import SmoothingSettings
from odm.search import _recent as recent
from odm.search._state import NO_ITEM
from roadmap.kinematics.forward import sphere_centers


def smoothed(planner, points, q, rounds=40, ahead=None):
    answer = None
    for _ in range(rounds):
        planner.improve(4, ahead)
        answer = planner.step(points, q=q)
        assert answer.status == "following"
    return answer


@pytest.mark.parametrize("seed", [0, 2, 3, 4])  # 1 is quick from the beginning
def test_a_path_gets_quicker_and_stays_free(small_map, seed):
    planner, points, first = on_its_way(small_map, seed)
    last = smoothed(planner, points, HOME)
    time = planner.smoother.time
    assert time(last.path) < 0.98 * time(first.path)
    assert np.allclose(last.path[-1], first.path[-1])
    for a, b in zip(last.path, last.path[1:], strict=False):
        assert planner.is_free(a, b)


@pytest.mark.parametrize("seed", range(4))
def test_a_point_in_a_new_leg_blocks_it(small_map, seed):
    planner, points, first = on_its_way(small_map, seed)
    path = smoothed(planner, points, HOME).path
    before = {q.tobytes() for q in first.path}
    robot = small_map.robot
    tested = 0
    for a, b in zip(path, path[1:], strict=False):
        if a.tobytes() in before and b.tobytes() in before:
            continue
        for center in sphere_centers(robot, 0.5 * (a + b))[robot.moving][::9]:
            answer = planner.step(np.vstack([points, center[None]]), q=HOME)
            legs = zip(answer.path, answer.path[1:], strict=False)
            assert not any(np.allclose(a, c) and np.allclose(b, d) for c, d in legs)
            tested += 1
        break  # the way is another one now
    assert tested


def distance_to(path, q):
    best = np.inf
    for a, b in zip(path, path[1:], strict=False):
        t = np.clip((q - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        best = min(best, np.abs(a + t * (b - a) - q).max())
    return best


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_the_way_up_to_where_the_next_frame_begins_stays(small_map, seed, share):
    planner, points, first = on_its_way(small_map, seed)
    path = first.path
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    at = share * lengths[-1]
    places = np.linspace(0.0, at, 15)
    kept = np.array([np.interp(places, lengths, path[:, j]) for j in range(3)]).T
    last = smoothed(planner, points, HOME, ahead=kept[-1])
    for q in kept:
        assert distance_to(last.path, q) < 1e-9
    assert planner.step(points, q=kept[-1]).status == "following"


def test_it_stops_where_the_robot_is_not_on_the_path(small_map):
    planner, points, first = on_its_way(small_map, 1)
    last = smoothed(planner, points, HOME, ahead=HOME + 1.0)
    assert np.array_equal(last.path, first.path)


@pytest.mark.parametrize("stays", [True, False])
def test_a_robot_that_stands_and_will_goes_straight_from_where_it_is(small_map, stays):
    """One that may be under way keeps what of its path it soon comes to."""
    planner, points, first = on_its_way(small_map, 1)
    assert len(first.path) > 2
    planner.step(NOBODY, q=HOME)
    recent.forget_recent(planner.memory.recent)
    assert planner.improve(4, HOME if stays else None)
    path = planner.step(NOBODY, q=HOME).path
    assert len(path) == (2 if stays else 3)
    assert np.array_equal(path[0], HOME)
    assert np.allclose(path[-1], first.path[-1])


def test_nothing_is_smoothed_while_it_holds_or_goes_straight(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    assert planner.smoother.run(4) == 0  # no frame yet
    planner.step(NOBODY, q=AWAY + [0.1, 0.0, 0.0])
    assert planner.improve(8) == 0


def new_legs(planner, points):
    """The legs that smoothing puts into the path in use."""
    legs, make = [], planner.smoother._make

    def noted(change, item):
        legs.extend(zip(change.corners, change.corners[1:], strict=False))
        make(change, item)

    planner.smoother._make = noted
    smoothed(planner, points, HOME)
    return legs


def nearest(planner, legs):
    """How near the cover comes to the points on some legs [m]."""
    shares = np.linspace(0.0, 1.0, 60)
    return [min(planner.separation(a + s * (b - a)) for s in shares) for a, b in legs]


def test_new_legs_keep_comfortable_or_save_much(small_map):
    comfort, near, made = 0.1, 0, 0
    for seed in range(12):
        _, points, first = on_its_way(small_map, seed)
        found = []
        for kept in (comfort, 0.0):
            settings = odm.PlannerSettings(smoothing_clearance=kept)
            planner = odm.ReactivePlanner(small_map, settings=settings)
            planner.smoother.settings = SmoothingSettings(
                min_saving_near=1.0
            )  # no change does
            planner.set_goals([first.path[-1]])
            planner.step(points, q=HOME)
            found.append(nearest(planner, new_legs(planner, points)))
        assert all(gap >= planner.keep + comfort - 1e-6 for gap in found[0])
        made += len(found[0])
        near += sum(gap < planner.keep + comfort for gap in found[1])
    assert made and near  # and without comfort some come nearer


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def beside_an_arm(small_map, shapes):
    """Return a planner with a path of eight corners, the arm, and its answer."""
    rng = np.random.default_rng(2)
    while True:
        planner, rods = odm.ReactivePlanner(small_map), draw_arm(rng)
        planner.set_goals([AWAY if rng.random() < 0.5 else draw_valid(planner, rng)])
        arm = odm.Obstacles(capsules=rods) if shapes else odm.sample_capsules(rods)
        answer = planner.step(arm, q=HOME)
        if len(answer.path) > 7:
            return planner, arm, answer


def test_what_cuts_a_path_shortest_comes_first(small_map):
    planner, arm, first = beside_an_arm(small_map, shapes=True)
    planner.improve(4)
    better = planner.step(arm, q=HOME)
    assert better.status == "following"
    assert length(better.path) < 0.9 * length(first.path)  # 0.99 by changes at random
    for a, b in zip(better.path, better.path[1:], strict=False):
        assert planner.is_free(a, b)


def test_new_legs_wait_for_their_cells_where_nothing_asks_for_them(small_map):
    """Beside shapes alone, unless there is a history that they must keep out of."""
    bare = []
    for shapes, moved in ((True, False), (False, False), (True, True)):
        planner, arm, _ = beside_an_arm(small_map, shapes)
        if moved:
            arm.capsules[:, [2, 5]] += 0.1
            planner.step(arm, q=HOME)
        planner.improve(4)
        answer = planner.step(arm, q=HOME)
        assert answer.status == "following"
        bare.append((planner.path.items() == NO_ITEM).sum())
    assert bare[0] > max(bare[1:])


def test_a_cut_whose_cells_are_looked_at_in_vain_takes_a_test(small_map, monkeypatch):
    """Cells take as long as all else of a cut: 8 in one test would be a late frame."""
    planner, arm, _ = beside_an_arm(small_map, shapes=True)
    arm.capsules[:, [2, 5]] += 0.1
    planner.step(arm, q=HOME)  # there is a history that legs must keep out of
    smoother, swept = planner._improver.smoother, []
    sweep = smoother.attacher.sweep
    monkeypatch.setattr(
        smoother.attacher, "sweep", lambda *leg: swept.append(0) or sweep(*leg)
    )
    monkeypatch.setattr(smoother, "was_hit", lambda item: True)
    planner.candidate.begin()
    made, left = smoother.cut(3)
    assert (made, left) == (0, 0) and len(swept) == 3
