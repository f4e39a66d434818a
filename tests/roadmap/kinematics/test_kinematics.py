"""Kinematics against pinocchio, pybullet and finite differences."""

import numpy as np
import pytest
from robot_asked import jacobian, motion_bounds

from roadmap import load_robot, tool_pose
from roadmap.kinematics.forward import (
    body_frames,
    cover_balls,
    difference,
    sphere_centers,
    wrapped,
)

N = 1000
# name -> (source, tip, frame of pinocchio's model to compare)
PYBULLET = {
    "panda": ("franka_panda/panda.urdf", "panda_grasptarget"),
    "kuka_iiwa": ("kuka_iiwa/model.urdf", "lbr_iiwa_link_7"),
    "xarm6": ("xarm/xarm6_robot.urdf", "link6"),
}
EXAMPLES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "baxter": ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
}


def pinocchio_tool(path, robot):
    """Return q -> pose of the tip by pinocchio; joints that robot locks stand at 0."""
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pin) is not installed")
    model = pin.buildModelFromUrdf(str(path))
    data, base, root = model.createData(), pin.neutral(model), model.frames[1].name

    def tool(q):
        full = base.copy()
        for name, value in zip(robot.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            cyclic = joint.nq == 2
            at = slice(joint.idx_q, joint.idx_q + joint.nq)
            full[at] = [np.cos(value), np.sin(value)] if cyclic else [value]
        pin.framesForwardKinematics(model, data, full)
        T_world_root = data.oMf[model.getFrameId(root)]
        T_world_tip = data.oMf[model.getFrameId(robot.tip_name)]
        return (T_world_root.inverse() * T_world_tip).homogeneous

    return tool


def assert_agree(robot, path, n):
    tool, rng = pinocchio_tool(path, robot), np.random.default_rng(1)
    for q in rng.uniform(robot.lower, robot.upper, (n, robot.dof)):
        assert np.abs(tool(q) - tool_pose(robot, q)).max() < 1e-9


@pytest.mark.parametrize("name", PYBULLET)
def test_tool_poses_agree_with_pinocchio(name, pybullet_file):
    file, tip = PYBULLET[name]
    robot = load_robot(pybullet_file(file), tip=tip, cover_excess=0.3)
    assert_agree(robot, pybullet_file(file), N if name == "panda" else 100)


@pytest.mark.parametrize("name", EXAMPLES)
def test_tool_poses_of_example_robots_agree_with_pinocchio(name, example_file):
    file, tip = EXAMPLES[name]
    robot = load_robot(example_file(file), tip=tip, cover_excess=0.3)
    assert_agree(robot, example_file(file), 100)


def test_every_link_agrees_with_pybullet(panda, pybullet_file, rng):
    bullet = pytest.importorskip("pybullet", reason="pybullet is not installed")
    client = bullet.connect(bullet.DIRECT)
    path = str(pybullet_file("franka_panda/panda.urdf"))
    body = bullet.loadURDF(path, useFixedBase=True, physicsClientId=client)
    index = {
        bullet.getJointInfo(body, i, physicsClientId=client)[12].decode(): i
        for i in range(bullet.getNumJoints(body, physicsClientId=client))
    }
    solid_frames = {name: panda.link_body[i] for i, name in enumerate(panda.link_names)}
    for q in rng.uniform(panda.lower, panda.upper, (N, panda.dof)):
        for j, value in enumerate([*q, 0.0, 0.0]):
            bullet.resetJointState(body, j, value, physicsClientId=client)
        frames = body_frames(panda, q)
        for k in range(1, 8):
            name = f"panda_link{k}"
            state = bullet.getLinkState(
                body, index[name], computeForwardKinematics=1, physicsClientId=client
            )
            R = np.array(bullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            T = frames[solid_frames[name]]
            assert np.abs(T[:3, 3] - state[4]).max() < 1e-6
            assert np.abs(T[:3, :3] - R).max() < 1e-6
    bullet.disconnect(client)


def test_mimic_and_prismatic_joints_move_as_the_urdf_says(gantry):
    assert gantry.joint_names == ("rail", "turn")
    x, turn = 0.4, 0.9
    wrist = -2 * turn + 0.3
    elbow = np.array([x + 0.2 + 0.5 * np.sin(turn), 0, 0.6 + 0.5 * np.cos(turn)])
    angle = turn + wrist
    expected = elbow + 0.2 * np.array([np.cos(angle), 0, -np.sin(angle)])
    T = tool_pose(gantry, np.array([x, turn]))
    assert np.allclose(T[:3, 3], expected, atol=1e-12)


def test_the_jacobian_agrees_with_differences(panda, gantry, rng):
    for robot in (panda, gantry):
        q = rng.uniform(robot.lower, robot.upper)
        J, step = jacobian(robot, q), 1e-6
        for j in range(robot.dof):
            dq = np.zeros(robot.dof)
            dq[j] = step
            before, after = tool_pose(robot, q - dq), tool_pose(robot, q + dq)
            linear = (after - before)[:3, 3] / (2 * step)
            W = (after - before)[:3, :3] @ before[:3, :3].T / (2 * step)
            angular = np.array([W[2, 1], W[0, 2], W[1, 0]])
            assert np.allclose(J[:, j], [*linear, *angular], atol=1e-5)


def test_a_continuous_joint_goes_the_short_way(gantry):
    dq = difference(gantry, [0.1, 3.0], [0.2, -3.0])
    assert np.allclose(dq, [0.1, 2 * np.pi - 6.0])


def test_continuous_joints_are_wrapped_and_those_within_stay_to_the_last_bit(
    gantry, rng
):
    q = rng.uniform(gantry.lower, gantry.upper, (1000, 2))
    assert wrapped(gantry, q).tobytes() == q.tobytes()
    turns = 2 * np.pi * rng.integers(-3, 4, 1000)[:, None] * gantry.continuous
    assert np.allclose(wrapped(gantry, q + turns), q, atol=1e-12)
    assert wrapped(gantry, np.full(2, np.pi))[gantry.continuous] == -np.pi


def test_motion_bounds_hold_on_dense_samples(panda, gantry, rng):
    for robot in (panda, gantry):
        for _ in range(20):
            q = rng.uniform(robot.lower, robot.upper)
            dq = rng.normal(size=robot.dof) * 0.3
            speed, bend = motion_bounds(robot, dq)
            t = np.linspace(0, 1, 101)
            path = np.array([sphere_centers(robot, q + s * dq) for s in t])
            steps = np.linalg.norm(np.diff(path, axis=0), axis=2)
            assert (steps <= speed / 100 + 1e-12).all()
            chord = path[0] + t[:, None, None] * (path[-1] - path[0])
            sag = np.linalg.norm(path - chord, axis=2).max(axis=0)
            assert (sag <= bend / 8 + 1e-12).all()


def test_the_balls_of_the_cover_are_its_centres_and_radii(panda, rng):
    for q in rng.uniform(panda.lower, panda.upper, (20, panda.dof)):
        balls = cover_balls(panda, q)
        assert np.array_equal(balls[:, :3], sphere_centers(panda, q))
        assert np.array_equal(balls[:, 3], panda.spheres[:, 3])
