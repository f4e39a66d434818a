"""Robots that cannot be used are refused with one sentence, a PlanningError."""

import importlib.util
import re
from itertools import pairwise

import numpy as np
import pytest
from urdf_parts import BALL, COARSE, mesh

from roadmap import load_robot
from roadmap.errors import PlanningError
from roadmap.loading import urdf


def refuses(source, words, **options):
    with pytest.raises(PlanningError, match=words) as caught:
        load_robot(source, **{**COARSE, **options})
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    refuses(tmp_path / "no.urdf", "no URDF file at .*no.urdf")
    refuses(tmp_path, "is a folder, no URDF file")


@pytest.mark.parametrize(
    "text",
    ["", "<robot name='x'>", "<robot><link name='a'></robot>", "not xml", "\0\1\2"],
)
def test_broken_xml_is_refused_not_repaired(text, tmp_path):
    (tmp_path / "r.urdf").write_text(text)
    refuses(tmp_path / "r.urdf", "not well-formed|not one tree|not a usable")


def test_another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "r.sdf").write_text("<sdf version='1.6'/>")
    refuses(tmp_path / "r.sdf", "<sdf>, not <robot>")


def test_a_xacro_file_is_told_how_to_be_expanded(tmp_path):
    (tmp_path / "r.urdf.xacro").write_text("<robot name='x'/>")
    refuses(tmp_path / "r.urdf.xacro", "xacro file; .*xacro r.urdf.xacro > r.urdf$")


@pytest.mark.parametrize("named", ['xmlns:xacro="http://www.ros.org/wiki/xacro"', ""])
def test_elements_that_xacro_should_have_expanded_are_not_dropped(urdf, link, named):
    file = urdf(link("base", BALL) + "<xacro:gripper side='left'/>")
    file.write_text(file.read_text().replace("<robot", f"<robot {named}"))
    refuses(file, "still has the element <xacro:gripper>.*run xacro first")


def test_a_default_name_space_is_passed_over_but_for_that_of_xacro(arm):
    file = arm(BALL)
    plain = file.read_text()
    file.write_text(plain.replace("<robot", '<robot xmlns="http://drake.mit.edu"'))
    assert load_robot(file, **COARSE).dof == 1
    xacro = "http://www.ros.org/wiki/xacro"
    file.write_text(plain.replace("<robot", f'<robot xmlns="{xacro}"'))
    refuses(file, "still has the element <xacro:robot>")


def test_what_is_no_path_and_no_number_is_refused(arm):
    refuses(b"arm.urdf", "b'arm.urdf' .bytes.; give a name")
    refuses(arm(BALL), "cannot be locked at 90: .*give a number", locked={"turn": "90"})


def test_how_far_links_reach_is_not_asked_where_nothing_travels(arm, monkeypatch):
    asked = []
    monkeypatch.setattr(urdf, "radii_of", lambda *parts: asked.append(parts))
    assert load_robot(arm(BALL), **COARSE).dof and not asked


def test_a_missing_mesh_names_link_file_and_places(arm, tmp_path):
    refuses(arm(mesh("package://p/no.stl")), "'package://p/no.stl' of link 'arm'.*look")
    refuses(arm(mesh("no.stl")), "no.stl.*starts at the folder of the URDF")


def test_an_unreadable_mesh_is_refused(arm, tmp_path):
    (tmp_path / "t.stl").write_bytes(b"solid nothing")
    refuses(arm(mesh("t.stl")), "t.stl.*of link 'arm'")
    (tmp_path / "t.obj").write_bytes(b"v 0 0 nan\nf 1 1 1\n")
    refuses(arm(mesh("t.obj")), "no finite triangles")
    (tmp_path / "t.dae").write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    refuses(arm(mesh("t.dae")), "'arm' .*only the pointer of Git LFS: run git lfs")
    (tmp_path / "t.obj").write_bytes(b"v 1e300 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    refuses(arm(mesh("t.obj")), "'arm' reaches 1e.300 m far, but at most 1e.06 m can")
    (tmp_path / "t.xyz").write_bytes(b"1 2 3")
    refuses(arm(mesh("t.xyz")), "cannot be read")


def test_a_robot_without_a_moving_joint_is_refused(arm):
    refuses(arm(BALL, "fixed"), "no joint moves")
    refuses(arm(BALL), "no joint moves", locked={"turn": 0.0})
    still = '<limit lower="0.3" upper="0.3" velocity="1" effort="1"/>'
    refuses(arm(BALL, inside=still), "no joint moves.*'turn' a <limit> that is a range")


def test_an_unknown_tip_lists_the_links(arm):
    refuses(arm(BALL), "no link 'hand'.*'base', 'arm'", tip="hand")


def test_of_many_links_those_of_similar_names_are_listed(urdf, link, joint):
    names = ["base", *(f"part_{k}" for k in range(30)), "Arm_Tool_Link"]
    body = "".join(link(name) for name in names)
    body += "".join(joint(b, "fixed", a, b) for a, b in pairwise(names))
    told = "did you mean Arm_Tool_Link. choose one of the 32 links of its URDF$"
    refuses(urdf(body), told, tip="tool_link")


def test_an_unclear_tip_lists_the_candidates(urdf, link, joint):
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "revolute", "base", "a") + joint("k", "revolute", "base", "b")
    refuses(urdf(body), "tip .--tip.: a, b, or any other")


