"""Which configurations of a target are offered, and how much a frame does for it."""

from collections import Counter

import numpy as np
import pytest
from meet_people import person, workspace

import odm
from handover.targets.live_targets import LiveTargets
from handover.targets.node_index import NodeIndex
from handover.targets.settings import LiveSettings
from handover.targets.target_goals import TargetGoals
from handover.targets.target_offers import Offer, TargetOffers
from odm import PlannerSettings
from roadmap.kinematics.forward import difference, sphere_centers, tool_pose

KEPT = PlannerSettings(
    goal_connections=4, start_connections=4, confirmations=1, cached_goals=16
)


@pytest.fixture(scope="module")
def index(cell_map):
    return NodeIndex(cell_map.robot, cell_map.roadmap.nodes)


@pytest.fixture
def planner(cell_map):
    planner = odm.ReactivePlanner(cell_map, settings=KEPT)
    planner.step(np.zeros((0, 3)), q=cell_map.roadmap.nodes[0])
    return planner


@pytest.fixture
def finder(planner, robot_map, index):
    meet = workspace(robot_map, person(0.9))
    return TargetGoals(planner, meet, index, LiveSettings(node_tolerance_m=0.0))


@pytest.fixture
def several(finder):
    """A target with several configurations, all found."""
    for target in finder.meet.best(60):
        while finder.is_open(target.key):
            finder.work(target)
        if len(finder.found(target.key)) > 1:
            return target
    raise AssertionError("no target has two configurations")


def settled(offers, targets, key, frames=40):
    """Let frames pass until a target is offered; return what came of each."""
    said = []
    for _ in range(frames):
        offers.begin(targets)
        said.append(offers.offer(key))
        offers.work(None)
        if said[-1] is Offer.MADE:
            break
    return said


def ball_round(planner, q, radius=0.05):
    p = tool_pose(planner.robot, q)[:3, 3]
    return odm.sample_capsules(np.r_[p, p, radius][None], 0.03)


def test_the_configurations_of_a_target_differ_and_all_hold_the_tool_there(
    finder, several
):
    robot, found = finder.planner.robot, finder.found(several.key)
    assert 2 <= len(found) <= LiveSettings().configurations
    for k, goal in enumerate(found):
        off = tool_pose(robot, goal.q)[:3, 3] - several.T_world_tool[:3, 3]
        assert np.linalg.norm(off) < 2e-4
        for other in found[:k]:
            assert np.abs(difference(robot, goal.q, other.q)).max() > 0.2


def test_a_target_is_offered_after_one_job_a_frame(planner, finder):
    target = finder.meet.best(1)[0]
    offers = TargetOffers(planner, finder, LiveSettings(connect_every=3))
    said = settled(offers, {target.key: target}, target.key)
    assert said[-1] is Offer.MADE and set(said[:-1]) == {Offer.COMING}
    assert 2 < len(said) <= finder.settings.starts + 3
    (goal,) = offers.goals((target.key,))
    assert planner.is_prepared(goal.q) and offers.attached == 1


def test_what_is_blocked_gives_way_to_another_configuration(planner, finder, several):
    key, targets = several.key, {several.key: several}
    offers = TargetOffers(planner, finder, LiveSettings(connect_every=1))
    settled(offers, targets, key)
    (first,) = offers.goals((key,))
    # something stands where the arm would be, and not where another one would
    others = [goal for goal in finder.found(key) if goal is not first]
    for p in sphere_centers(planner.robot, first.q)[planner.robot.moving]:
        ball = odm.sample_capsules(np.r_[p, p, 0.02][None], 0.03)
        planner.step(ball, q=planner.cell_map.roadmap.nodes[0])
        clear = [planner.stands_clear(goal.q) for goal in others]
        if any(clear) and not planner.stands_clear(first.q):
            break
    else:
        raise AssertionError("no ball tells the configurations apart")
    for _ in range(12):
        offers.begin(targets)
        offers.renew((key,))
        goals = offers.goals((key,))
        offers.work(key)
    assert planner.stands_clear(goals[0].q) and goals[0] is not first


def test_a_target_all_of_which_is_blocked_is_not_waited_for(planner, finder, several):
    offers = TargetOffers(planner, finder, LiveSettings(connect_every=1))
    q = finder.found(several.key)[0].q
    planner.step(ball_round(planner, q), q=planner.cell_map.roadmap.nodes[0])
    for _ in range(
        finder.settings.starts + 1
    ):  # it may look for more configurations first
        offers.begin({several.key: several})
        said = offers.offer(several.key)
        offers.work(None)
    assert said is Offer.NOT_NOW and offers.attached == 0
    # and what was found blocked is asked again: the ball goes away
    planner.step(np.zeros((0, 3)), q=planner.cell_map.roadmap.nodes[0])
    assert settled(offers, {several.key: several}, several.key)[-1] is Offer.MADE


def brink(planner, q, spare):
    """(1, 3) a point that is `spare` [m] beyond the clearance of the robot at q."""
    start = planner.cell_map.roadmap.nodes[0]
    T = tool_pose(planner.robot, q)
    near, far = 0.0, 0.5  # [m] along the tool's axis
    for _ in range(40):
        middle = 0.5 * (near + far)
        point = (T[:3, 3] + middle * T[:3, 2])[None]
        planner.step(point, q=start)
        if planner.separation(q) < planner.keep + spare:
            near = middle
        else:
            far = middle
    return point


