"""Grasp sets: fingers touch and never overlap, what is kept holds, bytes stay."""

import fcl
import numpy as np
import pytest

from handover import GraspSettings, build_grasps, load_grasps, load_hand, load_object
from handover.grasps import _closing as kernels
from handover.grasps.closing import close, is_outside, target_of
from handover.grasps.holding import Contacts, closure_quality, quality_bound, wrenches
from roadmap.errors import BadInput, BadMap

FEW = GraspSettings(samples=8, rolls=2)


@pytest.fixture(scope="module")
def cup():
    """Return a few grasps of the cup by the SDH."""
    return build_grasps(load_object("cup"), "sdh", FEW, threads=2)


def fcl_mesh(thing):
    """Return an object as python-fcl sees it: one mesh a part."""
    found = []
    for part in thing.parts:
        model = fcl.BVHModel()
        model.beginModel(len(part.vertices), len(part.faces))
        model.addSubModel(part.vertices, part.faces.astype(np.int32))
        model.endModel()
        found.append(fcl.CollisionObject(model))
    return found


def fcl_link(solids, i, frame):
    """Return a solid of a hand as python-fcl sees it."""
    points = solids.points[solids.ptr[i] : solids.ptr[i + 1]]
    at, T = frame[9:], frame[:9].reshape(3, 3)
    if len(points) == 0:
        shape = fcl.Cylinder(solids.size[i, 0], 2 * solids.size[i, 1])
    elif len(points) == 2:
        shape = fcl.Capsule(solids.margin[i], np.linalg.norm(points[1] - points[0]))
        at = at + T @ points.mean(axis=0)
    else:
        hull = __import__("trimesh").convex.convex_hull(points)
        faces = np.c_[np.full(len(hull.faces), 3), hull.faces].ravel()
        shape = fcl.Convex(np.array(hull.vertices), len(hull.faces), faces)
    return fcl.CollisionObject(shape, fcl.Transform(T, at))


def distances(hand, state, thing):
    """Return the distance of each solid of a hand from an object, by python-fcl."""
    meshes = fcl_mesh(thing)
    found = []
    for i, frame in enumerate(state.frames):
        link = fcl_link(hand.arrays.solids, i, frame)
        request, result = fcl.DistanceRequest(), fcl.DistanceResult()
        found.append(min(fcl.distance(link, m, request, result) for m in meshes))
    return np.array(found)


def collides(hand, state, thing):
    meshes = fcl_mesh(thing)
    return any(
        fcl.collide(fcl_link(hand.arrays.solids, i, frame), mesh) > 0
        for i, frame in enumerate(state.frames)
        for mesh in meshes
    )


def test_every_grasp_touches_and_none_overlaps(cup):
    hand = load_hand(cup.hand)
    for k in range(len(cup)):
        state = hand.state(cup.T_object_palm[k], cup.values[k])
        assert not collides(hand, state, cup.thing)
        open_ = hand.state(cup.T_object_palm[k], cup.preshape[k])
        assert not collides(hand, open_, cup.thing)
        # python-fcl tells distances of round solids up to 0.4 mm too large
        touched = np.unique(cup.contact_link[slice(*cup.contact_ptr[k : k + 2])])
        near = distances(hand, state, cup.thing)
        owner = hand.arrays.solids.owner
        assert len(touched) >= 2
        for link in touched:
            assert near[owner == link].min() < FEW.pad + 5e-4