def test_an_unclear_tip_names_the_hand_of_fingers_first(urdf, link, joint):
    arm = [link(name, BALL) for name in ("base", "a", "b", "c", "hand", "f", "g")]
    chain = ["base", "a", "b", "c"]
    for k, (parent, child) in enumerate(pairwise(chain)):
        arm.append(joint(f"j{k}", "revolute", parent, child))
    arm.append(joint("mount", "fixed", "c", "hand"))
    for kind, told in (
        ("revolute", "hand, which carries all of these: f"),
        ("fixed", "f, g"),
    ):
        fingers = [joint(f"to_{name}", kind, "hand", name) for name in "fg"]
        refuses(urdf("".join(arm + fingers)), f"tip .--tip.: {told}")


def test_the_trunk_of_two_arms_is_no_hand(urdf, link, joint):
    chains = [["base", "t1", "t2", "t3"]]
    chains += [["t3", *(f"{side}{k}" for k in range(5))] for side in "lr"]
    names = dict.fromkeys(name for chain in chains for name in chain)
    body = "".join(link(name, BALL) for name in names)
    for chain in chains:
        for a, b in pairwise(chain):
            body += joint(f"to_{b}", "revolute", a, b)
    refuses(urdf(body), "tip .--tip.: l4, r4, or any other")


def test_locking_what_cannot_be_locked_is_refused(arm, gantry, urdf, link, joint):
    refuses(arm(BALL), "'elbow'.*'turn'", locked={"elbow": 0})
    refuses(arm(BALL), "at 2.5.*-2 to 1.5", locked={"turn": 2.5})
    refuses(arm(BALL), "locked at nan", locked={"turn": np.nan})
    body = link("base") + link("a", BALL) + link("b", BALL)
    follow = '<mimic joint="j"/>'
    body += joint("j", "revolute", "base", "a")
    body += joint("k", "revolute", "a", "b", inside=follow)
    refuses(urdf(body), "'k' mimics 'j'; lock 'j'", locked={"k": 0})


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ('lower="1" upper="-1"', "lower 1.0 above upper -1.0"),
        ('lower="0"', "limits 0.0 to None"),
        ('lower="-inf" upper="1"', "-inf to 1.0"),
    ],
)
def test_unusable_limits_are_refused(limit, words, arm):
    refuses(arm(BALL, inside=f'<limit {limit} velocity="1" effort="1"/>'), words)


@pytest.mark.parametrize("kind", ["floating", "planar", "screw"])
def test_other_joint_types_are_refused(kind, arm):
    refuses(arm(BALL, kind), f"'turn'.*'{kind}'")


def test_shapes_that_are_not_understood_are_refused_not_skipped(arm):
    refuses(arm('<capsule radius="1" length="1"/>'), "capsule")
    refuses(arm('<box size="0.1 0.1"/>'), "sizes must be")
    refuses(arm('<sphere radius="0"/>'), "sizes must be")
    refuses(arm('<cylinder radius="-1" length="1"/>'), "sizes must be")


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        (f"<geometry>{BALL}<box size='1 1 1'/></geometry>", "<sphere>, <box>; give it"),
        (
            f"<geometry>{BALL}</geometry><geometry><box size='1 1 1'/></geometry>",
            "2 <g",
        ),
        (f'<origin/><origin xyz="1 0 0"/><geometry>{BALL}</geometry>', "2 <origin>"),
        ("<geometry/>", "<geometry> of link 'arm' in .*, line 1, holds no shape; give"),
        ("", "<collision> of link 'arm' in .* holds no <geometry>; give it one"),
        ('<geometry><cylinder radius="1"/></geometry>', "'arm' .* has no length; give"),
        ("<geometry><mesh/></geometry>", "<mesh> of link 'arm' in .* has no filename"),
    ],
)
def test_a_shape_is_never_dropped_beside_another(urdf, link, joint, inside, told):
    arm = f'<link name="arm"><collision>{inside}</collision></link>'
    refuses(urdf(link("base") + arm + joint("turn", "revolute", "base", "arm")), told)


