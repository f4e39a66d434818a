"""Robots and hands of the user's own, which no list of ours knows, in a plan."""

import re
from dataclasses import replace

import numpy as np
import pytest
from rows import each

import handover
from handover.grasps.grasp_build import GraspSettings, build_grasps
from handover.grasps.hand import load_hand, make_hand
from handover.plans import grasps as grasp_sets
from handover.plans.choose import Pair, common_voxels, shoulders
from handover.plans.limb import limb_of
from handover.plans.mover import Mover
from handover.plans.plan_record import record_of
from handover.plans.planner import plan_handover
from handover.scenes.plan_file import Hold, object_at, plan_record
from handover.scenes.start_check import start_distances
from odm.obstacles.shapes import Box
from roadmap.errors import BadInput, PlanningError
from roadmap.robot.known import robot_file

# links of an arm: size of a box in the middle of each [m]
_SIZES = (0.08, 0.08, 0.16), (0.09, 0.09, 0.3), (0.08, 0.08, 0.26), (0.05, 0.05, 0.05)
_ARM = ("z", 0.20, 2.9), ("y", 0.40, 2.2), ("y", 0.32, 2.6), ("z", 0.08, 2.9)
_WRIST = ("y", 0.08, 2.0), ("z", 0.02, 2.9)
_AXES = {"x": "1 0 0", "y": "0 1 0", "-y": "0 -1 0", "z": "0 0 1"}


def _link(name, size=None, z=0.0):
    if size is None:
        return f'<link name="{name}"/>'
    box = f'<box size="{size[0]} {size[1]} {size[2]}"/>'
    at = f'<origin xyz="0 0 {z}"/><geometry>{box}</geometry>'
    return f'<link name="{name}"><collision>{at}</collision></link>'


def _joint(name, kind, parent, child, xyz, axis="z", ends=(0.0, 0.0), more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin {xyz}/><axis xyz="{_AXES[axis]}"/>'
        f'<limit lower="{ends[0]}" upper="{ends[1]}" velocity="1" effort="9"/>'
        f"{more}</joint>"
    )


def _arm(mount, xyz, side=""):
    """Return an arm of six joints with a gripper of two jaws, one driven."""
    text, parent, at = "", mount, xyz
    for k, (axis, length, end) in enumerate((*_ARM, *_WRIST)):
        name, size = f"{side}link_{k}", _SIZES[min(k, 3)]
        if k == 5:
            size = (0.05, 0.05, 0.02)
        text += _joint(f"{side}j{k}", "revolute", parent, name, at, axis, (-end, end))
        text += _link(name, size, 0.0 if k == 5 else 0.5 * length)
        parent, at = name, f'xyz="0 0 {length}"'
    grip, follow = f"{side}grip", f'<mimic joint="{side}jaw_a"/>'
    text += _joint(f"{side}mount", "fixed", parent, grip, at)
    text += _link(grip, (0.05, 0.14, 0.04), 0.02)
    for jaw, axis, more in (("jaw_a", "y", ""), ("jaw_b", "-y", follow)):
        text += _link(f"{side}{jaw}_pad", (0.022, 0.012, 0.06), 0.03)
        at, pad = 'xyz="0 0 0.042"', f"{side}{jaw}_pad"
        text += _joint(side + jaw, "prismatic", grip, pad, at, axis, (0.0, 0.05), more)
    return text


def _hand(side="", palm=0.048, name=""):
    """Return the gripper as a table; jaws begin 6 mm apart from their middle."""
    return (
        f'{{root = "{side}grip", palm = "{side}grip", palm_position = [0, 0, {palm}], '
        f'fingers = [["{side}jaw_a"]], closed = {{{side}jaw_a = 0.006}}, '
        f"preshapes = [{{{side}jaw_a = 0.05}}]{name}}}"
    )


