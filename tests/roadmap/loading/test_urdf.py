"""Robots from URDF files: what is read and what is assumed."""

import numpy as np
import pytest
from urdf_parts import BALL, COARSE

from roadmap import load_robot, tool_pose
from roadmap.errors import BadRobot
from roadmap.geometry.polytope import support
from roadmap.geometry.spheres import robot_solids
from roadmap.loading.srdf import read_disabled_pairs
from roadmap.robot.description import read_description
from roadmap.robot.robot import BOX, CYLINDER, SPHERE, Robot


def test_the_panda_has_seven_joints_and_fingers_that_travel(panda):
    assert panda.dof == 7 and panda.tip_name == "panda_grasptarget"
    assert "held over the whole travel of panda_finger_joint1" in panda.notes
    assert not any("locked" in note for note in panda.notes)
    assert any("panda_link8" in note for note in panda.notes)
    assert panda.link_body.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 7, 7, 7]
    # between the fingers nothing is left, outside they reach as far as opened
    assert _gap(panda, 1) == pytest.approx(0.0, abs=0.005)
    opened = load_robot("panda", travel=(), **COARSE)
    assert any("panda_finger_joint1 = 0.04" in note for note in opened.notes)
    assert _gap(opened, 1) == pytest.approx(0.08, abs=0.005)
    assert _gap(panda, -1) == pytest.approx(_gap(opened, -1), abs=1e-6)


def _gap(panda: Robot, side: int) -> float:
    """Return how far apart the fingers are inside (1); minus that outside (-1)."""
    solids = robot_solids(panda)
    left = solids[panda.link_names.index("panda_leftfinger")]
    right = solids[panda.link_names.index("panda_rightfinger")]
    y = side * np.array([0.0, 1, 0])
    out = solids[panda.link_names.index("panda_hand")].T_body_solid[:3, :3] @ y
    return float((-support(left, -out[None]) - support(right, out[None]))[0])


@pytest.mark.parametrize("name", ["kuka_iiwa", "xarm6"])
def test_other_known_names_load(name, pybullet_file):
    pybullet_file("franka_panda/panda.urdf")
    robot = load_robot(name, **COARSE)
    assert robot.dof == {"kuka_iiwa": 7, "xarm6": 6}[name]


def test_a_robot_survives_its_store(gantry):
    again = Robot.from_store(gantry.meta(), gantry.arrays())
    assert again.fingerprint() == gantry.fingerprint()
    assert again.notes == gantry.notes and again.joint_names == gantry.joint_names


def test_primitives_and_their_poses_are_read(urdf, link, joint):
    body = link("base") + link("a", '<box size="0.1 0.2 0.3"/>', "1 0 0", "0 0 1.5708")
    body += link("b", '<cylinder radius="0.1" length="0.4"/>') + link("c", BALL)
    body += joint("j", "revolute", "base", "a") + joint("k", "fixed", "a", "b", "0 0 1")
    body += joint("l", "fixed", "b", "c", "0 1 0")
    robot = load_robot(urdf(body), **COARSE)
    assert robot.solid_kind.tolist() == [BOX, CYLINDER, SPHERE]
    assert robot.link_body.tolist() == [1, 1, 1]
    assert np.allclose(robot.solid_pose[:, :3, 3], [[1, 0, 0], [0, 0, 1], [0, 1, 1]])
    high = support(robot_solids(robot)[0], np.eye(3))
    assert np.allclose(high, [1.1, 0.05, 0.15], atol=1e-4)


def test_a_file_with_latin_1_comments_and_gazebo_tags_is_read(arm):
    path = arm(BALL)
    text = path.read_text().replace("</robot>", "<!-- \xfc --><gz:x/></robot>")
    path.write_bytes(text.encode("latin-1"))
    assert load_robot(path, **COARSE).dof == 1


@pytest.mark.parametrize("stored", ["utf-16", "utf-8-sig"])
def test_a_file_in_another_encoding_is_read(arm, stored):
    path = arm(BALL)
    path.write_text(path.read_text().replace('"arm"', '"\xe4"'), encoding=stored)
    assert "\xe4" in load_robot(path, **COARSE).link_names


@pytest.mark.parametrize("stored", ["latin-1", "utf-16"])
def test_an_srdf_in_another_encoding_is_read(tmp_path, stored):
    pair = '<disable_collisions link1="a" link2="b" reason="Never"/>'
    srdf = tmp_path / "r.srdf"
    srdf.write_text(f"<robot><!-- \xfc -->{pair}</robot>", encoding=stored)
    assert read_disabled_pairs(srdf) == {frozenset("ab"): "Never"}


