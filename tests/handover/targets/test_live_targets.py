"""The live thread: targets become goals, and the robot gets there."""

import numpy as np
import pytest
from meet_people import person, workspace
from small import small_recipe

import odm
from handover.meet.constraints import ClearOf
from handover.targets.live_targets import (
    BLOCKED,
    NOBODY,
    THERE,
    UNDER_WAY,
    WITHDRAWN,
    LiveTargets,
)
from handover.targets.node_index import NodeIndex
from handover.targets.settings import ChoiceSettings, LiveSettings
from odm.obstacles.scenery import Scenery, parse_scenery
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, tool_pose

STEP = 0.05  # [rad] the joints move in a frame


@pytest.fixture(scope="module")
def index(cell_map):
    return NodeIndex(cell_map.robot, cell_map.roadmap.nodes)


def live_of(cell_map, robot_map, index, human, **settings):
    planner = odm.ReactivePlanner(cell_map)
    meet = workspace(robot_map, human)
    return LiveTargets(planner, meet, None, index, LiveSettings(**settings))


def moved(robot, q, path):
    """Return where a robot is one frame later on a path."""
    for corner in path[1:]:
        way = difference(robot, q, corner)
        far = np.abs(way).max()
        if far > 1e-9:
            return q + way * min(1.0, STEP / far)
    return q


def run(live, q, people, pace=True):
    """Run a frame for every person; return where the robot is and all pursuits."""
    robot, pursuits = live.planner.robot, []
    points = {}
    for human in people:
        if id(human) not in points:
            points[id(human)] = human.surface_points()
        answer = live.step(human, points[id(human)].copy(), q)
        pursuits.append(live.pursuit)
        if answer.status != "holding" and pace:
            q = moved(robot, q, answer.path)
    return q, pursuits


def start(cell_map):
    """Return a node whose tool is up and away from the person."""
    tools = [tool_pose(cell_map.robot, q)[:3, 3] for q in cell_map.roadmap.nodes]
    return np.array(cell_map.roadmap.nodes[int(np.argmin([t[0] for t in tools]))])


def test_the_robot_gets_to_the_target_it_pursues(cell_map, robot_map, index):
    human = person(0.9)
    live = live_of(cell_map, robot_map, index, human)
    q, pursuits = run(live, start(cell_map), [human] * 250)
    last = pursuits[-1]
    assert last.state == THERE and last.kind == "exact"
    assert {UNDER_WAY, THERE} <= {p.state for p in pursuits}
    target = live.meet.rated([last.key])[0]
    off = tool_pose(cell_map.robot, q)[:3, 3] - target.T_world_tool[:3, 3]
    assert np.linalg.norm(off) < 1e-3
    assert last.quality == pytest.approx(target.quality)


@pytest.mark.parametrize("at_run_time", [False, True])
@pytest.mark.parametrize("rank_budget", [0, 200])
def test_no_target_is_pursued_that_an_arm_would_reach_through_a_board(
    cell_map, robot_map, index, rank_budget, at_run_time
):
    human = person(0.9)
    live = live_of(cell_map, robot_map, index, human, rank_budget=rank_budget)
    _, before = run(live, start(cell_map), [human] * 90)
    through = live.meet.rated([before[-1].key])[0]
    forearm = human.arm_capsules("right", through.arm_q[None])[0, 1]
    board = {"type": "box", "size": [0.02, 0.02, 0.02]}
    board["position"] = (0.5 * (forearm[:3] + forearm[3:6])).tolist()
    board = parse_scenery((board,))
    clear = (ClearOf(Scenery() if at_run_time else board),)

    live = live_of(cell_map, robot_map, index, human, rank_budget=rank_budget)
    live.meet = live.finder.meet = workspace(robot_map, human, constraints=clear)
    q, pursuits = start(cell_map), []
    if at_run_time:  # it is put there while the robot is on its way to that target
        q, pursuits = run(live, q, [human] * 90)
        assert pursuits[-1].key == through.key
        live.planner.scene.add("board", board.shapes()[0][1])
        q, pursuits = run(live, q, [human] * 20)
    _, pursuits = run(live, q, [human] * 120)
    keys = {p.key for p in pursuits} - {None}
    assert keys and through.key not in keys
    scene = ClearOf.of_scene(live.planner, np.eye(4))
    for target in live.meet.rated(sorted(keys)):
        assert live.meet.takeable([target], scene) == [target]
    if at_run_time:  # and back to it once it is taken away
        assert not live.meet.takeable([through], scene)
        live.planner.scene.clear()
        _, pursuits = run(live, q, [human] * 400)
        assert pursuits[-1].quality >= through.quality - 0.03


