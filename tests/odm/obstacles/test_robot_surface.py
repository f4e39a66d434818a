"""A robot as an obstacle: every part closed and covered, moved by its joints."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree
from small import DATA

import odm
from odm.exact.distances import ExactRobot
from odm.obstacles.mesh_surface import cover_densely, is_small_hull, volume
from odm.obstacles.robot_surface import robot_surface, solids_of, standing_shapes
from roadmap import load_robot
from roadmap.errors import BadInput
from roadmap.kinematics.forward import body_frames
from roadmap.robot.robot import BOX, CYLINDER, HULL
from roadmap.transforms import pose_of

MIXED = """<robot name="mixed">
<link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision>
</link>
<link name="turret"><collision><origin xyz="0 0 0.1" rpy="0.3 0 0"/><geometry>
<cylinder radius="0.05" length="0.2"/></geometry></collision></link>
<link name="slide"><collision><origin xyz="0.1 0 0"/><geometry>
<mesh filename="wedge.obj"/></geometry></collision></link>
<link name="ball"><collision><geometry><sphere radius="0.06"/></geometry></collision>
</link>
<joint name="turn" type="revolute"><parent link="base"/><child link="turret"/>
<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="push" type="prismatic"><parent link="turret"/><child link="slide"/>
<origin xyz="0.05 0 0.2" rpy="0 0.4 0"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.3" velocity="1" effort="1"/></joint>
<joint name="nod" type="revolute"><parent link="slide"/><child link="ball"/>
<origin xyz="0.25 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>
"""
WEDGE = """v 0 0 0
v 0.2 0 0
v 0 0.1 0
v 0 0 0.15
v 0.2 0.05 0.1
f 1 2 3
f 1 3 4
f 1 4 2
f 2 5 3
f 3 5 4
f 4 5 2
"""


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """A robot of a box, a cylinder, a hull and a ball, with a slide."""
    folder = tmp_path_factory.mktemp("mixed")
    (folder / "wedge.obj").write_text(WEDGE)
    (folder / "mixed.urdf").write_text(MIXED)
    return load_robot(folder / "mixed.urdf", tip="ball")


@pytest.fixture(scope="module")
def arm3():
    return load_robot(DATA / "arm3.urdf", tip="tool")


def draw(robot, rng):
    return rng.uniform(robot.lower, robot.upper)


def fine_points(robot, i, rng):
    """Return many points of the surface of solid i, in its own frame."""
    kind, size = robot.solid_kind[i], robot.solid_size[i]
    if kind == HULL:
        from scipy.spatial import ConvexHull

        points = robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
        return cover_densely(points, ConvexHull(points).simplices, 0.003)
    if kind == BOX:
        points = rng.uniform(-0.5, 0.5, (4000, 3))
        axis = rng.integers(0, 3, 4000)
        points[np.arange(4000), axis] = np.where(rng.random(4000) < 0.5, -0.5, 0.5)
        return points * size
    ball = rng.normal(size=(4000, 3))
    if kind == CYLINDER:
        ball[:, :2] /= np.linalg.norm(ball[:, :2], axis=1)[:, None]
        ball[:, 2] = rng.uniform(-0.5, 0.5, 4000)
        lid = rng.random(4000) < 0.4
        ball[lid, 2] = np.sign(ball[lid, 2]) * 0.5
        ball[lid, :2] *= np.sqrt(rng.random(int(lid.sum())))[:, None]
        return ball * [size[0], size[0], size[1]]
    return ball / np.linalg.norm(ball, axis=1)[:, None] * size[0]


@pytest.mark.parametrize("spacing", [0.03, 0.012])
def test_all_of_a_surface_is_near_its_samples(mixed, rng, spacing):
    assert set(mixed.solid_kind.tolist()) == {HULL, BOX, CYLINDER, 3}
    q = draw(mixed, rng)
    parts, frames = robot_surface(mixed, q, spacing=spacing), body_frames(mixed, q)
    for i in range(len(mixed.solid_kind)):
        T = frames[mixed.link_body[mixed.solid_link[i]]] @ mixed.solid_pose[i]
        fine = fine_points(mixed, i, rng) @ T[:3, :3].T + T[:3, 3]
        far, _ = cKDTree(parts[i].points).query(fine)
        assert far.max() <= parts[i].covering_radius + 1e-9 <= spacing + 1e-9


def test_samples_lie_on_the_solids(mixed, rng):
    exact = ExactRobot(mixed, base=True)
    q = draw(mixed, rng)
    points = np.concatenate([part.points for part in robot_surface(mixed, q)])
    for p in points[::7]:
        near = exact.distance(q, [odm.Sphere(1e-4, pose_of(p))])
        assert near.distance < 1e-6


def test_the_base_pose_moves_all_points(mixed, rng):
    q, T = draw(mixed, rng), pose_of((0.4, -0.2, 0.1), (0.1, 0.2, 2.0))
    for own, moved in zip(
        robot_surface(mixed, q), robot_surface(mixed, q, T), strict=True
    ):
        expected = own.points @ T[:3, :3].T + T[:3, 3]
        assert np.allclose(moved.points, expected, atol=1e-12)


def test_parts_are_closed_and_carry_the_names_of_their_links(mixed):
    parts = robot_surface(mixed, np.zeros(3))
    assert [p.label for p in parts] == ["base", "turret", "slide", "ball"]
    assert all(p.closed and p.covering_radius <= 0.03 for p in parts)


def test_standing_shapes_stand_at_the_base(mixed):
    T = pose_of((0.5, 0.0, 0.0), (0.0, 0.0, 1.0))
    (box,) = standing_shapes(mixed, T)
    assert np.allclose(box.T_base_shape, T) and np.allclose(box.size, [0.2, 0.2, 0.1])
    assert len(solids_of(mixed)) == 4


@pytest.mark.parametrize(
    ("q", "T", "spacing", "told"),
    [
        (np.zeros(6), None, 0.03, "3 moving joints"),
        ([0.0, np.nan, 0.0], None, 0.03, "q of the other robot holds NaN"),
        (np.zeros(3), 2.0 * np.eye(4), 0.03, "T_world_base is not a rigid motion"),
        (np.zeros(3), None, 0.0, "spacing 0.0 m must be above 0"),
    ],
)
def test_what_gives_no_surface_is_refused(arm3, q, T, spacing, told):
    with pytest.raises(BadInput, match=told):
        robot_surface(arm3, np.array(q), T, spacing)


def test_all_facets_of_a_hull_face_outwards(rng):
    robot = load_robot("panda")
    hulls = [s for s in solids_of(robot) if isinstance(s, odm.Mesh)]
    hulls += [odm.Mesh.hull_of(rng.normal(size=(30, 3)), np.eye(4)) for _ in range(5)]
    assert len(hulls) > 10
    for hull in hulls:
        expected = ConvexHull(hull.vertices).volume
        assert volume(hull.vertices, hull.faces) == pytest.approx(expected, rel=1e-9)
        assert is_small_hull(hull.vertices, hull.faces) == (len(hull.faces) <= 200)
    for points in (np.zeros((5, 3)), rng.normal(size=(3, 3)), np.full((6, 3), np.nan)):
        with pytest.raises(BadInput, match="have no convex hull"):
            odm.Mesh.hull_of(points, np.eye(4))
