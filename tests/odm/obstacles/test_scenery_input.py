"""Scenery that would block nothing is refused: each number of each type."""

import numpy as np
import pytest
import trimesh
from rows import each
from shapes_drawn import exact_distance
from wrappers import with_wrapper

import odm
from odm.close_test._static import solid_distance
from odm.obstacles.mesh_surface import is_inside
from odm.obstacles.scenery import Scenery, parse_scenery
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from odm.obstacles.surfaces import Surface, surface_of
from roadmap.errors import BadInput, BadRecipe
from roadmap.transforms import pose_of

solid_distance = with_wrapper(solid_distance)

PLANE = {"type": "plane", "normal": [0.0, 0.0, 1.0], "offset": 0.1}
BOX = {
    "type": "box",
    "size": [1.0, 2.0, 3.0],
    "position": [0.0, 1.0, 2.0],
    "rpy": [0.0, 0.1, 0.2],
}
MESH = {
    "type": "mesh",
    "file": "none.stl",
    "scale": 1.0,
    "position": [0.0, 1.0, 2.0],
    "rpy": [0.0, 0.1, 0.2],
    "covering_radius": 0.01,
}
SPHERE = {
    "type": "sphere",
    "radius": 0.1,
    "position": [0.0, 1.0, 2.0],
    "covering_radius": 0.02,
}
CAPSULE = {**SPHERE, "type": "capsule", "length": 0.4, "rpy": [0.0, 0.1, 0.2]}
CYLINDER = {**CAPSULE, "type": "cylinder"}
WRONG = [np.nan, np.inf, -np.inf, 1e9, None, "1", True, [1.0], {}]
SHAPES = {"box": Box, "sphere": Sphere, "capsule": Capsule, "cylinder": Cylinder}
CELL = """cell
* table
1
box
0.4 0.6 0.1
0.5 0 0.2
0 0 0 1
0 0 0 0
* post
1
cylinder
0.05 0.8
0 0.5 0.4
0 0 0 1
0 0 0 0
.
"""
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def numbers():
    """Yield each table with each place in it where a number stands."""
    for table in (PLANE, BOX, MESH, SPHERE, CAPSULE, CYLINDER):
        for key, value in table.items():
            if isinstance(value, list):
                yield from ((table, key, i) for i in range(len(value)))
            elif isinstance(value, float):
                yield table, key, None


def changed(table, key, at, value):
    """Return a table with another value at one place."""
    if at is not None:
        value = [value if i == at else v for i, v in enumerate(table[key])]
    return {**table, key: value}


@each("wrong", WRONG)
@each(("table", "key", "at"), numbers())
def test_each_number_of_a_recipe_must_be_one(table, key, at, wrong):
    if (key, at) == ("scale", None) and wrong == [1.0]:
        return  # told as three numbers
    with pytest.raises(BadRecipe, match=f"scenery 0: {key} is "):
        parse_scenery((changed(table, key, at, wrong),))


@pytest.mark.parametrize("table", [SPHERE, CAPSULE, CYLINDER, BOX])
def test_scenery_of_simple_shapes_is_exact(table, rng):
    found = parse_scenery((table, PLANE, {**table, "name": "it"}))
    assert len(found.points) == 0 and found.covering_radius == 0.0
    assert found.names == (f"{table['type']} 0", "plane 1", "it")
    sizes = [table[key] for key in ("size", "radius", "length") if key in table]
    pose = pose_of(table["position"], table.get("rpy", (0.0, 0.0, 0.0)))
    shape = SHAPES[table["type"]](*sizes, pose)
    points = pose[:3, 3] + rng.uniform(-2.0, 2.0, (300, 3))
    exact = exact_distance(shape, points)
    (name, drawn), *_ = found.shapes()
    assert name == found.names[0] and len(found.shapes()) == 2
    assert np.allclose(exact_distance(drawn, points), exact, atol=1e-9)
    for row in (found.solids[0], found.solids[2]):
        d = [solid_distance(*p, row, found.faces) for p in points]
        assert np.allclose(np.maximum(d, 0.0), exact, atol=1e-9)


