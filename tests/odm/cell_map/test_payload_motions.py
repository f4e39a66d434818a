"""What is carried: every motion and every question heeds it."""

import numpy as np
import pytest
from carrying import BALLS, CENTER, HIGH, OVER, RADIUS, arm_points, capsules, exact_gap
from small import AWAY, HOME, NOBODY, ball_at, draw_arm, draw_valid

import odm
from odm.cell_map.payload import loaded_map
from odm.cell_map.recipe import PayloadRecipe, Recipe, RobotRecipe
from odm.close_test.safety import Safety
from odm.exact.distances import ExactRobot
from odm.exact.fcl_robot import FclRobot
from odm.search import _paths as paths
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.loading.held_link import with_payload

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
def cell_map(carrying_map):
    return carrying_map


@pytest.fixture(scope="module")
def loaded(cell_map):
    return loaded_map(cell_map)


@pytest.fixture
def planner(cell_map):
    return odm.ReactivePlanner(cell_map)


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
    """Search, straight and improved motions, backing off: all that is answered."""
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
            planner.improve()
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
    assert (
        "payload would touch the scenery set by set_static"
        in planner.is_free(AWAY, AWAY).reason
    )
    planner.detach()
    planner.attach(BALLS)  # the scenery of the place outlives the hand
    assert not planner.is_free(AWAY, AWAY)


def test_the_place_closes_what_the_envelope_would_touch(cell_map, rng):
    """What set_static closes for the payload is no less than for the bare arm."""
    first, then = (odm.ReactivePlanner(cell_map) for _ in range(2))
    box = odm.Box([0.3, 0.3, 0.3], _at(np.array([0.4, 0.3, 0.5])))
    first.set_static(box)
    first.scene.test_waiting()
    bare = first.memory.graph.closed.copy()
    first.attach(BALLS)
    first.scene.test_waiting()
    carrying = first.memory.graph.closed
    assert (carrying | ~bare).all() and carrying.sum() > bare.sum()
    then.attach(BALLS)
    then.set_static(box)
    then.scene.test_waiting()
    assert np.array_equal(then.memory.graph.closed, carrying)
    then.detach()
    then.scene.test_waiting()
    assert np.array_equal(then.memory.graph.closed, bare)


def test_what_came_and_went_meanwhile_closes_what_it_should(cell_map):
    """What stands there since something was taken; what the envelope itself blocks."""
    planner, fresh = (odm.ReactivePlanner(cell_map) for _ in range(2))
    box, own = odm.Box([0.1, 0.6, 0.3]), cell_map.payload.closed
    at = _at(np.array([0.0, 0.0, 0.95]))
    planner.attach(BALLS)
    planner.scene.add("low", odm.Box([1.2, 1.2, 0.2]), _at(np.array([0.0, 0.0, 0.1])))
    planner.scene.remove("low")
    assert np.array_equal(planner.memory.graph.closed, own) and own.any()
    planner.scene.add("box", box, at)
    planner.detach()
    fresh.scene.add("box", box, at)
    closed = planner.memory.graph.closed
    assert np.array_equal(closed, fresh.memory.graph.closed) and closed.any()


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
    from odm.cell_map.payload import largest_robot

    inside = layout._in_reach(cell_map, largest_robot(cell_map))
    nx, ny, nz = (int(v) for v in cell_map.grid.blocks)
    lists = loaded.arm_cells.by_item
    blocks = np.unique(loaded.arm_cells.by_item.block.astype(np.int64))
    for b in blocks:
        masks = lists.mask[lists.block == b]
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
    paths.add_shortcut(planner.memory.shortcuts, 3, 9, 0)
    assert (planner.memory.shortcuts.key >= 0).any()
    planner.attach(BALLS) if takes else planner.detach()
    planner.set_goals([0.5 * OVER])  # no step in between: the usual order of a pick
    assert not (planner.memory.shortcuts.key >= 0).any()


@pytest.mark.parametrize("takes", [True, False])
def test_goals_are_joined_anew_for_another_hand(cell_map, takes):
    """Set again at once they are as of who had none before."""
    told = []
    for before in ([OVER, HIGH], []):
        planner = odm.ReactivePlanner(cell_map)
        if not takes:
            planner.attach(BALLS)
        if before:
            planner.set_goals(before)
        planner.step(NOBODY, q=HIGH)  # goals are joined to nodes on the way from there
        planner.attach(BALLS) if takes else planner.detach()
        planner.set_goals([OVER])
        goals, pool = planner.memory.goals, planner.memory.pool
        n, (items, cells) = goals.number[0], pool.used
        rows = goals.node[0, :n], goals.ref[0, :n], pool.end[:items], pool.mask[:cells]
        told.append([row.tobytes() for row in rows])
    assert told[0] == told[1] and n > 0


@pytest.mark.parametrize("first", ["attach", "clearance"])
def test_more_clearance_from_the_scene_counts_for_what_is_held(planner, first):
    """A ball stands 3 cm beyond the clearance from what is held, or will be."""
    x, y, z, radius = BALLS[1]
    beyond = radius + 0.02 + planner.cell_map.safety.m + 0.03
    at = tool_pose(planner.robot, HIGH) @ _at(np.array([x + beyond, y, z]))
    planner.scene.add("ball", odm.Sphere(0.02), at)
    if first == "attach":
        planner.attach(BALLS)
        assert planner.is_free(HIGH, HIGH)
    planner.set_extra_clearance(0.05)
    if first == "clearance":
        assert planner.is_free(HIGH, HIGH)
        planner.attach(BALLS)
    assert planner.is_free(HIGH, HIGH).failed == "scenery"
