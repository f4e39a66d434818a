"""Shapes through the planner: exact, in place, and a function of the frame."""

import tracemalloc

import numpy as np
import pytest
from shapes_drawn import draw_shape, draw_shapes, smallest_solid_gap
from small import AWAY, HOME, POST, draw_arm, draw_valid

import odm
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, tool_pose


def around_the_arm(rng, n):
    return draw_shapes(rng, n, middle=(0.0, 0.0, 0.6), spread=0.6)


def legs(robot, path):
    return [(a, difference(robot, a, b)) for a, b in zip(path, path[1:], strict=False)]


def test_every_leg_of_an_answer_keeps_m_from_the_very_shapes(small_map, rng):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    answered = 0
    planner.set_goals([AWAY])
    m = small_map.safety.m
    for _ in range(60):
        shapes = around_the_arm(rng, 2)
        q = draw_valid(planner, rng)
        answer = planner.step(odm.Obstacles.of(shapes), q=q)
        assert answer.certified == "whole surface"
        for a, dq in legs(small_map.robot, answer.path):
            answered += 1
            assert smallest_solid_gap(small_map, a, dq, shapes, 40) >= m - 1e-7
            assert planner.is_free(a, a + dq)
    assert answered > 30


def test_shapes_open_what_their_samples_close(small_map, planner, rng):
    """A hand 2 cm from the cover: nothing is free for samples, all is for shapes."""
    q, m = HOME.copy(), small_map.safety.m
    planner.set_goals([AWAY])
    tool = tool_pose(small_map.robot, q)[:3, 3]
    ball = np.array([[*tool, 0.03]])
    planner.step(odm.Obstacles(spheres=ball), q=q)
    outward = tool - np.array([0.0, 0.0, tool[2]])
    outward /= np.linalg.norm(outward)
    while planner.separation(q) < m + 0.003:
        ball[0, :3] += 0.001 * outward
        planner.step(odm.Obstacles(spheres=ball), q=q)
    assert planner.is_free(q, q) and planner.stands_clear(q)
    planner.step(odm.sample_capsules(ball[:, [0, 1, 2, 0, 1, 2, 3]], 0.03), q=q)
    assert not planner.is_free(q, q)


def lives(planner, seed, frames):
    """Return what a planner says of frames of shapes, points, and both."""
    rng, said = np.random.default_rng(seed), []
    for k in range(frames):
        shapes = draw_shapes(rng, int(rng.integers(0, 4)), spread=0.5)
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        given = points
        if k % 3:
            given = odm.Obstacles.of(shapes, points if k % 3 == 2 else None)
        q = draw_valid(planner, rng)
        answer = planner.step(given, q=q, stamp=0.01 * k, now=0.01 * k)
        said.append((answer.status, answer.path.tobytes(), answer.reason))
        said.append((planner.separation(q), planner.keep, planner.improve(4)))
        said.append(planner.invalid_edges().tobytes())
        said.append(str(planner.is_free(q, AWAY)))
    return said


def test_the_same_frames_give_the_same_bytes(small_map):
    one, other = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    for planner in (one, other):
        planner.set_goals([AWAY])
    lives(other, 5, 4)
    other = odm.ReactivePlanner(small_map)
    other.set_goals([AWAY])
    assert lives(one, 3, 12) == lives(other, 3, 12)


def test_a_planner_whose_room_must_grow_says_the_same(small_map):
    said = []
    for room in (1, 32768):
        settings = odm.PlannerSettings(point_capacity=room)
        planner = odm.ReactivePlanner(small_map, settings=settings)
        planner.set_goals([AWAY])
        planner.step(np.zeros((1, 3)), q=HOME)
        said.append(lives(planner, 8, 6))
    assert said[0] == said[1]


