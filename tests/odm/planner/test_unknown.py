"""What is not known is never free: NaN, refused frames, wrong units, old buffers."""

import math

import numpy as np
import pytest
from rows import each
from small import AWAY, HOME, NOBODY, POST, ball_at

import odm
from odm.close_test import _static as kernels
from odm.close_test.close_test import CloseTest
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose

NAN, INF = math.nan, math.inf
POINTS = odm.sample_capsules(POST, 0.03)
STILL = np.zeros(3)


def evasion(planner: odm.ReactivePlanner) -> np.ndarray | None:
    """Return how the robot evades a ball that comes at its hand."""
    ball = ball_at(tool_pose(planner.robot, HOME)[:3, 3] + [0.05, 0.0, 0.0])
    return planner.evasion(HOME, [(0.5, ball), (1.0, ball)], 1.0)


def is_closed(planner: odm.ReactivePlanner) -> bool:
    """Return whether every question is answered with no."""
    freedom = planner.is_free(HOME, HOME)
    answers = (
        not freedom and freedom.failed == "frame" and "last frame" in freedom.reason,
        not planner.is_free(HOME, HOME, by_links=True),
        not planner.stands_clear(HOME),
        planner.separation(HOME) == -INF,
        planner.blocked_leg(HOME[None]) == 0,
        planner.blocked_leg(HOME[None], points=NOBODY) is None,  # these are known
        evasion(planner) is None,
        len(planner.invalid_nodes()) == planner.cell_map.roadmap.n_nodes,
        len(planner.invalid_edges()) == planner.cell_map.roadmap.n_edges,
    )
    return all(answers)


# --- NaN ----------------------------------------------------------------------


@each("extra", [NAN, INF, -INF])
@each("points", [POINTS, NOBODY, None])
def test_an_extra_that_is_no_number_blocks(planner, extra, points):
    planner.step(NOBODY, q=HOME)
    assert planner.blocked_leg(HOME[None], extra, points) == 0


@pytest.mark.parametrize("value", [NAN, INF])
@pytest.mark.parametrize("points", [POINTS, NOBODY])
def test_a_path_that_is_no_number_blocks_at_the_leg_that_has_it(planner, points, value):
    planner.step(NOBODY, q=HOME)
    path = np.array([HOME, HOME, HOME, HOME])
    path[2, 1] = value
    assert planner.blocked_leg(path, points=NOBODY) == 1
    assert planner.blocked_leg(path, points=points) in (0, 1)


def around(size, at):
    """Return shapes of five kinds around a place, as thick as `size` [m]."""
    x, T = at, np.eye(4)
    T[:3, 3] = at
    corners = size * np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    box = [*T[:3].ravel(), *[2.0 * size] * 3]
    rod = [x[0], x[1], x[2] - size, x[0], x[1], x[2] + size, size]
    return {
        "sphere": odm.Obstacles(spheres=np.array([[*x, size]])),
        "capsule": odm.Obstacles(capsules=np.array([rod])),
        "cylinder": odm.Obstacles(cylinders=np.array([rod])),
        "box": odm.Obstacles(boxes=np.array([box])),
        "mesh": odm.Obstacles(meshes=[odm.Mesh.hull_of(corners, T)]),
    }


@pytest.mark.parametrize("kind", list(around(1.0, [0.0, 0.0, 0.0])))
def test_a_shape_around_the_whole_robot_blocks(planner, kind):
    """Its surface is near no link, so that no cell tells of it."""
    size = 0.85 if kind == "mesh" else 1.5  # samples of larger meshes are refused
    beside = around(size, [20.0, 0.0, 0.0])[kind]
    inside = around(size, [0.0, 0.0, 0.4])[kind]
    planner.set_goals([AWAY])
    assert planner.step(beside, q=HOME).status != "holding"
    on_its_way = HOME + 0.1 * (AWAY - HOME)
    for q in (HOME, on_its_way):
        answer = planner.step(inside, q=q)
        assert answer.status == "holding" and "is in contact" in answer.reason
        assert not planner.is_free(q, AWAY)
    assert planner.step(beside, q=on_its_way).status != "holding"
    planner.always_replan = True
    assert planner.step(inside, q=on_its_way).status == "holding"


