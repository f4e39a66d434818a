"""What the last search showed: it holds while all that blocked the way does."""

import numpy as np
import pytest

import odm
from odm.planner.settings import PlannerSettings
from odm.search._bound import GOAL_SIDE, NEARLY
from odm.search._items import FREE
from odm.search._state import IS_GOAL
from roadmap.kinematics.forward import tool_pose

NO_MOTION = -4
SETTINGS = PlannerSettings(close_test_connections=2, search=0)


def standing(wide_map, q, goals):
    """Return a planner that stands at q and wants to goals, not straight."""
    planner = odm.ReactivePlanner(wide_map, True, SETTINGS)
    planner.set_goals(goals)
    planner.attacher.attach_start(q)
    planner.attacher.join_start()
    # and is joined to nothing else, whatever a frame comes to
    planner.attacher._later.clear()
    planner.attacher.start_waits = planner.attacher.is_bare = False
    planner.memory.goals.attached_ref[:] = NO_MOTION
    return planner


def drawn(wide_map, rng, count):
    """Return pairs of configurations with the tool on both sides of the base."""
    robot = wide_map.robot
    q = rng.uniform(robot.lower, robot.upper, (400, robot.dof))
    q = q[odm.ReactivePlanner(wide_map).static.motions_free(q, np.zeros_like(q))]
    tools = np.array([tool_pose(robot, one)[:3, 3] for one in q])
    left, right = q[tools[:, 0] < -0.4], q[tools[:, 0] > 0.4]
    return [(left[k], right[k]) for k in range(count)]


def bars(rng, wide_map, q, count):
    """Return bars near the tool at q, so that some wall it in (count, 7)."""
    tool = tool_pose(wide_map.robot, q)[:3, 3]
    middle = tool + rng.normal(size=(count, 3)) * [0.25, 0.1, 0.25]
    along = rng.normal(size=(count, 3)) * 0.2
    return np.hstack([middle - along, middle + along, np.full((count, 1), 0.03)])


def length_of(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).sum() if len(path) else np.inf


def frames(rng, rods, count, tremble=0.003):
    """Return the rods in frames in which they tremble, come and go."""
    at = rods.copy()
    for k in range(count):
        step = 0.05 if k % 7 == 6 else tremble
        at[:, :6] += np.tile(rng.normal(size=(len(rods), 3)) * step, 2)
        yield at.copy()


@pytest.mark.parametrize("shapes", [True, False])
def test_it_answers_as_a_planner_that_remembers_nothing(wide_map, rng, shapes):
    held = none_held = searched = none = 0
    for q, goal in drawn(wide_map, rng, 10):
        planner = standing(wide_map, q, [goal])
        obstacles = odm.Obstacles(capsules=5)
        for rods in frames(rng, bars(rng, wide_map, goal, 5), 25):
            obstacles.capsules[:] = rods
            seen = obstacles if shapes else odm.sample_capsules(rods, 0.03)
            planner.memory.goals.attached_ref[:] = NO_MOTION
            answer = planner.step(seen, q=q)
            alone = planner.memory.stats.runs.item() == 0
            # the same motions of start and goal, and nothing that was shown
            planner.memory.proof.of[:] = -1
            planner.memory.goals.attached_ref[:] = NO_MOTION
            other = planner.step(seen, q=q)
            assert (len(answer.path) > 0) == (len(other.path) > 0)
            if len(answer.path):
                assert length_of(answer.path) <= NEARLY * length_of(other.path) + 1e-9
                legs = zip(answer.path[:-1], answer.path[1:], strict=True)
                assert all(planner.is_free(a, b) for a, b in legs)
            held += int(alone and len(answer.path) > 2)
            none_held += int(alone and not len(answer.path))
            searched += int(not alone)
            none += int(not len(answer.path))
    assert held > 40
    assert searched > 10
    assert none_held > 0 or none == 0


def test_a_start_that_moved_and_another_goal_know_nothing(wide_map, rng):
    (q, goal), (other_q, other_goal) = drawn(wide_map, rng, 2)
    planner = standing(wide_map, q, [goal])
    rods = bars(rng, wide_map, goal, 2)
    obstacles = odm.Obstacles(capsules=2)
    obstacles.capsules[:] = rods
    planner.step(obstacles, q=q)
    planner.set_goals([other_goal])
    planner.memory.goals.attached_ref[:] = NO_MOTION
    path = planner.step(obstacles, q=q).path
    assert len(path) == 0 or np.allclose(path[-1], other_goal)
    path = planner.step(obstacles, q=other_q).path
    assert len(path) == 0 or np.allclose(path[0], other_q)