def test_links_that_only_the_srdf_has_are_told(arm, tmp_path):
    pair = '<disable_collisions link1="{}" link2="{}"/>'
    srdf = tmp_path / "r.srdf"

    def told(*pairs):
        body = "".join(pair.format(*names) for names in pairs)
        srdf.write_text(f"<robot>{body}</robot>")
        notes = load_robot(arm(BALL), srdf=srdf, **COARSE).notes
        return [note for note in notes if "SRDF" in note]

    assert told() == told(("base", "arm")) == []
    assert "'Arm', 'hand', which" in told(("base", "Arm"), ("hand", "arm"))[0]
    many = told(*[("base", f"l{k}") for k in range(9)])[0]
    assert "'l5' and 3 more" in many and "l6" not in many


def test_joints_off_the_chain_are_locked_and_carried_along(urdf, link, joint):
    body = link("base") + link("a", BALL) + link("b", BALL) + link("c", BALL)
    limit = '<limit lower="0.2" upper="0.6" velocity="1" effort="1"/>'
    body += joint("j", "revolute", "base", "a") + joint("k", "revolute", "a", "b")
    body += joint("l", "prismatic", "a", "c", "0 0 1", "0 1 0", limit)
    path = urdf(body)
    robot = load_robot(path, tip="b", **COARSE)
    assert robot.joint_names == ("j", "k")
    assert robot.link_body.tolist() == [1, 1, 2]
    c = robot.link_names.index("c")
    assert np.allclose(robot.solid_pose[c, :3, 3], [0, 0.2, 1])
    assert any("l = 0.2 (default)" in note for note in robot.notes)
    robot = load_robot(path, tip="b", locked={"l": 0.5, "j": 1.0}, **COARSE)
    assert robot.joint_names == ("k",)
    turned = [0.5 * -np.sin(1.0), 0.5 * np.cos(1.0), 1]
    c = robot.link_names.index("c")
    assert np.allclose(robot.solid_pose[c, :3, 3], turned)


def test_followers_of_a_locked_joint_are_locked_with_it(urdf, link, joint):
    follow = '<mimic joint="l" multiplier="-2" offset="0.1"/>'
    body = link("base") + link("a", BALL) + link("f", BALL) + link("g", BALL)
    body += joint("j", "revolute", "base", "a")
    body += joint("l", "prismatic", "a", "f", axis="1 0 0")
    body += joint("m", "prismatic", "a", "g", axis="1 0 0", inside=follow)
    robot = load_robot(urdf(body), tip="a", locked={"l": 0.3}, **COARSE)
    x = {n: robot.solid_pose[i, 0, 3] for i, n in enumerate(robot.link_names)}
    assert x == pytest.approx({"a": 0.0, "f": 0.3, "g": -0.5})


def test_a_follower_on_the_chain_makes_its_leader_move(urdf, link, joint):
    """The leader is off the chain; a follower of the follower moves as well."""
    body = link("base") + link("side", BALL) + link("a", BALL) + link("b", BALL)
    body += joint("lead", "revolute", "base", "side", "1 0 0")
    one = '<mimic joint="lead" multiplier="2"/>'
    two = '<mimic joint="one" multiplier="3" offset="0.5"/>'
    body += joint("one", "revolute", "base", "a", inside=one)
    body += joint("two", "revolute", "a", "b", "1 0 0", inside=two)
    robot = load_robot(urdf(body), tip="b", **COARSE)
    assert robot.joint_names == ("lead",)
    assert sorted(robot.tree_f[1:, 15]) == [1, 2, 6]
    R = tool_pose(robot, np.array([0.1]))[:3, :3]
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(0.2 + 0.6 + 0.5)


@pytest.mark.parametrize(
    ("kind", "factor"), [("continuous", 0.5), ("prismatic", 1), ("prismatic", -0.05)]
)
def test_a_continuous_joint_does_not_wrap_where_a_follower_does_not(
    kind, factor, urdf, link, joint
):
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "continuous", "base", "a")
    follows = f'<mimic joint="j" multiplier="{factor}"/>'
    body += joint("k", kind, "a", "b", inside=follows)
    robot = load_robot(urdf(body), **COARSE)
    assert not robot.continuous.any()
    assert any("breaks the turn" in note for note in robot.notes)


@pytest.mark.parametrize(
    ("follows", "stops", "kept"),
    [
        ('multiplier="2" offset="0.5"', (-1.5, 2.0), (-1.0, 0.75)),
        ('multiplier="-1"', (-0.5, 9.0), (-2.0, 0.5)),
        ('multiplier="0.5"', (-1.0, 0.75), None),  # all of it, to the last bit
        ('multiplier="0" offset="9"', (-1.0, 1.0), None),
        ('multiplier="2"', (0.0, 0.0), None),  # what exporters write for nothing
    ],
)
def test_no_follower_leaves_its_limits(follows, stops, kept, urdf, link, joint):
    """A follower of a follower counts as well; who is told says so by name."""
    robot = load_robot(urdf(_two_followers(link, joint, follows, stops)), **COARSE)
    assert (robot.lower[0], robot.upper[0]) == pytest.approx(kept or (-2.0, 1.5))
    notes = [note for note in robot.notes if "lead: kept within" in note]
    assert len(notes) == (kept is not None) and all("second" in n for n in notes)


