"""Goals by tool pose: what is reached, what is refused and why, and in which order."""

import numpy as np
import pytest
from rows import each
from small import AWAY, HOME, NOBODY, draw_valid

import odm
from odm.exact.distances import ExactRobot
from odm.planner.pose_goals import PoseGoals
from odm.planner.settings import PoseSettings
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.transforms import pose_of


@pytest.fixture(scope="module")
def asked(small_map):
    """A planner that knows where its robot is."""
    planner = odm.ReactivePlanner(small_map)
    planner.step(NOBODY, q=HOME)
    return planner


def off(robot, q, T):
    R = tool_pose(robot, q)
    turn = 0.5 * (np.trace(R[:3, :3].T @ T[:3, :3]) - 1.0)
    return np.linalg.norm(R[:3, 3] - T[:3, 3]), np.arccos(np.clip(turn, -1.0, 1.0))


def test_poses_of_valid_configurations_are_reached_in_limits_and_free(asked, rng):
    robot, found = asked.robot, 0
    exact = ExactRobot(robot, base=True)
    for _ in range(30):
        T = tool_pose(robot, draw_valid(asked, rng))
        try:
            report = asked.set_goals(poses=[T])
        except BadConfiguration:
            continue
        found += 1
        assert np.array_equal(asked.goals, report.goals)
        for q in report.solutions:
            position, turn = off(robot, q, T)
            assert position < 1e-4 and turn < 1e-3
            assert ((robot.lower <= q) & (q <= robot.upper)).all()
            assert asked.static.motion_free(q, np.zeros_like(q))
            assert exact.self_distance(q).distance > 0.0
    assert found >= 27  # from near nodes alone, without a lucky start


def test_solutions_that_are_blocked_now_come_last_then_the_far_ones(small_map):
    planner = odm.ReactivePlanner(small_map)
    # the wrist of the small arm turns the tool: two postures for one place
    poses = [tool_pose(planner.robot, q) for q in (AWAY, HOME)]
    planner.step(NOBODY, q=HOME)
    report = planner.set_goals(poses=poses)
    assert report.index[0] == 1 and set(report.index) == {0, 1}
    ball = poses[1][:3, 3][None] + [[0.0, 0.0, 0.02]]
    planner.step(odm.sample_capsules(np.array([[*ball[0], *ball[0], 0.03]])), q=HOME)
    report = planner.set_goals(poses=poses)
    assert report.index[0] == 0  # that one can be reached now
    answer = planner.step(NOBODY, q=HOME)
    assert answer.goal == 0 and np.allclose(answer.path[-1], report.goals[0])


def test_what_is_refused_is_told_beside_what_is_taken(asked):
    robot = asked.robot
    good = tool_pose(robot, AWAY)
    far = pose_of([3.0, 0.0, 0.5], np.zeros(3))
    beneath = good.copy()
    beneath[2, 3] = -0.3
    report = asked.set_goals(poses=[far, good, beneath])
    assert set(report.index) == {1} and len(report.goals) >= 1
    told = {one.index: one.reason for one in report.refused}
    assert (
        "beyond the reach of" in told[0] and "floor" in told[2] or "nearer" in told[2]
    )
    with pytest.raises(BadConfiguration, match="none of 1 poses .* pose 0: it lies 3"):
        asked.set_goals(poses=[far])
    assert np.array_equal(asked.goals, report.goals)


def test_the_scene_refuses_solutions(small_map):
    planner = odm.ReactivePlanner(small_map)
    T = tool_pose(planner.robot, AWAY)
    planner.scene.add("crate", odm.Box((0.2, 0.2, 0.2)), T)
    with pytest.raises(BadConfiguration, match="would touch crate"):
        planner.set_goals(poses=[T])
    planner.scene.remove("crate")
    assert len(planner.set_goals(poses=[T]).goals)


def test_where_no_solution_is_free_more_are_looked_for(small_map, monkeypatch):
    planner = odm.ReactivePlanner(small_map)
    static, counts = planner.frame.static, []
    is_free = static.motions_free

    def not_at_first(q, dq):
        counts.append(len(q))
        return is_free(q, dq) & (len(counts) > 1)

    monkeypatch.setattr(static, "motions_free", not_at_first)
    found = PoseGoals(planner.frame, PoseSettings(same_within=0.0, max_solutions=3))
    assert len(found.solve([tool_pose(planner.robot, AWAY)], None, None).goals) == 1
    assert counts == [3, 24]