def test_a_small_convex_mesh_is_exact_and_another_one_is_sampled(tmp_path, rng):
    import trimesh

    hull = trimesh.creation.icosphere(1, 0.2)
    bent = trimesh.util.concatenate(
        [trimesh.creation.box((0.4, 0.1, 0.1)), trimesh.creation.box((0.1, 0.1, 0.4))]
    )
    for name, mesh in (("hull", hull), ("bent", bent)):
        mesh.export(tmp_path / f"{name}.stl")
    place = {"position": [0.3, 0.0, 0.5], "rpy": [0.3, 0.2, 0.1]}
    found = parse_scenery(
        (BOX, {"type": "mesh", "file": "hull.stl", "scale": 0.5, **place}), tmp_path
    )
    assert len(found.points) == 0 and len(found.faces) == len(hull.faces)
    vertices = 0.5 * np.asarray(hull.vertices)
    shape = Mesh(vertices, hull.faces, pose_of(place["position"], place["rpy"]))
    points = np.array(place["position"]) + rng.uniform(-0.6, 0.6, (300, 3))
    exact = exact_distance(shape, points)
    d = [solid_distance(*p, found.solids[1], found.faces) for p in points]
    assert np.allclose(np.maximum(d, 0.0), exact, atol=1e-6)
    assert np.allclose(exact_distance(found.shapes()[1][1], points), exact, atol=1e-9)
    far = np.array([4.0, 0.0, 0.5])  # there a ball around it is told
    lower = solid_distance(*far, found.solids[1], found.faces)
    assert 0.9 * exact_distance(shape, far[None])[0] < lower
    assert lower <= exact_distance(shape, far[None])[0]
    again = Scenery.from_store(found.meta(), found.arrays())
    assert np.array_equal(again.faces, found.faces)
    sampled = parse_scenery(({"type": "mesh", "file": "bent.stl"},), tmp_path)
    assert len(sampled.points) and not len(sampled.solids)
    assert sampled.covering_radius <= 0.01


def test_a_scene_file_is_scenery(tmp_path):
    (tmp_path / "cell.scene").write_text(CELL)
    table = {"type": "file", "file": "cell.scene", "position": [0.0, 0.0, 0.1]}
    found = parse_scenery((table, PLANE), tmp_path)
    assert found.names == ("table", "post", "plane 1")
    assert np.allclose(found.solids[0, 1:4], [0.5, 0.0, 0.3])
    with pytest.raises(BadRecipe, match="scenery 0: there is no file"):
        parse_scenery(({**table, "file": "none.scene"},), tmp_path)
    (tmp_path / "broken.scene").write_text(CELL[:60])
    with pytest.raises(BadRecipe, match="scenery 0: scene file .* in line"):
        parse_scenery(({**table, "file": "broken.scene"},), tmp_path, meshes=False)


@each("wrong", [None, 3, [], [1.0, 2.0], "abc", [[1.0], [1.0, 2.0]]])
@each(("table", "key"), [(PLANE, "normal"), (BOX, "size"), (BOX, "rpy"), (MESH, "rpy")])
def test_each_row_of_a_recipe_has_three_numbers(table, key, wrong):
    with pytest.raises(BadRecipe, match=f"scenery 0: {key} is "):
        parse_scenery(({**table, key: wrong},))


@each("table", [None, 3, "plane", {"type": []}, {"type": None}, {}])
def test_a_table_of_no_known_type_is_refused(table):
    told = (
        "choose one of plane, box, mesh, sphere, capsule, cylinder"
        if isinstance(table, dict)
        else "scenery 0"
    )
    with pytest.raises(BadRecipe, match=told):
        parse_scenery((table,))


@pytest.mark.parametrize("table", [BOX, SPHERE, CAPSULE, CYLINDER])
def test_what_stands_far_away_is_in_another_unit(table):
    there = {**table, "position": [95.0, 0.0, 0.0]}
    assert len(parse_scenery((there,)).solids) == 1
    told = r"scenery 0: .* would stand 1.. m from the robot's base, more than 100 m"
    with pytest.raises(BadRecipe, match=told):
        parse_scenery(({**table, "position": [0.0, 180.0, 0.0]},))


@pytest.mark.parametrize("shift", [120.0, 800.0])
def test_a_cell_in_millimetres_is_not_built_beside_the_robot(tmp_path, shift):
    (tmp_path / "mm.scene").write_text(
        f"s\n* box\n{shift} 0 0\n0 0 0 1\n1\nbox\n20 20 20\n0 0 0\n0 0 0 1\n"
        "0 0 0 0\n0\n.\n"
    )
    with pytest.raises(BadRecipe, match="'box' would stand .* give metres"):
        parse_scenery(({"type": "file", "file": "mm.scene"},), tmp_path)


def test_a_scene_of_nothing_is_no_scenery(tmp_path):
    table = {"type": "file", "file": "empty.scene"}
    for text in ("empty\n.\n", "one\n* it\n0 0 0\n0 0 0 1\n0\n0\n.\n"):
        (tmp_path / "empty.scene").write_text(text)
        with pytest.raises(BadRecipe, match="holds no shapes, so nothing would stand"):
            parse_scenery((table,), tmp_path)


def test_a_normal_of_any_length_is_one(rng):
    for length in (1e-200, 1e-9, 7.0, 900.0):
        row = parse_scenery(({"type": "plane", "normal": [0, 0, length]},)).solids[0]
        assert np.allclose(row[:5], [0, 0, 0, 1, 0])
    for table in ({**PLANE, "normal": [0, 0, 0]}, {**BOX, "size": [1, 0, 1]}):
        with pytest.raises(BadRecipe, match="scenery 0"):
            parse_scenery((table,))


