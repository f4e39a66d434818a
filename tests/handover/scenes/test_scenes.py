"""Scenes: seeds, ranges of the paper, starts, files, and what is refused."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from person_agent import arm_joint, person_urdf
from rows import each

import handover
from handover.grasps.hand import make_hand
from handover.human.anthropometry import ARM_JOINTS, ARM_RANGES
from handover.scenes.agent_body import agent_body, upright
from handover.scenes.paper import PAPER_SCENES, butler, kneeling, stool
from handover.scenes.scene import Scene
from handover.scenes.start_check import check_start, start_distances
from roadmap import load_robot
from roadmap.errors import BadInput, PlanningError
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.known import own_file

TEA = """
[giver]
agent = "crichton"
[receiver]
agent = "drchubo"
posture = "standing"
position = [0.9, 0.0, 0.001]
rpy = [0.0, 0.0, 3.14159]
use = ["left"]
[object]
name = "cup"
[start]
position = [0.5, 0.0, 0.751]
[goal]
position = [0.6, 0.0, 1.0]
held = true
"""
BOARD = """
[[scenery]]
type = "box"
size = [0.3, 1.0, 0.03]
position = [0.5, 0.0, 0.7349]
"""


def written(folder, text):
    path = folder / "tea.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", sorted(PAPER_SCENES))
def test_same_seed_same_scene_and_a_free_start(name):
    first, again, other = (handover.load_scene(name, s) for s in (3, 3, 4))
    for a in ("T_world_start", "T_world_goal"):
        assert (getattr(first, a) == getattr(again, a)).all()
    assert dict(first.receiver.joints) == dict(again.receiver.joints)
    assert (first.T_world_goal != other.T_world_goal).any()
    assert start_distances(first)[0][0] > 0.0


def test_draws_stay_within_the_papers_ranges():
    scenes = [butler(seed) for seed in range(25)]
    x, y = np.array([s.receiver.T_world_base[:2, 3] for s in scenes]).T
    yaw = [np.arctan2(*s.receiver.T_world_base[1::-1, 0]) for s in scenes]
    off = (np.array(yaw) - np.arctan2(-y, -x) + np.pi) % (2 * np.pi) - np.pi
    heights = np.array([s.T_world_goal[2, 3] for s in scenes])
    assert np.ptp(x) < 1e-12 and 1.0 < np.ptp(y) <= 1.6
    assert 15.0 < np.degrees(np.ptp(off)) <= 30.0
    assert 0.03 < np.ptp(heights) <= 0.06
    steps = {round(stool(s).receiver.T_world_base[2, 3] - 0.798, 6) for s in range(12)}
    assert steps == {0.2, 0.4, 0.6}
    goals = np.array([kneeling(s).T_world_goal for s in range(12)])
    middle = (0.9, 0.1, 0.25)
    assert np.linalg.norm(goals[:, :3, 3] - middle, axis=1).max() <= 0.03 + 1e-12
    roll = np.degrees(np.arctan2(goals[:, 2, 1], goals[:, 2, 2]))
    assert 15.0 < np.ptp(roll) and 10.0 <= roll.min() and roll.max() <= 50.0


def test_the_tray_is_where_the_right_hand_holds_it_and_the_cup_goes_on_it():
    scene = butler(11)
    tray = next(f.shape for f in scene.scenery if f.name == "tray")
    up = scene.T_world_goal[2, 3] - tray.T_base_shape[2, 3] - 0.5 * tray.length
    assert 0.0 < up < 0.002
    near = {
        one.split("/")[1]: d
        for d, one, other in start_distances(scene)
        if other == "tray"
    }
    fingers = [d for link, d in near.items() if "right_finger" in link]
    assert len(fingers) == 8 and min(fingers) > 0.0 and max(fingers) < 0.02
    assert scene.T_world_start[2, 2] == pytest.approx(-1.0)  # upside down
    assert scene.receiver.arms == ("left",)


def test_the_body_agrees_with_the_robot_that_plans():
    robot = load_robot("plain_arm", cover_excess=0.2)
    q = np.clip(np.linspace(0.2, -0.5, robot.dof), robot.lower, robot.upper)
    body = agent_body("plain_arm")
    joints = body.checked(dict(zip(robot.joint_names, q, strict=True)), "arm")
    assert body.frames(joints)[robot.tip_name] == pytest.approx(
        tool_pose(robot, q), abs=1e-9
    )


def test_the_person_is_a_human_with_fingers():
    assert own_file("person.urdf").read_text() == person_urdf()
    body = agent_body("person_left")
    human = handover.Human(1.75, T_world_pelvis=np.eye(4))
    rng = np.random.default_rng(0)
    for side in ("left", "right"):
        q = rng.uniform(*ARM_RANGES.T)
        names = [arm_joint(side, name) for name in ARM_JOINTS]
        frames = body.frames(body.checked(dict(zip(names, q, strict=True)), "person"))
        T = human.with_arm(side, q).T_world_hand(side)
        hand, palm = frames[f"{side}_hand"], frames[f"{side}_palm"]
        wrist = T[:3, 3] - human.skeleton.arms[0, 2] * T[:3, 2]
        assert hand[:3, 3] == pytest.approx(wrist, abs=1e-6)
        assert palm[:3, 2] == pytest.approx(T[:3, 0], abs=1e-6)
        assert palm[:3, 0] == pytest.approx(T[:3, 2], abs=1e-6)


@pytest.mark.parametrize("posture", ["standing", "sitting", "kneeling"])
def test_a_person_waits_without_touching_anything(posture):
    placed = handover.stand(handover.load_agent("person"), upright(1.2, 0, 0), posture)
    scene = butler(0)
    scene = Scene(
        "x", 0, scene.giver, placed, scene.obj, scene.T_world_start, scene.T_world_goal,
        tuple(f for f in scene.scenery if f.name == "floor"),
    )  # fmt: skip
    check_start(scene)


def test_a_scene_of_ones_own(tmp_path):
    scene = handover.load_scene(written(tmp_path, TEA + BOARD))
    assert scene.name == "tea" and scene.goal_held
    assert scene.receiver.arms == ("left",)
    assert [f.name for f in scene.scenery] == ["box 0"]


SHELF = """shelf
* shelf
2
box
0.1 0.1 0.1
1.0 2.0 0.5
0 0 0 1
0 0 0 0
sphere
0.2
1.0 2.0 0.9
0 0 0 1
0 0 0 0
.
"""


def test_scenery_of_a_scene_may_come_from_a_file(tmp_path):
    (tmp_path / "shelf.scene").write_text(SHELF)
    table = '[[scenery]]\ntype = "file"\nfile = "shelf.scene"\n'
    scene = handover.load_scene(written(tmp_path, TEA + table + "position = [0, 0, 1]"))
    assert [f.name for f in scene.scenery] == ["shelf", "shelf 2"]
    heights = [f.shape.T_base_shape[2, 3] for f in scene.scenery]
    assert heights == pytest.approx([1.5, 1.9])


def test_the_start_is_tested_against_each_piece_of_one_name(tmp_path):
    board = BOARD + 'name = "board"\n'
    far = board.replace("0.7349", "5.0")
    deep = TEA.replace("0.751", "0.740") + board + far
    with pytest.raises(BadInput, match="cup meets board"):
        handover.load_scene(written(tmp_path, deep))


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ('type = "box"', "tea.toml: scenery 0: size is None"),
        ('type = "box"\nsize = [1, 1, 1]\nrpy = [90, 0, 0]', "looks like degrees"),
        ('type = "plane"', "choose one of box, mesh"),
        ('type = "mesh"\nfile = "no.stl"', "there is no mesh"),
        ('type = "sphere"\nradius = 1\ncovering_radius = 0.01', "has no key"),
    ],
)
def test_scenery_that_is_wrong_says_where(tmp_path, table, told):
    with pytest.raises(BadInput, match=told):
        handover.load_scene(written(tmp_path, f"{TEA}[[scenery]]\n{table}\n"))


@each(
    ("old", "new", "told"),
    [
        ("[goal]\nposition = [0.6, 0.0, 1.0]\nheld = true", "", r"no part \[goal\]"),
        ("[start]\nposition = [0.5, 0.0, 0.751]", "[start]", "start.* has no position"),
        ('agent = "crichton"', "", "needs either agent or urdf"),
        ('agent = "crichton"', 'agent = "crichtom"', "did you mean 'crichton'"),
        ('name = "cup"', 'name = "cupp"', "no object 'cupp'"),
        ('posture = "standing"', 'posture = "flying"', "no posture 'flying'"),
        ('posture = "standing"', "posture = [1]", r"no posture \[1\]"),
        ('use = ["left"]', 'use = ["third"]', "third"),
        ("held = true", "hold = true", "no key 'hold'"),
        ('use = ["left"]', 'use = "left"', "is 'left'; write a list of arms"),
        ("3.14159]", "180]", r"rpy of .receiver. .*looks like degrees, give radians"),
        ("0.751]", "0.751]\nrpy = [0, 90.0, 0]", r"rpy of .start. .*degrees"),
        ("0.751]", '"high"]', "three metres"),
        ('agent = "crichton"', 'urdf = "no.urdf"', "a urdf and no arm"),
        ("[giver]", "[giver]\njoints = {elbow = 1.0}", "no joint 'elbow'"),
        (
            "[giver]",
            "[giver]\njoints = {left_arm_2_joint = 90.0}",
            "outside its limits",
        ),
    ],
)
def test_a_file_that_is_wrong_says_where(tmp_path, old, new, told):
    assert old in TEA
    with pytest.raises(PlanningError, match=told):
        handover.load_scene(written(tmp_path, TEA.replace(old, new, 1)))


def test_a_start_in_collision_is_refused(tmp_path):
    deep = TEA.replace("0.751", "0.740") + BOARD
    with pytest.raises(BadInput, match="cup meets box 0"):
        handover.load_scene(written(tmp_path, deep))


def test_all_that_can_meet_at_the_start_is_tested():
    scene = stool(0)
    giver, receiver = scene.giver, scene.receiver

    def meeting(**changed):
        rows = start_distances(replace(scene, **changed))
        return {(one, other) for distance, one, other in rows if distance <= 0.0}

    assert not meeting()
    for who in ("giver", "receiver"):
        placed = getattr(scene, who)
        link, shape = placed.shapes()[-1]
        pair = f"{placed.agent.name}/{link}", scene.obj.name
        assert pair in meeting(T_world_start=shape.T_base_shape)
        low = np.array(placed.T_world_base)
        low[2, 3] -= 0.1
        sunk = meeting(**{who: replace(placed, T_world_base=low)})
        names = {(a.split("/")[0], b) for a, b in sunk}
        stands_on = {"giver": "floor", "receiver": "step 3"}[who]
        assert (placed.agent.name, stands_on) in names
    there = replace(receiver, T_world_base=giver.T_world_base)
    names = {(a.split("/")[0], b.split("/")[0]) for a, b in meeting(receiver=there)}
    assert ("crichton", "drchubo") in names


def test_all_pieces_of_one_name_are_tested_at_the_start(tmp_path):
    named = BOARD + 'name = "board"\n'
    far = named.replace("position = [", "position = [9.0, 9.0, 9.0]  # [")
    for pieces in (named + far, far + named):
        with pytest.raises(BadInput, match="cup meets board"):
            handover.load_scene(
                written(tmp_path, TEA.replace("0.751", "0.740") + pieces)
            )


def test_unknown_scenes_and_hands_are_listed(tmp_path):
    with pytest.raises(BadInput, match="did you mean 'butler'"):
        handover.load_scene("butlr")
    with pytest.raises(BadInput, match="butler, kneeling"):
        handover.load_scene("nothing")
    with pytest.raises(BadInput, match="no scene file"):
        handover.load_scene(tmp_path / "no.toml")
    with pytest.raises(BadInput, match="seed"):
        handover.load_scene("butler", -1)


@pytest.mark.parametrize(
    ("make", "scale", "told"),
    [
        ("whole", 200.0, "20 m long"),
        ("open", 1.0, "closed|open|hole"),
        ("empty", 1.0, "faces|empty|read"),
    ],
)
def test_meshes_that_are_no_objects(tmp_path, make, scale, told):
    import trimesh

    mesh = trimesh.creation.box((0.06, 0.06, 0.1))
    if make == "open":
        mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    file = tmp_path / "thing.stl"
    if make == "empty":
        file.write_bytes(b"solid x\nendsolid x\n")
    else:
        mesh.export(file)
    text = TEA.replace('name = "cup"', f'file = "thing.stl"\nscale = {scale}')
    with pytest.raises(PlanningError, match=told):
        handover.load_scene(written(tmp_path, text))


def test_scenes_of_our_own_have_every_pair_of_agents():
    scenes = [handover.load_scene("varied", seed) for seed in (0, 1, 3, 4)]
    pairs = {(s.giver.agent.name, s.receiver.agent.name) for s in scenes}
    givers, receivers = ("crichton", "panda"), ("drchubo", "person")
    assert pairs == {(g, r) for g in givers for r in receivers}


def test_a_joint_of_a_similar_name_is_meant(tmp_path):
    text = TEA.replace('agent = "drchubo"\nposture = "standing"', 'agent = "person"')
    text += "[receiver.joints]\nright_elbow = 0.3\n"
    with pytest.raises(BadInput, match="did you mean right_elbow_flexion"):
        handover.load_scene(written(tmp_path, text))


OWN_HAND = """urdf = "ARM"
[giver.arms.right]
tip = "tool"
hand = {root = "hand", palm = "tool", fingers = [["grip"]], closed = {}, preshapes = []}
"""


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ('[["grip"]]', '[["gripp"]]', "no joint 'gripp'.*did you mean 'grip'. Give"),
        ('[["grip"]]', '[["x"]]', "no joint 'x'.*give joints of it: turn, bend"),
        ('[["grip"]]', '["grip"]', r"fingers of .*'grip'\]; give a list such as"),
        ('[["grip"]]', "3", "fingers of the hand of the right arm of .giver. is 3"),
        ("preshapes = []", "preshapes = 3", "preshapes of .* is 3; give a list such"),
    ],
)
def test_slips_in_a_hand_of_ones_own_are_told(tmp_path, before, after, told):
    arm = Path(__file__).resolve().parents[2] / "data" / "arm3.urdf"
    own = OWN_HAND.replace("ARM", str(arm)).replace(before, after)
    text = TEA.replace('agent = "crichton"', own)
    with pytest.raises(BadInput, match=told):
        handover.load_scene(written(tmp_path, text))


def test_a_hand_that_the_urdf_lacks_is_told_by_its_name(tmp_path):
    arm = Path(__file__).resolve().parents[2] / "data" / "arm3.urdf"
    own = f'urdf = "{arm}"\n[giver.arms.right]\ntip = "tool"\nhand = "panda"'
    text = TEA.replace('agent = "crichton"', own)
    told = "right arm of .giver. has the hand 'panda', but arm3.urdf has no joint"
    with pytest.raises(BadInput, match=told):
        handover.load_scene(written(tmp_path, text))


def _link(name, size="", at="0 0 0"):
    shape = f'<origin xyz="{at}"/><geometry><box size="{size}"/></geometry>'
    solid = f"<collision>{shape}</collision>" if size else ""
    return f'<link name="{name}">{solid}</link>'


def _joint(name, kind, parent, child, at, more=""):
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


def _jaw(axis, more=""):
    limit = '<limit lower="0" upper="0.025" velocity="0.1" effort="9"/>'
    return f'<axis xyz="0 {axis} 0"/>{limit}{more}'


GRIPPER = [
    _link("base", "0.1 0.1 0.1", "0 0 0.05"),
    _link("gripper", "0.07 0.1 0.1", "0 0 0.05"),
    _link("jaw_a", "0.02 0.01 0.04", "0 0.005 0.02"),
    _link("jaw_b", "0.02 0.01 0.04", "0 -0.005 0.02"),
    _link("tool0"),
    _joint(
        "turn",
        "revolute",
        "base",
        "gripper",
        "0 0 0.2",
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="9"/>',
    ),
    _joint("jaw_a_joint", "prismatic", "gripper", "jaw_a", "0 0 0.1", _jaw(1)),
    _joint(
        "jaw_b_joint",
        "prismatic",
        "gripper",
        "jaw_b",
        "0 0 0.1",
        _jaw(-1, '<mimic joint="jaw_a_joint"/>'),
    ),
    _joint("tool", "fixed", "gripper", "tool0", "0 0 0.12"),
]


def test_the_robot_of_ones_own_of_the_docs_holds_a_hammer(tmp_path):
    page = Path(__file__).resolve().parents[3] / "docs" / "plans.md"
    blocks = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    giver = next(block for block in blocks if "jaw_a_joint" in block)
    urdf = f'<robot name="mine">{"".join(GRIPPER)}</robot>'
    (tmp_path / "mine.urdf").write_text(urdf)
    text = TEA.replace('[giver]\nagent = "crichton"\n', giver).replace("0.5, ", "0.7, ")
    scene = handover.load_scene(written(tmp_path, text))
    hand = make_hand(scene.giver.agent.arms["right"].spec)
    few = handover.GraspSettings(samples=12, rolls=4)
    grasps = handover.build_grasps(handover.load_object("hammer"), hand, few)
    assert len(grasps) > 0 and hand.links == ("gripper", "jaw_a", "jaw_b", "tool0")
    # both jaws hold: the second one follows the first
    assert {"jaw_a", "jaw_b"} <= {hand.links[k] for k in np.unique(grasps.contact_link)}
