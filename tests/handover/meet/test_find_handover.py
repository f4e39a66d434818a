"""Algorithm 2: best first, verified, failing entries removed, and why."""

from dataclasses import replace

import numpy as np
import pytest
from meet_people import BOARD, person, workspace

import odm
from handover import ReachSettings, build_reach_map, chain_of
from handover.meet.constraints import ClearOf
from handover.meet.find import find_handover
from handover.meet.settings import FindSettings
from handover.meet.validity import PlannerValidity
from odm.exact.distances import ExactRobot
from odm.obstacles.scenery import Scenery, parse_scenery
from odm.obstacles.shapes import Capsule
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.transforms import pose_of

EYE = np.eye(4)
LONG = 60.0  # [s] tests do not wait for a clock


@pytest.fixture
def meet(robot_map):
    return workspace(robot_map, person(0.8))


def test_the_best_target_in_reach_is_found_within_the_tolerance(meet, robot):
    ranked = meet.best(30)
    found = find_handover(meet, robot, lambda q: True, LONG)
    assert found and found.reason == "" and not found.timed_out
    given_up = [target.key for target, _ in found.tried]
    assert [t.key for t in ranked][: len(given_up) + 1] == [*given_up, found.target.key]
    T = tool_pose(robot, found.q)
    off = np.linalg.norm(T[:3, 3] - found.target.T_world_tool[:3, 3])
    assert off <= FindSettings().position_tolerance
    turn = T[:3, :3].T @ found.target.T_world_tool[:3, :3]
    angle = np.arccos(min(1.0, (np.trace(turn) - 1) / 2))
    assert angle <= FindSettings().rotation_tolerance


def test_what_is_not_valid_is_removed_and_told_until_restored(meet, robot):
    best = find_handover(meet, robot, lambda q: True, LONG).target

    def not_there(q):
        off = tool_pose(robot, q)[:3, 3] - best.T_world_tool[:3, 3]
        return bool(np.linalg.norm(off) > 0.01), "a lamp hangs there"

    found = find_handover(meet, robot, not_there, LONG)
    assert found and found.target.quality <= best.quality
    why = {target.key: reason for target, reason in found.tried}
    assert "a lamp hangs there" in why[best.key]
    assert meet.rated([best.key]) == [None]
    meet.restore()
    assert meet.rated([best.key])[0].quality == best.quality


def test_no_arm_reaches_through_a_board(robot_map, robot):
    clear = (ClearOf(parse_scenery((BOARD,))),)
    meet = workspace(robot_map, person(0.8), constraints=clear)
    through = {t.key for t in meet.best(300)} - {
        t.key for t in meet.takeable(meet.best(300))
    }
    found = find_handover(meet, robot, lambda q: True, LONG)
    why = {target.key: reason for target, reason in found.tried}
    assert found and found.target.key not in through and through & why.keys()
    for key in through & why.keys():
        assert "would be in what stands still" in why[key]


def test_no_arm_reaches_through_what_the_planners_scene_adds(robot_map, cell_map):
    planner = odm.ReactivePlanner(cell_map)
    board = parse_scenery((BOARD,)).shapes()[0][1]
    shifted = pose_of((0.2, -0.1, 0.3), (0.1, 0.0, 0.4))
    planner.set_base(shifted)  # a scene stands in the world, and so does the person
    planner.scene.add("board", board, shifted)
    known = workspace(robot_map, person(0.8), constraints=(ClearOf(Scenery()),))
    through = {t.key for t in known.best(300)} - {
        t.key for t in known.takeable(known.best(300), ClearOf.of_scene(planner, EYE))
    }
    meet = workspace(
        robot_map, person(0.8), constraints=(ClearOf(parse_scenery((BOARD,))),)
    )
    clear = {t.key for t in meet.takeable(meet.best(300))}
    assert through and not through & clear  # as if the map had it
    planner.step(np.zeros((0, 3)), q=cell_map.roadmap.nodes[0])
    found = find_handover(known, planner.robot, planner, LONG)
    why = {target.key: reason for target, reason in found.tried}
    assert found.target is None or found.target.key not in through
    assert through & why.keys()
    for key in through & why.keys():
        assert "would be in what stands still" in why[key]
    bare = workspace(robot_map, person(0.8))  # who gives no ClearOf is not asked
    ranked = bare.best(300)
    assert bare.takeable(ranked, ClearOf.of_scene(planner, EYE)) == ranked


def test_each_rejected_one_says_what_it_fell_for(meet, robot):
    found = find_handover(meet, robot, lambda q: (False, "no"), timeout=20.0)
    assert not found and found.tried
    kinds = {reason.split(":")[0].split(" (")[0] for _, reason in found.tried}
    assert kinds <= {"no", "inverse kinematics"} and "no" in kinds


def test_when_nothing_is_left_it_says_so(robot_map, robot):
    meet = workspace(robot_map, person(1.2))
    for target in meet.best(1000)[3:]:
        meet.remove(target)
    found = find_handover(meet, robot, lambda q: (False, "the door is shut"), LONG)
    assert not found and found.target is None and not found.timed_out
    assert "all 3 targets failed" in found.reason and len(found.tried) == 3


