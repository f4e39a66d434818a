"""The planner's frame: go on, go a new way, hold and say why."""

import numpy as np
import pytest
from naive_cells import smallest_gap
from small import draw_arm, draw_valid

import odm
from roadmap.errors import BadConfiguration, BadInput

NOBODY = np.zeros((0, 3))
HOME, AWAY = np.array([1.2, 0.6, 0.0]), np.array([-1.2, -0.6, 0.0])
POST = np.array([[0.0, 0.0, 0.9, 0.0, 0.0, 1.4, 0.05]])  # over the base


def ball_at(p, radius=0.03):
    return odm.sample_capsules(np.array([[*p, *p, radius]]), 0.03)


def follow(planner, q, path, reach=0.05):
    """Return the configuration a little farther along a path."""
    for a, b in zip(path, path[1:], strict=False):
        leg = np.linalg.norm(b - a)
        if leg > reach:
            return a + (b - a) * reach / leg
        reach -= leg
    return path[-1].copy()


def test_every_piece_of_a_path_keeps_its_distance(small_map, planner, rng):
    keep = small_map.safety.rho + small_map.safety.m
    paths = 0
    for _ in range(60):
        q = draw_valid(planner, rng)
        planner.set_goals([draw_valid(planner, rng)])
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        answer = planner.step(points, q=q)
        if answer.status == "holding":
            continue
        paths += 1
        assert np.array_equal(answer.path[0], q)
        inside = points[(small_map.grid.locate(points) >= 0).all(axis=1)]
        for a, b in zip(answer.path, answer.path[1:], strict=False):
            assert smallest_gap(small_map, a, b - a, inside, 100) >= keep - 1e-9
            assert planner.is_free(wrapped(small_map, a), wrapped(small_map, b))
    assert paths > 25


@pytest.mark.parametrize("rounding", [None, 0.04])
def test_paths_keep_the_clearance_from_the_exact_arm(
    small_map, planner, rng, rounding
):
    from odm.exact import ExactRobot, obstacles_of

    robot = small_map.robot
    exact, paths = ExactRobot(robot), 0
    moving = robot.link_body[robot.solid_link] > 0
    for _ in range(40):
        q = draw_valid(planner, rng)
        planner.set_goals([draw_valid(planner, rng)])
        arm = draw_arm(rng)
        shapes = obstacles_of([capsule_of(row) for row in arm])
        points = odm.sample_capsules(arm, 0.03)
        if not (small_map.grid.locate(points) >= 0).all():
            continue
        answer = planner.step(points, q=q, rounding=rounding)
        for a, b in zip(answer.path, answer.path[1:], strict=False):
            paths += 1
            for t in np.linspace(0, 1, 12):
                nearest = exact.distance_of(moving, a + t * (b - a), shapes)
                assert nearest.distance >= small_map.safety.m - 1e-9
    assert paths > 15


def test_a_known_rounding_or_dense_points_cost_less_space(small_map, planner):
    planner.set_goals([AWAY])
    arm = np.array([[0.0, 0.3, 0.5, 0.0, 0.4, 0.5, 0.05]])
    points = odm.sample_capsules(arm, 0.03)
    planner.step(points, q=HOME)
    plain = planner.radii.copy()
    planner.step(points, q=HOME, rounding=0.05)
    assert (planner.radii < plain - 0.005).all()
    planner.step(points, q=HOME, covering_radius=0.01)
    assert np.allclose(planner.radii, plain - 0.02)
    planner.step(points, q=HOME)
    assert np.allclose(planner.radii, plain, atol=1e-12)


def capsule_of(row):
    a, b = row[:3], row[3:6]
    z = (b - a) / np.linalg.norm(b - a)
    x = np.cross(z, [1.0, 0.2, 0.3])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = (a + b) / 2
    return odm.Capsule(row[6], np.linalg.norm(b - a), pose)


def wrapped(cell_map, q):
    turns = np.round(q / (2 * np.pi))
    return np.where(cell_map.robot.continuous, q - 2 * np.pi * turns, q)


