"""Fingers travel by default: their cover holds them wherever they are, or a note."""

import numpy as np
import pytest
from nearest import out_of_spheres
from scipy.spatial import ConvexHull
from urdf_parts import COARSE

from roadmap import load_robot
from roadmap.errors import BadRobot
from roadmap.geometry.self_collision import always_touching_pairs, crowded_pairs
from roadmap.geometry.spheres import robot_solids
from roadmap.loading.body_tree import build_tree
from roadmap.robot.description import read_description
from roadmap.robot.robot import BOX, CYLINDER, HULL

ROD = '<geometry><cylinder radius="0.01" length="0.08"/></geometry>'
BAR = '<origin xyz="{0} 0 0.002"/><geometry><box size="{1} 0.016 0.012"/></geometry>'


def link(name: str, length: float = 0.05, shape: str = "") -> str:
    shape = shape or BAR.format(0.5 * length, length)
    return f'<link name="{name}"><collision>{shape}</collision></link>'


def joint(name, kind, parent, child, xyz, axis="0 0 1", limits=None, mimic="") -> str:
    low, high = (0, 0) if limits is None else limits
    limit = f'<limit lower="{low}" upper="{high}" velocity="1" effort="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f"{'' if limits is None else limit}{mimic}</joint>"
    )


ARM = (
    link("base", 0.1)
    + link("arm", 0.2)
    + link("palm", 0.06)
    + '<link name="tool"/>'
    + joint("lift", "prismatic", "base", "arm", "0 0 0.1", limits=(0, 0.3))
    + joint("swing", "revolute", "arm", "palm", "0.25 0 0", limits=(-1, 1))
    + joint("end", "fixed", "palm", "tool", "0.1 0 0")
)
HAND = (
    link("proximal")
    + link("distal", 0.04)
    + link("thumb", 0.0, ROD)
    + link("slider", 0.03)
    + link("wheel", 0.0, '<geometry><sphere radius="0.012"/></geometry>')
    + joint("near", "revolute", "palm", "proximal", "0.06 0.03 0", limits=(0, 1.2))
    + joint(
        "far", "revolute", "proximal", "distal", "0.05 0 0", "0.3 0 1", (-0.2, 1.4)
    )
    + joint(
        "opposed", "revolute", "palm", "thumb", "0.05 -0.03 0", "0 1 1", (-1, 1),
        '<mimic joint="near" multiplier="-0.7" offset="0.1"/>',
    )
    + joint("slide", "prismatic", "palm", "slider", "0.06 0 0", "0 1 0", (-0.01, 0.03))
    + joint("roll", "revolute", "slider", "wheel", "0.02 0 0.01", limits=(-0.6, 0.6))
)  # fmt: skip
OTHERS = (
    link("flag")
    + link("endless")
    + link("mast")
    + joint("wave", "revolute", "base", "flag", "0 0.3 0", limits=(-1, 1))
    + joint("spin", "continuous", "palm", "endless", "0 0 0.05", "1 0 0")
    + joint("hoist", "prismatic", "palm", "mast", "0 0 0.1", limits=(0, 0.8))
)


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    """Return the path of an arm with a hand of every kind of finger."""
    return written(tmp_path_factory, ARM + HAND + OTHERS)


def written(factory, body: str):
    path = factory.mktemp("hand") / "hand.urdf"
    path.write_text(f'<robot name="hand">{body}</robot>')
    return path


def travelling(robot) -> list[str]:
    start = "held over the whole travel of "
    notes = [n.removeprefix(start) for n in robot.notes if n.startswith(start)]
    return notes[0].split(", ") if notes else []


def fingers_at(description, still, names, values, rng):
    """Return points of each travelling link at values of the joints, body frame.

    They are found by the robot's own tree, with the joints locked there.
    """
    tip, home = still.tip_name, locked_of(still)
    then = build_tree(description, tip, home)
    now = build_tree(
        description, tip, {**home, **dict(zip(names, values, strict=True))}
    )
    points = {}
    for solid in robot_solids(still):
        name = still.link_names[solid.link]
        corners = extremes_of(solid, rng)
        mix = rng.dirichlet(np.full(len(corners), 0.2), 60) @ corners
        own = np.vstack([corners, mix])
        T = now.T_body_link[name] @ np.linalg.inv(then.T_body_link[name])
        points.setdefault(name, []).append(own @ T[:3, :3].T + T[:3, 3])
    return {name: np.vstack(rows) for name, rows in points.items()}