@pytest.mark.parametrize("rank_budget", [0, 200])
def test_targets_in_a_crate_are_back_when_it_is_gone(
    cell_map, robot_map, index, rank_budget
):
    human = person(0.9)
    live = live_of(cell_map, robot_map, index, human, rank_budget=rank_budget)
    best, other = live.meet.best(2)
    live.meet.remove(other)  # by the user
    at = np.eye(4)
    at[:3, 3] = best.T_world_tool[:3, 3]
    live.planner.scene.add("crate", odm.Box((0.3, 0.3, 0.3)), at)
    q, pursuits = run(live, start(cell_map), [human] * 90)
    assert best.key not in {p.key for p in pursuits}
    assert best.key in live.finder.failed and best.key in live.meet.removed
    assert live.finder.why_failed.endswith(" would touch crate)")
    live.planner.scene.remove("crate")
    q, pursuits = run(live, q, [human] * 60)
    assert pursuits[-1].key == best.key and other.key in live.meet.removed
    assert set(live.meet.removed) == {other.key, *live.finder.failed}
    assert "crate" not in live.finder.why_failed
    live.finder.forget()
    assert live.meet.removed.tolist() == [other.key]


@pytest.mark.parametrize("rank_budget", [0, 200])
def test_targets_that_nobody_can_take_leave_room_for_as_many_others(
    cell_map, robot_map, index, rank_budget
):
    human = person(0.9)
    free = workspace(robot_map, human).best(40)
    arms = human.arm_capsules("right", np.array([t.arm_q for t in free[:10]]))[:, 1]
    middles = 0.5 * (arms[:, :3] + arms[:, 3:6])
    lower, upper = middles.min(axis=0) - 0.05, middles.max(axis=0) + 0.05
    board = {"type": "box", "size": (upper - lower).tolist()}
    board["position"] = (0.5 * (lower + upper)).tolist()
    clear = (ClearOf(parse_scenery((board,))),)
    live = live_of(cell_map, robot_map, index, human, rank_budget=rank_budget)
    live.meet = live.finder.meet = workspace(robot_map, human, constraints=clear)
    blocked = len(live.meet.best(10)) - len(live.meet.takeable(live.meet.best(10)))
    assert blocked >= 3  # of the ten that are considered in a frame
    run(live, start(cell_map), [human] * 200, pace=False)
    assert live.pursuit.targets >= live.settings.ranked


def test_it_is_there_for_the_other_hand_once_that_was_ranked(
    cell_map, robot_map, index
):
    human = person(0.9)
    live = live_of(cell_map, robot_map, index, human, rank_budget=50)
    q, pursuits = run(live, start(cell_map), [human] * 400)
    assert pursuits[-1].state == THERE
    live.expect("left")
    q, pursuits = run(live, q, [human] * 400)
    assert pursuits[0].state == UNDER_WAY and pursuits[-1].state == THERE
    new = workspace(robot_map, human, side="left").rated([pursuits[-1].key])[0]
    assert pursuits[-1].quality == pytest.approx(new.quality)


def test_goals_on_the_brink_are_offered_where_there_are_no_others(
    cell_map, robot_map, index
):
    human = person(0.9)
    settings = {"spare_m": 1.0, "spare_frames": 60}  # none keeps so much
    live = live_of(cell_map, robot_map, index, human, **settings)
    _, pursuits = run(live, start(cell_map), [human] * 150)
    assert {p.state for p in pursuits[:60]} <= {BLOCKED, NOBODY}
    assert pursuits[-1].state in (UNDER_WAY, THERE)
    assert live.goals and live.planner.separation(live.goals[0].q) < 1.0