def test_an_extra_that_is_an_array_is_refused(planner):
    planner.step(NOBODY, q=HOME)
    with pytest.raises(BadInput, match="extra is an array"):
        planner.blocked_leg(HOME[None], POINTS)


def test_an_extra_below_the_clearance_is_refused(planner):
    m = planner.cell_map.safety.m
    assert planner.blocked_leg(HOME[None], -m, NOBODY) is None
    with pytest.raises(BadInput, match="takes away more than the clearance"):
        planner.blocked_leg(HOME[None], -m - 0.001, NOBODY)


@each(
    "points",
    [
        np.zeros((4, 2)),
        np.zeros(3),
        np.zeros((2, 3), object),
        np.zeros((1, 3), complex),
    ],  # fmt: skip
)
def test_points_of_the_wrong_kind_are_refused_by_every_question(planner, points):
    with pytest.raises(BadInput, match="points"):
        planner.blocked_leg(HOME[None], 0.0, points)
    with pytest.raises(BadInput, match="points"):
        planner.evasion(HOME, [(0.1, points)], 0.5)


@each(
    "path",
    [np.zeros((1, 2)), HOME, np.array([[None] * 3]), [["a", "b", "c"]], [[1], []]],
)
def test_paths_of_the_wrong_kind_are_refused(planner, path):
    with pytest.raises(BadInput, match="path"):
        planner.blocked_leg(path)


def test_points_that_are_no_numbers_block(planner):
    bad = POINTS.copy()
    bad[0, 0] = NAN
    planner.set_goals([AWAY])
    planner.step(POINTS, q=HOME)
    assert planner.blocked_leg(HOME[None], 0.0, bad) == 0
    near = ball_at([0.3, 0.0, 0.35])
    planner.step(near, q=HOME)
    assert planner.evasion(HOME, [(0.1, np.full((1, 3), NAN))], 0.5) is None


def test_configurations_that_are_no_numbers_are_refused_by_questions(planner):
    planner.step(NOBODY, q=HOME)
    q = np.array([0.0, NAN, 0.0])
    for ask in (
        planner.separation,
        planner.stands_clear,
        lambda q: planner.is_free(q, HOME),
        lambda q: planner.evasion(q, [], 0.5),
        lambda q: planner.approach(np.eye(4), q),
    ):
        with pytest.raises(BadInput, match="NaN or infinity"):
            ask(q)
    with pytest.raises(BadInput, match="time that is not finite"):
        planner.evasion(HOME, [(NAN, POINTS)], 0.5)
    with pytest.raises(BadInput, match="real numbers"):
        planner.separation(np.array([None, 1.0, 2.0]))


@each("value", [NAN, INF, -INF])
@each("what", ["q", "dq", "radii"])
def test_the_kernels_take_what_is_no_number_for_blocked(planner, what, value):
    far = np.array([[-0.85, -0.85, 0.0]])
    planner.step(far, q=HOME)
    planner.frame.sort()
    m, given = planner.memory, {"q": HOME, "dq": STILL, "radii": planner.frame.radii}
    assert CloseTest(m.arm, given["radii"], 0.01, m.work).clear(HOME, STILL, m.cloud)
    given[what] = given[what].copy()
    given[what][-1] = value
    q, dq, radii = given.values()
    assert not CloseTest(m.arm, radii, 0.01, m.work).clear(q, dq, m.cloud)


