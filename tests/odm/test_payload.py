"""What is carried: the map's envelope, attach and detach, and who must heed it."""

from dataclasses import replace

import numpy as np
import pytest
from naive_cells import free_items
from small import (
    AWAY,
    HOME,
    NOBODY,
    ball_at,
    draw_arm,
    draw_valid,
    small_recipe,
)

import odm
from odm._kernels import close, frame, ways
from odm.audit import audit
from odm.exact import ExactRobot, obstacles_of
from odm.fcl_robot import FclRobot
from odm.payload import envelope_robot, loaded_map
from odm.recipe import PayloadRecipe, Recipe, RobotRecipe, Safety, parse_recipe
from roadmap.build import RoadmapSettings
from roadmap.carry import PAYLOAD, with_payload
from roadmap.errors import BadInput, BadRecipe
from roadmap.kinematics import difference, tool_pose

CENTER, RADIUS = np.array([0.1, 0.0, 0.02]), 0.12  # the map's envelope
BALLS = np.array([[0.1, 0.0, 0.02, 0.06], [0.16, 0.0, 0.0, 0.04]])
BRICK = odm.Box([0.1, 0.06, 0.12])
# the small arm may stand so with BALLS in its hand: nearer to the floor it may not
HIGH, OVER = np.array([0.7, 0.4, 0.0]), np.array([-0.7, -0.4, 0.0])
SHIFT = np.block([[np.eye(3), CENTER[:, None]], [np.zeros((1, 3)), 1.0]])