def test_a_robot_on_its_path_goes_on_until_it_arrives(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    points, q = odm.sample_capsules(POST, 0.03), HOME.copy()
    first = planner.step(points, q=q)
    assert first.status == "replanned"
    for _ in range(400):
        answer = planner.step(points, q=q)
        assert answer.status == "following"
        assert answer.goal == 0
        if np.allclose(q, AWAY):
            break
        q = follow(planner, q, answer.path)
    assert np.allclose(wrapped(small_map, q - AWAY), 0)


def test_a_blocked_path_is_replaced_and_a_cleared_one_is_freed_in_the_same_frame(
    small_map,
):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    straight = planner.step(NOBODY, q=HOME)
    assert len(straight.path) == 2
    planner.reset()
    wall = np.array([[0.0, y, z] for y in np.arange(-0.5, 0.5, 0.05) for z in
                     np.arange(0.1, 1.6, 0.05)])
    held = planner.step(wall, q=HOME)
    assert held.status == "holding"
    assert planner.step(NOBODY, q=HOME).status == "replanned"


def test_a_free_path_is_not_given_up_for_a_hair(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    q, changes = HOME.copy(), 0
    post = POST.copy()
    planner.step(odm.sample_capsules(post, 0.03), q=q)
    for _ in range(100):
        shake = post.copy()
        shake[:, :6] += np.tile(rng.normal(scale=0.01, size=3), 2)
        answer = planner.step(odm.sample_capsules(shake, 0.03), q=q)
        changes += answer.status == "replanned"
    assert changes <= 5


def test_the_first_reachable_goal_wins_and_costs_change_that(small_map, planner):
    near, far = np.array([0.9, 0.4, 0.0]), AWAY
    planner.set_goals([far, near])
    assert planner.step(NOBODY, q=HOME).goal == 0
    planner.set_goals([far, near], costs=[0.0, 0.0])
    assert planner.step(NOBODY, q=HOME).goal == 1
    planner.set_goals([far, near], costs=[0.0, 10.0])
    assert planner.step(NOBODY, q=HOME).goal == 0
    # the first goal walled in: the second is taken
    planner.set_goals([far, near])
    tip = ball_at([-0.55, 0.0, 0.2], 0.1)
    answer = planner.step(tip, q=HOME)
    assert answer.goal == 1


def test_a_goal_that_is_a_node_needs_no_attachment(small_map, planner):
    node = small_map.roadmap.nodes[7]
    planner.set_goals([node])
    assert planner.memory.goals.number[0] == 1
    answer = planner.step(NOBODY, q=small_map.roadmap.nodes[90].copy())
    assert np.allclose(wrapped(small_map, answer.path[-1] - node), 0)


def test_unchanged_goals_are_not_attached_again(planner):
    planner.set_goals([AWAY])
    used = planner.memory.pool.used.copy()
    planner.set_goals([AWAY.copy()])
    assert np.array_equal(planner.memory.pool.used, used)


def test_many_goals_do_not_fill_the_memory(small_map, planner, rng):
    for _ in range(600):
        planner.set_goals([draw_valid(planner, rng)])
        assert planner.step(NOBODY, q=HOME).status != "holding"
    items, entries = planner.memory.pool.used
    assert items < len(planner.memory.pool.begin)
    assert entries < len(planner.memory.pool.block)


def test_polishing_never_lengthens_and_is_remembered(small_map, planner, rng):
    cuts = shorter = 0
    for _ in range(25):
        q = HOME + rng.uniform(-0.2, 0.2, 3)
        planner.set_goals([AWAY + rng.uniform(-0.2, 0.2, 3)])
        points = odm.sample_capsules(POST + rng.uniform(-0.02, 0.02, 7), 0.03)
        before = planner.step(points, q=q)
        if before.status == "holding" or len(before.path) < 3:
            continue
        made = planner.polish(8)
        after = planner.step(points, q=q)
        cuts += made
        gain = length(before.path) - length(after.path)
        assert gain >= -1e-9
        shorter += gain > 1e-6
        for a, b in zip(after.path, after.path[1:], strict=False):
            assert planner.is_free(wrapped(small_map, a), wrapped(small_map, b))
    assert cuts > 0
    assert shorter > 0


def length(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def test_scenery_of_the_place_is_heeded_by_paths_and_questions(small_map, planner):
    planner.set_goals([AWAY])
    box = odm.Box((0.1, 0.6, 0.3), np.eye(4)).moved(
        np.array([[1, 0, 0, 0.0], [0, 1, 0, 0.0], [0, 0, 1, 0.95], [0, 0, 0, 1.0]])
    )
    planner.set_static([box])
    assert planner.is_free(HOME, AWAY).failed == "scenery"
    answer = planner.step(NOBODY, q=HOME)
    points = odm.surface_of(box, 0.03).points
    for a, b in zip(answer.path, answer.path[1:], strict=False):
        assert smallest_gap(small_map, a, b - a, points, 100) >= 0.04 - 1e-9
    planner.set_static(NOBODY)
    assert planner.is_free(HOME, AWAY)


def test_is_free_names_the_test_that_failed(small_map, planner):
    robot = small_map.robot
    planner.step(ball_at([0.0, 0.0, 0.8]), q=HOME)
    assert planner.is_free(HOME, HOME)
    assert planner.is_free(HOME, np.array([9.0, 0, 0])).failed == "limits"
    low = np.array([robot.upper[0], robot.upper[1], 0.0])
    assert planner.is_free(low, low).failed in ("scenery", "self-collision")
    verdict = planner.is_free(HOME, AWAY)
    assert verdict.failed == "frame"
    assert "point" in verdict.reason


def test_one_planner_does_not_depend_on_what_another_did(small_map, rng):
    a, b = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    points = odm.sample_capsules(draw_arm(rng), 0.03)
    a.set_goals([AWAY])
    for _ in range(5):
        b.set_goals([draw_valid(b, rng)])
        b.step(points, q=draw_valid(b, rng))
    b.reset()
    b.set_goals([AWAY])
    assert np.array_equal(a.step(points, q=HOME).path, b.step(points, q=HOME).path)


def test_nothing_is_allocated_in_a_frame_but_the_answer(small_map):
    import tracemalloc

    planner = odm.ReactivePlanner(small_map, always_replan=True)
    planner.set_goals([AWAY])
    points = odm.sample_capsules(POST, 0.03)
    for _ in range(50):
        planner.step(points, q=HOME)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(500):
        planner.step(points, q=HOME)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 4096


def test_no_kernel_is_compiled_again_for_another_map(small_map, tmp_path):
    from odm._kernels import frame, step

    small_map.save(tmp_path / "map")
    loaded = odm.load_map(tmp_path / "map")
    kernels = (step.step, frame.take_points)
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    planner.step(odm.sample_capsules(POST, 0.03), q=HOME)
    seen = [len(k.signatures) for k in kernels]
    other = odm.ReactivePlanner(loaded)
    other.set_goals([AWAY])
    other.step(odm.sample_capsules(POST, 0.03), q=HOME)
    assert [len(k.signatures) for k in kernels] == seen


def test_read_only_arrays_do_not_make_the_frame_compile(small_map, planner):
    from odm._kernels import frame, step

    planner.set_goals([AWAY])
    points = odm.sample_capsules(POST, 0.03)
    planner.step(points, q=HOME)
    seen = len(step.step.signatures), len(frame.take_points.signatures)
    points.flags.writeable = False
    planner.step(points, q=small_map.roadmap.nodes[3])
    assert (len(step.step.signatures), len(frame.take_points.signatures)) == seen


# --- bad values hold, bad programs raise ----------------------------------------


def test_points_that_are_not_numbers_hold_with_the_reason(planner):
    planner.set_goals([AWAY])
    points = odm.sample_capsules(POST, 0.03)
    points[3, 1] = np.nan
    answer = planner.step(points, q=HOME)
    assert answer.status == "holding"
    assert len(answer.path) == 0
    assert "1 obstacle points are NaN" in answer.reason


def test_old_data_hold_with_their_age(planner):
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=HOME, stamp=1.0, now=1.35)
    assert answer.status == "holding"
    assert "350 ms old" in answer.reason
    assert planner.step(NOBODY, q=HOME, stamp=1.0, now=1.05).status != "holding"
    assert planner.step(NOBODY, q=HOME, stamp=2.0, now=1.0).status == "holding"
    assert planner.step(NOBODY, q=HOME, stamp=np.nan, now=1.0).status == "holding"


def test_a_start_out_of_limits_or_unknown_holds(planner):
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=np.array([1.6, 0.0, 0.0]))
    assert "turn = 1.6 lies outside" in answer.reason
    answer = planner.step(NOBODY, q=np.array([np.nan, 0.0, 0.0]))
    assert "NaN" in answer.reason
    assert planner.step(NOBODY, q=np.array([1.5005, 0.2, 0.0])).status != "holding"


def test_a_start_in_contact_is_named_with_its_link_and_a_retreat(planner):
    planner.set_goals([AWAY])
    answer = planner.step(ball_at([0.3, 0.0, 0.35]), q=HOME)
    assert answer.status == "holding"
    assert "start is in contact" in answer.reason
    assert answer.blockers.link in ("upper", "lower", "hand")
    assert len(answer.blockers.points) == 1


def test_a_start_in_self_collision_or_scenery_holds(small_map, planner):
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=np.array([1.5, 1.9, 0.0]))
    assert answer.status == "holding"
    assert "start is not free" in answer.reason