def test_a_memory_with_shapes_is_saved_and_loaded(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    for n in (1, 45):  # more than a fresh planner has room for, too
        shapes = draw_shapes(rng, n, middle=(0.0, 0.0, 1.6), spread=0.4)
        shapes.append(draw_shape("mesh", rng, middle=(0.6, 0.0, 0.6), spread=0.1))
        points = rng.uniform(0.8, 0.9, (5, 3))
        planner.step(odm.Obstacles.of(shapes, points), q=HOME)
        fresh = odm.ReactivePlanner(small_map)
        fresh.load_memory(planner.save_memory())
        for _ in range(10):
            q = draw_valid(planner, rng)
            assert fresh.separation(q) == planner.separation(q)
            assert bool(fresh.is_free(q, HOME)) == bool(planner.is_free(q, HOME))
        assert np.array_equal(fresh.points, planner.points)
        assert lives(fresh, n, 4) == lives(planner, n, 4)


def test_shapes_are_given_in_the_world(small_map, rng):
    T = np.eye(4)
    T[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = [1.0, 2.0, 0.3]
    at_base, moved = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    shapes = around_the_arm(rng, 5)
    in_world = [shape.moved(T) for shape in shapes]
    moved.set_base(T)
    at_base.step(odm.Obstacles.of(shapes), q=HOME)
    moved.step(odm.Obstacles.of(in_world), q=HOME)
    here = [draw_valid(at_base, rng) for _ in range(10)]
    there = [at_base.separation(q) for q in here]
    assert [moved.separation(q) for q in here] == pytest.approx(there, abs=1e-9)
    path = np.stack(here[:2])
    extra = np.linspace(-0.01, 0.1, 8)
    for e in extra:
        asked = moved.blocked_leg(path, e, odm.Obstacles.of(in_world))
        assert asked == at_base.blocked_leg(path, e)
    late = odm.ReactivePlanner(small_map)  # a base that is told after the frame
    late.step(odm.Obstacles.of(in_world), q=HOME)
    late.set_base(T)
    assert [late.separation(q) for q in here] == pytest.approx(there, abs=1e-9)
    assert np.array_equal(late.invalid_edges(), moved.invalid_edges())


def test_what_is_near_as_more_distance_is_kept_has_samples_at_once(small_map):
    wall = odm.Obstacles.of([odm.Box([8.0, 8.0, 0.01], _aside(2.0))])
    before, after = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    before.step(wall, q=HOME)
    before.set_extra_clearance(0.5)
    after.set_extra_clearance(0.5)
    after.step(wall, q=HOME)
    assert np.array_equal(before.points, after.points)


def _aside(z):
    T = np.eye(4)
    T[2, 3] = z
    return T


def test_braking_asks_of_shapes_what_it_asks_of_the_frame(small_map, planner, rng):
    path, blocked = np.stack([HOME, AWAY]), []
    for _ in range(40):
        obstacles = odm.Obstacles.of(around_the_arm(rng, 1))
        planner.step(obstacles, q=HOME)
        extra = rng.uniform(-0.01, 0.1)
        here = planner.blocked_leg(path, extra)
        assert planner.blocked_leg(path, extra, obstacles) == here
        blocked.append(here)
        planner.step(np.zeros((0, 3)), q=HOME)
        assert planner.blocked_leg(path, extra, obstacles) == here
    assert {None, 0} == set(blocked)
    obstacles = odm.Obstacles(capsules=1)  # never written
    assert planner.blocked_leg(path, 0.0, obstacles) == 0


def test_extra_clearance_counts_for_shapes(small_map, planner, rng):
    shapes = odm.Obstacles.of(around_the_arm(rng, 1))
    planner.step(shapes, q=HOME)
    gap, m = planner.separation(HOME), small_map.safety.m
    assert gap > m
    for extra in (gap - m - 1e-4, gap - m + 1e-4):
        planner.set_extra_clearance(min(max(extra, 0.0), 0.5))
        free = planner.stands_clear(HOME)
        assert free == (extra < gap - m or extra > 0.5)
        planner.step(shapes, q=HOME)
        assert planner.stands_clear(HOME) == free


def test_a_hold_names_the_shape_and_its_label(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    at = tool_pose(small_map.robot, HOME)[:3, 3]
    row = np.array([[*at, *at, 0.05]])
    labels = {"capsules": ["left hand"]}
    answer = planner.step(odm.Obstacles(capsules=row, labels=labels), q=HOME)
    assert answer.status == "holding"
    assert "capsule 0 (left hand) is" in answer.reason
    assert len(answer.blockers.points) == 0
    free = planner.is_free(HOME, AWAY)
    assert free.failed == "frame" and "of capsule 0 (left hand) at" in free.reason


def test_a_robot_inside_a_solid_is_not_free(small_map, planner):
    everything = odm.Obstacles(spheres=np.array([[0.0, 0.0, 0.0, 4.9]]))
    planner.step(everything, q=HOME)
    assert not planner.is_free(HOME, HOME)
    assert planner.separation(HOME) < 0.0


def test_classes_beside_shapes_are_refused(planner):
    obstacles = odm.Obstacles(capsules=POST)
    with pytest.raises(BadInput, match="classes were given beside Obstacles"):
        planner.step(obstacles, q=HOME, classes=np.zeros(0, int))


def test_a_frame_of_shapes_allocates_nothing(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    obstacles = odm.Obstacles(capsules=POST, boxes=2)
    T = np.eye(4)
    T[:3, 3] = [0.9, 0.9, 0.5]
    obstacles.boxes[:] = [*T[:3].ravel(), 0.1, 0.2, 0.3]
    for k in range(60):
        obstacles.capsules[0, 0] = 1e-3 * (k % 7)
        planner.step(obstacles, q=HOME)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for k in range(300):
        obstacles.capsules[0, 0] = 1e-3 * (k % 7)
        planner.step(obstacles, q=HOME)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 4096


@pytest.mark.parametrize("n_shapes", [0, 3])
def test_a_frame_is_marked_once_where_the_base_or_the_clearance_changes(
    small_map, n_shapes
):
    planner = odm.ReactivePlanner(small_map)
    rows = np.array([[0.5, 0.1 * k, 0.5, 0.05] for k in range(n_shapes)])
    spheres = rows.reshape(-1, 4)
    planner.step(odm.Obstacles(spheres=spheres, points=np.zeros((2, 3))), q=HOME)
    marked = planner.frame.epoch[1]
    planner.set_base(np.eye(4))
    assert planner.frame.epoch[1] == marked + 1
    planner.set_extra_clearance(0.02)
    assert planner.frame.epoch[1] == marked + 2
