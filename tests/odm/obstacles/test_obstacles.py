"""Obstacles: arrays in place, samples with a proved covering radius, bad input."""

import copy
import pickle

import numpy as np
import pytest
from nearest import to_nearest
from rows import each
from shapes_drawn import KINDS, draw_shape, draw_shapes, exact_distance

import odm
from odm.obstacles import mesh_surface
from odm.obstacles.mesh_surface import cover_densely
from odm.obstacles.obstacles import SolidRoom, hull_of, lent_arrays
from roadmap.errors import BadInput

CAPSULES = np.array([[0.3, 0.0, 0.4, 0.5, 0.1, 0.6, 0.05]])
TIP = odm.Mesh(np.eye(4)[:, :3], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def dense_surface(shape, rng):
    """Return many points on a shape's surface, by another way than the samples."""
    if isinstance(shape, odm.Mesh):
        points = cover_densely(shape.vertices, shape.faces, 0.01)
    elif isinstance(shape, odm.Box):
        points = rng.uniform(-0.5, 0.5, (3000, 3)) * shape.size
        axis = rng.integers(0, 3, len(points))
        side = rng.choice([-0.5, 0.5], len(points))
        points[np.arange(len(points)), axis] = side * shape.size[axis]
        corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
        points = np.vstack([points, corners * shape.size])
    else:
        out = rng.normal(size=(3000, 3))
        out /= np.linalg.norm(out, axis=1)[:, None]
        length = getattr(shape, "length", 0.0)
        points = shape.radius * out
        points[:, 2] += np.where(out[:, 2] > 0.0, 0.5, -0.5) * length
        tube = rng.random(len(points)) < 0.5
        round_ = out[:, :2] / np.linalg.norm(out[:, :2], axis=1)[:, None]
        points[tube, :2] = shape.radius * round_[tube]
        points[tube, 2] = rng.uniform(-0.5, 0.5, tube.sum()) * length
        if isinstance(shape, odm.Cylinder):
            reach = np.sqrt(rng.random(len(points)))[:, None] * shape.radius
            points[~tube, :2] = (round_ * reach)[~tube]
            points[~tube, 2] = rng.choice([-0.5, 0.5], (~tube).sum()) * length
    T = shape.T_base_shape
    return points @ T[:3, :3].T + T[:3, 3]


def samples_of(planner, shapes):
    """Return the samples that a frame of the planner makes of shapes."""
    planner.step(odm.Obstacles.of(shapes), q=planner.cell_map.roadmap.nodes[0])
    return planner.points.copy()


@pytest.mark.parametrize("kind", KINDS)
def test_a_ball_that_meets_a_shape_has_a_sample_near(kind, planner, rng):
    """Within rho of it: the smallest ball asked about, larger ones, of all sizes."""
    ball = planner.memory.arm.spheres[:, 3].min() + planner.cell_map.safety.m
    rho, farthest = planner.rho, 0.0
    for _ in range(40):
        shape = draw_shape(kind, rng, spread=0.2)
        points = samples_of(planner, [shape])
        assert exact_distance(shape, points).max() < 1e-7
        surface = dense_surface(shape, rng)
        for radius in (ball, 1.3 * ball, 4.0 * ball):
            out = rng.normal(size=surface.shape)
            out /= np.linalg.norm(out, axis=1)[:, None]
            centers = surface + radius * rng.uniform(0.5, 1.0, (len(out), 1)) * out
            apart = to_nearest(centers, points) - radius
            assert apart.max() <= rho + 1e-9
            farthest = max(farthest, apart.max())
    assert farthest > 0.7 * rho  # no more samples than that takes


def test_a_mesh_first_seen_in_a_frame_costs_a_third_and_few_more_points(rng):
    mesh = odm.Mesh.hull_of(rng.normal(size=(12, 3)) * 0.06, np.eye(4))
    hull = hull_of(mesh)
    asked = []
    choose = mesh_surface.greedy_cover

    def counted(*lists):
        asked.append(sum(len(one) for one in lists))
        return choose(*lists)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(mesh_surface, "greedy_cover", counted)
        points = hull.samples(0.03)
        more, _ = mesh_surface.sample_closed_mesh(hull.vertices, hull.triangles, 0.03)
    assert 3 * asked[0] < asked[1]
    assert len(points) <= 1.25 * len(more)
    gap = to_nearest(cover_densely(hull.vertices, hull.triangles, 0.003), points)
    assert gap.max() <= 0.03 + 1e-9


def test_the_part_of_a_large_shape_inside_the_grid_is_sampled(planner, rng):
    T = np.eye(4)
    T[:3, 3] = [0.3, 0.0, -5.0]
    wall = odm.Box([40.0, 40.0, 10.2], T)  # its top at 0.1
    rod = odm.Capsule.between([-50.0, 0.2, 0.4], [50.0, 0.2, 0.4], 0.05)
    grid = planner.cell_map.grid
    for shape in (wall, rod):
        points = samples_of(planner, [shape])
        assert 20 < len(points) < 60_000
        surface = dense_surface(odm.Box([2.0, 2.0, 10.2], T), rng)
        surface = surface[surface[:, 2] > 0.1 - 1e-9]  # the sides are farther out
        if shape is rod:
            mid = odm.Capsule.between([-1.0, 0.2, 0.4], [1.0, 0.2, 0.4], 0.05)
            surface = dense_surface(mid, rng)
            surface = surface[np.abs(surface[:, 0]) < 0.99]
        surface = surface[(grid.locate(surface) >= 0).all(axis=1)]
        gap = to_nearest(surface, points)
        assert len(surface) > 50 and gap.max() <= 1.5 * planner.rho


def test_arrays_are_written_in_place_and_read_in_the_frame(planner):
    q = planner.cell_map.roadmap.nodes[0].copy()
    obstacles = odm.Obstacles(capsules=1, spheres=np.array([[2.0, 2.0, 2.0, 0.1]]))
    answer = planner.step(obstacles, q=q)
    assert answer.status == "holding" and "capsule 0 is not finite" in answer.reason
    obstacles.capsules[:] = CAPSULES
    planner.step(obstacles, q=q)
    first = planner.separation(q)
    assert planner.trouble is None
    obstacles.capsules[0, :6] += 0.1
    planner.step(obstacles, q=q)
    assert planner.separation(q) != first
    obstacles.capsules = CAPSULES
    planner.step(obstacles, q=q)
    assert planner.separation(q) == first


def test_the_same_shapes_give_the_same_samples_whatever_was_before(planner, rng):
    first = [draw_shapes(rng, int(rng.integers(1, 6)), spread=0.2) for _ in range(12)]
    alone = []
    for shapes in first:
        fresh = odm.ReactivePlanner(planner.cell_map)
        alone.append(samples_of(fresh, shapes))
    for k in rng.integers(0, len(first), 40):
        assert np.array_equal(samples_of(planner, first[k]), alone[k])


def test_points_and_shapes_come_together(planner, rng):
    q = planner.cell_map.roadmap.nodes[0].copy()
    points = rng.uniform(-0.3, 0.3, (50, 3)) + [0.0, 0.0, 0.5]
    obstacles = odm.Obstacles(capsules=CAPSULES, points=points)
    answer = planner.step(obstacles, q=q)
    assert answer.certified == "visible surface"
    assert np.array_equal(planner.points[:50], points)
    obstacles.points = np.zeros((0, 3))
    answer = planner.step(obstacles, q=q)
    assert answer.certified == "whole surface"
    alone = planner.separation(q)
    planner.step(np.zeros((0, 3)), q=q)
    assert planner.separation(q) == np.inf > alone  # the shapes are gone


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda o: o.capsules.__setitem__((0, 0), np.nan), "capsule 0 .* not finite"),
        (lambda o: o.capsules.__setitem__((0, 6), 0.0), "radius that is not above 0"),
        (lambda o: o.spheres.__setitem__((1, 3), -1.0), "sphere 1 has a radius"),
        (lambda o: o.cylinders.__setitem__((0, slice(0, 6)), 0.5), "two equal ends"),
        (lambda o: o.boxes.__setitem__((0, 14), 0.0), "edge length that is not above"),
        (lambda o: o.boxes.__setitem__((0, 0), 1.1), "box 0 .* no rigid motion"),
        (lambda o: o.boxes.__setitem__((0, slice(0, 3)), -o.boxes[0, :3]), "no rigid"),
        (lambda o: o.poses.__setitem__((0, 1, 1), np.inf), "mesh 0 is not finite"),
        (lambda o: o.capsules.__setitem__((0, 0), 2e3), "larger than 1000 m"),
        (lambda o: o.spheres.__setitem__((0, 3), 90.0), "radius above 5 m"),
    ],
)
def test_a_bad_value_holds_the_robot_and_says_which_shape(planner, change, text, rng):
    q = planner.cell_map.roadmap.nodes[0].copy()
    planner.set_goals([planner.cell_map.roadmap.nodes[5]])
    shapes = [draw_shape(kind, rng) for kind in (*KINDS, "sphere")]
    obstacles = odm.Obstacles.of(shapes)
    change(obstacles)
    answer = planner.step(obstacles, q=q)
    assert answer.status == "holding"
    import re

    assert re.search(text, answer.reason)
    assert not planner.is_free(q, q) and planner.blocked_leg(q[None]) == 0
    assert planner.separation(q) == -np.inf