@each("column", range(16))
def test_a_solid_that_blocks_nothing_is_no_scenery(column):
    rows = parse_scenery((PLANE, BOX)).solids.copy()
    rows[1, column] = np.nan
    with pytest.raises(BadRecipe, match="block nothing"):
        Scenery(rows)


@each(
    "given",
    [
        {"points": np.array([[0, np.nan, 0]])},
        {"covering_radius": np.nan},
        {"points": np.zeros((3, 2))},
        {"solids": np.zeros((3, 15))},
    ],
)
def test_other_scenery_that_is_none_is_refused(given):
    with pytest.raises(BadRecipe):
        Scenery(**given)


# --- scenery of a place -----------------------------------------------------------


def turned(at, value):
    """Return a pose with one wrong number."""
    T = np.eye(4)
    T[at] = value
    return T


@each("wrong", [np.nan, np.inf, -0.1, 1e9, "1", None])
@each(
    "make",
    [
        Sphere,
        lambda x: Capsule(x, 1.0),
        lambda x: Capsule(1.0, x),
        lambda x: Cylinder(x, 1.0),
        lambda x: Cylinder(1.0, x),
        lambda x: Box([1, x, 1]),
    ],
)
def test_each_size_of_a_shape_must_be_one(make, wrong):
    with pytest.raises(BadInput):
        make(wrong)


@each(
    "T",
    [
        turned((0, 3), np.nan),
        turned((1, 1), np.nan),
        turned((2, 2), -1.0),
        turned((0, 0), 1.1),
        turned((3, 0), 0.5),
        turned((3, 3), 0.0),
        turned((3, 3), 2.0),
        np.eye(3),
        "here",
        None,
    ],
)
def test_each_pose_of_a_shape_must_be_rigid(T):
    for make in (
        lambda: Sphere(1.0, T),
        lambda: Capsule(1.0, 1.0, T),
        lambda: Box([1, 1, 1], T),
        lambda: Mesh(CORNERS, FACES, T),
    ):
        with pytest.raises(BadInput):
            make()


@each(
    ("call", "told"),
    [
        (lambda: Sphere(0.1).moved(np.zeros(3)), r"T has shape \(3,\); give"),
        (lambda: Sphere(0.1).moved("here"), "T, a str, holds no real numbers"),
        (lambda: Sphere(0.1, 1j * np.eye(4)), "a shape, a ndarray, holds no real"),
        (lambda: Capsule.between([0, 0], [0, 1], 0.1), r"have shape \(2,\); give two"),
        (lambda: Capsule.between("a", [0, 0, 1], 0.1), "must be an array of real"),
        (lambda: Surface("x", 0.1), "points must be an array of real numbers"),
        (lambda: odm.sample_capsules("x"), "capsule rows must be an array of real"),
        (lambda: odm.sample_capsules([[1, 2], [1]]), "all rows of the same length"),
    ],
)
def test_what_is_no_pose_and_no_place_is_told_in_a_sentence(call, told):
    with pytest.raises(BadInput, match=told) as error:
        call()
    assert "\n" not in str(error.value)


def test_a_pose_in_single_precision_is_one_and_one_off_by_5e_6_is_none():
    T = pose_of([0.1, 0.2, 0.3], [0.4, -0.5, 0.6])
    single = T.astype(np.float32)
    assert np.abs(single[:3, :3] @ single[:3, :3].T - np.eye(3)).max() > 1e-8
    assert np.array_equal(Box([1, 1, 1], single).T_base_shape, single)
    T[:3, 0] *= 1.0 + 2.5e-6
    with pytest.raises(BadInput, match=r"off by .*e-06 \(limit 1e-6\)"):
        Box([1, 1, 1], T)


@each(
    ("vertices", "faces"),
    [
        (CORNERS * np.nan, FACES),
        (CORNERS, FACES + 1),
        (CORNERS, FACES - 1),
        (CORNERS, FACES * np.nan),
        (CORNERS, FACES + 0.5),
        (CORNERS, "abc"),
        ([], []),
    ],
)
def test_a_mesh_of_no_numbers_is_refused(vertices, faces):
    with pytest.raises(BadInput):
        Mesh(vertices, faces)


def test_a_mesh_whose_faces_turn_both_ways_is_turned_outside_out():
    """As qhull makes them; what is in such a mesh counted as outside of it."""
    ball = trimesh.creation.icosphere(2, 0.1)
    faces = np.array(ball.faces)
    faces[::2] = faces[::2, ::-1]
    assert not is_inside(ball.vertices[faces], np.zeros((1, 3)))[0]
    soup = np.arange(faces.size).reshape(-1, 3)  # as in an STL: no common corners
    for mesh in (
        Mesh(ball.vertices, faces),
        Mesh(ball.vertices[faces].reshape(-1, 3), soup),
        Mesh(ball.vertices, np.array(ball.faces)[:, ::-1]),
    ):
        corners = mesh.vertices[mesh.faces]
        out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", out, corners.mean(axis=1)) > 0.0).all()
        assert is_inside(corners, np.zeros((1, 3)))[0]