def test_a_configuration_on_the_brink_of_the_clearance_is_not_offered(
    planner, finder, several
):
    q = finder.found(several.key)[0].q
    planner.step(brink(planner, q, 0.002), q=planner.cell_map.roadmap.nodes[0])
    assert planner.stands_clear(q, 0.001) and not planner.stands_clear(q, 0.003)
    assert planner.stands_clear(q)
    said = {}
    for spare in (0.001, 0.003):
        settings = LiveSettings(node_tolerance_m=0.0, spare_m=spare)
        offers = TargetOffers(planner, finder, settings)
        told = settled(offers, {several.key: several}, several.key)
        said[spare] = told[-1]
    assert said == {0.001: Offer.MADE, 0.003: Offer.NOT_NOW}


def test_a_node_is_offered_only_where_the_robot_would_stand_clear(
    planner, robot_map, index
):
    meet = workspace(robot_map, person(0.9))
    finder = TargetGoals(
        planner, meet, index, LiveSettings(node_tolerance_m=0.2, node_tolerance_rad=1.0)
    )
    offers = TargetOffers(planner, finder, LiveSettings(connect_every=1))
    for target in meet.best(200):
        offers.begin({target.key: target})
        node = finder.near_node(target)
        if node is not None:
            break
    assert offers.ready(target.key) is node
    planner.step(ball_round(planner, node.q), q=planner.cell_map.roadmap.nodes[0])
    offers.begin({target.key: target})
    assert offers.ready(target.key) is None


def test_no_frame_does_two_jobs_however_the_person_moves(
    cell_map, robot_map, index, monkeypatch
):
    planner = odm.ReactivePlanner(cell_map, settings=KEPT)
    people = [person(0.75 + 0.004 * (k % 100), 0.002 * (k % 60)) for k in range(300)]
    meet = workspace(robot_map, people[0])
    live = LiveTargets(planner, meet, None, index, LiveSettings(connect_every=4))
    done: Counter = Counter()

    def counted(owner, name, what):
        call = getattr(owner, name)

        def run(*args, **options):
            done[what] += 1
            return call(*args, **options)

        monkeypatch.setattr(owner, name, run)

    counted(live.finder, "work", "solved")
    counted(planner.attacher, "_attach_goal", "attached")
    counted(planner, "stands_clear", "tested")
    counted(live.finder, "_node_of", "looked up")
    q, jobs, joined = cell_map.roadmap.nodes[0].copy(), Counter(), []
    for k, human in enumerate(people):
        done.clear()
        live.look(human, q)
        assert done["solved"] + done["attached"] <= 1
        assert done["tested"] <= 60
        joined += [k] * done["attached"]
        jobs.update(done)
        live.note(planner.step(human.surface_points(), q=q), q)
    assert jobs["solved"] > 5 and jobs["attached"] > 2  # it did work
    assert min(np.diff(joined)) >= 4


def test_what_was_joined_may_be_set_once_where_nothing_is_kept(
    cell_map, robot_map, index
):
    planner = odm.ReactivePlanner(cell_map)  # keeps no goals
    planner.step(np.zeros((0, 3)), q=cell_map.roadmap.nodes[0])
    meet = workspace(robot_map, person(0.9))
    finder = TargetGoals(planner, meet, index, LiveSettings(node_tolerance_m=0.0))
    target = finder.meet.best(1)[0]
    offers = TargetOffers(planner, finder, LiveSettings(connect_every=5))
    assert settled(offers, {target.key: target}, target.key)[-1] is Offer.MADE
    assert len(offers.goals((target.key,))) == 1


def test_a_place_that_no_node_is_near_to_is_worth_one_start(
    planner, robot_map, index, monkeypatch
):
    """As below a table: with all starts the next place has its turn much later."""
    starts = []

    def ik(*args, **options):
        starts.append(args)
        return []

    monkeypatch.setattr(type(planner.robot), "ik", ik)
    meet = workspace(robot_map, person(0.9))
    ranked, tools = meet.best(400), index.T_base_tool[:, :3, 3]
    gaps = np.linalg.norm(tools[:, None] - tools, axis=2) + 9.0 * np.eye(len(tools))
    assert index.apart_m == pytest.approx(np.median(gaps.min(axis=1)))
    off = [
        np.linalg.norm(tools - t.T_world_tool[:3, 3], axis=1).min() / index.apart_m
        for t in ranked
    ]
    far = float(np.median(off))
    finder = TargetGoals(
        planner, meet, index, LiveSettings(node_tolerance_m=0.0, far=far)
    )
    order = np.argsort(off)
    for k, most in ((order[:3], finder.settings.starts), (order[-3:], 1)):
        for target in (ranked[i] for i in k):
            starts.clear()
            while finder.is_open(target.key):
                finder.work(target)
            assert len(starts) == most
            assert "found no solution" in finder.failed[target.key]
    assert "robot gets to none of 6 looked at (inverse kin" in finder.why_failed
    finder.failed[-1] = "it is not free: link5 would touch table at 50% of the motion"
    assert "none of 7 looked at (link5 would touch table)" in finder.why_failed
    finder.forget()
    assert finder.why_failed == "" and finder.is_open(ranked[order[-1]].key)