def test_a_continuous_joint_stops_where_its_follower_does(urdf, link, joint):
    def follows(stops):
        text = _two_followers(link, joint, 'multiplier="1"', stops, "continuous")
        return load_robot(urdf(text), **COARSE)

    robot = follows((-1.0, 4.0))
    assert not robot.continuous[0]
    assert (robot.lower[0], robot.upper[0]) == pytest.approx((-1.0, np.pi))
    robot = follows((-4.0, 4.0))  # it turns to a stop, though not within one turn
    assert not robot.continuous[0] and robot.upper[0] == np.pi
    assert follows((-1e16, 1e16)).continuous[0]


def test_a_follower_that_leaves_no_range_is_told(urdf, link, joint):
    body = _two_followers(link, joint, 'offset="5"', (-1.0, 1.0))
    with pytest.raises(BadRobot, match="'lead'.*'second'.*correct one <limit>"):
        load_robot(urdf(body), **COARSE)


def _two_followers(link, joint, follows, stops, kind="revolute"):
    """Return a chain of a joint, one that follows it, and one that follows that."""
    limit = f'<limit lower="{stops[0]}" upper="{stops[1]}" velocity="1" effort="1"/>'
    body = link("base") + link("a", BALL) + link("b", BALL) + link("c", BALL)
    body += joint("lead", kind, "base", "a")
    first = '<mimic joint="lead"/>'
    body += joint("first", "continuous", "a", "b", "1 0 0", inside=first)
    second = f'{limit}<mimic joint="first" {follows}/>'
    return body + joint("second", "revolute", "b", "c", "1 0 0", inside=second)


def test_missing_velocity_limits_get_stated_defaults(arm):
    zero = '<limit lower="-1" upper="1" velocity="0" effort="1"/>'
    for kind, speed in (("revolute", 1.0), ("prismatic", 0.1)):
        robot = load_robot(arm(BALL, kind, zero), **COARSE)
        assert robot.max_velocity[0] == speed
        assert any("velocity limit taken as" in note for note in robot.notes)
    assert robot.max_acceleration[0] == pytest.approx(4 * speed)
    assert robot.max_jerk[0] == pytest.approx(40 * speed)
    assert any("jerk" in note for note in robot.notes)


def test_a_joint_that_may_turn_faster_than_arms_do_is_told(arm):
    quick = '<limit lower="-1" upper="1" velocity="{}" effort="1"/>'
    notes = load_robot(arm(BALL, inside=quick.format(100)), **COARSE).notes
    assert any("may turn at 100 rad/s" in note for note in notes)
    slow = load_robot(
        arm(BALL, inside=quick.format(100)), velocity={"turn": 2}, **COARSE
    )
    slides = load_robot(arm(BALL, "prismatic", quick.format(100)), **COARSE)
    for robot in (slow, slides):
        assert not any("may turn at" in note for note in robot.notes)


def test_a_revolute_joint_without_limits_gets_a_full_turn_and_says_so(arm):
    robot = load_robot(arm(BALL, inside='<limit effort="1"/>'), **COARSE)
    assert robot.lower[0] == -np.pi and robot.upper[0] == np.pi
    assert any("no position limits" in note for note in robot.notes)


def test_the_only_end_of_the_longest_chain_is_the_default_tip(urdf, link, joint):
    body = link("base") + link("a", BALL) + link("b") + link("c") + link("camera")
    body += joint("j", "revolute", "base", "a") + joint("k", "revolute", "a", "b")
    body += joint("f", "fixed", "b", "c") + joint("g", "fixed", "a", "camera")
    assert load_robot(urdf(body), **COARSE).tip_name == "c"


def test_a_description_lists_its_links_in_file_order(arm):
    description = read_description(arm(BALL))
    assert list(description.links) == ["base", "arm"] and description.root == "base"
    with pytest.raises(BadRobot):
        read_description("nowhere.urdf")


def test_the_version_that_files_beside_pybullet_declare_is_read_as_plain_xml(arm):
    file = arm(BALL)
    plain = load_robot(file, **COARSE)
    text = file.read_text()
    assert not text.startswith("<?xml")
    for quote in "\"'":
        file.write_text(f"<?xml version={quote}0.0{quote} ?>\n{text}")
        assert load_robot(file, **COARSE).joint_names == plain.joint_names