def test_solids_and_configurations_of_no_numbers_are_in_contact(planner):
    static = planner.static
    floor = np.zeros((1, 17))
    floor[0, 3:5] = 1.0, -9.0  # far below
    box = np.zeros((1, 17))
    box[0, :4], box[0, [4, 8, 12]], box[0, 13:16] = (1, 9, 9, 9), 1.0, 0.1
    skip = np.zeros((len(planner.robot.tree_i), 1), bool)

    def clear(q, solid):
        solids = kernels.Solids(solid, skip, 0.01)
        return kernels.motion_clear_of_solids(static.arm, q, STILL, solids, static.work)

    for solid, at in ((floor, 4), (box, 13), (box, 2)):
        assert clear(HOME, solid)
        assert not clear(np.array([0.0, NAN, 0.0]), solid)
        broken = solid.copy()
        broken[0, at] = NAN
        assert not clear(HOME, broken)
    assert not static.motion_free(np.array([NAN, 0.0, 0.0]), STILL)
    assert not static.motion_free(HOME, np.array([0.0, 0.0, NAN]))


# --- frames that are refused ----------------------------------------------------


@pytest.mark.parametrize(
    ("points", "times", "words"),
    [
        (NOBODY, {"stamp": 0.9}, "100 ms older"),  # without now, too
        (NOBODY, {"stamp": 0.9, "now": 0.95}, "in the future|older"),
        (NOBODY, {"stamp": 0.99, "now": 1.02}, "10 ms older"),
        (NOBODY, {"stamp": 1.0, "now": 1.5}, "500 ms old"),
        (NOBODY, {"stamp": 1.5, "now": 1.1}, "in the future"),
        (NOBODY, {"stamp": NAN}, "stamp of the obstacle data is nan"),
        (NOBODY, {"stamp": 1.1, "now": NAN}, "now of the obstacle data is nan"),
        (NOBODY, {"now": INF}, "now of the obstacle data is inf"),
        (np.full((2, 3), NAN), {}, "2 obstacle points are NaN"),
        (1e3 * POINTS, {}, "millimetres"),
    ],
)
def test_a_refused_frame_holds_and_no_question_says_free(planner, points, times, words):
    planner.set_goals([AWAY])
    first = {"stamp": 1.0} if times == {"stamp": 0.9} else {"stamp": 1.0, "now": 1.01}
    assert planner.step(NOBODY, q=HOME, **first).status != "holding"
    assert planner.is_free(HOME, HOME) and evasion(planner) is not None
    if times == {"stamp": 0.9, "now": 0.95}:  # a clock set back is another beginning
        assert planner.step(points, q=HOME, **times).status != "holding"
        return
    answer = planner.step(points, q=HOME, **times)
    assert answer.status == "holding" and answer.retreat is None
    assert any(word in answer.reason for word in words.split("|"))
    assert is_closed(planner)
    assert planner.improve() == 0
    assert planner.step(NOBODY, q=HOME, stamp=1.2, now=1.21).status != "holding"
    assert planner.is_free(HOME, HOME) and planner.separation(HOME) == INF


def test_a_clock_set_back_without_now_goes_on_after_reset(planner):
    planner.set_goals([AWAY])
    planner.step(NOBODY, q=HOME, stamp=5.0)
    answer = planner.step(NOBODY, q=HOME, stamp=1.0)
    assert answer.status == "holding" and "call reset" in answer.reason
    planner.reset()
    assert planner.step(NOBODY, q=HOME, stamp=1.01).status != "holding"


def test_an_approach_after_a_refused_frame_has_no_motion(planner):
    planner.step(np.full((1, 3), NAN), q=HOME)
    found = planner.approach(np.eye(4), HOME)
    assert not len(found.path) and "could not be used" in found.reason


# --- buffers and clearance --------------------------------------------------------


def test_a_buffer_that_is_filled_anew_changes_no_question(planner):
    planner.set_goals([AWAY])
    buffer = ball_at([0.3, 0.0, 0.35])
    planner.step(buffer, q=HOME)
    gap = planner.separation(HOME)
    assert gap < 0.1
    for change in (lambda: None, lambda: planner.set_extra_clearance(0.01)):
        planner.step(buffer, q=HOME)
        kept = buffer.copy()
        buffer += 5.0
        change()
        assert planner.separation(HOME) == gap
        assert planner.blocked_leg(HOME[None], 0.2) == 0
        buffer[:] = kept


