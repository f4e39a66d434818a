"""A chain: the robot's own kinematics, joint by joint, and what cannot be one."""

from dataclasses import replace

import numpy as np
import pytest
from reach_chains import person_pose, slow_dexterity
from robot_asked import jacobian
from wrappers import with_wrapper

from handover import chain_of
from handover.reach._reach_touch import touches_itself
from handover.reach.extremes import reachable_box, work_of
from handover.reach.reach_touch import touch_of
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.geometry.self_collision import configuration_free
from roadmap.kinematics import _chain as kernels
from roadmap.kinematics._forward import body_frames
from roadmap.kinematics.forward import tool_pose

sine_cosine = with_wrapper(kernels.sine_cosine)
to_lattice = with_wrapper(kernels.to_lattice)

touches_itself = with_wrapper(touches_itself)

FLAP = """<robot name="flap">
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
</link>
<link name="upper"><collision><origin xyz="0.15 0 0"/><geometry>
<box size="0.28 0.04 0.04"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.15 0 0"/><geometry>
<box size="0.28 0.04 0.04"/></geometry></collision></link>
<link name="hand"><collision><origin xyz="0.05 0 0"/><geometry>
<box size="0.08 0.04 0.04"/></geometry></collision></link>
<link name="flap"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.38 0.04 0.04"/></geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.9" upper="2.9" velocity="1" effort="1"/></joint>
<joint name="c" type="revolute"><parent link="fore"/><child link="hand"/>
<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
<joint name="d" type="revolute"><parent link="base"/><child link="flap"/>
<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/><mimic joint="b" multiplier="0.5"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>
"""


def draw(chain, rng):
    return rng.uniform(*chain.limits.T)


@pytest.mark.parametrize("name", ["kawasaki_fs003n", "rail_arm", "armar3"])
def test_pose_and_jacobian_are_the_robot_s(name, rng):
    robot = load_robot(name, cover_excess=0.2)
    chain = chain_of(robot)
    work = work_of(chain)
    for _ in range(30):
        q = draw(chain, rng)
        whole = chain.full(q)
        np.testing.assert_allclose(
            chain.tool_pose(q), tool_pose(robot, whole), atol=1e-9
        )
        kernels.forward(chain.arrays, q, work.frames)
        kernels.jacobian(chain.arrays, work.frames, work.jac)
        J = jacobian(robot, whole)
        np.testing.assert_allclose(work.jac, J[:, list(chain.rows)], atol=1e-9)
        fast = kernels.dexterity(chain.arrays, q, work.jac, work.weighted, work.gram)
        assert fast == pytest.approx(slow_dexterity(chain, q, work.jac), rel=1e-6)


def test_joints_beside_the_tool_stay_where_they_were():
    robot = load_robot("rail_arm", tip="upper_arm", cover_excess=0.2)
    chain = chain_of(robot)
    assert chain.joint_names == ("slide", "turn", "shoulder")
    q = np.array([0.2, 1.0, -0.5])
    np.testing.assert_allclose(chain.full(q), q)
    np.testing.assert_allclose(chain.tool_pose(q), tool_pose(robot, q), atol=1e-9)


def test_the_arm_of_the_tests_is_the_one_that_was_meant(arm, rng):
    for _ in range(20):
        q = draw(arm, rng)
        np.testing.assert_allclose(arm.tool_pose(q), person_pose(q), atol=1e-9)
    assert arm.tool_pose(np.zeros(7))[2, 3] == pytest.approx(-1.0)


def test_sine_and_cosine_are_the_library_s(rng):
    for x in [*rng.uniform(-20, 20, 2000), *(np.arange(-8, 9) * np.pi / 4), 0.0]:
        s, c = sine_cosine(x)
        assert abs(s - np.sin(x)) < 3e-16 and abs(c - np.cos(x)) < 3e-16


def test_a_sample_can_be_drawn_again_and_lies_within_the_limits(arm):
    work = work_of(arm)
    drawn = np.empty((4000, 7), np.uint16)
    for k, row in enumerate(drawn):
        kernels.draw_code(5, k, row)
    again = np.empty(7, np.uint16)
    kernels.draw_code(5, 1234, again)
    np.testing.assert_array_equal(again, drawn[1234])
    kernels.draw_code(6, 1234, again)
    assert (again != drawn[1234]).any()
    at_limit = ((drawn == 0) | (drawn == kernels.LEVELS)).mean()
    assert 0.08 < at_limit < 0.12
    assert abs(drawn.mean() / kernels.LEVELS - 0.5) < 0.02
    kernels.from_lattice(arm.arrays, drawn[7], work.q)
    to_lattice(arm.arrays, work.q, again)
    np.testing.assert_array_equal(again, drawn[7])


