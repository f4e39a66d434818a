"""What is carried: the map's envelope, attach and detach."""

from dataclasses import replace

import numpy as np
import pytest
from carrying import (
    BALLS,
    BRICK,
    CENTER,
    HIGH,
    OVER,
    RADIUS,
    SHIFT,
    arm_points,
    capsules,
)
from naive_cells import free_items
from rows import each
from small import AWAY, HOME, NOBODY, draw_arm, small_recipe
from wrappers import with_wrapper

import odm
from odm.audit.audit import audit
from odm.cell_map.payload import carried_object, envelope_robot, loaded_map
from odm.cell_map.recipe import PayloadRecipe, parse_recipe
from odm.close_test import _close as close
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from odm.search import _frame as frame
from roadmap.errors import BadInput, BadRecipe
from roadmap.kinematics.forward import difference
from roadmap.loading.held_link import PAYLOAD, with_payload

plan = with_wrapper(frame.plan)


@pytest.fixture(scope="module")
def cell_map(carrying_map):
    return carrying_map


@pytest.fixture(scope="module")
def loaded(cell_map):
    return loaded_map(cell_map)


@pytest.fixture
def planner(cell_map):
    return odm.ReactivePlanner(cell_map)


# --- the layer -----------------------------------------------------------------


def test_a_payload_never_frees_anything(planner, rng):
    taken = 0
    for _ in range(30):
        _, points = arm_points(rng)
        planner.step(points, HOME)
        nodes, edges = planner.invalid_nodes(), planner.invalid_edges()
        planner.attach(BALLS)
        planner.step(points, HOME)
        more_nodes, more_edges = planner.invalid_nodes(), planner.invalid_edges()
        assert np.isin(nodes, more_nodes).all() and np.isin(edges, more_edges).all()
        taken += len(more_edges) - len(edges)
        planner.detach()
    assert taken > 100


def test_the_layers_together_are_the_cells_of_both(planner, loaded, rng):
    planner.attach(BALLS)
    for _ in range(6):
        _, points = arm_points(rng)
        planner.step(points, HOME)
        nodes, edges = free_items(loaded, points)
        assert np.array_equal(planner.invalid_nodes(), np.flatnonzero(~nodes))
        assert np.array_equal(planner.invalid_edges(), np.flatnonzero(~edges))
    planner.step(NOBODY, HOME)
    assert not len(planner.invalid_nodes()) and not len(planner.invalid_edges())


def test_no_edge_that_is_free_with_a_payload_touches_an_obstacle(loaded):
    report = audit(loaded, pairs=20_000, seed=4)
    assert report.passed and report.boundary > 2000


def test_python_fcl_sees_no_contact_on_open_edges(cell_map, planner, rng):
    """A second opinion: the whole envelope in hand, anywhere on edges that are open."""
    robot, roadmap = envelope_robot(cell_map.robot, cell_map.payload), cell_map.roadmap
    fcl, ends = FclRobot(robot), roadmap.nodes[roadmap.edges]
    planner.attach(cell_map.payload.spheres)
    tried = near = 0
    for _ in range(40):
        arm, points = arm_points(rng)
        planner.step(points, HOME)
        fcl.set_obstacles(capsules(arm))
        closed = np.flatnonzero(cell_map.payload.closed[roadmap.n_nodes :])
        taken = np.union1d(closed, planner.invalid_edges())
        open_ = np.setdiff1d(np.arange(roadmap.n_edges), taken)
        for edge in rng.permutation(open_)[:25]:
            q = ends[edge, 0] + rng.random() * difference(robot, *ends[edge])
            assert not fcl.collides(q)
            tried, near = tried + 1, near + (fcl.distance(q) < 0.12)
    assert tried > 300 and near > 10


