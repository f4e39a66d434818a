"""Agents and hands: the same kinematics as the robots', postures on the floor."""

import numpy as np
import pytest

from handover import agent_names, hand_names, load_agent, load_hand
from handover.grasps.hand import make_hand
from handover.grasps.hands import HandSpec
from roadmap import load_robot
from roadmap.errors import BadInput, BadRobot
from roadmap.geometry.spheres import robot_solids
from roadmap.kinematics.forward import body_frames, tool_pose
from roadmap.robot.description import read_description
from roadmap.robot.known import robot_file

COARSE = {"cover_excess": 0.1}


@pytest.mark.parametrize("name", ["sdh_left", "sdh_right", "hubo_left", "hubo_right"])
def test_a_hand_stands_as_the_robot_that_carries_it(name, rng):
    hand = load_hand(name)
    lower, upper = -0.3, 0.9
    values = rng.uniform(lower, upper, len(hand.joints))
    values = np.where(["knuckle" in j for j in hand.joints], 0.5, values)
    locked = dict(zip(hand.joints, values.tolist(), strict=True))
    robot = load_robot(hand.spec.robot, locked=locked, **COARSE)
    q = rng.uniform(robot.lower, robot.upper)
    T_palm_base = np.linalg.inv(tool_pose(robot, q))
    state = hand.state(np.eye(4), values)
    links, frames = body_frames(robot, q), {}
    for solid in robot_solids(robot):
        T = T_palm_base @ links[robot.link_body[solid.link]] @ solid.T_body_solid
        frames.setdefault(robot.link_names[solid.link], []).append(T[:3, 3])
    seen = 0
    for frame, owner in zip(state.frames, hand.arrays.solids.owner, strict=True):
        places = np.array(frames[hand.links[owner]])
        assert np.linalg.norm(places - frame[9:], axis=1).min() < 1e-9
        seen += 1
    assert seen >= 7


def test_the_hands_have_the_joints_that_the_paper_gives_them():
    assert len(load_hand("hubo_left").joints) == 6
    assert len(load_hand("hubo_right").joints) == 8
    # eight joints of the SDH, two of which swivel together
    assert len(load_hand("sdh").joints) == 7
    sdh = load_hand("sdh").arrays
    assert (sdh.kind > 0).sum() == 8
    assert len(load_hand("panda").joints) == 1


def test_both_jaws_of_the_gripper_move_with_one_joint():
    hand = load_hand("panda")
    open_, closed = (hand.state(np.eye(4), [v]).frames for v in (0.04, 0.0))
    moved = np.linalg.norm(open_[:, 9:] - closed[:, 9:], axis=1)
    assert sorted(np.round(moved, 9)) == [0.0, 0.04, 0.04]


def test_a_rod_with_balls_at_both_ends_is_one_solid():
    solids = load_hand("sdh").arrays.solids
    capsules = solids.margin > 0
    assert capsules.sum() == 6 and (solids.margin[capsules] == 0.0145).all()


def test_no_point_moves_faster_than_the_lever(rng):
    for name in ("sdh", "hubo_right", "panda"):
        hand = load_hand(name)
        for d in range(len(hand.joints)):
            values = hand.preshapes[0].copy()
            before = hand.state(np.eye(4), values)
            values[d] += 1e-5
            after = hand.state(np.eye(4), values)
            ball = hand.arrays.solids.ball
            for i in range(len(ball)):
                ends = ball[i, :3] + ball[i, 3] * rng.normal(size=(20, 3)) / 3.0
                ends = ends[np.linalg.norm(ends - ball[i, :3], axis=1) <= ball[i, 3]]
                moved = _placed(after.frames[i], ends) - _placed(before.frames[i], ends)
                far = np.linalg.norm(moved, axis=1).max(initial=0.0)
                assert far <= hand.arrays.lever[d] * 1.001e-5
                assert hand.arrays.moves[d, i] or far < 1e-12


def _placed(frame, points):
    return points @ frame[:9].reshape(3, 3).T + frame[9:]


@pytest.mark.parametrize("name", agent_names())
def test_every_arm_of_an_agent_ends_in_its_hand(name):
    for arm in load_agent(name).arms.values():
        spec = arm.spec
        assert spec.robot.split("_")[0] == arm.robot.split("_")[0]
        description = read_description(robot_file(arm.robot))
        assert {*spec.joints} <= set(description.joints)
        assert spec.palm in description.links