FOLDING = """<robot name="folding">
<link name="base"><collision><geometry><sphere radius="0.04"/></geometry></collision>
</link>
<link name="upper"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.4 0.06 0.06"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.15 0 0.08"/><geometry>
<box size="0.2 0.04 0.04"/></geometry></collision></link>
<joint name="swing" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3.1" upper="3.1" velocity="1" effort="1"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def cell_map(tmp_path_factory):
    envelope = PayloadRecipe(radius=RADIUS, position=tuple(CENTER))
    folder = tmp_path_factory.mktemp("maps") / "arm3"
    odm.build_map(replace(small_recipe(), payload=envelope)).save(folder)
    return odm.load_map(folder)


@pytest.fixture(scope="module")
def loaded(cell_map):
    return loaded_map(cell_map)


@pytest.fixture
def planner(cell_map):
    return odm.ReactivePlanner(cell_map)


def arm_points(rng):
    arm = draw_arm(rng)
    return arm, odm.sample_capsules(arm, 0.03)


def capsules(arm):
    return [odm.Capsule.between(row[:3], row[3:6], row[6]) for row in arm]


def exact_gap(robot, shapes, q_a, q_b, n=9):
    exact = ExactRobot(robot)
    dq = difference(robot, q_a, q_b)
    places = [q_a + t * dq for t in np.linspace(0.0, 1.0, n)]
    return min(exact.distance(q, shapes).distance for q in places)


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
    with pytest.raises(BadInput, match=r"add a \[payload\] table to its recipe"):
        odm.ReactivePlanner(stored).attach(BALLS)


def test_the_layer_is_stored_and_read_again(cell_map, tmp_path):
    again = odm.load_map(cell_map.save(tmp_path / "map"))
    assert again.recipe == cell_map.recipe and again.hash == cell_map.hash
    for name, array in cell_map.payload.arrays().items():
        assert np.array_equal(array, again.payload.arrays()[name])


@pytest.mark.parametrize(
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


# --- attach and detach ---------------------------------------------------------


def frames(planner, seed, n=40):
    """Return the bytes of all answers beside a moving arm."""
    rng = np.random.default_rng(seed)
    arm, q, found = draw_arm(rng), HIGH.copy(), []
    for k in range(n):
        arm[:, :6] += 0.01 * np.sin(0.3 * k)
        answer = planner.step(odm.sample_capsules(arm, 0.03), q)
        planner.polish()
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
    assert np.array_equal(used.radii, bare.radii)


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
    known = len(close.motion_clear.signatures), len(frame.plan.signatures)
    masks = cell_map.arm_cells.mask, cell_map.payload.mask
    before = [mask.tobytes() for mask in masks]
    planner.attach(BRICK, SHIFT)
    frames(planner, 2, 5)
    planner.detach()
    assert known == (len(close.motion_clear.signatures), len(frame.plan.signatures))
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
    "thing", [[[0, 0, 0]], [[0, 0, 0, -0.1]], [[0, 0, np.nan, 0.1]], "cup", []]
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


# --- every motion heeds it -----------------------------------------------------


def test_is_free_agrees_with_exact_geometry(cell_map, planner, rng):
    """Certified free: the solids and the object keep m, python-fcl sees no contact."""
    planner.attach(BALLS)
    loaded = with_payload(cell_map.robot, BALLS)
    exact, fcl = ExactRobot(loaded), FclRobot(loaded)
    m, freed, by_payload = cell_map.safety.m, 0, 0
    for _ in range(300):
        arm, points = arm_points(rng)
        q_a, q_b = draw_valid(planner, rng), draw_valid(planner, rng)
        q_b = q_a + 0.3 * difference(cell_map.robot, q_a, q_b)
        planner.step(points, q_a)
        answer = planner.is_free(q_a, q_b)
        by_payload += "payload would" in answer.reason
        if not answer:
            continue
        freed += 1
        shapes = capsules(arm)
        fcl.set_obstacles(shapes)
        for t in (0.0, 0.31, 0.5, 0.77, 1.0):
            q = q_a + t * (q_b - q_a)
            assert exact.distance(q, shapes).distance >= m
            assert not fcl.collides(q)
            assert exact.self_distance(q).distance > 0.0
    assert freed > 100 and by_payload > 5


def test_an_object_that_touches_the_own_arm_is_not_free(tmp_path):
    """A robot that folds: by exact geometry, at rest and in the middle of a motion."""
    urdf = tmp_path / "folding.urdf"
    urdf.write_text(FOLDING)
    cell_map = odm.build_map(
        Recipe(
            "folding", RobotRecipe(str(urdf), tip="fore"),
            RoadmapSettings(nodes=40, neighbors=4), Safety(h=0.05),
            payload=PayloadRecipe(radius=0.06, position=(0.3, 0.0, 0.0)),
        )
    )  # fmt: skip
    planner = odm.ReactivePlanner(cell_map)
    thing = np.array([[0.3, 0.0, 0.0, 0.05]])
    loaded = with_payload(cell_map.robot, thing)
    exact, rng = ExactRobot(loaded), np.random.default_rng(1)
    planner.attach(thing)
    touching = folded = 0
    for _ in range(200):
        q = rng.uniform(cell_map.robot.lower, cell_map.robot.upper)
        free = planner.is_free(q, q)
        if exact.self_distance(q).distance <= 0.0:
            touching += 1
            assert free.failed == "self-collision" and "payload" in free.reason
        folded += bool(free)
    assert touching > 5 and folded > 50
    stretched, shut = np.array([0.0, 0.5]), np.array([0.0, 3.0])
    through = planner.is_free(stretched, shut)
    assert through.failed == "self-collision" and "upper would touch" in through.reason
    planner.detach()
    assert planner.is_free(np.array([0.0, 3.0]), np.array([0.0, 3.0]))


def test_every_path_keeps_robot_and_object_off_a_moving_arm(cell_map, rng):
    """Search, straight and polished motions, backing off: all that is answered."""
    loaded, m = with_payload(cell_map.robot, BALLS), cell_map.safety.m
    seen = {"following": 0, "replanned": 0, "holding": 0}
    for seed in range(8):
        planner = odm.ReactivePlanner(cell_map)
        planner.attach(BALLS)
        walk = np.random.default_rng(seed)
        arm, v = draw_arm(walk), 0.01 * walk.normal(size=3)
        q = draw_valid(planner, walk)
        planner.set_goals([draw_valid(planner, walk) for _ in range(2)])
        for _ in range(30):
            arm = arm + np.array([*v, *v, 0.0])
            answer = planner.step(odm.sample_capsules(arm, 0.03), q)
            seen[answer.status] += 1
            shapes = capsules(arm)
            legs = list(zip(answer.path, answer.path[1:], strict=False))
            for a, b in legs[:3]:
                assert exact_gap(loaded, shapes, a, b) >= m
            if answer.retreat is not None:
                now = exact_gap(loaded, shapes, q, q, 1)
                away = exact_gap(loaded, shapes, *answer.retreat)
                assert away >= min(m, now) - 1e-3
            planner.polish()
            if legs:
                dq = difference(cell_map.robot, *legs[0])
                q = q + dq * min(1.0, 0.1 / max(np.abs(dq).max(), 1e-9))
    assert min(seen.values()) > 5, seen


def test_braking_heeds_the_payload(cell_map, planner):
    outer = ExactRobot(with_payload(cell_map.robot, BALLS)).frames(HOME)[-1]
    points = ball_at(outer[9:] + 0.1 * outer[:9].reshape(3, 3)[:, 0])
    planner.step(points, HOME)
    assert planner.blocked_leg(HOME[None]) is None
    gap = planner.separation(HOME)
    planner.attach(BALLS)
    assert planner.blocked_leg(HOME[None], points=points) == 0
    assert planner.separation(HOME) < gap


def test_what_the_object_touches_is_named(planner):
    planner.attach(BALLS)
    planner.set_goals([AWAY])
    planner.set_static(odm.Box([0.1, 0.1, 0.1], _at(_outer(planner, AWAY))))
    assert "payload would touch the scenery set by set_static" in planner.is_free(
        AWAY, AWAY
    ).reason
    planner.detach()
    planner.attach(BALLS)  # the scenery of the place outlives the hand
    assert not planner.is_free(AWAY, AWAY)


def test_the_place_closes_what_the_envelope_would_touch(cell_map, rng):
    """What set_static closes for the payload is no less than for the bare arm."""
    first, then = (odm.ReactivePlanner(cell_map) for _ in range(2))
    box = odm.Box([0.3, 0.3, 0.3], _at(np.array([0.4, 0.3, 0.5])))
    first.set_static(box)
    bare = first.memory.graph.closed.copy()
    first.attach(BALLS)
    carrying = first.memory.graph.closed
    assert (carrying | ~bare).all() and carrying.sum() > bare.sum()
    then.attach(BALLS)
    then.set_static(box)
    assert np.array_equal(then.memory.graph.closed, carrying)
    then.detach()
    assert np.array_equal(then.memory.graph.closed, bare)


def test_goals_that_the_object_cannot_reach_are_refused(planner):
    low = None
    for q in planner.cell_map.roadmap.nodes[planner.cell_map.payload.closed[:150]]:
        if planner.is_free(q, q):
            planner.attach(np.array([[*CENTER, RADIUS]]))
            blocked = not planner.is_free(q, q)
            if blocked:
                low = q
                break
            planner.detach()
    assert low is not None
    with pytest.raises(ValueError, match="payload"):
        planner.set_goals([low])


def test_approach_heeds_the_payload(cell_map, planner):
    T = tool_pose(cell_map.robot, AWAY)
    back = HOME * 0.2 + AWAY * 0.8
    planner.step(NOBODY, back)
    free = planner.approach(T, q=back)
    planner.attach(BALLS)
    held = planner.approach(T, q=back)
    assert bool(free) == bool(held)
    points = ball_at(_outer(planner, AWAY))
    planner.step(points, back)
    answer = planner.approach(T, q=back)
    assert not answer


def _outer(planner, q):
    loaded = with_payload(planner.cell_map.robot, BALLS)
    return ExactRobot(loaded).frames(q)[-1, 9:]


def _at(p):
    T = np.eye(4)
    T[:3, 3] = p
    return T


def test_cameras_look_wherever_a_payload_can_get(cell_map, loaded):
    from odm.cameras import layout

    inside = layout._in_reach(cell_map)
    nx, ny, nz = (int(v) for v in cell_map.grid.blocks)
    blocks = np.unique(loaded.arm_cells.block.astype(np.int64))
    for b in blocks:
        masks = loaded.arm_cells.mask[loaded.arm_cells.block == b]
        word = int(np.bitwise_or.reduce(masks))
        at = 4 * np.array([b // (ny * nz), b // nz % ny, b % nz])
        for k in range(64):
            if word >> k & 1:
                assert inside[tuple(at + [k >> 4, k >> 2 & 3, k & 3])]
    assert layout.needs_all_cubes(cell_map, 0.02)


@pytest.mark.parametrize("takes", [True, False])
def test_no_shortcut_is_remembered_from_another_hand(cell_map, takes):
    planner = odm.ReactivePlanner(cell_map)
    if not takes:
        planner.attach(BALLS)
    planner.set_goals([HIGH])
    planner.step(NOBODY, q=OVER)
    # one that an earlier search has found, by the number of its item
    ways.add_shortcut(planner.memory.short, 3, 9, 0)
    assert (planner.memory.short.key >= 0).any()
    planner.attach(BALLS) if takes else planner.detach()
    planner.set_goals([0.5 * OVER])  # no step in between: the usual order of a pick
    assert not (planner.memory.short.key >= 0).any()