def test_of_two_axes_none_is_chosen(arm):
    twice = '<axis xyz="0 0 1"/>'
    assert load_robot(arm(BALL, inside=twice), **COARSE).dof == 1  # it is the same
    refuses(arm(BALL, inside='<axis xyz="1 0 0"/>'), "'turn' in .* holds 2 <axis>")


@pytest.mark.parametrize("xyz", ["0.3", "0 0", "0 0 0.3 1", ""])
def test_a_place_of_other_than_three_numbers_is_refused(urdf, link, joint, xyz):
    body = link("base", BALL) + link("arm", BALL, xyz=xyz)
    file = urdf(body + joint("turn", "revolute", "base", "arm"))
    refuses(file, f'<origin xyz="{xyz}"> of .* holds . numbers; give three')


@pytest.mark.parametrize("given", ['multiplier="nan"', 'offset="inf"'])
def test_a_follower_by_what_is_not_finite_is_refused(urdf, link, joint, given):
    body = link("base") + link("a", BALL) + link("b", BALL)
    follow = f'<mimic joint="j" {given}/>'
    body += joint("j", "revolute", "base", "a")
    body += joint("k", "revolute", "a", "b", inside=follow)
    refuses(urdf(body), f"<mimic {given}> of .* is not finite; give a finite number")
    word = given.partition('"')[0] + '"two"'
    refuses(urdf(body.replace(given, word)), "holds 'two', which is no number")


def test_broken_trees_are_refused(urdf, link, joint):
    ends = link("a", BALL) + link("b", BALL)
    refuses(urdf(ends), "not one tree")
    refuses(urdf(ends + joint("j", "revolute", "a", "c")), "'c', which the file")
    loop = joint("j", "revolute", "a", "b") + joint("k", "revolute", "b", "a")
    refuses(urdf(ends + loop), "not one tree")
    refuses(urdf(ends + loop + link("root")), "loop through")
    refuses(urdf(ends + link("a")), "the link name 'a' twice")
    twice = joint("j", "revolute", "a", "b") + joint("k", "fixed", "a", "b")
    refuses(urdf(ends + twice), "link 'b' is the child of 2 joints .j, k.")


def test_parts_without_a_name_or_an_end_are_named(urdf, link, joint):
    ends = link("a", BALL) + link("b", BALL)
    arm = ends + joint("j", "revolute", "a", "b")
    refuses(urdf(arm.replace('<child link="b"/>', "")), "'j' .* names no child link")
    refuses(urdf(arm.replace('<link name="b"', "<link")), "a <link> of .* has no name")
    file = urdf(arm)
    text = file.read_text()
    file.write_text(text.replace(text[text.index("<robot") :].split(">")[0], "<robot"))
    refuses(file, "<robot> of .* has no name")


def test_mimics_of_nothing_or_in_a_circle_are_refused(arm, urdf, link, joint):
    refuses(arm(BALL, inside='<mimic joint="ghost"/>'), "mimics 'ghost'")
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "revolute", "base", "a", inside='<mimic joint="k"/>')
    body += joint("k", "revolute", "a", "b", inside='<mimic joint="j"/>')
    refuses(urdf(body), "itself a follower")
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "fixed", "base", "a")
    body += joint("k", "revolute", "a", "b", inside='<mimic joint="j"/>')
    refuses(urdf(body), "'k' mimics the fixed joint 'j'; remove its <mimic>")


@pytest.mark.parametrize("axis", ["0 1", "0 0 1 0", ""])
def test_an_axis_of_other_than_three_numbers_is_refused(urdf, link, joint, axis):
    body = link("base", BALL) + link("arm", BALL)
    file = urdf(body + joint("turn", "revolute", "base", "arm", axis=axis))
    refuses(file, f'<axis xyz="{axis}"> of .*, line 1, holds .* numbers; give three')


