"""Meshes of URDF files: where they are looked for, and what becomes of them."""

import re

import numpy as np
import pytest
from urdf_parts import BALL, COARSE, mesh

from roadmap import load_robot
from roadmap.errors import BadRobot
from roadmap.geometry.spheres import robot_solids
from roadmap.kinematics.forward import body_frames
from roadmap.loading.assembly import LEFT_OUT
from roadmap.robot.robot import HULL
from sim.loop.warmup import URDF

# a tetrahedron, as OBJ with bytes that are not UTF-8 and with negative indices
OBJ = b"# Gr\xf6\xdfe\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 9 9 9\n"
OBJ += b"f 1 2 3\nf 1/1/1 2/1/1 4/1/1\nf -5 -3 -2\no part two\nf 2//1 3//1 4//1\n"
FLAT = b"v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nf 1 2 3\n"


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


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("package://nobody/t.obj", "set ROS_PACKAGE_PATH to the folder"),
        ("meshes/T.OBJ", "correct the file's name, which starts at the folder of"),
        ("file:///nowhere/t.obj", "correct the file's name, which"),
    ],
)
def test_a_mesh_that_is_not_there_is_told_with_what_helps(name, remedy, arm):
    with pytest.raises(BadRobot, match=remedy):
        load_robot(arm(mesh(name)), **COARSE)


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


def test_links_that_are_only_drawn_use_their_hull(arm):
    """A base that was only drawn was left out: the arm could meet it."""
    path = arm(BALL)
    path.write_text(path.read_text().replace("collision", "visual"))
    robot = load_robot(path, **COARSE)
    assert robot.link_names == ("base", "arm")
    for name in robot.link_names:
        assert any(f"{name}: no collision" in note for note in robot.notes)
    assert not any("left out" in note for note in robot.notes)


def test_the_arm_of_a_robot_that_is_only_drawn_is_tested_against_its_base(tmp_path):
    urdf, drawn = tmp_path / "solid.urdf", tmp_path / "drawn.urdf"
    urdf.write_text(URDF)
    drawn.write_text(URDF.replace("collision", "visual"))
    solid, robot = (load_robot(path, tip="hand") for path in (urdf, drawn))
    assert robot.fingerprint() == solid.fingerprint()
    names = robot.link_names
    assert ("base", "hand") in {(names[i], names[j]) for i, j in robot.self_pairs}
    # beside a base that has collision geometry what is drawn is decoration, and told
    sign = "<visual><geometry><box size='1 1 1'/></geometry></visual>"
    more = f'<link name="sign">{sign}</link><joint name="s" type="fixed">'
    more += '<parent link="base"/><child link="sign"/></joint>'
    urdf.write_text(URDF.replace("</robot>", more + "</robot>"))
    beside = load_robot(urdf, tip="hand")
    assert beside.link_names == solid.link_names
    assert f"{LEFT_OUT}: sign" in beside.notes


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


@pytest.mark.parametrize(
    "shape",
    [
        '<box size="0.2 0.1 1e-9"/>',
        '<box size="1e-320 0.1 0.2"/>',
        '<cylinder radius="0.2" length="1e-9"/>',
        '<cylinder radius="1e-7" length="2"/>',
        '<sphere radius="1e-9"/>',
    ],
)
def test_a_thin_primitive_is_thickened_and_covered(shape, arm, rng):
    robot = load_robot(arm(shape), cover_excess=0.05)
    kind = shape[1 : shape.index(" ")]
    assert f"arm: a {kind} is flat; thickened to 0.1 mm" in robot.notes
    assert not any("flat" in n for n in load_robot(arm(BALL), **COARSE).notes)
    sides = np.array([float(word) for word in re.findall(r"[\d.e-]*\d", shape)])
    size = {"box": sides / 2, "sphere": sides.repeat(3)}
    half = size.get(kind, np.array([sides[0], sides[0], sides[-1] / 2]))
    inside = rng.uniform(-1.0, 1.0, (500, 3))
    if kind != "box":  # within a disc
        inside[:, :2] *= np.sqrt(0.5)
    inside *= half
    spheres = robot.spheres[robot.sphere_link == 1]
    away = np.linalg.norm(inside[:, None] - spheres[None, :, :3], axis=2)
    assert (away <= spheres[:, 3]).any(axis=1).all()