def walked(planner, nodes):
    """Return the nodes that are reached from some, over what the frame leaves free."""
    roadmap = planner.cell_map.roadmap
    good = np.ones(roadmap.n_nodes, np.bool_)
    good[planner.invalid_nodes()] = False
    left = np.setdiff1d(np.arange(roadmap.n_edges), planner.invalid_edges())
    edges = roadmap.edges[left]
    edges = edges[good[edges].all(axis=1)]
    reached = np.zeros(roadmap.n_nodes, np.bool_)
    reached[nodes] = True
    reached &= good
    while True:
        ahead = edges[reached[edges].any(axis=1)].ravel()
        if reached[ahead].all():
            return reached
        reached[ahead] = True


def is_cut_off(planner):
    """Whether no free motion of the start leads to a node that leads into the goal."""
    m = planner.memory
    free = 4 * m.numbers.frame.item() + FREE
    starts, n = m.start_connections, m.goals.number.item(0)
    k = starts.count.item(0)
    ends = m.goals.node[0, :n][m.goals.memo[0, :n] == free]
    begins = starts.node[:k][starts.memo[:k] == free]
    return not walked(planner, ends)[begins].any()


def wall(rng):
    """Return bars that part the left from the right, but for gaps (9, 7)."""
    x = rng.uniform(-0.1, 0.1, (3, 3, 1))
    z = rng.uniform(-0.2, 0.2, (3, 3, 1)) + np.array([-0.4, 0.1, 0.6])[:, None, None]
    y = np.array([-0.8, 0.0, 0.8])[None, :, None] + 0.0 * z
    middle = np.concatenate([x, y, z], axis=2).reshape(-1, 3)
    along = np.array([0.0, 0.4, 0.0]) + rng.normal(size=(9, 3)) * 0.05
    return np.hstack([middle - along, middle + along, np.full((9, 1), 0.12)])


def test_a_goal_whose_side_was_flooded_stays_shut_while_the_flood_meets_no_start(
    wide_map, rng
):
    """Motions are joined at both ends meanwhile, and the flood goes on by them."""
    shut = opened = more = 0
    for q, goal in drawn(wide_map, rng, 25):
        planner = odm.ReactivePlanner(wide_map, True, SETTINGS)
        planner.set_goals([goal])
        m, obstacles = planner.memory, odm.Obstacles(capsules=9)
        before = False
        for k, rods in enumerate(frames(rng, wall(rng), 40, 0.01)):
            obstacles.capsules[:] = rods
            left = 9 - max(0, k - 30)  # they leave, by turns
            obstacles.capsules[left:, 2:6:3] += 9.0
            joins = planner.attacher.n_motions
            answer = planner.step(obstacles, q=q)
            by_flood = m.numbers.exhausted.item() == GOAL_SIDE
            if len(answer.path):
                opened += before
                legs = zip(answer.path[:-1], answer.path[1:], strict=True)
                assert all(planner.is_free(a, b) for a, b in legs)
            elif by_flood:
                assert is_cut_off(planner)
                alone = m.stats.runs.item() == 0
                shut += alone
                more += alone and planner.attacher.n_motions > joins
            before = by_flood and not len(answer.path)
    assert shut > 50 and opened > 2 and more > 0


def test_a_motion_into_a_goal_that_was_shut_opens_it(wide_map, rng):
    """It leads from where the robot may go; else the flood would go on without it."""
    opened = 0
    for q, goal in drawn(wide_map, rng, 25):
        planner = odm.ReactivePlanner(wide_map, True, SETTINGS)
        planner.set_goals([goal])
        m, obstacles = planner.memory, odm.Obstacles(capsules=wall(rng))
        for _ in range(4):
            answer = planner.step(obstacles, q=q)
        by_flood = m.numbers.exhausted.item() == GOAL_SIDE
        if len(answer.path) or not by_flood or m.stats.runs.item():
            continue
        goals, k = m.goals, m.goals.number.item(0)
        begins = m.start_connections.node[: m.start_connections.count[0]]
        nodes = wide_map.roadmap.nodes
        node = next((v for v in begins if planner.is_free(q, nodes[v])), None)
        if node is None:
            continue
        # as if the goal were that node
        goals.node[0, k], goals.ref[0, k], goals.length[0, k] = node, IS_GOAL, 0.0
        goals.at[0, node], goals.number[0] = k, k + 1
        assert len(planner.step(obstacles, q=q).path)
        opened += 1
    assert opened > 0
