"""Robots from URDF files: what is read, what is assumed, what is refused."""

import importlib.util

import numpy as np
import pytest

from roadmap import load_robot, tool_pose
from roadmap.description import read_description
from roadmap.errors import BadRobot, PlanningError
from roadmap.kinematics import body_frames
from roadmap.polytope import support
from roadmap.robot import BOX, CYLINDER, HULL, SPHERE, Robot
from roadmap.spheres import robot_solids

COARSE = {"cover_excess": 0.1}
BALL = '<sphere radius="0.05"/>'
# a tetrahedron, as OBJ with bytes that are not UTF-8 and with negative indices
OBJ = b"# Gr\xf6\xdfe\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 9 9 9\n"
OBJ += b"f 1 2 3\nf 1/1/1 2/1/1 4/1/1\nf -5 -3 -2\no part two\nf 2//1 3//1 4//1\n"
FLAT = b"v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nf 1 2 3\n"


def mesh(filename, scale=""):
    return f'<mesh filename="{filename}" {scale}/>'


@pytest.fixture
def arm(urdf, link, joint):
    """Return a function: shape of the moving link -> path of its URDF."""

    def write(shape="", kind="revolute", inside="", name="robot.urdf"):
        body = link("base", BALL) + link("arm", shape)
        return urdf(body + joint("turn", kind, "base", "arm", inside=inside), name)

    return write


# ---- what is read


def test_the_panda_has_seven_joints_and_open_fingers(panda):
    assert panda.dof == 7 and panda.tip_name == "panda_grasptarget"
    assert any("panda_finger_joint1 = 0.04" in note for note in panda.notes)
    assert any("panda_link8" in note for note in panda.notes)
    assert panda.link_body.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 7, 7, 7]
    solids = robot_solids(panda)
    left = solids[panda.link_names.index("panda_leftfinger")]
    right = solids[panda.link_names.index("panda_rightfinger")]
    y = np.array([[0.0, 1, 0], [0, -1, 0]])
    T_hand = solids[panda.link_names.index("panda_hand")].T_body_solid[:3, :3]
    gap = -support(left, -(T_hand @ y[0])[None]) - support(right, (T_hand @ y[0])[None])
    assert gap[0] == pytest.approx(0.08, abs=0.005)


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


@pytest.mark.parametrize(
    "reference",
    [
        "meshes/t.obj",
        "package://meshes/t.obj",
        "package://some_robot/meshes/t.obj",
        "file://{tmp}/meshes/t.obj",
        "{tmp}/meshes/t.obj",
    ],
)
def test_meshes_are_found_scaled_and_taken_as_hulls(reference, arm, tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/t.obj").write_bytes(OBJ)
    scale = 'scale="0.1 0.2 -0.3"'
    path = arm(mesh(reference.format(tmp=tmp_path), scale))
    solid = robot_solids(load_robot(path, **COARSE))[1]
    assert solid.kind == HULL and len(solid.points) == 4
    assert np.allclose(solid.points.max(axis=0), [0.1, 0.2, 0.0])
    assert np.allclose(solid.points.min(axis=0), [0.0, 0.0, -0.3])


def test_packages_are_looked_up_in_given_folders_and_ros_package_path(
    arm, tmp_path, monkeypatch
):
    folder = tmp_path / "elsewhere/my_robot/meshes"
    folder.mkdir(parents=True)
    (folder / "t.obj").write_bytes(OBJ)
    path = arm(mesh("package://my_robot/meshes/t.obj", 'scale="0.1 0.1 0.1"'))
    for root in ("elsewhere", "elsewhere/my_robot"):
        load_robot(path, package_dirs=[tmp_path / root], **COARSE)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
    load_robot(path, **COARSE)


@pytest.mark.parametrize("kind", ["stl", "dae"])
def test_stl_and_dae_give_the_same_hull_as_obj(kind, arm, tmp_path):
    import trimesh

    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.export(tmp_path / f"t.{kind}")
    solid = robot_solids(load_robot(arm(mesh(f"t.{kind}")), **COARSE))[1]
    assert np.allclose(np.abs(solid.points), [0.05, 0.1, 0.15], atol=1e-6)


def test_the_unit_of_a_dae_is_applied(arm, tmp_path):
    import trimesh

    data = trimesh.creation.box((100, 200, 300)).export(file_type="dae").decode()
    assert "<unit" not in data or 'meter="1' in data
    unit = '<asset><unit name="millimeter" meter="0.001"/>'
    data = data.replace("<asset>", unit, 1)
    (tmp_path / "t.dae").write_text(data)
    solid = robot_solids(load_robot(arm(mesh("t.dae")), **COARSE))[1]
    assert np.allclose(np.abs(solid.points), [0.05, 0.1, 0.15], atol=1e-6)


def test_dae_meshes_lie_where_pinocchio_sees_them(example_file):
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pin) is not installed")
    path = example_file("kinova_description/robots/kinova.urdf")
    robot = load_robot(path, tip="j2s6s200_end_effector", **COARSE)
    model = pin.buildModelFromUrdf(str(path))
    shapes = pin.buildGeomFromUrdf(
        model,
        str(path),
        pin.GeometryType.COLLISION,
        package_dirs=[str(path.parents[4])],
    )
    data, places = model.createData(), shapes.createData()
    pin.updateGeometryPlacements(model, data, shapes, places, pin.neutral(model))
    frames = body_frames(robot, np.zeros(robot.dof))
    names, compared = list(robot.link_names), 0
    for i, shape in enumerate(shapes.geometryObjects):
        name = model.frames[shape.parentFrame].name
        if name not in names or "finger" in name:
            continue
        T = places.oMg[i].homogeneous
        points = shape.geometry.vertices() * shape.meshScale
        points = points @ T[:3, :3].T + T[:3, 3]
        solid = robot_solids(robot)[names.index(name)]
        R = frames[robot.link_body[names.index(name)]]
        own = solid.body_points() @ R[:3, :3].T + R[:3, 3]
        assert np.allclose(own.min(axis=0), points.min(axis=0), atol=1e-4)
        assert np.allclose(own.max(axis=0), points.max(axis=0), atol=1e-4)
        compared += 1
    assert compared >= 6