def test_an_arm_is_loaded_with_its_hand_open_or_in_a_grasp():
    arm = load_agent("drchubo").arms["left"]
    shape = arm.spec.preshapes[0]
    still = load_robot(arm.robot, locked=shape, **COARSE)
    assert still.dof == 7 and still.tip_name == "left_palm"
    shape = {**shape, "left_finger_1_flexion": 1.0}
    closed = load_robot(arm.robot, locked=shape, **COARSE)
    assert any("left_finger_1_flexion = 1," in note for note in closed.notes)
    assert still.fingerprint() != closed.fingerprint()


def test_crichton_s_arms_are_back_to_back_at_the_height_that_was_measured():
    left, right = (load_robot(f"crichton_{s}", **COARSE) for s in ("left", "right"))
    T, U = (tool_pose(r, np.zeros(7)) for r in (left, right))
    reach = 0.287 + 0.733 + 0.0672 + 0.0745  # shoulder, arm, sensor, palm
    np.testing.assert_allclose(T[:3, 3], [0, reach, 1.23], atol=2e-3)
    np.testing.assert_allclose(U[:3, 3], [0, -reach, 1.23], atol=2e-3)
    np.testing.assert_allclose(T[:3, 2], [0, 1, 0], atol=1e-6)
    half_turn = np.diag([-1.0, -1.0, 1.0])
    np.testing.assert_allclose(half_turn @ T[:3, :3], U[:3, :3], atol=1e-6)


@pytest.mark.parametrize(
    "posture, shoulder", [("standing", 1.169), ("kneeling", 0.787)]
)
def test_hubo_stands_on_the_floor(posture, shoulder):
    agent = load_agent("drchubo")
    stand = agent.posture(posture)
    arm = agent.arms["left"]
    stands = {**arm.spec.preshapes[0], **stand.joints}
    robot = load_robot(arm.robot, locked=stands, **COARSE)
    T = stand.T_floor_base
    lowest = min(
        _lowest(solid, T @ body_frames(robot, np.zeros(7))[robot.link_body[solid.link]])
        for solid in robot_solids(robot)
        if robot.link_body[solid.link] == 0
    )
    assert -0.002 <= lowest <= 0.03
    first = T @ body_frames(robot, np.zeros(7))[1]
    assert first[2, 3] == pytest.approx(shoulder, abs=1e-3)


def _lowest(solid, T_floor_body):
    T = T_floor_body @ solid.T_body_solid
    half = 0.5 * np.array(solid.size)
    if solid.kind == 3:  # a ball
        return T[2, 3] - solid.size[0]
    if solid.kind == 2:  # a rod
        across = solid.size[0] * np.linalg.norm(T[2, :2])
        return T[2, 3] - across - 0.5 * solid.size[1] * abs(T[2, 2])
    return T[2, 3] - np.abs(T[2, :3]) @ half


def test_steps_of_the_stool_lift_hubo():
    agent = load_agent("drchubo")
    heights = [agent.posture(f"step_{k}").T_floor_base[2, 3] for k in (1, 2, 3)]
    np.testing.assert_allclose(np.diff(heights), 0.20)


def test_unknown_names_get_the_lists():
    with pytest.raises(BadInput, match=r"no hand 'shd'; did you mean 'sdh'"):
        load_hand("shd")
    with pytest.raises(BadInput, match=r"no agent 'hubo'.*crichton, drchubo, panda"):
        load_agent("hubo")
    with pytest.raises(BadInput, match=r"no posture 'lying'; give one of standing"):
        load_agent("drchubo").posture("lying")
    assert {"sdh", "hubo_left", "hubo_right", "panda"} <= set(hand_names())


def test_a_hand_that_its_urdf_lacks_is_refused():
    spec = load_hand("sdh").spec
    lame = HandSpec("lame", spec.robot, "fist", spec.palm, spec.fingers, {}, ({},))
    with pytest.raises(BadRobot, match="names the link 'fist'.*lacks"):
        make_hand(lame)
    lame = HandSpec("lame", spec.robot, spec.root, spec.palm, (("thumb",),), {}, ({},))
    with pytest.raises(BadRobot, match="no finger of it|names the joint 'thumb'"):
        make_hand(lame)