def test_goals_are_set_only_when_they_change(cell_map, robot_map, index):
    human = person(0.9)
    live = live_of(cell_map, robot_map, index, human)
    calls = []
    set_goals = live.planner.set_goals
    live.planner.set_goals = lambda *goals: (calls.append(goals), set_goals(*goals))
    _, pursuits = run(live, start(cell_map), [human] * 200)
    assert len(calls) == sum(p.set_goals for p in pursuits) == live.counts["set_goals"]
    assert 1 <= len(calls) < 40
    for a, b in zip(calls, calls[1:], strict=False):
        assert not np.array_equal(np.array(a), np.array(b))


def test_a_person_who_trembles_does_not_change_the_target(cell_map, robot_map, index):
    rng, human = np.random.default_rng(2), person(0.9)
    live = live_of(cell_map, robot_map, index, human)
    q, _ = run(live, start(cell_map), [human] * 200)
    key = live.pursuit.key
    people = [person(0.9 + d, a) for d, a in rng.uniform(-0.004, 0.004, (100, 2))]
    _, pursuits = run(live, q, people)
    assert {p.key for p in pursuits} == {key}


def test_a_person_who_goes_elsewhere_is_followed(cell_map, robot_map, index):
    here, there = person(0.9, 0.25), person(0.9, -0.35)
    live = live_of(cell_map, robot_map, index, here)
    q, before = run(live, start(cell_map), [here] * 200)
    _, after = run(live, q, [there] * 300)
    assert before[-1].key is not None and after[-1].key is not None
    assert before[-1].key != after[-1].key
    margin = live.settings.choice.quality_hysteresis
    live.meet.update(there)
    was = live.meet.rated([before[-1].key])[0]
    assert was is None or after[-1].quality > was.quality + margin


def test_with_nobody_in_reach_it_goes_to_its_place_of_rest(cell_map, robot_map, index):
    here, away = person(0.9), person(2.5)
    live = live_of(cell_map, robot_map, index, here)
    rest = start(cell_map)
    q, pursuits = run(live, rest, [here] * 150)
    assert np.abs(difference(cell_map.robot, q, rest)).max() > 0.1
    q, pursuits = run(live, q, [away] * 250)
    assert pursuits[-1].state == NOBODY and pursuits[-1].goals == 0
    assert pursuits[-1].missing_m == pytest.approx(live.meet.missing_m)
    assert np.abs(difference(cell_map.robot, q, rest)).max() < 1e-9


def test_withdrawn_it_goes_to_its_place_of_rest_and_then_to_the_same_target(
    cell_map, robot_map, index
):
    human, rest = person(0.9), start(cell_map)
    live = live_of(cell_map, robot_map, index, human)
    q, before = run(live, rest, [human] * 250)
    assert before[-1].state == THERE
    live.withdraw()
    q, away = run(live, q, [human] * 250)
    assert {p.state for p in away} == {WITHDRAWN}
    assert {p.key for p in away} == {None} and [p.set_goals for p in away].count(1) == 1
    np.testing.assert_allclose(difference(cell_map.robot, q, rest), 0, atol=1e-9)
    assert live.targets  # they are ranked meanwhile
    live.resume()
    changes = live.counts["changes"]
    q, after = run(live, q, [human] * 250)
    assert after[-1].state == THERE and after[-1].key == before[-1].key
    assert live.counts["changes"] == changes


def test_withdrawn_it_goes_to_rest_where_the_person_within_the_clearance_lets_it(
    cell_map, robot_map, index
):
    human, rest = person(0.9), start(cell_map)
    live = live_of(cell_map, robot_map, index, human)
    q, _ = run(live, rest, [human] * 250)
    tool = tool_pose(cell_map.robot, q)[:3, 3]
    touching = np.vstack([human.surface_points(), tool])
    live.step(human, touching, q)
    live.withdraw()
    answer = live.step(human, touching, q)
    assert answer.status == "holding" and live.pursuit.state == WITHDRAWN
    q, _ = run(live, q, [human] * 250)
    np.testing.assert_allclose(difference(cell_map.robot, q, rest), 0, atol=1e-9)


