"""Objects: closed solids of their size and mass; meshes that are none are refused."""

import numpy as np
import pytest
import trimesh

from handover import load_object, make_object, object_names
from handover.grasps.objects import _volume, part_triangles
from handover.grasps.surface import even_points
from odm.obstacles.shapes import Mesh
from roadmap.errors import BadInput


@pytest.mark.parametrize("name", object_names())
def test_our_objects_are_closed_and_of_a_hand_s_size(name):
    thing = load_object(name)
    for part in thing.parts:
        mesh = trimesh.Trimesh(part.vertices, part.faces)
        assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert 0.1 <= thing.mass_kg <= 1.0 and 0.05 < thing.radius < 0.3
    assert load_object(name).fingerprint() == thing.fingerprint()


def test_the_centre_of_mass_is_that_of_the_parts_by_mass():
    hammer = load_object("hammer")
    centers = [trimesh.Trimesh(p.vertices, p.faces).center_mass for p in hammer.parts]
    expected = np.average(centers, axis=0, weights=hammer.masses)
    np.testing.assert_allclose(hammer.center, expected, atol=1e-9)
    assert hammer.center[0] > 0.08  # the head is heavy


def test_the_cup_is_hollow():
    cup = load_object("cup").parts[0]
    mesh = trimesh.Trimesh(cup.vertices, cup.faces)
    inside = trimesh.proximity.signed_distance(mesh, [[0, 0, 0.05], [0, 0, 0.003]])
    assert inside[0] < 0 < inside[1]


def test_samples_are_even_and_on_the_outside_of_the_union():
    hammer = load_object("hammer")
    points, normals = even_points(hammer, 90, np.random.default_rng(3))
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    gaps[np.diag_indices(len(points))] = np.inf
    assert gaps.min(axis=1).max() < 2.5 * gaps.min()
    for part in hammer.parts:
        mesh = trimesh.Trimesh(part.vertices, part.faces)
        assert trimesh.proximity.signed_distance(mesh, points).max() < 1e-6
        outside = trimesh.proximity.signed_distance(mesh, points + 1e-3 * normals)
        assert outside.max() < 1e-6


def write(tmp_path, mesh, name="thing.stl"):
    mesh.export(tmp_path / name)
    return tmp_path / name


def test_a_mesh_file_becomes_an_object(tmp_path):
    path = write(tmp_path, trimesh.creation.box((100.0, 60.0, 40.0)))
    thing = load_object(path, mass_kg=0.2, scale=0.001)
    assert thing.name == "thing" and thing.mass_kg == 0.2
    assert thing.radius == pytest.approx(0.5 * np.linalg.norm((0.1, 0.06, 0.04)))
    light = load_object(path, scale=0.001)
    assert light.mass_kg == pytest.approx(500 * 0.1 * 0.06 * 0.04)


def test_an_open_mesh_is_refused(tmp_path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.faces = box.faces[1:]
    with pytest.raises(BadInput, match=r"thing.*not closed.*fill its holes"):
        load_object(write(tmp_path, box), mass_kg=0.1)


def test_an_empty_mesh_is_refused(tmp_path):
    (tmp_path / "none.stl").write_text("solid none\nendsolid none\n")
    with pytest.raises(BadInput, match="mesh"):
        load_object(tmp_path / "none.stl")


@pytest.mark.filterwarnings("error")
def test_a_corner_too_far_off_for_any_table_is_told_in_a_sentence_alone(tmp_path):
    cup = load_object("cup").parts[0]
    far = trimesh.Trimesh(cup.vertices.copy(), cup.faces, process=False)
    far.vertices[0] = 1e30
    with pytest.raises(BadInput, match="e.30 m long"):
        load_object(write(tmp_path, far))


def test_a_cup_of_twenty_metres_is_in_the_wrong_unit(tmp_path):
    cup = load_object("cup").parts[0]
    huge = trimesh.Trimesh(cup.vertices * 200.0, cup.faces)
    with pytest.raises(BadInput, match=r"is 19 m long.* to 1 m; if .* a scale of 0.01"):
        load_object(write(tmp_path, huge), mass_kg=0.1)
    with pytest.raises(BadInput, match=r"thing is 300 m long.*a scale of 0.001"):
        load_object(write(tmp_path, trimesh.creation.box((300, 90, 90))), mass_kg=0.1)
    with pytest.raises(BadInput, match="give all lengths in metres"):
        load_object(write(tmp_path, trimesh.creation.box([1e-3] * 3)), mass_kg=0.1)


def test_a_mesh_that_is_inside_out_is_turned_and_one_that_is_so_in_part():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    for faces in (box.faces[:, ::-1], np.vstack([box.faces[:6], box.faces[6:, ::-1]])):
        thing = make_object("box", [Mesh(box.vertices, faces)], [0.1])
        assert abs(_volume(part_triangles(thing.parts[0])) - 1e-3) < 1e-12


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan, 200.0])
def test_a_mass_that_is_none_is_refused(mass):
    with pytest.raises(BadInput, match="mass"):
        make_object("cup", load_object("cup").parts, [mass])


def test_an_unknown_object_gets_the_list():
    with pytest.raises(BadInput, match=r"no object 'hamer'.*cup.*hammer.*closed mesh"):
        load_object("hamer")


def test_our_objects_have_their_own_mass_and_size():
    with pytest.raises(BadInput, match="leave mass and scale out"):
        load_object("cup", mass_kg=1.0)