def test_edges_that_are_open_keep_the_envelope_off_arm_and_floor(cell_map, rng):
    robot = envelope_robot(cell_map.robot, cell_map.payload)
    exact, roadmap = ExactRobot(robot, base=True), cell_map.roadmap
    closed = cell_map.payload.closed[roadmap.n_nodes :]
    assert 0 < closed.sum() < len(closed)
    floor = [odm.Box([9.0, 9.0, 2.0], np.block(
        [[np.eye(3), np.array([[0.0], [0.0], [-1.0]])], [np.zeros((1, 3)), 1.0]]
    ))]  # fmt: skip
    own = robot.link_names.index(PAYLOAD)
    pairs = robot.self_pairs[(robot.self_pairs == own).any(axis=1)]
    moving = exact.body > 0
    ends = roadmap.nodes[roadmap.edges]
    ground = obstacles_of(floor)
    for edge in rng.choice(np.flatnonzero(~closed), 150):
        q = ends[edge, 0] + rng.random() * difference(robot, *ends[edge])
        assert exact.self_distance(q, pairs).distance > 0.0
        assert exact.distance_of(moving, q, ground).distance >= cell_map.safety.m


def test_a_map_without_the_layer_is_what_it_was(small_map, tmp_path):
    assert "payload" not in small_map.recipe.as_dict()
    stored = odm.load_map(small_map.save(tmp_path / "map"))
    assert stored.payload is None
    planner = odm.ReactivePlanner(stored)
    planner.attach(BALLS)
    assert planner.held_by == "close test"


def test_the_layer_is_stored_and_read_again(cell_map, tmp_path):
    again = odm.load_map(cell_map.save(tmp_path / "map"))
    assert again.recipe == cell_map.recipe and again.hash == cell_map.hash
    for name, array in cell_map.payload.arrays().items():
        assert np.array_equal(array, again.payload.arrays()[name])


@each(
    ("table", "words"),
    [
        ({}, "either a radius"),
        ({"radius": 0.1, "size": [0.1, 0.1, 0.1]}, "either a radius"),
        ({"radius": -0.1}, "payload.radius is -0.1"),
        ({"radius": float("nan")}, "payload.radius is nan"),
        ({"size": [0.1, 0.1]}, "payload.size"),
        ({"size": "large"}, "payload.size is large"),
        ({"radius": 0.1, "position": [0, 0, 99]}, "payload.position"),
        ({"radios": 0.1}, "did you mean 'radius'"),
    ],
)
def test_a_bad_payload_table_is_refused(table, words):
    with pytest.raises(BadRecipe, match=words):
        parse_recipe({"payload": table}, "bad")


def test_an_envelope_that_always_touches_is_refused_at_the_build():
    with pytest.raises(BadRecipe, match="in contact at all 150 nodes"):
        odm.build_map(replace(small_recipe(), payload=PayloadRecipe(radius=0.8)))


def test_an_object_drawn_in_millimetres_is_told_so():
    for thing in (odm.Box((200.0, 20.0, 20.0)), odm.Cylinder(10.0, 200.0)):
        with pytest.raises(BadInput, match="200.* m large.*not in millimetres"):
            carried_object(thing)


# --- attach and detach ---------------------------------------------------------


def frames(planner, seed, n=40):
    """Return the bytes of all answers beside a moving arm."""
    rng = np.random.default_rng(seed)
    arm, q, found = draw_arm(rng), HIGH.copy(), []
    for k in range(n):
        arm[:, :6] += 0.01 * np.sin(0.3 * k)
        answer = planner.step(odm.sample_capsules(arm, 0.03), q)
        planner.improve()
        found.append((answer.status, answer.path.tobytes()))
        if len(answer.path) > 1:
            dq = answer.path[1] - answer.path[0]
            q = q + dq * min(1.0, 0.05 / max(np.abs(dq).max(), 1e-9))
    return found


def test_detach_leaves_no_trace(cell_map):
    bare, used = (odm.ReactivePlanner(cell_map) for _ in range(2))
    for planner in (bare, used):
        planner.set_goals([OVER])
    used.attach(BALLS)
    used.detach()
    assert frames(bare, 9) == frames(used, 9)
    used.attach(BALLS)
    frames(used, 5)
    used.detach()
    bare.reset()
    assert used.attached is None
    assert len(used.memory.arm.spheres) == len(cell_map.arm.spheres)
    assert np.array_equal(used.frame.radii, bare.frame.radii)


