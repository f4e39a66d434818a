"""Scene files of others: what stands in them is read as it is, or refused by line."""

import numpy as np
import pytest
from rows import each

from odm.obstacles.scene_files import read_scene, write_scene
from odm.obstacles.shapes import Box, Cylinder, Mesh, Sphere
from roadmap.errors import BadInput
from roadmap.transforms import pose_of

# as MoveIt writes it since 2020: a pose of each object, and its subframes
NEW = """(noname)+
* shelf board
0.5 0.1 0.2
0 0 0.7071067811865476 0.7071067811865476
2
box
0.6 0.3 0.02
0 0 0.1
0 0 0 1
1 0 0 1
sphere
0.05
0.2 0 0
0 0 0 1
0 0 0 0
1
grasp here
0 0 0
0 0 0 1
* bin
0 0 0
0 0 0 1
1
mesh
4 4
0 0 0
1 0 0
0 1 0
0 0 1
0 2 1
0 1 3
1 2 3
2 0 3
0.1 0.2 0.3
0 0 0 1
0 0 0 0
0
.
"""
OLD = """old
* post
3
cylinder
0.05
0.8
0 0.5 0.4
0 0 0 1
0 0 0 0
cone
0.1 0.3
1 0 0
0 0 0 1
0 0 0 0
plane
0 0 1 0.25
0 0 0
0 0 0 1
0 0 0 0
.
"""
URDF = """<robot name="cell"><link name="world"/>
<link name="bench"><collision><origin xyz="0 0 0.1"/><geometry>
<box size="1 0.5 0.2"/></geometry></collision></link>
<link name="door"><collision><geometry><cylinder radius="0.1" length="0.5"/></geometry>
</collision><collision><origin xyz="0 0 1"/><geometry><sphere radius="0.2"/></geometry>
</collision></link>
<joint name="stands" type="fixed"><parent link="world"/><child link="bench"/>
<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint>
<joint name="hinge" type="revolute"><parent link="bench"/><child link="door"/>
<origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="0.5" upper="1" effort="1" velocity="1"/></joint></robot>
"""


def read(tmp_path, text, name="cell.scene"):
    (tmp_path / name).write_text(text)
    return read_scene(tmp_path / name)


def test_a_moveit_scene_of_today(tmp_path):
    (name, (board, ball), T), (bin_, (mesh,), where) = read(tmp_path, NEW)
    assert (name, bin_) == ("shelf board", "bin")
    assert np.allclose(T, pose_of([0.5, 0.1, 0.2], [0, 0, np.pi / 2]))
    assert isinstance(board, Box) and board.size.tolist() == [0.6, 0.3, 0.02]
    assert np.allclose(board.T_base_shape[:3, 3], [0, 0, 0.1])
    assert isinstance(ball, Sphere) and ball.radius == 0.05
    assert isinstance(mesh, Mesh) and mesh.faces.shape == (4, 3)
    assert np.allclose(mesh.T_base_shape[:3, 3], [0.1, 0.2, 0.3])
    assert np.array_equal(where, np.eye(4))