def test_a_person_out_of_reach_is_no_exception(robot_map, robot):
    found = find_handover(workspace(robot_map, person(2.5)), robot, lambda q: True)
    assert not found and found.tried == () and not found.timed_out
    assert "1.0" in found.reason and "nearer" in found.reason


def test_a_time_that_is_over_gives_the_best_not_refuted_and_says_so(meet, robot):
    ranked, times = meet.best(5), iter([0.0, 0.1, 0.2, 0.3, 9.0])
    found = find_handover(
        meet, robot, lambda q: False, timeout=1.0, clock=lambda: next(times)
    )
    assert found.timed_out and found.q is None and not found
    assert [t.key for t, _ in found.tried] == [t.key for t in ranked[:3]]
    assert found.target.key == ranked[3].key
    assert "1 s was over after 3 targets" in found.reason


def test_a_planner_tells_what_is_free(robot_map, cell_map):
    human = person(0.8)
    meet, planner = workspace(robot_map, human), odm.ReactivePlanner(cell_map)
    q = cell_map.roadmap.nodes[0]
    planner.step(human.surface_points(), q=q)
    found = find_handover(meet, planner.robot, planner, LONG)
    assert found and planner.is_free(found.q, found.q)
    # a ball where the tool would be: the next frame refuses that target
    ball = np.r_[tool_pose(planner.robot, found.q)[:3, 3], 0, 0, 0, 0.06]
    ball[3:6] = ball[:3]
    planner.step(odm.sample_capsules(ball[None], 0.03), q=q)
    valid, why = PlannerValidity(planner)(found.q)
    assert not valid and why.startswith("frame:")
    other = find_handover(meet, planner.robot, planner, LONG)
    assert any(why.startswith("frame:") for _, why in other.tried)
    assert not other or other.target.key != found.target.key


def test_a_configuration_that_cannot_be_joined_is_no_goal(cell_map, monkeypatch):
    planner = odm.ReactivePlanner(cell_map)
    q = cell_map.roadmap.nodes[3]
    assert PlannerValidity(planner)(q) == (True, "")
    standing = planner.is_free(q, q)

    def only_standing(a, b):
        return standing if np.array_equal(a, b) else odm.Freedom(False, "frame", "x")

    monkeypatch.setattr(planner, "is_free", only_standing)
    valid, why = PlannerValidity(planner)(q + 1e-3)
    assert not valid and why.startswith("attachment:")
    assert PlannerValidity(planner, joined=0)(q + 1e-3) == (True, "")


def test_exact_geometry_may_judge(meet, robot):
    exact = ExactRobot(robot)
    rods = [Capsule.between(c[:3], c[3:6], c[6]) for c in meet.human.capsules()]

    def apart(q):
        distance = exact.distance(q, rods).distance
        return distance > 0.02, f"{100 * distance:.0f} cm from the person"

    found = find_handover(meet, robot, apart, LONG)
    assert found and exact.distance(found.q, rods).distance > 0.02


@pytest.mark.parametrize(
    "timeout",
    [0.0, -1.0, float("nan"), float("inf"), "1", None, 10**400]
    + [pytest.param(10**5000, id="more than Python writes")],
)
def test_a_time_that_is_none_is_refused(meet, robot, timeout):
    with pytest.raises(BadInput, match="timeout"):
        find_handover(meet, robot, lambda q: True, timeout)


def test_a_tolerance_is_kept_that_is_asked_for(meet, robot):
    wide = FindSettings(position_tolerance=0.02, rotation_tolerance=0.1, attempts=1)
    found = find_handover(meet, robot, lambda q: True, 30.0, settings=wide)
    T = np.linalg.inv(meet.settings.T_world_base) @ found.target.T_world_tool
    off = np.linalg.norm(tool_pose(robot, found.q)[:3, 3] - T[:3, 3])
    assert 1e-4 < off <= 0.02


@pytest.mark.parametrize("wrong", [None, 3, "free"])
def test_a_validity_that_cannot_be_asked_is_refused(meet, robot, wrong):
    with pytest.raises(BadInput, match="is_valid"):
        find_handover(meet, robot, wrong)


@pytest.mark.parametrize("wrong", [None, 1, ("yes", "no"), (True,)])
def test_an_answer_that_is_none_is_refused(meet, robot, wrong):
    with pytest.raises(BadInput, match="is_valid answered"):
        find_handover(meet, robot, lambda q: wrong, LONG)


def test_another_robot_is_refused(meet):
    other = load_robot("panda", cover_excess=0.2)
    with pytest.raises(BadInput, match="panda"):
        find_handover(meet, other, lambda q: True)


def test_the_same_robot_with_another_tool_is_refused(robot):
    longer = robot.T_body_tip.copy()
    longer[2, 3] += 0.1
    chain = chain_of(replace(robot, T_body_tip=longer))
    settings = ReachSettings(cell=0.2, rotations=72, samples=2000)
    reach = build_reach_map(chain, settings, threads=1)
    meet = workspace(reach, person(0.8), cell=0.2)
    with pytest.raises(BadInput, match="tool"):
        find_handover(meet, robot, lambda q: True)