def test_a_blocked_goal_is_named_with_what_would_help(planner):
    planner.set_goals([AWAY])
    answer = planner.step(ball_at([-0.5, 0.0, 0.25], 0.08), q=HOME)
    assert answer.status == "holding"
    assert answer.reason.startswith("goal 0 is blocked")
    assert "away" in answer.reason
    assert answer.goal is None


def test_no_goal_holds(planner):
    assert "set_goals" in planner.step(NOBODY, q=HOME).reason


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((4, 2)), "shape"),
        (np.zeros(3), "shape"),
        (np.array([["a", "b", "c"]]), "dtype"),
        (np.zeros((2, 3), complex), "dtype"),
    ],
)
def test_points_of_the_wrong_kind_raise(planner, points, words):
    with pytest.raises(BadInput, match=words):
        planner.step(points, q=HOME)


def test_other_wrong_arguments_raise_one_clear_sentence(planner):
    with pytest.raises(BadInput, match="3 moving joints"):
        planner.step(NOBODY, q=np.zeros(7))
    with pytest.raises(BadInput, match="covering radius of 0.05"):
        planner.step(NOBODY, q=HOME, covering_radius=0.05)
    with pytest.raises(BadInput, match="labels"):
        planner.step(NOBODY, q=HOME, labels=np.zeros(3))
    with pytest.raises(BadInput, match="dq"):
        planner.step(NOBODY, q=HOME, dq=np.zeros(2))