def _scene(folder, body, hands, joints, more=""):
    """Write a robot of one's own that gives a person who stands a box of tea."""
    (folder / "own.urdf").write_text(f'<robot name="own">{body}</robot>')
    given = "".join(f"{name} = {value}\n" for name, value in joints.items())
    arms = "".join(
        f'[giver.arms.{side}]\ntip = "{tip}"\nhand = {hand}\n'
        for side, (tip, hand) in hands.items()
    )
    path = folder / "own.toml"
    path.write_text(
        f'[giver]\nurdf = "own.urdf"\nposition = [0.0, 0.0, 0.701]\n'
        f"[giver.joints]\n{given}{arms}"
        '[receiver]\nagent = "person"\nposition = [1.1, 0.0, 0.0]\n'
        'rpy = [0.0, 0.0, 3.1416]\nuse = ["right"]\n[object]\nname = "box"\n'
        "[start]\nposition = [0.45, 0.25, 0.777]\nrpy = [1.5708, 0.0, 0.0]\n"
        "[goal]\nposition = [0.7, 0.0, 1.1]\nrpy = [0.0, 0.0, 1.57]\nheld = true\n"
        '[[scenery]]\ntype = "box"\nsize = [1.0, 3.0, 0.03]\n'
        f"position = [0.3, 0.0, 0.685]\n{more}"
    )
    return path


_BENT = {"j1": 0.3, "j2": 1.2, "j4": 0.8, "jaw_a": 0.05}
_READY = {"panda_joint4": -2.356, "panda_joint6": 1.571}
_BASE = _link("base", (0.16, 0.16, 0.1), 0.05)


@pytest.fixture
def own(tmp_path):
    body = _BASE + _arm("base", 'xyz="0 0 0.12"')
    return _scene(tmp_path, body, {"right": ("grip", _hand())}, _BENT)


@pytest.fixture
def few(monkeypatch):
    """Grasp sets of few samples: a second, not ten."""
    settings = GraspSettings(samples=40, rolls=8)

    def build(thing, hand, progress=None):
        return build_grasps(thing, hand, settings, progress=progress)

    monkeypatch.setattr(grasp_sets, "build_grasps", build)


def test_a_robot_with_a_hand_of_its_own_gives(own, few, tmp_path):
    scene = handover.load_scene(own)
    plan = plan_handover(scene, 600.0, folder=tmp_path / "sets")
    assert plan.found, plan.reason
    assert plan.grasps_giver.joints == ("jaw_a",)
    record, end = record_of(plan), plan.duration
    assert np.abs(object_at(record, scene, end) - scene.T_world_goal).max() < 1e-6
    assert record["holds"][1]["touching"] == ["grip", "jaw_a_pad", "jaw_b_pad"]


def test_hands_of_one_name_have_sets_of_their_own(own, few, tmp_path):
    thing, folder = handover.load_object("box"), tmp_path / "sets"
    spec = handover.load_scene(own).giver.agent.arms["right"].spec
    first = grasp_sets.grasps_for(thing, spec, folder)
    T = spec.T_link_palm.copy()
    T[2, 3] += 0.01  # as after a mended file
    other = grasp_sets.grasps_for(thing, replace(spec, T_link_palm=T), folder)
    assert first.hash and other.hash and other.hash != first.hash
    again = grasp_sets.grasps_for(thing, replace(spec), folder)
    assert again.hash == first.hash and len(list(folder.iterdir())) == 2


def test_a_known_hand_is_what_the_urdf_carries(tmp_path):
    """A Panda's hand with longer fingers has grasps of these, not of the Panda's."""
    text = robot_file("panda").read_text()
    jaw = 'xyz="0 0 0.0584"'  # of both fingers, from the hand
    assert text.count(jaw) == 2
    folder = robot_file("panda").parent
    text = text.replace("package://", f"{folder}/")
    hands = {}
    for name, at in (("as_it_is", jaw), ("longer", 'xyz="0 0 0.0784"')):
        (tmp_path / name).mkdir()
        path = _scene(
            tmp_path / name, _BASE, {"right": ("panda_hand", '"panda"')}, _READY
        )
        (tmp_path / name / "own.urdf").write_text(text.replace(jaw, at))
        arm = handover.load_scene(path).giver.agent.arms["right"]
        hands[name] = make_hand(arm.spec).fingerprint()
    assert hands["as_it_is"] == load_hand("panda").fingerprint() != hands["longer"]