def test_attaching_again_gives_the_same_bytes(cell_map):
    found = []
    for _ in range(2):
        planner = odm.ReactivePlanner(cell_map)
        planner.set_goals([OVER])
        planner.attach(BALLS)
        found.append(frames(planner, 9))
    assert found[0] == found[1]
    planner = odm.ReactivePlanner(cell_map)
    planner.set_goals([OVER])
    assert frames(planner, 9) != found[0]  # the payload matters here
    assert {status for status, _ in found[0]} == {"following", "replanned", "holding"}


def test_attach_compiles_nothing_and_leaves_the_map_alone(cell_map, planner, rng):
    planner.set_goals([AWAY])
    frames(planner, 1, 5)
    planner.attach(BALLS)
    frames(planner, 1, 5)
    planner.detach()
    known = len(close.motion_clear.signatures), len(plan.signatures)
    masks = cell_map.arm_cells.code, cell_map.payload.cells.code
    before = [mask.tobytes() for mask in masks]
    planner.attach(BRICK, SHIFT)
    frames(planner, 2, 5)
    planner.detach()
    assert known == (len(close.motion_clear.signatures), len(plan.signatures))
    assert before == [mask.tobytes() for mask in masks]


@pytest.mark.parametrize(
    ("thing", "half"),
    [
        (BRICK, [0.05, 0.03, 0.06]),
        (odm.Sphere(0.05), [0.028, 0.028, 0.028]),
        (odm.Capsule(0.03, 0.1), [0.02, 0.02, 0.05]),
        (odm.Cylinder(0.04, 0.1), [0.028, 0.028, 0.05]),
    ],
    ids=lambda v: type(v).__name__,
)
def test_the_spheres_of_what_is_attached_contain_it(planner, thing, half, rng):
    planner.attach(thing, SHIFT)
    points = rng.uniform(-1, 1, (500, 3)) * half + CENTER
    gaps = points[:, None] - planner.attached[:, :3]
    outside = np.linalg.norm(gaps, axis=2) - planner.attached[:, 3]
    assert (outside.min(axis=1) <= 0.0).all()


def test_spheres_are_taken_as_they_are(planner):
    small = BALLS * 0.5
    planner.attach(small, SHIFT)
    assert np.allclose(planner.attached, small + np.append(CENTER, 0.0))


def test_what_does_not_fit_is_refused_with_both_sizes(planner):
    with pytest.raises(BadInput, match=r"reaches 0\.2000 m .* sphere of 0\.12 m"):
        planner.attach(np.array([[*CENTER, 0.2]]))
    with pytest.raises(BadInput, match=r"reaches 0\.1\d+ m .* sphere of 0\.12 m"):
        planner.attach(odm.Box([0.2, 0.2, 0.2]), SHIFT)
    assert planner.attached is None
    planner.attach(np.array([[*CENTER, RADIUS]]))  # as large as the envelope


def test_attaching_twice_and_detaching_nothing_is_refused(planner):
    with pytest.raises(BadInput, match="nothing is attached"):
        planner.detach()
    planner.attach(BALLS)
    with pytest.raises(BadInput, match="attached already; call detach"):
        planner.attach(BALLS)
    assert len(planner.attached) == 2


@pytest.mark.parametrize(
    "thing",
    [
        [[0, 0, 0]],
        [[0, 0, 0, -0.1]],
        [[0, 0, np.nan, 0.1]],
        [["0.1", "0", "0.02", "0.05"]],
        np.array([[0.1, 0, 0.02, 0.05 + 0.1j]]),
        "cup",
        [],
    ],
)
def test_a_thing_that_is_none_is_refused(planner, thing):
    with pytest.raises(BadInput):
        planner.attach(thing)
    with pytest.raises(BadInput, match="not a rigid motion"):
        planner.attach(BALLS, 2.0 * np.eye(4))
    assert planner.attached is None


def test_a_robot_with_a_link_of_that_name_carries_nothing_else(cell_map):
    with pytest.raises(BadInput, match="has a link 'payload' already"):
        with_payload(with_payload(cell_map.robot, BALLS), BALLS)