def test_a_scale_of_two_or_four_numbers_is_refused(arm):
    refuses(arm(mesh("part.obj", 'scale="1 1 1 1"')), "holds 4 numbers; give three")


def test_a_place_turned_by_degrees_is_refused(urdf, link, joint):
    body = link("base", BALL) + link("arm", BALL, rpy="0 90 0")
    file = urdf(body + joint("turn", "revolute", "base", "arm"))
    refuses(file, '<origin rpy="0 90 0"> of .* looks like degrees; give radians')


@pytest.mark.parametrize("rpy", ["0, 0, 0", "0 0 0,5", "0 0 ${pi}"])
def test_what_is_no_number_is_told_with_its_line(urdf, link, joint, rpy):
    body = link("base", BALL) + link("arm", BALL, rpy=rpy)
    file = urdf(body + joint("turn", "revolute", "base", "arm"))
    word = next(w for w in rpy.split() if w not in "0")
    refuses(file, f"line 1, holds {re.escape(repr(word))}, which is no number; write")


@pytest.mark.parametrize("number", ["1_0", "\u0663"])
def test_what_only_python_takes_for_a_number_is_none(urdf, link, joint, number):
    body = link("base", BALL) + link("arm", BALL, xyz=f"0 0 {number}")
    file = urdf(body + joint("turn", "revolute", "base", "arm"))
    refuses(file, f"holds '{number}', which is no number; write")


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("<collision", "<colision", "<link> .* holds <colision>.*; write <collision>"),
        ("<axis", "<Axis", "<joint> .* holds <Axis>, .* not know; write <axis>"),
        ("<limit ", "<limits ", "<joint> .* holds <limits>.*; write <limit>"),
        ("<link", "<Link", "<robot> of .* holds <Link>.*; write <link>"),
        ("rpy=", "quat_xyzw=", "'quat_xyzw', .* write rpy, the same turn as roll"),
        ("xyz=", "pos=", "<origin> of .* has 'pos', .* read; write xyz, rpy"),
        ("lower=", "Lower=", "<limit> of .* has 'Lower', .* read; write lower"),
        ("radius=", "radious=", "<sphere> of .* has 'radious', .* read; write radius"),
        ("multiplier=", "multipler=", "<mimic> .* 'multipler', .* write multiplier"),
    ],
)
def test_a_name_with_a_slip_is_never_read_over(urdf, link, joint, right, wrong, told):
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1" acceleration="9"/>'
    body = link("base", BALL) + link("arm", BALL) + link("more", BALL)
    body += joint("turn", "revolute", "base", "arm", inside=limit)
    follow = f'<mimic joint="turn" multiplier="2"/>{limit}'
    body += joint("after", "revolute", "arm", "more", inside=follow)
    assert right in body and load_robot(urdf(body), **COARSE).dof == 1
    closed = "</" + right[1:], "</" + wrong[1:]
    refuses(urdf(body.replace(right, wrong).replace(*closed)), told)


def test_a_zero_axis_is_refused(urdf, link, joint):
    body = link("base") + link("a", BALL)
    refuses(urdf(body + joint("j", "revolute", "base", "a", axis="0 0 0")), "axis")


def test_a_missing_or_broken_srdf_is_refused(arm, tmp_path):
    refuses(arm(BALL), "no SRDF file", srdf=tmp_path / "no.srdf")
    for text, told in (("<robot>", "not well-formed"), ("<srdf/>", "leave it out")):
        (tmp_path / "r.srdf").write_text(text)
        refuses(arm(BALL), told, srdf=tmp_path / "r.srdf")


def test_without_pybullet_the_panda_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    refuses("panda", "comes with pybullet, which is not installed.*3.11")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"locked": ["j"]}, "locked is .* give {joint name: value}"),
        ({"velocity": 3}, r"velocity is 3 \(int\); give {joint name: value}"),
        ({"jerk": {"j": "quick"}}, "a limit of jerk of quick; give a number above 0"),
        ({"srdf": 3}, r"an SRDF file is 3 \(int\); give its path"),
    ],
)
def test_arguments_of_another_kind_are_refused(urdf, link, joint, given, told):
    body = link("base") + link("a", BALL) + joint("j", "revolute", "base", "a")
    with pytest.raises(PlanningError, match=told):
        load_robot(urdf(body), **given)