def locked_of(still) -> dict[str, float]:
    """Return the values of the joints that a robot's note calls locked."""
    start = "locked joints: "
    (note,) = [n.removeprefix(start) for n in still.notes if n.startswith(start)]
    rows = [row.split(" = ") for row in note.split(", ")]
    return {name: float(value.split()[0]) for name, value in rows}


def extremes_of(solid, rng):
    """Return points on the surface of a solid, all corners with it, body frame."""
    if solid.kind == HULL:
        return solid.body_points()
    if solid.kind == BOX:
        points = rng.choice([-0.5, 0.5], (100, 3)) * solid.size
    elif solid.kind == CYLINDER:
        angle, radius = rng.uniform(0, 2 * np.pi, 200), solid.size[0]
        side = rng.choice([-0.5, 0.5], 200) * solid.size[1]
        points = np.c_[radius * np.cos(angle), radius * np.sin(angle), side]
    else:
        points = rng.normal(size=(200, 3))
        points *= solid.size[0] / np.linalg.norm(points, axis=1)[:, None]
    T = solid.T_body_solid
    return points @ T[:3, :3].T + T[:3, 3]


def assert_held(path, robot, still, rng, tries=25) -> float:
    """Hold the law; return how far the fingers move out of those that stand still."""
    description, names = read_description(path), travelling(robot)
    limits = [(description.joints[n].lower, description.joints[n].upper) for n in names]
    low, high = np.array(limits).T
    moved, hulls = 0.0, {}
    for k in range(tries):
        u = rng.random(len(names)) if k > 3 else rng.integers(0, 2, len(names))
        values = low + u * (high - low)
        points = fingers_at(description, still, names, values, rng)
        for name, rows in points.items():
            own = robot.spheres[robot.sphere_link == robot.link_names.index(name)]
            assert out_of_spheres(rows, own).max() <= 1e-9, name
            if name not in hulls:
                hulls[name] = hulls_of(robot, name)
            assert out_of_hulls(hulls[name], rows) <= 1e-9, name
            own = still.spheres[still.sphere_link == still.link_names.index(name)]
            moved = max(moved, out_of_spheres(rows, own).max())
    return moved


def hulls_of(robot, name) -> list[np.ndarray]:
    """Return the planes of a link's hulls; none where a solid of it stands still."""
    own = [s for s in robot_solids(robot) if robot.link_names[s.link] == name]
    if any(s.kind != HULL for s in own):
        return []
    return [ConvexHull(s.body_points()).equations for s in own]


def out_of_hulls(hulls, points) -> float:
    out = [(e[:, :3] @ points.T + e[:, 3:]).max(axis=0) for e in hulls]
    return np.min(out, axis=0).max() if out else 0.0


def test_a_hand_is_held_wherever_its_fingers_are(hand, rng):
    robot = load_robot(hand, tip="tool", cover_excess=0.02)
    assert travelling(robot) == ["near", "far", "slide", "roll"]
    still = load_robot(hand, tip="tool", cover_excess=0.02, travel=())
    assert assert_held(hand, robot, still, rng) > 0.03


@pytest.mark.parametrize("file", ["panda", "xarm6_with_gripper"])
def test_grippers_of_pybullet_are_held(file, pybullet_file, rng):
    """Two fingers on slides; two of three links each, all of which mimic one joint."""
    folder = {"panda": "franka_panda", "xarm6_with_gripper": "xarm"}[file]
    path = pybullet_file(f"{folder}/{file}.urdf")
    tip = {"panda": "panda_grasptarget", "xarm6_with_gripper": "link6"}[file]
    robot = load_robot(path, tip=tip, cover_excess=0.02)
    assert len(travelling(robot)) == 1
    still = load_robot(path, tip=tip, cover_excess=0.02, travel=())
    assert assert_held(path, robot, still, rng, tries=12) > 0.015