def test_the_reachable_box_holds_every_tool_and_is_touched(arm, robot, rng):
    for chain in (arm, chain_of(robot)):
        box = reachable_box(chain)
        tools = np.array(
            [chain.tool_pose(draw(chain, rng))[:3, 3] for _ in range(4000)]
        )
        assert (tools >= box[0]).all() and (tools <= box[1]).all()
        room = np.abs(np.stack([tools.min(axis=0), tools.max(axis=0)]) - box)
        assert room.max() < 0.15 * np.ptp(box, axis=0).max()


@pytest.mark.parametrize("name", ["kawasaki_fs003n", "armar3", "panda"])
def test_tables_never_change_an_answer_about_self_collision(name, rng):
    robot = load_robot(name, cover_excess=0.2)
    chain = chain_of(robot)
    touch = touch_of(chain)
    assert (touch.pair[:, 2] >= 0).any() and touch.clear.any()
    assert not len(touch.tree_i)
    free = agreed(robot, chain, touch, [draw(chain, rng) for _ in range(1500)])
    assert 0 < free < 1500


def agreed(robot, chain, touch, configurations) -> int:
    """Compare with the planner's own test; returns how many are free."""
    work, free = work_of(chain), 0
    for q in configurations:
        slow = configuration_free(robot, chain.full(q))[0]
        kernels.forward(chain.arrays, q, work.frames)
        assert touches_itself(touch, q, work.frames) == (not slow)
        free += slow
    return free


def test_a_link_that_follows_no_joint_of_the_tool_is_placed_by_itself(tmp_path, rng):
    # the flap mimics the elbow, but is no part of the way to the hand
    urdf = tmp_path / "flap.urdf"
    urdf.write_text(FLAP, encoding="utf-8")
    robot = load_robot(str(urdf), tip="hand", cover_excess=0.2)
    chain = chain_of(robot)
    touch = touch_of(chain)
    assert len(touch.tree_i) and len(touch.pair)
    free = agreed(robot, chain, touch, [draw(chain, rng) for _ in range(800)])
    assert 0 < free < 800


@pytest.mark.parametrize(("name", "tip"), [("panda", None), ("rail_arm", "upper_arm")])
def test_links_carried_along_stand_where_the_robot_s_do(name, tip, rng):
    # beyond the upper arm nothing moves, but all of it is carried along
    robot = load_robot(name, tip=tip, cover_excess=0.2)
    chain = chain_of(robot)
    touch, work = touch_of(chain), work_of(chain)
    for _ in range(20):
        q = draw(chain, rng)
        kernels.forward(chain.arrays, q, work.frames)
        bodies = np.zeros((len(robot.tree_i), 12))
        body_frames(robot.tree_i, robot.tree_f, chain.full(q), bodies)
        for s, (row, first, end, lane, last) in enumerate(touch.shell.tolist()):
            ours = work.frames[row] if row >= 0 else touch.still
            theirs = bodies[robot.link_body[robot.shell_link[s]]]
            points = robot.shell_points[robot.shell_ptr[s] : robot.shell_ptr[s + 1]]
            expected = placed(theirs, points)
            np.testing.assert_allclose(
                placed(ours, touch.points[first:end]), expected, atol=1e-9
            )
            lanes = placed(ours, touch.lanes[:, lane:last].T)
            np.testing.assert_allclose(lanes[: len(points)], expected, atol=1e-9)
            filled = lanes[len(points) :] - expected[-1]
            assert np.abs(filled).max(initial=0.0) < 1e-9


def placed(pose, points):
    return points @ pose[:9].reshape(3, 3).T + pose[9:]


def test_the_fingerprint_tells_chains_apart(arm, robot):
    limits = np.array(arm.limits)
    limits[3, 1] -= 0.01
    fixed = np.array(arm.fixed)
    fixed[3, 11] += 0.001
    others = [replace(arm, limits=limits), replace(arm, fixed=fixed)]
    prints = {c.fingerprint() for c in [arm, *others, chain_of(robot)]}
    prints.add(chain_of(robot, self_collisions=False).fingerprint())
    assert len(prints) == 5
    assert replace(arm).fingerprint() == arm.fingerprint()


def test_arrays_that_make_no_chain_are_refused(arm):
    for change, word in (
        ({"limits": arm.limits[:, ::-1]}, "lower must be below"),
        ({"limits": arm.limits[:3]}, "shape"),
        ({"fixed": arm.fixed[:-1]}, "shape"),
        ({"fixed": np.full_like(arm.fixed, np.nan)}, "NaN"),
    ):
        with pytest.raises(BadInput, match=word):
            replace(arm, **change)


def test_a_tool_that_no_joint_moves_is_refused(robot):
    with pytest.raises(BadInput, match="moves its tool"):
        chain_of(replace(robot, tip_body=0))