@pytest.fixture
def on_rail(tmp_path):
    """An arm on a rail along y, 0.9 m each way."""
    body = _link("base", (0.1, 0.1, 0.04), 0.02) + _joint(
        *("rail", "prismatic", "base", "car", 'xyz="0 0 0.08"', "y", (-0.9, 0.9))
    )
    body += _link("car", (0.14, 0.14, 0.05), 0.03) + _arm("car", 'xyz="0 0 0.08"')
    return _scene(tmp_path, body, {"right": ("grip", _hand())}, _BENT)


def _movers(scene):
    giver = limb_of(scene.giver.agent, "right")
    other = limb_of(scene.receiver.agent, "right")
    return (
        Mover(scene, scene.giver, giver, scene.receiver, other),
        Mover(scene, scene.receiver, other, scene.giver, giver),
    )


def test_an_arm_on_a_rail_meets_who_stands_at_its_end(on_rail):
    text = on_rail.read_text()
    on_rail.write_text(text.replace("[1.1, 0.0, 0.0]", "[1.1, 1.3, 0.0]"))
    pair = Pair(*_movers(handover.load_scene(on_rail)), None, None)
    ours, theirs = shoulders(pair)
    assert ours[1] == pytest.approx(0.9) and theirs[1] > 1.3
    assert len(common_voxels(pair, 0.25)) > 10


def test_an_arm_on_a_rail_keeps_clear_of_what_stands_at_its_end(on_rail):
    scene = handover.load_scene(on_rail)
    limb = limb_of(scene.giver.agent, "right")
    draws = np.random.default_rng(0).uniform(limb.lower, limb.upper, (400, limb.dof))
    draws[:, 0] = 0.9
    ends = [
        scene.giver.link_pose("link_3", dict(zip(limb.joints, q.tolist(), strict=True)))
        for q in draws
    ]
    far = np.argsort([-T[1, 3] for T in ends])[:5]
    assert all(ends[k][1, 3] > 1.5 for k in far)  # from the rail's middle, it is not
    for k in far:  # a block about the forearm
        block = handover.Fixture("block", Box((0.04, 0.04, 0.04), ends[k]))
        there = replace(scene, scenery=(block,))
        mover, _ = _movers(there)
        assert "would touch block" in mover.why(draws[k])[1]


def test_bars_of_a_gripper_that_meet_where_it_is_open_are_joined(tmp_path):
    """A linkage closes a loop, which a URDF cannot say: its bars overlap."""
    bar = _link("bar", (0.02, 0.05, 0.02), 0.02) + _joint(
        *("swing", "revolute", "grip", "bar", 'xyz="0 0.04 0.04"', "y", (-1.0, 1.0)),
        more='<mimic joint="jaw_a" multiplier="0.5"/>',
    )
    body, hands = _BASE + _arm("base", 'xyz="0 0 0.12"'), {"right": ("grip", _hand())}
    scene = handover.load_scene(_scene(tmp_path, body + bar, hands, _BENT))
    joints = {**scene.giver.joints, "jaw_a": 0.005}  # both pads, which meet only shut
    shut = replace(scene, giver=replace(scene.giver, joints=joints))
    meeting = [pair for distance, *pair in start_distances(shut) if distance <= 0.0]
    assert meeting == [["own/jaw_a_pad", "own/jaw_b_pad"]]


def test_a_pad_that_slides_far_out_on_a_turning_bar_is_moved_by_all_of_it(tmp_path):
    """Fingers close by steps that no point of them may exceed."""
    bar = _link("bar", (0.02, 0.02, 0.02)) + _link("pad", (0.02, 0.02, 0.02))
    bar += _joint("swing", "revolute", "grip", "bar", 'xyz="0 0 0.1"', "y", (-1, 1))
    bar += _joint("out", "prismatic", "bar", "pad", 'xyz="0 0 0.03"', "z", (0, 0.5))
    hand = (
        '{root = "grip", palm = "grip", fingers = [["swing", "out"], ["jaw_a"]], '
        "closed = {swing = 1.0, out = 0.5, jaw_a = 0.006}, "
        "preshapes = [{swing = 0.0, out = 0.3, jaw_a = 0.05}]}"
    )
    body, hands = (
        _BASE + _arm("base", 'xyz="0 0 0.12"') + bar,
        {"right": ("grip", hand)},
    )
    scene = handover.load_scene(_scene(tmp_path, body, hands, _BENT))
    made = make_hand(scene.giver.agent.arms["right"].spec)
    swing, out = (made.joints.index(name) for name in ("swing", "out"))
    values = made.preshapes[0].copy()
    values[out] = 0.5
    pad = made.links.index("pad")
    at = made.state(np.eye(4), values).links[pad, 9:].copy()
    values[swing] += 1e-4
    way = np.linalg.norm(made.state(np.eye(4), values).links[pad, 9:] - at) / 1e-4
    assert 0.5 < way < made.arrays.lever[swing] < way + 0.1