def test_a_hollow_in_a_mesh_stays_one():
    shell = trimesh.creation.icosphere(2, 0.1)
    hollow = np.array(shell.faces)[:, ::-1] + len(shell.vertices)
    vertices = np.concatenate([shell.vertices, 0.5 * shell.vertices])
    mesh = Mesh(vertices, np.concatenate([shell.faces, hollow]))
    inside = is_inside(mesh.vertices[mesh.faces], np.array([[0, 0, 0], [0, 0, 0.075]]))
    assert inside.tolist() == [False, True]


def test_a_mesh_with_a_hole_is_refused_where_it_is_made(tmp_path):
    cup = trimesh.creation.icosphere(2, 0.1)
    assert len(Mesh(cup.vertices, cup.faces).faces) == len(cup.faces)
    with pytest.raises(BadInput, match=r"319 faces is not closed.*: 3 edges.*fill"):
        Mesh(cup.vertices, cup.faces[:-1])
    trimesh.Trimesh(cup.vertices, cup.faces[:-1]).export(tmp_path / "cup.stl")
    with pytest.raises(BadInput, match=r"cup\.stl: a mesh of 319 faces"):
        Mesh.from_file(tmp_path / "cup.stl")
    with pytest.raises(BadInput, match="not closed"):
        Mesh(np.eye(3), [[0, 0, 0]])  # nothing is left of it
    with pytest.raises(BadInput, match="not closed"):
        Mesh(CORNERS, FACES[1:])


def test_a_mesh_whose_triangles_share_no_corners_is_closed_all_the_same():
    apart = Mesh(
        CORNERS[FACES].reshape(-1, 3), np.arange(3 * len(FACES)).reshape(-1, 3)
    )
    assert len(surface_of(apart, 0.03).points)


def test_a_mesh_that_is_inside_out_is_turned(planner):
    turned_faces = FACES[:, ::-1]
    one, other = Mesh(CORNERS, FACES), Mesh(CORNERS, turned_faces)
    assert {tuple(np.roll(f, -f.argmin())) for f in one.faces} == {
        tuple(np.roll(f, -f.argmin())) for f in other.faces
    }
    a, b, c = (other.vertices[other.faces[:, k]] for k in range(3))
    assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0.0
    mirrored = Mesh(CORNERS * [1.0, -1.0, 1.0], FACES)  # as scale="1 -1 1" of a URDF
    a, b, c = (mirrored.vertices[mirrored.faces[:, k]] for k in range(3))
    assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0.0


@pytest.mark.parametrize(
    "place",
    [
        [np.zeros((4, 3))],
        [None],
        ["box"],
        3,
        "box",
        np.array(["a"]),
        np.zeros((2, 2)),
        np.array([[0.0, np.inf, 0.0]]),
    ],
)
def test_a_place_of_no_shapes_is_refused_and_forgotten(planner, place):
    with pytest.raises(BadInput):
        planner.set_static(place)
    planner.set_base(np.eye(4))
    assert planner.is_free(np.zeros(3), np.zeros(3))


def test_points_of_a_surface_must_be_finite(planner):
    with pytest.raises(BadInput, match="1 points of post are NaN"):
        Surface(np.array([[0, 0, 1], [np.nan, 0, 0]]), 0.01, "post")
    with pytest.raises(BadInput, match="covering radius"):
        Surface(np.zeros((1, 3)), np.nan)


def test_shapes_as_large_as_towns_are_refused_before_they_fill_the_memory(planner):
    large = (Box([900, 900, 900]), Sphere(500), Capsule(200, 100), Cylinder(200, 9))
    for shape in large:
        with pytest.raises(BadInput, match="give metres"):
            surface_of(shape, 0.03)
        with pytest.raises(BadInput, match="give metres"):
            planner.set_static(shape)


@pytest.mark.parametrize("T", [turned((0, 3), np.nan), turned((0, 0), 2.0)])
def test_a_base_that_stands_nowhere_is_refused(planner, T):
    with pytest.raises(BadInput):
        planner.set_base(T)
    assert planner.is_free(np.zeros(3), np.zeros(3))


def test_sound_shapes_are_sampled_as_before(planner):
    for shape in (Sphere(0.1), Box([1, 2, 0.5]), Capsule(0.1, 0.0), Cylinder(0.1, 1)):
        assert len(odm.surface_of(shape, 0.03).points)
    assert len(surface_of(Mesh(CORNERS, FACES), 0.03).points)