def test_near_rest_inverse_kinematics_begins_at_the_place_of_rest(
    cell_map, robot_map, index
):
    human, rest = person(0.9), start(cell_map)
    live = live_of(cell_map, robot_map, index, human, near_rest=True)
    robot, begun = live.planner.robot, []
    finder = live.finder
    live.look(human, rest)
    solve = robot.ik
    target = live.targets[0]
    finder.forget()
    object.__setattr__(
        robot, "ik", lambda T, q, **o: begun.append(q) or solve(T, q, **o)
    )
    for _ in range(live.settings.starts):
        finder.work(target)
    object.__delattr__(robot, "ik")
    np.testing.assert_array_equal(begun[0], rest)
    assert not any(np.array_equal(q, rest) for q in begun[1:])
    plain = live_of(cell_map, robot_map, index, human)
    plain.look(human, rest)
    assert plain.finder.rest is None


def test_of_targets_alike_the_one_that_turns_the_tool_least_goes_first(
    cell_map, robot_map, index
):
    human, rest = person(0.9), start(cell_map)
    live = live_of(cell_map, robot_map, index, human, near_rest=True)
    live.look(human, rest)
    plain = live_of(cell_map, robot_map, index, human)
    plain.look(human, rest)
    assert {t.key for t in live.targets} == {t.key for t in plain.targets}
    told = [round(t.quality, 6) for t in live.targets]
    assert told == sorted(told, reverse=True)
    R = tool_pose(cell_map.robot, rest)[:3, :3]
    base = live.meet.settings.T_world_base[:3, :3]
    turns = [
        np.arccos((np.trace((base @ R).T @ t.T_world_tool[:3, :3]) - 1) / 2)
        for t in live.targets
    ]
    alike = [
        (a, b)
        for a, b, x, y in zip(turns, turns[1:], told, told[1:], strict=False)
        if x == y
    ]
    assert alike and all(a <= b + 1e-9 for a, b in alike)


def test_a_blocked_best_target_is_left_for_the_best_reachable(
    cell_map, robot_map, index
):
    human = person(0.9)
    live = live_of(cell_map, robot_map, index, human)
    _, pursuits = run(live, start(cell_map), [human] * 200)
    first = live.meet.rated([pursuits[-1].key])[0]
    live = live_of(cell_map, robot_map, index, human, connect_every=6)
    ball = np.r_[first.T_world_tool[:3, 3], first.T_world_tool[:3, 3], 0.02]
    wall = odm.sample_capsules(ball[None], 0.03)
    q, keys, states = start(cell_map), [], []
    for _ in range(500):
        points = np.concatenate([human.surface_points(), wall])
        answer = live.step(human, points, q)
        keys.append(live.pursuit.key)
        states.append(live.pursuit.state)
        if answer.status != "holding":
            q = moved(cell_map.robot, q, answer.path)
    assert first.key not in keys
    assert states[-1] in (THERE, UNDER_WAY) and BLOCKED not in states[-50:]


def test_a_target_that_no_inverse_kinematics_reaches_is_removed(
    cell_map, robot_map, index
):
    human = person(0.9)
    every = {"node_tolerance_m": 0.0, "far": 1e6}  # all starts, however far it is
    live = live_of(cell_map, robot_map, index, human, **every)
    target = live.meet.best(1)[0]
    far = target.T_world_tool.copy()
    far[0, 3] += 5.0
    target = type(target)(**(vars(target) | {"T_world_tool": far}))
    for _ in range(live.settings.starts):
        assert live.finder.is_open(target.key)
        assert live.finder.work(target) is None
    assert not live.finder.is_open(target.key) and target.key in live.finder.failed
    assert live.meet.rated([target.key]) == [None]


