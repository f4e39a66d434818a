"""What the last search showed: it holds while all that blocked the way does."""

import numpy as np
import pytest

import odm
from odm.planner.settings import PlannerSettings
from odm.search._bound import NEARLY
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


def frames(rng, rods, count):
    """Return the rods in frames in which they tremble, come and go."""
    at = rods.copy()
    for k in range(count):
        step = 0.05 if k % 7 == 6 else 0.003
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