def test_a_gripper_of_example_robot_data_is_held(example_file, rng):
    path = example_file("talos_data/robots/talos_left_arm.urdf")
    names = {"tip": "gripper_left_base_link", "cover_excess": 0.03}
    robot, still = load_robot(path, **names), load_robot(path, **names, travel=())
    assert travelling(robot) == ["gripper_left_joint"]
    assert assert_held(path, robot, still, rng, tries=8) > 0.01


@pytest.mark.parametrize("seed", range(5))
def test_random_fingers_of_several_joints_are_held(seed, tmp_path_factory):
    rng = np.random.default_rng(seed)
    body, parent = ARM, "palm"
    for k in range(2 + seed % 3):
        low = rng.uniform(-1.0, 0.0)
        slides = k not in (0, 2) and rng.random() < 0.4
        limits = np.array([low, low + rng.uniform(0.3, 1.5)]) * (0.03 if slides else 1)
        xyz = " ".join(f"{v:.4f}" for v in rng.uniform([0.03, -0.02, -0.02], 0.05))
        axis = " ".join(f"{v:.4f}" for v in rng.normal(size=3))
        mimic = ""
        if k == 2:  # with an own factor, and an offset
            mimic = '<mimic joint="j0" multiplier="-0.6" offset="0.2"/>'
        kind = "prismatic" if slides else "revolute"
        body += link(f"l{k}", rng.uniform(0.02, 0.05))
        body += joint(f"j{k}", kind, parent, f"l{k}", xyz, axis, limits, mimic)
        parent = f"l{k}"
    path = written(tmp_path_factory, body)
    names = {"tip": "tool", "cover_excess": 0.03}
    robot, still = load_robot(path, **names), load_robot(path, **names, travel=())
    assert len(travelling(robot)) == [2, 2, 3][seed % 3]
    assert_held(path, robot, still, rng)


def test_what_is_locked_stands_and_the_rest_travels(hand):
    locked = {"near": 0.4, "roll": 0.1}
    robot = load_robot(hand, tip="tool", locked=locked, **COARSE)
    assert travelling(robot) == ["far", "slide"]
    still = load_robot(hand, tip="tool", locked=locked, travel=(), **COARSE)
    for name in ("proximal", "thumb"):  # the thumb follows a locked joint
        for a, b in zip(solids_of(robot, name), solids_of(still, name), strict=True):
            assert a.kind == b.kind
            np.testing.assert_array_equal(a.T_body_solid, b.T_body_solid)
    assert all(s.kind == HULL for s in solids_of(robot, "distal"))
    assert (
        "locked joints: near = 0.4, roll = 0.1, wave = 0 (default), spin = 0 "
        in (robot.notes[0])
    )


def test_an_empty_travel_is_none(hand):
    robot = load_robot(hand, tip="tool", travel=[], **COARSE)
    assert not travelling(robot)
    assert all(s.kind != HULL for s in robot_solids(robot))
    assert not any("behind the tool" in note for note in robot.notes)


def test_joints_elsewhere_stand_still(hand):
    robot = load_robot(hand, tip="tool", **COARSE)
    assert "wave = 0 (default)" in robot.notes[0]
    assert [s.kind for s in solids_of(robot, "flag")] != [HULL]


def test_a_joint_of_the_gripper_that_cannot_travel_is_told(hand):
    notes = load_robot(hand, tip="tool", **COARSE).notes
    (spin,) = [n for n in notes if n.startswith("spin behind the tool stands at 0,")]
    assert "it has no two limits; put it elsewhere with locked" in spin
    (hoist,) = [n for n in notes if n.startswith("hoist behind the tool stands at 0,")]
    assert "would move mast by up to 0.80 m" in hoist
    with pytest.raises(BadRobot, match="'spin' has no two limits"):
        load_robot(hand, tip="tool", travel=("spin",), **COARSE)
    robot = load_robot(hand, tip="tool", travel=("hoist",), **COARSE)
    assert travelling(robot) == ["hoist"]
    locked = load_robot(hand, tip="tool", locked={"spin": 1.0, "hoist": 0.2}, **COARSE)
    assert not any("behind the tool" in note for note in locked.notes)