def test_a_node_serves_only_where_the_person_can_take_the_object(
    cell_map, robot_map, index
):
    human = person(0.9)
    live = live_of(
        cell_map, robot_map, index, human, node_tolerance_m=0.2, node_tolerance_rad=1.0
    )
    meet, served = live.meet, 0
    for target in meet.best(200):
        goal = live.finder.near_node(target)
        if goal is None:
            continue
        served += 1
        T = tool_pose(cell_map.robot, goal.q) @ meet.obj.T_tool_object
        assert len(human.arm_ik("right", T @ meet.grasps[target.grasp]).q)
        off = np.linalg.norm(
            tool_pose(cell_map.robot, goal.q)[:3, 3] - target.T_world_tool[:3, 3]
        )
        assert off <= 0.2
    assert served


def test_a_base_that_stands_elsewhere_than_the_workspace_has_it_is_refused(
    cell_map, robot_map, index
):
    human, T = person(0.9), np.eye(4)
    T[0, 3] = 0.05
    live = live_of(cell_map, robot_map, index, human)
    q, points = start(cell_map), human.surface_points()
    live.step(human, points, q)
    live.planner.set_base(T)
    for _ in range(2):
        with pytest.raises(BadInput, match="base stands at .* by planner.set_base"):
            live.step(human, points, q)
    meet = workspace(robot_map, human, T_world_base=T)
    there = LiveTargets(live.planner, meet, None, index)
    there.step(human, points, q)  # both know of it
    assert there.targets
    live.planner.set_base(np.eye(4))
    live.step(human, points, q)


def test_the_same_frames_give_the_same_pursuits(cell_map, robot_map, index):
    people = [person(0.9 - 0.002 * k) for k in range(120)]
    runs = []
    for _ in range(2):
        live = live_of(cell_map, robot_map, index, people[0])
        q, pursuits = run(live, start(cell_map), people)
        runs.append((q.tobytes(), pursuits))
    assert runs[0] == runs[1]


def test_another_robots_workspace_is_refused(robot_map):
    planner = odm.ReactivePlanner(odm.build_map(small_recipe(), threads=1))
    with pytest.raises(BadInput, match="arm3"):
        LiveTargets(planner, workspace(robot_map, person(0.9)))


def test_an_index_of_another_map_is_refused(cell_map, robot_map):
    index = NodeIndex(cell_map.robot, cell_map.roadmap.nodes[:9])
    with pytest.raises(BadInput, match="9 nodes"):
        live_of(cell_map, robot_map, index, person(0.9))


def test_what_is_no_index_rest_person_or_allowance_is_refused(
    cell_map, robot_map, index
):
    live = live_of(cell_map, robot_map, index, person(0.9))
    planner, meet, q = live.planner, live.meet, start(cell_map)
    for call, words in (
        (lambda: LiveTargets(planner, meet, index=3), "index is 3"),
        (lambda: LiveTargets(planner, meet, rest="home"), "q must be an array of real"),
        (lambda: LiveTargets(planner, meet, rest=np.nan * q), "rest holds NaN"),
        (lambda: live.look("somebody", q), "human is 'somebody'"),
        (lambda: live.look(person(0.9), "here"), "q must be an array of real"),
        (lambda: live.look(person(0.9), q, 3), "allowance is 3"),
        (lambda: live.expect(np.zeros(2)), "no array.* arm"),
    ):
        with pytest.raises(BadInput, match=words):
            call()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"ranked": 0}, "ranked"),
        ({"connect_every": 0.5}, "connect_every"),
        ({"node_tolerance_m": -1.0}, "node_tolerance_m"),
        ({"node_tolerance_rad": float("nan")}, "node_tolerance_rad"),
        ({"spare_m": -0.001}, "spare_m"),
    ],
)
def test_live_settings_that_are_none_are_refused(wrong, words):
    with pytest.raises(BadInput, match=words):
        LiveSettings(**wrong)


def test_no_more_are_ranked_than_can_be_however_long_it_is_blocked(
    cell_map, robot_map, index
):
    far = person(4.0)
    settings = {"ranked": 60_000, "choice": ChoiceSettings(untried_frames=1)}
    live = live_of(cell_map, robot_map, index, far, **settings)
    _, pursuits = run(live, start(cell_map), [far] * 8)
    assert {p.state for p in pursuits} == {NOBODY}
