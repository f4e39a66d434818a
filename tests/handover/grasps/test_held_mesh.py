"""A mesh of the user's: held by the robot's own gripper, and wrapped in rods."""

import numpy as np
import pytest
import trimesh

from handover import load_object
from handover.grasps.held_mesh import held_mesh, rods_around
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps

PADS = ("panda_leftfinger", "panda_rightfinger")
BOTTLE = [(0, 0), (0.021, 0), (0.022, 0.12), (0.011, 0.15), (0.011, 0.195), (0, 0.195)]


@pytest.fixture(scope="module")
def robot():
    pytest.importorskip("pybullet_data")
    return load_robot("panda", cover_excess=0.02)


@pytest.fixture
def bottle(tmp_path):
    solid = trimesh.creation.revolve(np.array(BOTTLE), sections=24)
    solid.export(tmp_path / "bottle.stl")
    return tmp_path / "bottle.stl"


def held(robot, file, **more):
    thing = load_object(file, **more)
    return held_mesh(thing, robot, "panda", robot.tip_name, PADS)


def test_a_mesh_is_held_by_its_end_and_points_out_of_the_hand(robot, bottle):
    obj = held(robot, bottle, mass_kg=0.2)
    assert obj.name == "bottle" and obj.mass_kg == 0.2 and obj.turns == 2
    T = obj.T_tool_object
    assert np.allclose(T[:3, 0], (0.0, 0.0, 1.0))  # its x is the tool's z
    assert np.abs(T[:2, 3]).max() < 0.01 and 0.05 < T[2, 3] < 0.2
    ends = obj.capsules[:, [0, 3]] + np.outer(obj.capsules[:, 6], (-1.0, 1.0))
    assert -0.13 < ends.min() < -0.0975 and 0.0975 < ends.max() < 0.13
    places = obj.hand_grasps[:, 0, 3]  # a person takes it before the fingers
    assert (places > 0.0).all() and (places < 0.0975).all()


def test_a_persons_hand_on_a_short_object_is_not_where_the_gripper_is(robot, tmp_path):
    """It was, on a cup: nobody could take one, or give it."""
    trimesh.creation.box((0.05, 0.05, 0.12)).export(tmp_path / "short.stl")
    obj = held(robot, tmp_path / "short.stl")
    balls = robot.spheres[[robot.link_names[k] in PADS for k in robot.sphere_link]]
    front = float((balls[:, 2] + balls[:, 3]).max()) - robot.T_body_tip[2, 3]
    end = obj.T_tool_object[2, 3] + 0.06
    middle = obj.T_tool_object[2, 3] + obj.hand_grasps[:, 0, 3]
    assert (middle <= end + 1e-6).all()
    assert (middle > front + 0.055).all()


def test_rods_hold_all_of_a_mesh_and_little_more():
    box = trimesh.creation.box((0.2, 0.06, 0.02))
    corners = np.array(box.triangles)
    rods = rods_around(corners)
    points = box.sample(3000)
    inside = ball_gaps(np.column_stack([points, np.zeros(len(points))]), rods)
    assert inside.min(axis=1).max() <= 1e-9
    assert len(rods) <= 12
    out = np.abs(rods[:, [1, 2, 4, 5]]).max(axis=0) + rods[:, 6].max()
    assert out[0] < 0.04 and out[1] < 0.02


@pytest.mark.parametrize(
    "size, scale, told",
    [
        ((0.2, 0.15, 0.12), 1.0, "cannot hold thing of 20 x 15 x 12 cm"),
        ((0.03, 0.03, 0.03), 1.0, "a person's hand needs 6 cm; give a longer object"),
        ((200.0, 30.0, 30.0), 1.0, "millimetres, give a scale of 0.001"),
        ((0.02, 0.02, 1.2), 1.0, "to 1 m; longer things are not held at one end"),
    ],
)
def test_what_nobody_can_hold_or_take_is_refused(robot, tmp_path, size, scale, told):
    trimesh.creation.box(size).export(tmp_path / "thing.stl")
    with pytest.raises(BadInput, match=told):
        held(robot, tmp_path / "thing.stl", scale=scale)


def test_an_open_mesh_is_refused(robot, bottle):
    mesh = trimesh.load(bottle)
    mesh.update_faces(np.arange(len(mesh.faces)) > 5)
    mesh.export(bottle)
    with pytest.raises(BadInput, match="is not closed"):
        held(robot, bottle)


JAWS = """<robot name="jaws">
{links}
<joint name="turns" type="revolute"><parent link="base"/><child link="hand"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="slides" type="prismatic"><parent link="hand"/><child link="jaw"/>
<origin xyz="{at}"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" velocity="1" effort="1"/></joint></robot>"""
BOX = """<link name="{}"><collision><geometry><box size="0.04 0.04 0.04"/></geometry>
</collision></link>"""


@pytest.mark.parametrize(
    ("at", "axis"), [("0.1 0 0", "x"), ("0 -0.1 0", "-y"), ("0 0 -0.1", "-z")]
)
def test_a_tool_whose_z_does_not_point_to_its_pads_is_refused(tmp_path, at, axis):
    file = tmp_path / "jaws.urdf"
    links = "".join(BOX.format(name) for name in ("base", "hand", "jaw"))
    file.write_text(JAWS.format(links=links, at=at), encoding="utf-8")
    robot = load_robot(file, tip="hand")
    with pytest.raises(BadInput, match=rf"lie along the {axis} axis of its tool hand"):
        held_mesh(load_object("cup"), robot, str(file), "hand", ("jaw",))


@pytest.mark.parametrize("kind", ["continuous", "revolute"])
def test_a_gripper_that_a_joint_without_limits_moves_is_refused(tmp_path, kind):
    file = tmp_path / "jaws.urdf"
    links = "".join(BOX.format(name) for name in ("base", "hand", "jaw"))
    text = JAWS.format(links=links, at="0 0 0.1").replace("prismatic", kind)
    limit = '<limit lower="0" upper="0.04" velocity="1" effort="1"/>'
    assert limit in text
    file.write_text(text.replace(limit, ""), encoding="utf-8")
    robot = load_robot(file, tip="hand", locked={"slides": 0.0})
    with pytest.raises(BadInput, match="are moved by no joint with limits"):
        held_mesh(load_object("cup"), robot, str(file), "hand", ("jaw",))