def test_a_chain_too_long_to_hold_stands_as_far_as_it_must(tmp_path_factory):
    body, parent = ARM, "palm"
    for k in range(9):
        body += link(f"l{k}", 0.05)
        axis = "0 0 1" if k % 2 else "0 1 0"
        body += joint(
            f"j{k}", "revolute", parent, f"l{k}", "0.05 0 0", axis, (-1.2, 1.2)
        )
        parent = f"l{k}"
    path = written(tmp_path_factory, body)
    robot = load_robot(path, tip="tool", **COARSE)
    notes = [n for n in robot.notes if "behind the tool stands at 0" in n]
    assert travelling(robot) and notes
    assert len(travelling(robot)) + len(notes) == 9
    with pytest.raises(BadRobot, match="would travel with j0 and j1 and .* lock some"):
        load_robot(path, tip="tool", travel=[f"j{k}" for k in range(9)], **COARSE)


def test_a_finger_that_would_fill_the_room_of_the_arm_stands(tmp_path_factory):
    """Folded back it lies on the arm, so over its travel it touches it always."""
    body = ARM.replace('lower="-1" upper="1"', 'lower="-0.1" upper="0.1"')
    body += link("finger", 0.14)
    limits = (-3.14, 0)
    body += joint("fold", "revolute", "palm", "finger", "0 0 0.012", "0 1 0", limits)
    path = written(tmp_path_factory, body)
    robot = load_robot(path, tip="tool", **COARSE)
    asked = load_robot(path, tip="tool", travel=("fold",), **COARSE)
    assert ("arm", "finger") in [p[:2] for p in asked.dropped_pairs if "always" in p[2]]
    assert not travelling(robot)
    assert any("arm and finger touch in most poses" in note for note in robot.notes)
    assert not any("always" in reason for _, _, reason in robot.dropped_pairs)


def test_a_pair_that_stands_apart_in_some_poses_is_tested(tmp_path_factory):
    """It touches in most poses anyhow, but only as a hull in all of them."""
    body = ARM.replace('lower="-1" upper="1"', 'lower="-0.4" upper="0.4"')
    body += link("finger", 0.14)
    limits = (3.04, 3.9)
    body += joint("wag", "revolute", "palm", "finger", "0 0 0.006", "0 0 1", limits)
    path = written(tmp_path_factory, body)
    asked, still = (
        load_robot(path, tip="tool", travel=names, **COARSE) for names in (["wag"], ())
    )
    pair = frozenset(("arm", "finger"))
    assert pair in always_touching_pairs(asked)
    assert pair in crowded_pairs(still) - always_touching_pairs(still)
    robot = load_robot(path, tip="tool", **COARSE)
    assert not travelling(robot) and not always_touching_pairs(robot)


def test_a_tip_on_a_finger_plans_for_that_finger(hand):
    robot = load_robot(hand, tip="proximal", **COARSE)
    assert robot.joint_names == ("lift", "swing", "near")
    assert travelling(robot) == ["far"]
    thumb = robot.link_body[robot.link_names.index("thumb")]
    assert robot.tree_f[thumb, 15] == -0.7  # it follows, as planned
    with pytest.raises(BadRobot, match="'near' moves the tool"):
        load_robot(hand, tip="proximal", travel=("near",), **COARSE)


def test_a_robot_without_fingers_says_nothing(urdf):
    path = urdf(ARM)
    robot = load_robot(path, tip="tool", **COARSE)
    assert (
        robot.fingerprint()
        == load_robot(path, tip="tool", travel=(), **COARSE).fingerprint()
    )
    assert not travelling(robot)


def solids_of(robot, name):
    return [s for s in robot_solids(robot) if robot.link_names[s.link] == name]