def test_points_beside_the_grid_count_as_soon_as_more_distance_is_kept(small_map):
    grid = small_map.grid
    beside = np.array([[0.0, 0.0, float(grid.upper[2]) + 0.01]])
    told, asked = (odm.ReactivePlanner(small_map, always_replan=True) for _ in range(2))
    asked.set_extra_clearance(0.3)
    for planner in (told, asked):
        planner.step(beside, q=HOME)
    told.set_extra_clearance(0.3)
    assert told.separation(HOME) == asked.separation(HOME) < INF
    assert np.array_equal(told.invalid_nodes(), asked.invalid_nodes())
    assert len(told.invalid_nodes())


# --- what is certified ----------------------------------------------------------


def test_the_whole_surface_is_certified_where_the_caller_says_so_alone(planner):
    planner.set_goals([AWAY])
    lone = np.array([[0.0, 0.0, 1.2]])
    labels = np.zeros(len(POINTS), int)
    for points, told, certified in (
        (lone, {}, "visible surface"),
        (POINTS, {}, "visible surface"),
        (POINTS, {"rounding": 0.05}, "visible surface"),
        (POINTS, {"covering_radius": 0.03}, "visible surface"),
        (POINTS, {"closed": True}, "whole surface"),
        (POINTS, {"closed": True, "covering_radius": 0.03}, "whole surface"),
        (POINTS, {"labels": labels}, "whole surface"),
    ):
        assert planner.step(points, q=HOME, **told).certified == certified


# --- units ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scale", "words"), [(1e3, "millimetres: divide by 1000"), (100, "centimetres")]
)
@pytest.mark.parametrize("stamped", [True, False])
def test_points_in_another_unit_hold_with_its_name(planner, scale, words, stamped):
    planner.set_goals([AWAY])
    arm = odm.sample_capsules(np.array([[0.8, 0.3, 0.9, 0.6, 0.0, 0.5, 0.05]]), 0.03)
    for k in range(100):
        times = {"stamp": 0.01 * k, "now": 0.01 * k} if stamped else {}
        answer = planner.step(scale * arm, q=HOME, **times)
        assert answer.status == "holding" and words in answer.reason


def test_how_far_points_may_be_is_the_users_choice(small_map):
    settings = odm.PlannerSettings(max_range_m=100.0)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    assert planner.step(POINTS + [60.0, 0, 0], q=HOME).status != "holding"
    assert "150 m in the middle" in planner.step(POINTS + [150, 0, 0], q=HOME).reason


def test_who_stands_away_walks_in_and_out_or_is_gone_does_not_hold(planner):
    planner.set_goals([AWAY])
    top = float(planner.cell_map.grid.upper[2])
    heights = np.r_[np.full(5, 3.0), np.linspace(3.0, top - 0.1, 200)]
    for k, z in enumerate(np.r_[heights, heights[::-1]]):
        points = ball_at([0.0, 0.0, z])
        answer = planner.step(points, q=HOME, stamp=0.01 * k, now=0.01 * k)
        assert answer.status != "holding", (k, z, answer.reason)
    assert planner.step(NOBODY, q=HOME, stamp=9.0, now=9.0).status != "holding"


def test_who_jumps_out_of_the_grid_holds_until_they_may_have_left(planner):
    planner.set_goals([AWAY])
    far = POINTS + [0.0, 0.0, 5.0]

    def status(points, t):
        return planner.step(points, q=HOME, stamp=t, now=t)

    assert status(POINTS, 1.0).status != "holding"
    answer = status(far, 1.01)
    assert answer.status == "holding" and "nobody leaves that fast" in answer.reason
    assert is_closed(planner)
    assert status(far, 1.02).status == "holding"  # not only for a frame
    assert status(POINTS, 1.03).status != "holding"
    assert status(NOBODY, 1.04).status != "holding"  # nobody at all is an answer
    assert status(far, 1.05).status == "holding"
    assert status(far, 1.8).status != "holding"