@each(
    ("given", "text"),
    [
        (
            {"capsules": np.zeros((2, 6))},
            r"capsules have shape \(2, 6\); give \(k, 7\)",
        ),
        ({"spheres": -1}, "-1 spheres were asked for"),
        ({"cylinders": 2**70}, "cylinders were asked for; give 0 to 1000000"),
        ({"boxes": "box"}, "boxes must be an array"),
        ({"meshes": ["mesh"]}, "mesh 0 is a str; give an odm.Mesh"),
        ({"points": np.zeros((3, 2))}, r"points have shape \(3, 2\)"),
        ({"capsules": 1, "labels": {"capsules": ["a", "b"]}}, "2 labels of capsules"),
        ({"labels": {"capsule": ["a"]}}, "give a mapping from some of capsules"),
        ({"capsules": 1, "classes": {"capsules": [7]}}, "class 7"),
    ],
)
def test_a_wrong_shape_raises(given, text):
    with pytest.raises(BadInput, match=text):
        odm.Obstacles(**given)


@each("classes", ["x", [1], [1.0, 2.0], [0, 7], [[0, 1]], 5, object()])
def test_classes_that_are_none_are_refused_and_those_before_stay(classes):
    obstacles = odm.Obstacles(spheres=2, classes={"spheres": [1, 2]})
    with pytest.raises(BadInput, match="classes"):
        obstacles.shape_classes = classes
    assert obstacles.shape_classes.tolist() == [1, 2]
    obstacles.shape_classes = [2, 0]
    assert obstacles.shape_classes.dtype == np.int8
    assert obstacles.shape_classes.tolist() == [2, 0]


