"""Ends that the cover refuses and the links do not are left and entered, proved."""

from itertools import pairwise

import numpy as np
import pytest
from forms import size
from shapes_drawn import KINDS, least_on, near_a_link
from small import draw_valid, plates

import odm
from odm.exact.distances import ExactRobot, obstacles_of
from odm.execution.executor import Executor
from odm.frame.link_test import LinkTest
from odm.planner.saved_memory import differences
from roadmap.errors import BadInput
from roadmap.kinematics.forward import sphere_centers

TIGHT = odm.PlannerSettings(tight_ends=True)
RADIUS = 0.02  # [m] no place of a cloud's surface is farther from a point


def tell(planner, shape, how, q):
    """Let a planner see a shape, as it is or as points, and answer from q."""
    if how == "shape":
        return planner.step(odm.Obstacles.of([shape]), q=q)
    cloud = odm.surface_of(shape, RADIUS)
    return planner.step(cloud.points, q=q, covering_radius=cloud.covering_radius)


def ask(planner, shape, how, q):
    """Answer from q, with as much of `improve` as may be needed."""
    answer = tell(planner, shape, how, q)
    for _ in range(20):
        if answer.status == "holding" and planner.improve(8):
            answer = tell(planner, shape, how, q)
    return answer


def tight(planner, exact, rng, how):
    """Yield configurations, and shapes that only the cover there is too near to."""
    low = 0.0115 + (how == "cloud") * RADIUS
    for _ in range(size(30, 60)):
        q = draw_valid(planner, rng)
        there = near_a_link(exact, q, str(rng.choice(KINDS)), rng, (low, low + 0.02))
        if there is None or there[1] < low:
            continue
        tell(planner, there[0], how, q)
        if not planner.stands_clear(q):
            yield q, there[0]


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    cell_map = plates(tmp_path_factory.mktemp("plates")).cell_map
    planner = odm.ReactivePlanner(cell_map, settings=TIGHT)
    return planner, ExactRobot(planner.robot)


@pytest.mark.parametrize("how", ["shape", "cloud"])
def test_what_the_links_call_clear_keeps_m(robot, how, rng):
    planner, exact = robot
    links, m, told = LinkTest(planner.frame), planner.cell_map.safety.m, []
    far = m + (how == "cloud") * RADIUS
    for _ in range(size(100, 200)):
        q, dq = draw_valid(planner, rng), rng.normal(0.0, 0.1, 2)
        at = q + rng.random() * dq
        kind = str(rng.choice(KINDS))
        there = near_a_link(exact, at, kind, rng, (far - 0.003, far + 0.005))
        if there is not None:
            tell(planner, there[0], how, q)
            told.append(links.clear(q, dq))
            if told[-1]:
                assert least_on(exact, q, dq, obstacles_of([there[0]])) >= m
    assert sum(told) > size(7, 15) and len(told) > sum(told) + size(7, 15)


@pytest.mark.parametrize("how", ["shape", "cloud"])
def test_the_path_leads_from_one_tight_end_to_the_other(robot, how, rng):
    planner, exact = robot
    m, goal = planner.cell_map.safety.m, np.zeros(2)
    found = 0
    for q, shape in tight(planner, exact, rng, how):
        for begin, end in ((q, goal), (goal, q)):
            planner.reset()
            planner.set_goals([end])
            answer = ask(planner, shape, how, begin)
            if answer.status == "holding" or not answer.by_links:
                continue
            found += 1
            assert (planner.goals == end).all() and (answer.path[-1] == end).all()
            while len(answer.path) > 1:  # the robot follows it
                a, b = answer.path[:2]
                assert planner.is_free(a, b, by_links=0 in answer.by_links)
                assert least_on(exact, a, b - a, obstacles_of([shape])) >= m
                at = b if np.abs(b - a).max() < 0.02 else a + 0.5 * (b - a)
                if (at == end).all():
                    break
                answer = tell(planner, shape, how, at)
                assert answer.status != "holding" and (answer.path[0] == at).all()
    assert found > size(7, 15)