def test_a_tolerance_takes_what_is_near_enough(asked):
    T = tool_pose(asked.robot, AWAY)
    T[:3, 3] *= 1.002
    with pytest.raises(BadConfiguration, match="comes no nearer than"):
        asked.set_goals(poses=[T], tolerance=1e-5)
    report = asked.set_goals(poses=[T], tolerance=(0.02, 0.2))
    position, turn = off(asked.robot, report.goals[0], T)
    assert position <= 0.02 and turn <= 0.2


def test_poses_are_in_the_world(small_map):
    planner = odm.ReactivePlanner(small_map)
    T = tool_pose(planner.robot, AWAY)
    here = planner.set_goals(poses=[T]).goals
    moved = pose_of([1.0, 2.0, 0.3], [0.0, 0.0, 1.0])
    planner.set_base(moved)
    there = planner.set_goals(poses=[moved @ T]).goals
    assert np.allclose(here, there, atol=1e-5)


def test_the_number_of_goals_is_bounded_and_the_same_call_gives_the_same(asked, rng):
    poses = [tool_pose(asked.robot, draw_valid(asked, rng)) for _ in range(8)]
    few = asked.set_goals(poses=poses, most=2)
    assert len(few.goals) == 2 and len(few.solutions) > 2
    all_ = asked.set_goals(poses=poses)
    assert len(all_.goals) >= len(np.unique(all_.solution_index))
    again = asked.set_goals(poses=poses)
    assert again.goals.tobytes() == all_.goals.tobytes()


@each(
    ("how", "told"),
    [
        ({"poses": []}, "no poses were given; give 1 to 32 poses"),
        ({"poses": np.eye(4)}, "poses have shape .4, 4.; give 1 to 32"),
        ({"poses": 3}, "poses are a int"),
        ({"poses": [[[1, 2], [3]]]}, "pose 0, a list, holds no real numbers"),
        ({"poses": [np.ones((4, 4))]}, "pose 0"),
        ({"poses": [np.eye(4), np.full((4, 4), np.nan)]}, "pose 1"),
        ({"poses": [np.eye(4)] * 33}, "33 poses were given"),
        ({"poses": [np.eye(4)], "tolerance": 0.0}, "tolerance is 0.0; give"),
        ({"poses": [np.eye(4)], "tolerance": (1, 2, 3)}, "tolerance is"),
        ({"poses": [np.eye(4)], "tolerance": "fine"}, "tolerance is 'fine'"),
        ({"poses": [np.eye(4)], "most": 0}, "most is 0"),
        ({"poses": [np.eye(4)], "most": 2.5}, "most is 2.5"),
        ({"poses": [np.eye(4)], "goals": [HOME]}, "beside poses"),
        ({"goals": []}, "no goals were given; give 1 to 32"),
        ({"goals": np.zeros((0, 3))}, "no goals were given"),
        ({}, "no goals were given"),
    ],
)
def test_bad_poses_and_goals_are_told_in_one_sentence(asked, how, told):
    with pytest.raises(BadInput, match=told) as caught:
        asked.set_goals(**how)
    assert "\n" not in str(caught.value)


def test_one_bad_goal_among_good_ones_is_told_and_left_out(small_map):
    planner = odm.ReactivePlanner(small_map)
    bad = np.array([0.0, 9.0, 0.0])
    report = planner.set_goals([bad, AWAY, HOME], costs=[0.0, 2.0, 0.5])
    assert report.index.tolist() == [1, 2] and len(report.refused) == 1
    assert report.refused[0].index == 0
    assert "goal 0 is out of limits" in report.refused[0].reason
    assert np.array_equal(planner.goals, [AWAY, HOME])
    assert planner.costs.tolist() == [2.0, 0.5]
    answer = planner.step(NOBODY, q=0.9 * HOME)
    assert report.index[answer.goal] == 2
    with pytest.raises(BadConfiguration, match="goal 1 is out of limits"):
        planner.set_goals([bad, -bad])
    assert planner.set_goals([HOME]).refused == ()


def test_a_pose_has_few_motions_at_once_and_the_others_between_frames(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.step(NOBODY, q=HOME)
    planner.set_goals(poses=[tool_pose(planner.robot, AWAY)])
    number = planner.memory.goals.number
    least = planner.attacher.settings.pose_at_once
    assert 0 < number[0] <= least < planner.attacher.settings.goal_at_once
    assert planner.step(NOBODY, q=HOME).path.size
    while planner.attacher.waits:
        planner.improve(4)
    assert number[0] > least


def test_the_settings_say_which_solutions_are_one_and_how_many_are_looked_at(asked):
    T = tool_pose(asked.robot, AWAY)
    counts = []
    for settings in (PoseSettings(), PoseSettings(same_within=0.0, max_solutions=3)):
        found = PoseGoals(asked.frame, settings)
        counts.append(len(found.solve([T], None, None).solutions))
    assert counts == [1, 3]
