"""Every point of a closed surface is within the covering radius of a sample."""

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rows import each
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import odm.obstacles.shapes as shapes
from odm.obstacles.mesh_surface import is_inside
from odm.obstacles.surfaces import (
    Surface,
    require_covering,
    rounded_covering,
    sample_capsules,
    sample_cylinders,
    surface_of,
)
from roadmap.errors import BadInput
from roadmap.transforms import pose_of

lengths = st.one_of(st.just(0.0), st.floats(1e-4, 1.5))
radii = st.floats(1e-3, 0.3)
spacings = st.floats(0.01, 0.1)
seeds = st.integers(0, 2**32 - 1)
laws = settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def sampled_mesh(vertices, faces, spacing=0.03):
    surface = surface_of(shapes.Mesh(vertices, faces), spacing)
    return surface.points, surface.covering_radius


def random_pose(rng):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.uniform(-1, 1, 3)
    return T


def tube_points(rng, n, radius, length):
    angle = rng.uniform(0, 2 * np.pi, n)
    z = rng.uniform(0, 1, n).round(rng.integers(1, 4)) * length - length / 2
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def capsule_surface(rng, radius, length, n=3000):
    ball = rng.normal(size=(n, 3))
    ball[: n // 10, 2] = 0.0  # the rim
    ball *= radius / np.linalg.norm(ball, axis=1)[:, None]
    ball[:, 2] += np.where(ball[:, 2] > 0, 0.5, -0.5) * length
    return np.concatenate([ball, tube_points(rng, n, radius, length)])


def cylinder_surface(rng, radius, length, n=3000):
    disc = tube_points(rng, n, 1.0, 0.0)
    disc *= (radius * np.sqrt(rng.uniform(0, 1, n)).round(2))[:, None]
    disc[:, 2] = np.where(rng.random(n) < 0.5, -0.5, 0.5) * length
    return np.concatenate([disc, tube_points(rng, n, radius, length)])


def box_surface(rng, size, n=4000):
    points = rng.uniform(-0.5, 0.5, (n, 3))
    points[: n // 4] = points[: n // 4].round(1)  # edges and corners
    axis = rng.integers(0, 3, n)
    points[np.arange(n), axis] = np.where(rng.random(n) < 0.5, -0.5, 0.5)
    return points * size


def farthest(surface_points, samples):
    return cKDTree(samples).query(surface_points)[0].max()


def hexagons(area, spacing):
    """Return the least number of samples a large flat surface needs."""
    return area / (1.5 * np.sqrt(3) * spacing**2)


@laws
@given(radii, lengths, spacings, seeds)
def test_a_capsule_is_covered_caps_included(radius, length, spacing, seed):
    rng = np.random.default_rng(seed)
    shape = shapes.Capsule(radius, length, random_pose(rng))
    surface = surface_of(shape, spacing)
    truth = Surface(capsule_surface(rng, radius, length), 0.0)
    truth = truth.moved(shape.T_base_shape)
    assert farthest(truth.points, surface.points) <= spacing
    assert surface.covering_radius == spacing


@laws
@given(radii, st.floats(1e-4, 1.5), spacings, seeds)
def test_a_cylinder_is_covered_discs_included(radius, length, spacing, seed):
    rng = np.random.default_rng(seed)
    shape = shapes.Cylinder(radius, length, random_pose(rng))
    truth = Surface(cylinder_surface(rng, radius, length), 0.0)
    truth = truth.moved(shape.T_base_shape)
    assert farthest(truth.points, surface_of(shape, spacing).points) <= spacing


@laws
@given(st.tuples(*[st.floats(1e-3, 0.6)] * 3), spacings, seeds)
def test_a_box_is_covered_corners_included(size, spacing, seed):
    rng = np.random.default_rng(seed)
    shape = shapes.Box(np.array(size), random_pose(rng))
    truth = Surface(box_surface(rng, shape.size), 0.0).moved(shape.T_base_shape)
    surface = surface_of(shape, spacing)
    assert farthest(truth.points, surface.points) <= spacing
    a, b, c = size
    bound = 1.6 * hexagons(2 * (a * b + b * c + c * a), spacing)
    rims = 2 * (a + b + c) / spacing  # faces are covered one by one, narrow ones too
    assert len(surface.points) <= bound + rims + 6


@laws
@given(radii, lengths, spacings)
def test_rods_and_balls_need_few_points(radius, length, spacing):
    rod = np.array([[0, 0, 0, 0, 0, length, radius]])
    n = len(sample_capsules(rod, spacing))
    area = 2 * np.pi * radius * (length + 2 * radius)
    # rings at both ends of the tube, and a line of points on a rod thinner than spacing
    extra = 2 * np.pi * radius / spacing + length / spacing + 4
    assert n <= 1.6 * hexagons(area, spacing) + extra


def test_the_arm_of_the_reference_set_up_needs_little_more_than_a_hexagonal_grid():
    arm = np.array([[0, 0, 0, 0.28, 0, 0, 0.05], [0.28, 0, 0, 0.3, 0.2, 0.1, 0.04]])
    area = sum(
        2 * np.pi * r * (np.linalg.norm(b - a) + 2 * r)
        for a, b, r in zip(arm[:, :3], arm[:, 3:6], arm[:, 6], strict=True)
    )
    assert len(sample_capsules(arm, 0.03)) <= 1.25 * hexagons(area, 0.03)


@pytest.mark.parametrize("name", ["torus", "ball", "box", "needle"])
@pytest.mark.parametrize("spacing", [0.03, 0.015])
def test_a_closed_mesh_is_covered_and_the_radius_is_computed(name, spacing):
    mesh = {
        "torus": trimesh.creation.torus(0.15, 0.05),
        "ball": trimesh.creation.icosphere(3, 0.1),
        "box": trimesh.creation.box((0.3, 0.2, 0.002)),
        "needle": trimesh.creation.cone(0.01, 0.4, sections=7),
    }[name]
    points, radius = sampled_mesh(mesh.vertices, mesh.faces, spacing)
    truth, _ = trimesh.sample.sample_surface(mesh, 20_000, seed=1)
    truth = np.concatenate([truth, mesh.vertices])
    assert farthest(truth, points) <= radius <= spacing
    assert mesh.nearest.on_surface(points[:100])[1].max() < 1e-9
    assert len(points) <= 2.2 * hexagons(mesh.area, spacing) + 16


@laws
@given(radii, lengths, spacings, seeds)
def test_moving_the_points_is_sampling_the_moved_shape(radius, length, spacing, seed):
    rng = np.random.default_rng(seed)
    shape, T = shapes.Capsule(radius, length), random_pose(rng)
    moved = surface_of(shape, spacing, "forearm").moved(T)
    assert moved.label == "forearm" and moved.closed
    assert moved.covering_radius == spacing
    truth = Surface(capsule_surface(rng, radius, length, 500), 0.0).moved(T)
    assert farthest(truth.points, moved.points) <= spacing
    back = moved.moved(np.linalg.inv(T))
    assert np.allclose(back.points, surface_of(shape, spacing).points, atol=1e-12)


@laws
@given(st.permutations(range(4)), seeds)
def test_the_order_of_capsules_changes_only_the_order_of_points(order, seed):
    rng = np.random.default_rng(seed)
    rods = rng.uniform(0.05, 0.4, (4, 7))
    one = sample_capsules(rods)
    other = sample_capsules(rods[list(order)])
    assert np.array_equal(np.unique(one, axis=0), np.unique(other, axis=0))


def test_each_capsule_of_many_is_sampled_as_if_alone():
    rods = np.random.default_rng(3).uniform(0.05, 0.4, (5, 7))
    alone = [sample_capsules(rods[i : i + 1]) for i in range(5)]
    assert np.array_equal(sample_capsules(rods), np.concatenate(alone))


def test_a_capsule_of_no_length_is_a_sphere():
    rod = np.array([[0.3, 0.1, 0.5, 0.3, 0.1, 0.5, 0.06]])
    points = sample_capsules(rod)
    assert np.allclose(np.linalg.norm(points - rod[0, :3], axis=1), 0.06)
    ball = shapes.Sphere(0.06, pose_of(rod[0, :3]))
    assert np.array_equal(points, surface_of(ball).points)


def test_no_obstacle_gives_no_points():
    assert sample_capsules(np.empty((0, 7))).shape == (0, 3)


def test_every_shape_gives_a_closed_labelled_surface():
    ball = trimesh.creation.icosphere(1, 0.1)
    for shape in (
        shapes.Sphere(0.1),
        shapes.Capsule(0.1, 0.2),
        shapes.Cylinder(0.1, 0.2),
        shapes.Box(np.array([0.1, 0.2, 0.3])),
        shapes.Mesh(ball.vertices, ball.faces),
    ):
        surface = surface_of(shape)
        assert surface.closed and surface.label == type(shape).__name__.lower()
        assert not surface.points.flags.writeable


def test_raw_points_carry_the_radius_their_caller_declares():
    surface = Surface(np.zeros((5, 3)), 0.02)
    assert not surface.closed
    require_covering(surface, 0.03)
    with pytest.raises(BadInput, match="larger than the map's rho"):
        require_covering(surface, 0.01)
    with pytest.raises(BadInput, match="covering radius nan m must be at least 0"):
        Surface(np.zeros((5, 3)), np.nan)


def bad_rod(column, value):
    rods = np.tile([0.0, 0, 0, 0, 0, 0.2, 0.05], (3, 1))
    rods[1, column] = value
    return rods


@each("sample", [sample_capsules, sample_cylinders])
@each(
    ("column", "value", "says"),
    [
        (6, 0.0, "1 has radius 0.0 m"),
        (6, -0.1, "1 has radius -0.1 m"),
        (6, np.nan, "1 has nan in column 6"),
        (2, np.inf, "1 has inf in column 2"),
    ],
)
def test_a_bad_rod_is_named(sample, column, value, says):
    with pytest.raises(BadInput, match=says):
        sample(bad_rod(column, value))


def test_what_cannot_be_covered_is_refused():
    with pytest.raises(BadInput, match=r"\(k, 7\)"):
        sample_capsules(np.zeros(7))
    with pytest.raises(BadInput, match="spacing"):
        sample_capsules(bad_rod(6, 0.05), 0.0)
    with pytest.raises(BadInput, match="no direction"):
        sample_cylinders(bad_rod(5, 0.0))
    with pytest.raises(BadInput, match="edge length"):
        shapes.Box(np.array([0.1, 0.0, 0.1]))
    with pytest.raises(BadInput, match="rigid"):
        shapes.Sphere(0.1, np.diag([1.0, 1, 2, 1]))
    with pytest.raises(BadInput, match="must be at least 0"):
        Surface(np.zeros((1, 3)), -0.1)
    with pytest.raises(BadInput, match="shape"):
        Surface(np.zeros(3), 0.1)


def test_an_open_mesh_is_refused():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    with pytest.raises(BadInput, match="not closed"):
        sampled_mesh(box.vertices, box.faces[:-1])
    with pytest.raises(BadInput, match="missing vertex"):
        sampled_mesh(box.vertices, box.faces + 1)
    with pytest.raises(BadInput, match="too large"):
        sampled_mesh(box.vertices * 1000, box.faces)


@laws
@given(st.floats(0.01, 0.2), lengths, spacings, st.floats(0.01, 0.15), seeds)
def test_a_rounded_obstacle_needs_a_smaller_radius(radius, length, spacing, ball, seed):
    """Wherever a ball touches the capsule, a sample is within ball + that radius."""
    rng = np.random.default_rng(seed)
    needed = rounded_covering(spacing, radius, ball)
    assert needed <= spacing
    samples = surface_of(shapes.Capsule(radius, length), spacing).points
    outer = capsule_surface(rng, radius + 1.0, length)
    axis = np.clip(outer[:, 2], -0.5 * length, 0.5 * length)
    foot = np.column_stack([np.zeros((len(axis), 2)), axis])
    normal = (outer - foot) / (radius + 1.0)
    for size in (1.0, 0.3, 0.0):
        centers = foot + (radius + size * ball) * normal
        assert farthest(centers, samples) <= ball + needed + 1e-12
    larger = rounded_covering(spacing, radius, 1.1 * ball)
    assert larger <= needed + 1e-15


def test_the_reference_arm_needs_two_thirds_of_rho():
    assert rounded_covering(0.03, 0.04, 0.03) == pytest.approx(0.0197, abs=1e-4)
    assert rounded_covering(0.03, 0.01, 0.03) == 0.03


def test_a_mesh_comes_from_a_file_in_its_own_unit(tmp_path):
    box = trimesh.creation.box((100.0, 200.0, 300.0))
    box.export(tmp_path / "box.stl")
    mesh = shapes.Mesh.from_file(tmp_path / "box.stl", scale=1e-3)
    surface = surface_of(mesh, 0.03)
    assert (np.abs(surface.points) <= np.array([0.05, 0.1, 0.15]) + 1e-6).all()
    assert len(surface.points) > 20
    with pytest.raises(BadInput, match="does not exist"):
        shapes.Mesh.from_file(tmp_path / "no.stl")
    (tmp_path / "bad.stl").write_text("nothing")
    with pytest.raises(BadInput, match="repair|cannot be read"):
        shapes.Mesh.from_file(tmp_path / "bad.stl")


@pytest.mark.parametrize("shape", [(2, 3, 4), (9, 2), (9, 4), (3,), ()])
def test_a_hull_of_what_are_no_points_is_refused_and_ends_no_process(shape):
    with pytest.raises(BadInput, match=r"have shape .* give \(n, 3\)"):
        shapes.Mesh.hull_of(np.zeros(shape), np.eye(4))


def test_a_hull_with_corners_nanometres_apart_is_closed():
    """One of a Panda's fingers has such; to make them one tore the hull open."""
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(0)
    corners = 0.03 * np.round(rng.normal(size=(12, 3)), 1)
    points = np.vstack([corners, corners + 2e-9 * rng.normal(size=(12, 3))])
    faces = ConvexHull(points).simplices
    surface = surface_of(shapes.Mesh(points, faces), 0.01)
    assert surface.closed and surface.covering_radius <= 0.01


def test_a_mesh_much_finer_than_its_points_takes_little_and_is_covered(rng):
    ball = trimesh.creation.icosphere(4, 0.02)  # 5120 triangles of 1 mm, 5 cm apart
    many = [ball.vertices + [0.1 * k, 0.0, 0.0] for k in range(3)]
    faces = np.vstack([ball.faces + k * len(ball.vertices) for k in range(3)])
    points, radius = sampled_mesh(np.vstack(many), faces, 0.05)
    assert radius <= 0.05 and len(points) < 30
    surface = trimesh.Trimesh(np.vstack(many), faces, process=False)
    places, _ = trimesh.sample.sample_surface(surface, 4000, seed=1)
    assert cKDTree(points).query(places)[0].max() <= radius + 1e-9


def test_what_a_mesh_holds_is_inside(rng):
    """A ring: its hole, and what is between its bounds and itself, is outside."""
    ring = trimesh.creation.torus(0.5, 0.2, 48, 32)
    T = random_pose(rng)
    triangles = trimesh.transform_points(ring.vertices, T)[ring.faces]
    points = rng.uniform(-0.8, 0.8, (400, 3))
    across = np.hypot(np.linalg.norm(points[:, :2], axis=1) - 0.5, points[:, 2])
    sure = np.abs(across - 0.2) > 0.01  # the facets of its faces lie between
    found = is_inside(triangles, trimesh.transform_points(points, T))
    assert np.array_equal(found[sure], (across < 0.2)[sure]) and 20 < found.sum() < 380