def _two_arms(more=""):
    """Return two arms on one lift."""
    body = _link("base", (0.1, 0.1, 0.04), 0.02) + _joint(
        *("lift", "prismatic", "base", "column", 'xyz="0 0 0.05"', "z", (0.0, 0.5))
    )
    body += _link("column", (0.1, 0.1, 0.4), 0.22)
    for side, turn in (("left_", -1.5708), ("right_", 1.5708)):
        y = 0.1 if side == "left_" else -0.1
        body += _arm("column", f'xyz="0 {y} 0.4" rpy="{turn} 0 0"', side)
    return body + more


def test_a_lift_that_carries_both_arms_stays_where_it_waits(tmp_path):
    hands = {side: (f"{side}_grip", _hand(f"{side}_")) for side in ("left", "right")}
    scene = handover.load_scene(_scene(tmp_path, _two_arms(), hands, {"lift": 0.2}))
    for side in ("left", "right"):
        limb = limb_of(scene.giver.agent, side)
        arm = [f"{side}_j{k}" for k in range(6)]
        assert list(limb.joints) == [*arm, f"{side}_jaw_a"]


def test_a_camera_that_turns_on_the_wrist_is_told(tmp_path):
    turn = _joint("pan", "revolute", "link_4", "camera", 'xyz="0 0.1 0"')
    body = _BASE + _arm("base", 'xyz="0 0 0.12"') + _link("camera") + turn
    path = _scene(tmp_path, body, {"right": ("grip", _hand())}, _BENT)
    scene = handover.load_scene(path)
    with pytest.raises(BadInput, match="make 'pan' fixed in the URDF"):
        limb_of(scene.giver.agent, "right")


def test_a_plan_names_its_urdf_wherever_its_scene_was_read_from(own, monkeypatch):
    named = []
    for folder, path in ((own.parent, own.name), (own.parents[1], own)):
        monkeypatch.chdir(folder)
        scene = handover.load_scene(path)
        named.append(plan_record(scene, [], [_rests(scene)])["giver"]["urdf"])
    assert named == [str(own.with_name("own.urdf"))] * 2


def _rests(scene):
    return Hold("world", "", scene.T_world_start, 0.0)


# --- what a scene's file says of a hand and is refused ------------------------------


def _told(own, before, after):
    """Return what is said of a scene's file with one of its entries changed."""
    text = own.read_text()
    assert before in text
    own.write_text(text.replace(before, after, 1))
    with pytest.raises(PlanningError) as refused:
        handover.load_scene(own)
    return str(refused.value)


_SHUT, _OPEN = "closed = {jaw_a = 0.006}", "preshapes = [{jaw_a = 0.05}]"


