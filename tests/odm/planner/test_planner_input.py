"""Bad values hold the robot with a reason; bad programs raise one sentence."""

import re

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, POST, ball_at

import odm
from odm.answer import NOTHING
from odm.planner.saved_memory import differences
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics.forward import sphere_centers


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


def test_frames_out_of_order_hold_and_a_clock_set_back_begins_anew(planner):
    planner.set_goals([AWAY])
    assert planner.step(NOBODY, q=HOME, stamp=5.00, now=5.01).status != "holding"
    answer = planner.step(NOBODY, q=HOME, stamp=4.97, now=5.02)
    assert answer.status == "holding"
    assert "30 ms older than those of the frame before" in answer.reason
    # it is the newest that counts, not the last
    assert planner.step(NOBODY, q=HOME, stamp=4.99, now=5.03).status == "holding"
    assert planner.step(NOBODY, q=HOME, stamp=5.00, now=5.04).status != "holding"
    assert planner.step(NOBODY, q=HOME, stamp=1.00, now=1.01).status != "holding"
    planner.reset()
    assert planner.step(NOBODY, q=HOME, stamp=0.98, now=1.02).status != "holding"


def test_how_old_data_may_be_is_the_users_choice(small_map):
    settings = odm.PlannerSettings(max_age_s=0.5)
    planner = odm.ReactivePlanner(small_map, settings=settings)
    planner.set_goals([AWAY])
    assert planner.step(NOBODY, q=HOME, stamp=1.0, now=1.45).status != "holding"
    answer = planner.step(NOBODY, q=HOME, stamp=1.0, now=1.6)
    assert "600 ms old, more than the 500 ms" in answer.reason


def test_how_far_a_joint_is_out_of_its_limits_is_told_and_that_degrees_are_none(
    planner,
):
    upper = planner.robot.upper
    assert upper[0] == 1.5
    just = planner.is_free(upper + [1e-9, 0.0, 0.0], HOME)
    told = "= 1.5 lies outside its limits -1.5 to 1.5 by 1e-09 rad"
    assert just.reason.endswith(told)
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=np.array([45.0, 0.0, 0.0]))
    assert "by 44 rad, which looks like degrees, not radians" in answer.reason


def test_a_start_out_of_limits_or_unknown_holds(planner):
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=np.array([1.6, 0.0, 0.0]))
    assert "turn = 1.6 lies outside" in answer.reason
    answer = planner.step(NOBODY, q=np.array([np.nan, 0.0, 0.0]))
    assert "NaN" in answer.reason
    assert planner.step(NOBODY, q=np.array([1.5005, 0.2, 0.0])).status != "holding"


@pytest.mark.parametrize("turned", [2e8, -1e13, 1e17, 1e300])
def test_a_joint_that_turned_so_far_that_numbers_tell_no_place_is_unknown(
    planner, turned
):
    lost = np.array([*HOME[:2], turned])  # its twist turns without end
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=lost)
    assert answer.status == "holding"
    assert "twist" in answer.reason and "check its encoder" in answer.reason
    planner.step(NOBODY, q=HOME)
    for a, b in ((lost, HOME), (HOME, lost), (lost, lost)):
        assert planner.is_free(a, b).failed == "limits"
        assert planner.blocked_leg(np.stack([HOME, a, b])) in (0, 1)
    with pytest.raises(BadConfiguration, match=r"twist.*1e\+08"):
        planner.set_goals([lost])
    near = np.array([*HOME[:2], HOME[2] + 1e6 * 2.0 * np.pi])
    assert planner.step(NOBODY, q=near).status != "holding"


def test_a_start_in_contact_is_named_with_its_link_and_a_retreat(planner):
    planner.set_goals([AWAY])
    answer = planner.step(ball_at([0.3, 0.0, 0.35]), q=HOME)
    assert answer.status == "holding"
    assert "start is in contact" in answer.reason
    # the links themselves may be farther: a cover sticks out of them
    assert f"from the cover of {answer.blockers.link}, closer" in answer.reason
    assert answer.blockers.link in ("upper", "lower", "hand")
    assert len(answer.blockers.points) == 1


def test_blockers_are_looked_for_where_they_are_asked_for_in_their_frame(planner):
    planner.set_goals([AWAY])
    ball = ball_at([-0.5, 0.0, 0.25], 0.08)
    asked, late = planner.step(ball, q=HOME), planner.step(ball, q=HOME)
    assert asked.blockers is NOTHING and "ask for the reason" in asked.reason  # late
    assert late.reason.startswith("goal 0 is blocked")
    kept = late.blockers
    assert len(kept.edges) and len(kept.cells) and kept.goal == 0 and kept.link
    asked = planner.step(ball, q=HOME)
    assert asked.reason == late.reason  # the sentence alone
    planner.step(NOBODY, q=HOME)
    assert late.blockers is kept and asked.blockers is NOTHING