def test_a_file_with_latin_1_comments_and_gazebo_tags_is_read(arm):
    path = arm(BALL)
    text = path.read_text().replace("</robot>", "<!-- \xfc --><gz:x/></robot>")
    path.write_bytes(text.encode("latin-1"))
    assert load_robot(path, **COARSE).dof == 1


# ---- joints


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


def test_a_continuous_joint_with_a_fractional_follower_does_not_wrap(urdf, link, joint):
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "continuous", "base", "a")
    half = '<mimic joint="j" multiplier="0.5"/>'
    body += joint("k", "continuous", "a", "b", inside=half)
    robot = load_robot(urdf(body), **COARSE)
    assert not robot.continuous.any()
    assert any("breaks the turn" in note for note in robot.notes)


def test_missing_velocity_limits_get_stated_defaults(arm):
    zero = '<limit lower="-1" upper="1" velocity="0" effort="1"/>'
    for kind, speed in (("revolute", 1.0), ("prismatic", 0.1)):
        robot = load_robot(arm(BALL, kind, zero), **COARSE)
        assert robot.max_velocity[0] == speed
        assert any("velocity limit taken as" in note for note in robot.notes)
    assert robot.max_acceleration[0] == pytest.approx(4 * speed)
    assert robot.max_jerk[0] == pytest.approx(40 * speed)
    assert any("jerk" in note for note in robot.notes)


def test_a_revolute_joint_without_limits_gets_a_full_turn_and_says_so(arm):
    robot = load_robot(arm(BALL, inside='<limit effort="1"/>'), **COARSE)
    assert robot.lower[0] == -np.pi and robot.upper[0] == np.pi
    assert any("no position limits" in note for note in robot.notes)


def test_the_only_end_of_the_longest_chain_is_the_default_tip(urdf, link, joint):
    body = link("base") + link("a", BALL) + link("b") + link("c") + link("camera")
    body += joint("j", "revolute", "base", "a") + joint("k", "revolute", "a", "b")
    body += joint("f", "fixed", "b", "c") + joint("g", "fixed", "a", "camera")
    assert load_robot(urdf(body), **COARSE).tip_name == "c"


# ---- geometry


def test_a_moving_link_with_visual_geometry_only_uses_its_hull_and_says_so(arm):
    path = arm(BALL)
    path.write_text(path.read_text().replace("collision", "visual"))
    robot = load_robot(path, **COARSE)
    assert robot.link_names == ("arm",)
    assert any("arm: no collision" in note for note in robot.notes)
    assert any("base" in note and "left out" in note for note in robot.notes)


@pytest.mark.parametrize("points", [FLAT, b"v 0 0 0\nv .3 0 0\nv .1 0 0\nf 1 2 3\n"])
def test_a_flat_mesh_is_thickened_and_covered(points, arm, tmp_path, rng):
    (tmp_path / "t.obj").write_bytes(points)
    robot = load_robot(arm(mesh("t.obj")), cover_excess=0.02)
    assert any("flat; thickened" in note for note in robot.notes)
    corners = robot_solids(robot)[1].body_points()
    inside = rng.dirichlet(np.ones(len(corners)), 500) @ corners
    spheres = robot.spheres[robot.sphere_link == 1]
    away = np.linalg.norm(inside[:, None] - spheres[None, :, :3], axis=2)
    assert (away <= spheres[:, 3]).any(axis=1).all()