@each(
    ("before", "after", "told"),
    [
        ('tip = "grip"', 'tip = "gripp"', "tip .* is 'gripp'.* did you mean 'grip'"),
        (
            'root = "grip"',
            'root = "x"',
            "root of the right arm .* is 'x', but own",
        ),
        (
            'palm = "grip"',
            'palm = "x"',
            "palm of the right arm .* is 'x', but own",
        ),
        (
            'palm = "grip"',
            'palm = "link_4"',
            "'j5' moves the palm 'link_4' and",
        ),
        (
            'palm = "grip"',
            'palm = "jaw_a_pad"',
            "'jaw_a' moves the palm .* apart",
        ),
        ("[0, 0, 0.048]", "[0, 0, 48]", "palm_position .* farther than 1 m .* metres"),
        ('[["jaw_a"]]', "[]", r"has fingers \[\]; give each finger .* of jaw_a"),
        (
            '[["jaw_a"]]',
            "[[]]",
            r"has fingers \[\[\]\]; give each finger",
        ),
        ('[["jaw_a"]]', '[["jaw_a"], ["jaw_a"]]', "give each finger joints of its own"),
        ('[["jaw_a"]]', '[["j5"]]', "fingers has 'j5', which moves none"),
        ('[["jaw_a"]]', '[["jaw_b"]]', "fingers has 'jaw_b', which moves none"),
        (_SHUT, "closed = {}", "closed lacks 'jaw_a'; say where it closes to"),
        (_SHUT, "closed = {jaw = 0.0}", "closed has 'jaw'.*did you mean 'jaw_a'"),
        (
            _SHUT,
            "closed = {jaw_a = 6}",
            "jaw_a at 6, outside its limits 0 to 0.05",
        ),
        (_OPEN, "preshapes = []", "has no preshapes; give how it stands open"),
        (
            _OPEN,
            "preshapes = [{jaw_a = 0.06}]",
            "preshape 0 has jaw_a at 0.06",
        ),
        (_OPEN, "preshapes = [{j5 = 0.0}]", "preshape 0 has 'j5', which moves none of"),
        (
            _OPEN,
            _OPEN + ', name = "../sets"',
            "the name '../sets'; give letters",
        ),
        (
            _OPEN,
            _OPEN + ', name = "panda"',
            "'panda', which is a known hand's",
        ),
        (_OPEN, _OPEN + ", name = 7", "the name 7; give letters"),
        ('name = "box"', 'file = "a.stl"\nscale = -1', "scale of .object. is -1; give"),
        ('name = "box"', 'file = "a.stl"\nscale = "1"', "scale of .object. is '1'"),
        ('name = "box"', 'file = "a.stl"\nmass_kg = "1"', "mass_kg of .object. is '1'"),
        ('name = "box"', 'file = "a.stl"\nmass_kg = true', "mass_kg .* is True; give"),
        (
            'use = ["right"]',
            "use = []",
            r"use of .receiver. is \[\]; write a",
        ),
        (
            'use = ["right"]',
            'use = ["left", "left"]',
            "a list of arms, each once",
        ),
        (
            "[giver]",
            'name = ["tea"]\n[giver]',
            "scene's name is .'tea'.; give",
        ),
        (
            "[giver]",
            'name = "a\\nb"\n[giver]',
            "scene's name is 'a.nb'; give",
        ),
    ],
)
def test_what_a_hand_cannot_be_is_told(tmp_path, before, after, told):
    body = _BASE + _arm("base", 'xyz="0 0 0.12"')
    own = _scene(tmp_path, body, {"right": ("grip", _hand())}, _BENT)
    assert re.search(told, _told(own, before, after))


def test_a_palm_may_be_a_link_before_the_hand(own):
    """What a maker calls its flange is often not of the hand, but fixed to it."""
    hand = handover.load_scene(own).giver.agent.arms["right"].spec
    at = np.array([0.0, 0.0, 0.02])  # of the hand, on the last link of the arm
    T = hand.T_link_palm.copy()
    T[:3, 3] += at
    same = make_hand(replace(hand, palm="link_5", T_link_palm=T))
    assert same.fingerprint() == make_hand(hand).fingerprint()


def test_a_joint_beyond_its_limit_by_a_rounding_is_put_on_it(own):
    text = own.read_text()
    own.write_text(text.replace("jaw_a = 0.05\n", "jaw_a = 0.0504\nj5 = 2.9005\n", 1))
    joints = handover.load_scene(own).giver.joints
    assert joints["jaw_a"] == 0.05 and joints["j5"] == 2.9


def test_a_follower_that_ends_sooner_ends_the_joint_that_it_follows(own):
    urdf = own.with_name("own.urdf")
    head, jaw, rest = urdf.read_text().partition('<joint name="jaw_b"')
    urdf.write_text(head + jaw + rest.replace('upper="0.05"', 'upper="0.04"', 1))
    own.write_text(own.read_text().replace("[{jaw_a = 0.05}]", "[{jaw_a = 0.04}]"))
    with pytest.raises(BadInput, match="jaw_a at 0.05, outside its limits 0 to 0.04"):
        handover.load_scene(own)
