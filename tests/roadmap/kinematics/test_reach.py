"""Bounds on the distance of points from joint axes hold for every configuration."""

import numpy as np
import pytest

from roadmap.kinematics.forward import body_frames


def seen_reach(robot, body, points, n, rng):
    """Return the largest distance from each axis over samples: a bound from below."""
    lower = np.where(robot.continuous, -np.pi, robot.lower)
    turns = np.zeros(robot.dof, bool)
    turns[robot.tree_i[robot.tree_i[:, 2] == 1, 1]] = True
    low, high = np.where(turns, -np.pi, lower), np.where(turns, np.pi, robot.upper)
    seen = np.zeros((len(points), len(robot.tree_i)))
    for q in rng.uniform(low, high, (n, robot.dof)):
        frames = body_frames(robot, q)
        world = np.einsum("nij,nj->ni", frames[body][:, :3, :3], points)
        world += frames[body][:, :3, 3]
        axes = np.einsum("kij,kj->ki", frames[1:, :3, :3], robot.tree_f[1:, 12:15])
        away = np.cross(world[:, None] - frames[1:, :3, 3], axes)
        np.maximum(seen[:, 1:], np.linalg.norm(away, axis=2), out=seen[:, 1:])
    return seen


def ancestors(robot, body):
    chain = []
    while body > 0:
        chain.append(body)
        body = robot.tree_i[body, 0]
    return chain


@pytest.mark.parametrize("name", ["panda", "gantry"])
def test_no_sampled_configuration_exceeds_the_bound(name, request, rng):
    robot = request.getfixturevalue(name)
    seen = seen_reach(robot, robot.sphere_body, robot.spheres[:, :3], 1500, rng)
    turns = robot.tree_i[:, 2] == 1
    own = robot.sphere_reach > 0
    assert (seen <= robot.sphere_reach)[:, turns][own[:, turns]].all()


def test_the_bound_is_not_crude(panda, rng):
    seen = seen_reach(panda, panda.sphere_body, panda.spheres[:, :3], 1500, rng)
    own = panda.sphere_reach > 0.05
    assert (panda.sphere_reach[own] <= 1.08 * seen[own]).all()


@pytest.mark.parametrize("name", ["panda", "gantry"])
def test_a_shell_s_bound_holds_for_all_its_points(name, request, rng):
    robot = request.getfixturevalue(name)
    shell = np.repeat(np.arange(len(robot.shell_link)), np.diff(robot.shell_ptr))
    body = robot.link_body[robot.shell_link[shell]]
    seen = seen_reach(robot, body, robot.shell_points, 300, rng)
    for k in np.flatnonzero(robot.tree_i[:, 2] == 1):
        moved = robot.shell_reach[shell, k] > 0
        assert (seen[moved, k] <= robot.shell_reach[shell[moved], k]).all()


def test_the_own_joint_s_distance_is_exact(panda):
    for i, body in enumerate(panda.sphere_body):
        if body > 0:
            axis, p = panda.tree_f[body, 12:15], panda.spheres[i, :3]
            exact = np.linalg.norm(np.cross(axis, p))
            assert exact <= panda.sphere_reach[i, body] <= exact + 2e-9


def test_joints_that_do_not_move_a_sphere_count_nothing(panda, gantry):
    for robot in (panda, gantry):
        for i, body in enumerate(robot.sphere_body):
            chain = ancestors(robot, body)
            others = [k for k in range(len(robot.tree_i)) if k not in chain]
            assert not robot.sphere_reach[i, others].any()
            slides = [k for k in chain if robot.tree_i[k, 2] == 2]
            assert (robot.sphere_reach[i, slides] == 1.0).all()


def test_prismatic_travel_adds_to_what_lies_before_it(urdf, link, joint):
    from roadmap import load_robot

    rail = '<limit lower="0.1" upper="0.5" velocity="1" effort="1"/>'
    body = link("base") + link("arm") + link("tip", '<sphere radius="0.02"/>')
    body += joint("turn", "revolute", "base", "arm")
    body += joint("slide", "prismatic", "arm", "tip", "0.2 0 0", "1 0 0", rail)
    robot = load_robot(urdf(body))
    assert np.allclose(robot.sphere_reach, [[0, 0.7, 1.0]], atol=1e-3)
    assert robot.sphere_reach[0, 1] >= 0.7