@each("labels", ["x", ["a"], 5, {"spheres": ["a", "b"]}, {"sphere": ["a"]}])
def test_labels_that_are_none_are_refused_and_those_before_stay(labels):
    obstacles = odm.Obstacles(spheres=1, labels={"spheres": ["head"]})
    with pytest.raises(BadInput, match="labels"):
        obstacles.labels = labels
    assert obstacles.name(0) == "sphere 0 (head)"
    obstacles.labels = None
    assert obstacles.name(0) == "sphere 0"


def test_another_number_of_rows_is_refused_and_a_wrong_kind_of_shape():
    obstacles = odm.Obstacles(capsules=2)
    with pytest.raises(BadInput, match="made for .2, 7."):
        obstacles.capsules = np.zeros((3, 7))
    with pytest.raises(BadInput, match="a str is no shape"):
        odm.Obstacles.of(["box"])


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda o: pickle.loads(pickle.dumps(o))]
)
@pytest.mark.parametrize("others", [{}, {"boxes": 1}])
def test_what_is_written_into_a_copy_counts(again, others):
    copied = again(odm.Obstacles(capsules=CAPSULES, **others))
    copied.capsules[0, 0] = 5.0
    assert lent_arrays(copied)[0][0] == 5.0 and repr(copied).startswith(
        "Obstacles(1 capsules"
    )