def test_long_motions_are_not_tested_by_the_links_nor_goals_joined_in_a_frame(
    robot, rng, monkeypatch
):
    planner, exact = robot
    clear, attach = LinkTest.clear, type(planner.attacher)._attach_goal
    far, joined, used = [], [], 0
    monkeypatch.setattr(
        LinkTest,
        "clear",
        lambda own, q, dq: far.append(np.linalg.norm(dq)) or clear(own, q, dq),
    )
    monkeypatch.setattr(
        type(planner.attacher),
        "_attach_goal",
        lambda own, g, q, *more: joined.append(g) or attach(own, g, q, *more),
    )
    for q, shape in tight(planner, exact, rng, "shape"):
        planner.reset()
        planner.set_goals([q])
        for k in range(20):
            joined.clear()
            answer = tell(planner, shape, "shape", q + [0.3 * (k % 2), 1.5])
            assert not joined
            used += bool(answer.by_links)
            planner.improve(8)
    climb = planner._tight.settings
    assert used > 3 and max(far) <= climb.rounds * climb.step


def test_who_comes_nearer_to_a_tight_goal_keeps_the_robot_out(robot, rng):
    planner, exact = robot
    goal, blocked = np.zeros(2), 0
    for q, shape in tight(planner, exact, rng, "shape"):
        planner.reset()
        planner.set_goals([q])
        if not ask(planner, shape, "shape", goal).by_links:
            continue
        middle = sphere_centers(planner.robot, q).mean(axis=0)
        towards = middle - shape.T_base_shape[:3, 3]
        T = np.eye(4)
        T[:3, 3] = 0.008 * towards / np.linalg.norm(towards)
        nearer = shape.moved(T)
        for a, b in pairwise(ask(planner, nearer, "shape", goal).path):
            assert least_on(exact, a, b - a, obstacles_of([nearer])) >= 0.01
        blocked += exact.distance(q, obstacles_of([nearer]), cap=0.1).distance < 0.01
    assert blocked > 3


def test_a_hold_is_explained_by_the_goal_that_was_asked_for(robot, rng):
    planner, _ = robot
    told = 0
    for q, shape in tight(planner, ExactRobot(planner.robot), rng, "shape"):
        reasons = []
        for budget in (0, 8):
            planner.reset()
            planner.set_goals([q])
            answer = tell(planner, shape, "shape", np.zeros(2))
            for _ in range(20):
                told += answer.status == "holding" and planner.improve(budget)
            reasons.append(answer.reason)
        assert reasons[0] == reasons[1]
    assert told > 3


def test_memory_holds_them_and_whoever_stops_does_without(robot, rng):
    planner, exact = robot
    other = odm.ReactivePlanner(planner.cell_map, settings=TIGHT)
    q, shape = next(tight(planner, exact, rng, "shape"))
    goal = np.zeros(2)
    planner.reset()
    planner.set_goals([goal, q])
    assert ask(planner, shape, "shape", q).by_links
    other.load_memory(planner.save_memory())
    told = [tell(one, shape, "shape", q) for one in (planner, other)]
    assert told[0].path.tobytes() == told[1].path.tobytes() and told[1].by_links
    assert not differences(planner.save_memory(), other.save_memory())
    Executor(planner.robot, planner, q, 0.01)
    answer = ask(planner, shape, "shape", q)
    assert answer.status == "holding" and not answer.path.size
    planner.use_tight_ends(True)
    assert ask(planner, shape, "shape", q).by_links
    nobody = odm.Obstacles.of([])
    planner.step(nobody, q=q)
    assert not planner.step(nobody, q=q).by_links
    assert (planner.goals == [goal, q]).all()


def test_who_does_without_takes_up_no_memory_that_holds_them(robot, rng):
    planner, exact = robot
    q, shape = next(tight(planner, exact, rng, "shape"))
    planner.reset()
    planner.set_goals([np.zeros(2)])
    assert ask(planner, shape, "shape", q).by_links
    saved = planner.save_memory()
    other = odm.ReactivePlanner(planner.cell_map, settings=TIGHT)
    Executor(other.robot, other, q, 0.01)
    with pytest.raises(BadInput, match="another settings"):
        other.load_memory(saved)
    other.use_tight_ends(True)
    other.load_memory(saved)
    assert tell(other, shape, "shape", q).by_links


def test_a_place_beside_is_not_reached_through_what_stands_still(robot, rng):
    planner, _ = robot
    T, outer = np.eye(4), sphere_centers(planner.robot, draw_valid(planner, rng))[-1]
    T[:3, 3] = outer
    planner.scene.add("post", odm.Sphere(0.05), T)
    reached, refused = 0, 0
    for _ in range(100):
        q, to = draw_valid(planner, rng), draw_valid(planner, rng)
        planner.step(np.zeros((0, 3)), q=q)  # nobody is about
        free = planner.static.motion_free(q, to - q)
        assert planner._tight._passes(q, to) == free
        reached, refused = reached + free, refused + (not free)
    planner.scene.remove("post")
    assert reached and refused