def test_raw_points_are_certified_as_far_as_they_are_seen(planner):
    planner.set_goals([AWAY])
    points = odm.sample_capsules(POST, 0.03)
    assert planner.step(points, q=HOME).certified == "whole surface"
    raw = planner.step(points, q=HOME, covering_radius=0.01)
    assert raw.certified == "visible surface"


def test_points_outside_the_grid_are_counted(planner):
    points = np.array([[9.0, 0, 0], [0, 0, 0.9], [0, -50.0, 0]])
    assert planner.step(points, q=HOME).work.outside == 2


def test_more_points_than_ever_are_taken(small_map):
    settings = odm.PlannerSettings(max_points=100)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    rng = np.random.default_rng(0)
    points = rng.uniform([-1, -1, 1.3], [1, 1, 2.0], (5000, 3))
    answer = planner.step(points, q=HOME)
    assert answer.work.points == 5000


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ([0.0, 0.0], "shape"),
        ([np.nan, 0.0, 0.0], "NaN"),
        ([3.0, 0.0, 0.0], "turn = 3"),
        ([1.5, 1.9, 0.0], "not free"),
    ],
)
def test_goals_that_can_never_be_reached_raise(planner, goal, words):
    with pytest.raises(BadConfiguration, match=words):
        planner.set_goals([np.array(goal)])


def test_too_many_goals_and_bad_costs_raise(planner):
    with pytest.raises(BadConfiguration, match="at most 32"):
        planner.set_goals(np.zeros((33, 3)))
    with pytest.raises(BadConfiguration, match="costs"):
        planner.set_goals([AWAY], costs=[-1.0])