def test_the_distance_is_that_of_python_fcl(rng):
    hand, hammer = load_hand("sdh"), load_object("hammer")
    target, found = target_of(hammer), np.full(2, -1)
    use = np.ones(len(hand.arrays.local), bool)
    seen = 0
    for _ in range(20):
        T = np.eye(4)
        T[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        T[:3, :3] *= np.sign(np.linalg.det(T[:3, :3]))
        T[:3, 3] = rng.uniform(-0.25, 0.25, 3)
        state = hand.state(T, hand.preshapes[0])
        found[:] = -1
        mine = kernels.clearance(hand.arrays, state, use, target.mesh, 1.0, found)
        theirs = max(0.0, distances(hand, state, hammer).min())
        if theirs > 1e-3:
            seen += 1
            assert theirs - 5e-4 <= mine <= theirs + 1e-6
        # the same, begun from the pair that was nearest
        again = kernels.clearance(hand.arrays, state, use, target.mesh, 1.0, found)
        assert again == pytest.approx(mine, abs=1e-9)
    assert seen > 5


def test_a_finger_stops_within_the_tolerance_and_does_not_overlap():
    hand, jar = load_hand("sdh"), load_object("food_jar")
    target, T = target_of(jar), np.eye(4)
    T[:3, 2], T[:3, 0] = [-1, 0, 0], [0, 1, 0]
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    T[:3, 3] = [0.043 + 0.06, 0, 0.06]
    state = close(hand, target, T, 0, 2e-4)
    assert (state.touched >= 0).sum() >= 3
    use, found = np.ones(len(hand.arrays.local), bool), np.full(2, -1)
    near = kernels.clearance(hand.arrays, state, use, target.mesh, 1.0, found)
    assert 0.5e-4 < near <= 2e-4


def test_a_hand_inside_a_hollow_is_not_outside():
    # a mesh around the whole hand touches nothing of it
    import trimesh

    from handover import make_object
    from odm.obstacles.shapes import Mesh

    room = trimesh.creation.box((0.9, 0.9, 0.9))
    thing = make_object("room", [Mesh(room.vertices, room.faces)], [1.0])
    hand, target = load_hand("sdh"), None
    target = target_of(thing)
    state = hand.state(np.eye(4), hand.preshapes[0])
    assert not is_outside(hand, state, target, 1e-4)
    away = np.eye(4)
    away[0, 3] = 1.5
    assert is_outside(hand, hand.state(away, hand.preshapes[0]), target, 1e-4)


def test_a_gripper_gives_way_until_both_jaws_touch():
    hand, box = load_hand("panda"), load_object("box")
    T = np.eye(4)
    # from above onto the box, jaws along z of the box (50 mm), 8 mm off the middle
    T[:3, :3] = np.column_stack([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    T[:3, 3] = [0.0, 0.045 + 0.01, 0.008]
    state = close(hand, target_of(box), T, 0, 2e-4)
    assert state is not None and abs(state.palm[11]) < 1e-3
    assert state.values[0] == pytest.approx(0.025, abs=2e-3)


def test_the_quality_is_that_of_a_hull_worked_out_by_hand():
    cross = np.concatenate([np.eye(6), -np.eye(6)])
    assert closure_quality(cross) == pytest.approx(1 / np.sqrt(6))
    assert closure_quality(2.0 * cross) == pytest.approx(2 / np.sqrt(6))
    assert closure_quality(cross + [2, 0, 0, 0, 0, 0]) == 0.0  # the origin outside
    flat = cross.copy()
    flat[:, 5] = 0.0
    assert closure_quality(flat) == 0.0
    assert closure_quality(cross[:6]) == 0.0


def test_the_bound_is_never_below_the_quality(rng):
    positive = 0
    for _ in range(20):
        points = rng.normal(size=(30, 6)) + 0.3
        quality = closure_quality(points)
        assert quality_bound(points) >= quality - 1e-9
        positive += quality > 0
    assert positive > 3


def test_forces_of_a_contact_lie_in_its_friction_cone():
    contacts = Contacts(
        np.array([[0.1, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]), np.array([0])
    )
    found = wrenches(contacts, np.zeros(3), 0.1, 0.5, 6)
    forces, moments = found[:, :3], found[:, 3:]
    np.testing.assert_allclose(np.linalg.norm(forces, axis=1), 1.0)
    np.testing.assert_allclose(-forces[:, 0], np.cos(np.arctan(0.5)))
    np.testing.assert_allclose(moments, np.cross([1.0, 0, 0], forces), atol=1e-12)


def test_four_pads_about_a_box_hold_and_two_points_do_not():
    def pads(points, normals):
        found = Contacts(np.array(points), np.array(normals), np.arange(len(points)))
        return closure_quality(wrenches(found, np.zeros(3), 0.1, 0.5, 6))

    two = [[0.05, 0, 0], [-0.05, 0, 0]]
    inward = [[-1.0, 0, 0], [1.0, 0, 0]]
    assert pads(two, inward) == 0.0  # it turns about the line between them
    four = [[0.05, 0, 0.02], [0.05, 0.02, -0.01], [-0.05, 0, 0.02], [-0.05, 0, -0.02]]
    assert pads(four, [inward[0]] * 2 + [inward[1]] * 2) > 0.01
    # pads on one side only push it away
    assert pads(four, [inward[0]] * 4) == 0.0


def test_any_number_of_threads_makes_the_same_bytes(cup, tmp_path):
    again = build_grasps(load_object("cup"), "sdh", FEW, threads=1)
    one, other = cup.save(tmp_path / "a"), again.save(tmp_path / "b")
    for file in sorted(one.glob("*.npy")):
        assert file.read_bytes() == (other / file.name).read_bytes(), file.name
    assert load_grasps(one).hash == load_grasps(other).hash
    third = build_grasps(
        load_object("cup"), "sdh", GraspSettings(samples=8, rolls=2, seed=2)
    )
    assert third.save(tmp_path / "c") and load_grasps(tmp_path / "c").hash != (
        load_grasps(one).hash
    )


def test_a_stored_set_comes_back_as_it_was(cup, tmp_path):
    back = load_grasps(cup.save(tmp_path / "set"))
    assert len(back) == len(cup) > 3 and back.hand == "sdh_left"
    np.testing.assert_array_equal(back.values, cup.values)
    assert back.thing.fingerprint() == cup.thing.fingerprint()
    tried = back.built["tried"]
    held = tried - sum(back.built["refused"].values())  # by one palm or by two
    assert tried == 16 and held <= len(back) <= 2 * held


def test_an_altered_set_is_refused(cup, tmp_path):
    place = cup.save(tmp_path / "set")
    file = place / "values.npy"
    data = bytearray(file.read_bytes())
    data[-3] ^= 1
    file.write_bytes(bytes(data))
    with pytest.raises(BadMap, match="values.*was altered"):
        load_grasps(place)
    with pytest.raises(BadMap, match="holds no grasp set; build one with `odm grasps"):
        load_grasps(tmp_path)


def test_what_no_hand_can_hold_is_said(tmp_path):
    import trimesh

    from handover import make_object
    from odm.obstacles.shapes import Mesh

    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.4)
    thing = make_object("ball", [Mesh(ball.vertices, ball.faces)], [1.0])
    few = GraspSettings(samples=2, rolls=1)
    with pytest.raises(BadInput, match=r"no grasp of ball by the hand panda.*another"):
        build_grasps(thing, "panda", few)