# ---- bad input: one sentence, a PlanningError


def refuses(source, words, **options):
    with pytest.raises(PlanningError, match=words) as caught:
        load_robot(source, **{**COARSE, **options})
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path):
    refuses(tmp_path / "no.urdf", "no URDF file at .*no.urdf")


@pytest.mark.parametrize(
    "text", ["", "<robot name='x'>", "<robot><link name='a'></robot>", "not xml"]
)
def test_broken_xml_is_refused_not_repaired(text, tmp_path):
    (tmp_path / "r.urdf").write_text(text)
    refuses(tmp_path / "r.urdf", "not well-formed|not one tree|not a usable")


def test_another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "r.sdf").write_text("<sdf version='1.6'/>")
    refuses(tmp_path / "r.sdf", "<sdf>, not <robot>")


def test_a_missing_mesh_names_link_file_and_places(arm, tmp_path):
    refuses(arm(mesh("package://p/no.stl")), "'package://p/no.stl' of link 'arm'.*look")
    refuses(arm(mesh("no.stl")), "no.stl.*package_dirs")


def test_an_unreadable_mesh_is_refused(arm, tmp_path):
    (tmp_path / "t.stl").write_bytes(b"solid nothing")
    refuses(arm(mesh("t.stl")), "t.stl.*of link 'arm'")
    (tmp_path / "t.obj").write_bytes(b"v 0 0 nan\nf 1 1 1\n")
    refuses(arm(mesh("t.obj")), "no finite triangles")
    (tmp_path / "t.xyz").write_bytes(b"1 2 3")
    refuses(arm(mesh("t.xyz")), "cannot be read")


def test_a_robot_without_a_moving_joint_is_refused(arm):
    refuses(arm(BALL, "fixed"), "no joint moves")
    refuses(arm(BALL), "no joint moves", locked={"turn": 0.0})
    still = '<limit lower="0.3" upper="0.3" velocity="1" effort="1"/>'
    refuses(arm(BALL, inside=still), "no joint moves")


def test_an_unknown_tip_lists_the_links(arm):
    refuses(arm(BALL), "no link 'hand'.*'base', 'arm'", tip="hand")


def test_an_unclear_tip_lists_the_candidates(urdf, link, joint):
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "revolute", "base", "a") + joint("k", "revolute", "base", "b")
    refuses(urdf(body), "tip= one of .*'a', 'b'")


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


def test_broken_trees_are_refused(urdf, link, joint):
    ends = link("a", BALL) + link("b", BALL)
    refuses(urdf(ends), "not one tree")
    refuses(urdf(ends + joint("j", "revolute", "a", "c")), "'c', which the file")
    loop = joint("j", "revolute", "a", "b") + joint("k", "revolute", "b", "a")
    refuses(urdf(ends + loop), "not one tree")
    refuses(urdf(ends + loop + link("root")), "loop through")
    refuses(urdf(ends + link("a")), "twice")


def test_mimics_of_nothing_or_in_a_circle_are_refused(arm, urdf, link, joint):
    refuses(arm(BALL, inside='<mimic joint="ghost"/>'), "mimics 'ghost'")
    body = link("base") + link("a", BALL) + link("b", BALL)
    body += joint("j", "revolute", "base", "a", inside='<mimic joint="k"/>')
    body += joint("k", "revolute", "a", "b", inside='<mimic joint="j"/>')
    refuses(urdf(body), "itself a follower")


def test_a_zero_axis_is_refused(urdf, link, joint):
    body = link("base") + link("a", BALL)
    refuses(urdf(body + joint("j", "revolute", "base", "a", axis="0 0 0")), "axis")


def test_a_missing_or_broken_srdf_is_refused(arm, tmp_path):
    refuses(arm(BALL), "no SRDF file", srdf=tmp_path / "no.srdf")
    (tmp_path / "r.srdf").write_text("<robot>")
    refuses(arm(BALL), "not well-formed", srdf=tmp_path / "r.srdf")


def test_without_pybullet_the_panda_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    refuses("panda", "pip install pybullet.*3.11")


def test_a_description_lists_its_links_in_file_order(arm):
    description = read_description(arm(BALL))
    assert list(description.links) == ["base", "arm"] and description.root == "base"
    with pytest.raises(BadRobot):
        read_description("nowhere.urdf")