def test_points_deep_inside_a_link_are_told_to_be_of_the_robot_itself(
    small_map, planner
):
    planner.set_goals([AWAY])
    robot, own = small_map.robot, "rather of the robot's own picture: check pose and"
    widest = int((robot.spheres[:, 3] * (robot.sphere_body > 0)).argmax())
    middle, r = sphere_centers(robot, HOME)[widest], robot.spheres[widest, 3]
    assert own in planner.step(middle[None], q=HOME).reason
    beside = middle + [0.0, r - 0.02, 0.0]
    for is_it in (beside[None], odm.Obstacles(spheres=np.array([[*middle, 0.05]]))):
        reason = planner.step(is_it, q=HOME).reason
        assert "start is in contact" in reason and "own picture" not in reason
        # "is -4.2 cm from the cover of upper" was for mathematicians
        assert " cm inside the cover of " in reason and "is -" not in reason


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
    assert f" inside the cover of {answer.blockers.link} there" in answer.reason
    assert "away" in answer.reason
    assert answer.goal is None


def test_what_is_too_near_reads_as_nearer_than_what_is_kept(planner):
    planner.set_goals([AWAY])
    near, far = 0.155, 0.175
    while far - near > 1e-5:
        y = (near + far) / 2
        answer = planner.step(ball_at([-0.5, y, 0.25], 0.08), q=HOME)
        if "goal 0 is blocked" in (answer.reason or ""):
            near, reason = y, answer.reason
        else:
            far = y
    gap, keep = re.findall(r"(\S+) cm from .* closer than (\S+) cm", reason)[0]
    assert float(gap) < float(keep), reason


@pytest.mark.parametrize(("q", "goal"), [(HOME, AWAY), (AWAY, HOME)])
def test_how_dense_points_must_be_for_a_place_to_be_free_is_told(planner, q, goal):
    """At HOME the robot starts, or ends."""
    planner.set_goals([goal])
    said = 0
    for x in np.arange(0.3, 0.9, 0.01):
        ball = ball_at([x, 0.0, 0.3], 0.05)
        reason = planner.step(ball, q=q).reason or ""
        found = re.search(r"more than (\S+) cm from one, say so", reason)
        if found is None:
            continue
        said += 1
        for share, free in ((1.0, True), (1.2, False)):
            radius = 0.01 * share * float(found[1])
            answer = planner.step(ball, q=q, covering_radius=min(radius, planner.rho))
            words = ("in contact", "is blocked")
            assert free != any(word in (answer.reason or "") for word in words), x
            assert "say so" not in (answer.reason or "")
    assert said


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
    for radius in (-0.01, np.nan):
        with pytest.raises(BadInput, match="covering radius of"):
            planner.step(NOBODY, q=HOME, covering_radius=radius)
    with pytest.raises(BadInput, match="labels"):
        planner.step(NOBODY, q=HOME, labels=np.zeros(3))
    with pytest.raises(BadInput, match="dq"):
        planner.step(NOBODY, q=HOME, dq=np.zeros(2))


def test_a_frame_that_was_refused_is_none(planner):
    planner.set_goals([AWAY])
    near = odm.Obstacles(spheres=np.array([[0.3, 0.0, 0.5, 0.1]]))
    planner.step(near, q=HOME, stamp=1.0, now=1.0)
    before = planner.save_memory()
    for take, wrong in (
        (planner.step, {"stamp": "x"}),
        (planner.step, {"stamp": 1.1, "now": [1.1]}),
        (planner.step, {"rounding": -1.0}),
        (planner.see, {"now": "x"}),
    ):
        with pytest.raises(BadInput, match="give seconds as numbers|rounding"):
            take(NOBODY, q=AWAY, **wrong)
        assert not differences(before, planner.save_memory()), wrong
        assert "sphere 0" in planner.is_free(HOME, AWAY).reason


def test_raw_points_are_certified_as_far_as_they_are_seen(planner):
    planner.set_goals([AWAY])
    points = odm.sample_capsules(POST, 0.03)
    whole = planner.step(points, q=HOME, closed=True)
    assert whole.certified == "whole surface"
    raw = planner.step(points, q=HOME, covering_radius=0.01)
    assert raw.certified == "visible surface"


def test_points_outside_the_grid_are_counted(planner):
    points = np.array([[9.0, 0, 0], [0, 0, 0.9], [0, -50.0, 0]])
    assert planner.step(points, q=HOME).work.outside == 2


def test_more_points_than_ever_are_taken(small_map):
    settings = odm.PlannerSettings(point_capacity=100)
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


def test_questions_after_a_frame_of_no_numbers_are_answered_with_no(planner):
    planner.step(np.array([[0.5, np.nan, 0.5]]), q=HOME)
    freedom = planner.is_free(HOME, HOME)
    assert not freedom and freedom.failed == "frame" and "NaN" in freedom.reason


@pytest.mark.parametrize("shape", [(0, 3), (3,), (2, 2)])
def test_a_path_that_is_none_is_refused_by_the_braking_test(planner, shape):
    with pytest.raises(BadInput, match="a path of shape"):
        planner.blocked_leg(np.zeros(shape))


def test_scenery_of_no_numbers_is_refused_and_forgotten(planner):
    with pytest.raises(BadInput, match="points of scenery are NaN"):
        planner.set_static(np.array([[0.5, np.nan, 0.5]]))
    planner.set_base(np.eye(4))
    planner.set_extra_clearance(0.01)