def test_nobody_changes_how_much_compiled_loops_read():
    """With more rows told than there are, they would read what lies behind them."""
    obstacles = odm.Obstacles(capsules=CAPSULES, meshes=[TIP])
    assert obstacles.told_classes is None  # an array once somebody asked for it
    obstacles.shape_classes[:] = odm.CONTACT
    public = {name for name in dir(obstacles) if not name.startswith("_")}
    arrays = {n for n in public if isinstance(getattr(obstacles, n), np.ndarray)}
    assert arrays == {"capsules", "spheres", "cylinders", "boxes", "poses"} | {
        "points", "shape_classes", "told_classes"
    }  # fmt: skip
    assert type(obstacles.meshes) is tuple


def test_poses_that_are_set_move_the_meshes():
    obstacles = odm.Obstacles(meshes=[TIP])
    obstacles.poses = np.eye(4)[None, :3] + 0.5
    assert (lent_arrays(obstacles)[0].reshape(3, 4) == np.eye(4)[:3] + 0.5).all()
    with pytest.raises(BadInput, match="made for .1, 3, 4."):
        obstacles.poses = np.eye(4)


def test_labels_name_the_shape(planner):
    labels = {"capsules": ["forearm"]}
    obstacles = odm.Obstacles(capsules=CAPSULES, labels=labels)
    assert obstacles.name(0) == "capsule 0 (forearm)"
    grown = odm.Obstacles(spheres=np.array([[0, 0, 0.5, 0.4]]), labels={})
    assert grown.name(0) == "sphere 0"


def test_shapes_outside_the_frame_know_bad_values():
    room = SolidRoom()
    assert room.of(odm.Obstacles(capsules=CAPSULES), np.eye(4)).count[0] == 1
    assert room.of(odm.Obstacles(capsules=1), np.eye(4)) is None


def test_a_mesh_that_is_not_convex_counts_as_its_hull(rng):
    cup = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.2, 0.2, 0.2]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]])
    obstacles = odm.Obstacles(meshes=[odm.Mesh(cup, faces)])
    assert len(obstacles.meshes[0].faces) == 4
    with pytest.raises(BadInput, match="mesh 0 is flat"):
        odm.Obstacles(meshes=[odm.Mesh(cup * [1, 1, 0], faces)])


def test_a_name_with_a_slip_is_an_error_and_not_kept():
    obstacles = odm.Obstacles(capsules=1)
    with pytest.raises(AttributeError, match="capsule"):
        obstacles.capsule = np.zeros((1, 7))


def test_classes_and_labels_of_none_are_as_if_they_were_left_out():
    """Who hands on an argument of their own need not ask whether it is there."""
    told = {"capsules": None, "spheres": [int(odm.CONTACT)]}
    found = odm.Obstacles(
        capsules=CAPSULES, spheres=np.ones((1, 4)), classes=told, labels={"boxes": None}
    )
    expected = [odm.AVOID] * len(CAPSULES) + [odm.CONTACT]
    np.testing.assert_array_equal(found.shape_classes, expected)