def test_an_older_moveit_scene_has_no_poses_of_objects(tmp_path):
    ((name, (post, cone, plate), T),) = read(tmp_path, OLD)
    assert name == "post" and np.array_equal(T, np.eye(4))
    assert isinstance(post, Cylinder) and (post.radius, post.length) == (0.05, 0.8)
    # a cone is inside the pyramid that stands for it, with its tip on z
    along = np.linspace(-0.15, 0.15, 9)
    angle = np.linspace(0, 2 * np.pi, 50)
    r = 0.1 * (0.15 - along) / 0.3
    rim = np.stack([np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle))], -1)
    points = np.concatenate([rim, np.repeat(along[:, None, None], 50, 1)], -1)
    a, b, c = (cone.vertices[cone.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    inside = np.einsum("fi,nfi->nf", normal, points.reshape(-1, 1, 3) - a)
    assert inside.max() < 1e-12 and np.ptp(cone.vertices[:, 2]) == pytest.approx(0.3)
    # z = -0.25, and the robot stands above it
    top = plate.T_base_shape[:3, 3] + 0.5 * plate.size[2] * plate.T_base_shape[:3, 2]
    assert np.allclose(top, [0, 0, -0.25]) and plate.T_base_shape[2, 2] > 0.99


@pytest.mark.parametrize("moved", [False, True])
def test_a_plane_is_solid_where_the_origin_is_not(tmp_path, moved):
    below = OLD.replace("0 0 1 0.25", "0 0 -2 1")  # z = 0.5: a ceiling
    if moved:
        below = OLD.replace("0 0 1 0.25\n0 0 0", "0 0 1 0\n0 0 0.5")
    ((_, (*_, plate), _),) = read(tmp_path, below)
    low = plate.T_base_shape[2, 3] - 0.5 * plate.size[2]
    assert low == pytest.approx(0.5)


def test_a_urdf_stands_with_its_joints_in_their_limits(tmp_path):
    (bench, (box,), T_bench), (door, (rod, ball), T) = read(tmp_path, URDF, "cell.urdf")
    assert (bench, door) == ("bench", "door")
    assert np.allclose(T_bench, pose_of([1, 0, 0], [0, 0, np.pi / 2]))
    assert np.allclose(T, T_bench @ pose_of([0, 0, 0.5], [0, 0, 0.5]))
    assert isinstance(box, Box) and isinstance(rod, Cylinder)
    assert np.allclose(ball.T_base_shape[:3, 3], [0, 0, 1])


FOLLOWER = """<robot name="cell"><link name="bench"/>
<link name="door"><collision><geometry><sphere radius="0.1"/></geometry></collision>
</link><link name="flap"><collision><geometry><sphere radius="0.1"/></geometry>
</collision></link>
<joint name="hinge" type="revolute"><parent link="bench"/><child link="door"/>
<axis xyz="0 0 1"/><limit lower="0.5" upper="2" velocity="1" effort="1"/></joint>
<joint name="fold" type="revolute"><parent link="door"/><child link="flap"/>
<axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="1" effort="1"/>
<mimic joint="hinge" multiplier="-2" offset="0.3"/></joint></robot>"""


def test_a_follower_of_a_urdf_stands_where_its_joint_puts_it(tmp_path):
    (_, _, T_door), (_, _, T_flap) = read(tmp_path, FOLLOWER, "cell.urdf")
    assert np.allclose(T_door, pose_of([0, 0, 0], [0, 0, 0.5]))
    assert np.allclose(T_flap, T_door @ pose_of([0, 0, 0], [0, 0, -2 * 0.5 + 0.3]))
    text = FOLLOWER.replace('name="hinge" type="revolute"', 'name="hinge" type="fixed"')
    (_, _, T_door), (_, _, T_flap) = read(tmp_path, text, "cell.urdf")
    assert np.allclose(T_door, np.eye(4))
    assert np.allclose(T_flap, pose_of([0, 0, 0], [0, 0, 0.3]))


@pytest.mark.parametrize(
    ("joint", "told"),
    [
        ("ghost", "'fold' mimics 'ghost', which is not in the file; correct or remove"),
        ("fold", "'fold' mimics 'fold', which is itself a follower of it; correct"),
    ],
)
def test_a_follower_of_nothing_or_of_itself_is_refused(tmp_path, joint, told):
    text = FOLLOWER.replace('mimic joint="hinge"', f'mimic joint="{joint}"')
    with pytest.raises(BadInput, match=told):
        read(tmp_path, text, "cell.urdf")


def test_a_mesh_of_a_urdf_is_read_beside_it(tmp_path):
    import trimesh

    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "part.stl")
    text = URDF.replace(
        '<box size="1 0.5 0.2"/>', '<mesh filename="part.stl" scale="0.1 0.1 0.1"/>'
    )
    (_, (mesh,), _), _ = read(tmp_path, text, "cell.urdf")
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [0.1, 0.2, 0.3])
    with pytest.raises(BadInput, match="gone.stl"):
        read(tmp_path, text.replace("part.stl", "gone.stl"), "cell.urdf")


def test_the_unit_of_a_mesh_of_a_urdf_is_that_of_its_file(tmp_path):
    import trimesh

    data = trimesh.creation.box((100, 200, 300)).export(file_type="dae").decode()
    unit = '<asset><unit name="millimeter" meter="0.001"/>'
    (tmp_path / "part.dae").write_text(data.replace("<asset>", unit, 1))
    part = '<mesh filename="part.dae" scale="2 1 -1"/>'
    text = URDF.replace('<box size="1 0.5 0.2"/>', part)
    (_, (mesh,), _), _ = read(tmp_path, text, "cell.urdf")
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [0.2, 0.2, 0.3])


@each(
    ("text", "told"),
    [
        ("", "ends without its last line '.', in line 0"),
        (OLD.replace("\n.\n", "\n"), "ends without its last line"),
        (OLD[:30], "ends where .* should stand, in line"),
        (OLD.replace("0.05", "wide"), "has 'wide' where radius and length .* line 5"),
        (OLD.replace("0.05", "nan"), "has 'nan' where"),
        (OLD.replace("0.05", "-1"), "holds a shape that cannot be: radius -1"),
        (OLD.replace("cylinder", "torus"), "has a shape 'torus'; known are box"),
        (OLD.replace("0 0 0 1", "0 0 0 3"), "which is no rotation"),
        (OLD.replace("0 0 0 1", "0 0 0 1e300"), "which is no rotation"),
        (OLD.replace("0 0 1 0.25", "0 0 0 1"), "is no direction"),
        (OLD.replace("* post", "* "), "an object without a name"),
        (OLD.replace("* post", "post"), "has 'post' where"),
        (NEW.replace("4 4\n", "-4 4\n"), "the number of vertices"),
        (NEW.replace("2 0 3\n", "2 0 9\n"), "names a missing vertex"),
    ],
)
def test_a_broken_scene_is_told_by_its_line(tmp_path, text, told):
    with pytest.raises(BadInput, match=told) as caught:
        read(tmp_path, text)
    assert "cell.scene" in str(caught.value) and "\n" not in str(caught.value)


def test_other_files_are_refused(tmp_path):
    for call in (read_scene, lambda path: write_scene(path, [])):
        with pytest.raises(BadInput, match=r"a scene is 3 \(int\); give its path"):
            call(3)
    with pytest.raises(BadInput, match="does not exist; check the path"):
        read_scene(tmp_path / "none.scene")
    for name in ("cell.stl", "cell"):
        with pytest.raises(BadInput, match="give a MoveIt .scene file or a .urdf"):
            read(tmp_path, OLD, name)
    (tmp_path / "raw.scene").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="is no text"):
        read_scene(tmp_path / "raw.scene")
    with pytest.raises(BadInput, match="no link of .* has a <collision>"):
        read(tmp_path, '<robot name="r"><link name="a"/></robot>', "cell.urdf")
    with pytest.raises(BadInput):
        read(tmp_path, "<robot", "cell.urdf")
