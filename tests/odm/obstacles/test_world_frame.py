"""Points and poses in the world: the base may stand elsewhere, the map stays."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small import AWAY, HOME, NOBODY, draw_arm, draw_valid

import odm
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose


def draw_base(rng):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    T[:3, 3] = rng.uniform(-3, 3, 3)
    return T


def in_world(T, points):
    return np.ascontiguousarray(points @ T[:3, :3].T + T[:3, 3])


def drive(planner, points_of, n=25):
    q, found = HOME.copy(), []
    for k in range(n):
        answer = planner.step(points_of(k), q)
        planner.improve()
        found.append((answer.status, answer.path.copy()))
        if len(answer.path) > 1:
            dq = answer.path[1] - answer.path[0]
            q = q + dq * min(1.0, 0.05 / max(np.abs(dq).max(), 1e-9))
    return found


def test_a_frame_is_the_same_wherever_the_base_stands(small_map, rng):
    """The same scene about the base, given in the world, gets the same answers."""
    for _ in range(4):
        arm, T = draw_arm(rng), draw_base(rng)
        scene = [
            odm.sample_capsules(arm + 0.004 * k * np.eye(7)[0], 0.03) for k in range(25)
        ]
        here, there = (odm.ReactivePlanner(small_map) for _ in range(2))
        there.set_base(T)
        for planner in (here, there):
            planner.set_goals([AWAY])
        one = drive(here, lambda k, s=scene: s[k])
        other = drive(there, lambda k, s=scene, T=T: in_world(T, s[k]))
        assert [s for s, _ in one] == [s for s, _ in other]
        for (_, a), (_, b) in zip(one, other, strict=True):
            assert a.shape == b.shape and np.abs(a - b).max(initial=0.0) < 1e-9
        nodes = here.invalid_nodes()
        assert np.array_equal(nodes, there.invalid_nodes())


def test_points_beside_shapes_are_in_the_world_too(small_map, rng):
    """Both come in one call: the points follow the base as the shapes do."""
    arm, points, T = draw_arm(rng), rng.uniform(-1.0, 1.0, (40, 3)), draw_base(rng)
    turned = arm.copy()
    turned[:, :3], turned[:, 3:6] = in_world(T, arm[:, :3]), in_world(T, arm[:, 3:6])
    here, there = (odm.ReactivePlanner(small_map) for _ in range(2))
    there.set_base(T)
    for planner in (here, there):
        planner.set_goals([AWAY])
    one = here.step(odm.Obstacles(capsules=arm, points=points), q=HOME)
    given = in_world(T, points)
    other = there.step(odm.Obstacles(capsules=turned, points=given), q=HOME)
    assert one.status == other.status
    assert np.abs(here.points[:40] - points).max() == 0.0
    assert np.abs(there.points[:40] - points).max() < 1e-9
    assert np.array_equal(given, in_world(T, points))


def test_scenery_of_the_place_stays_in_the_world_when_the_base_moves(small_map):
    box = odm.Box([0.2, 0.2, 0.2], _at([1.0, 0.0, 0.5]))
    planner = odm.ReactivePlanner(small_map)
    T = _at([0.5, 0.0, 0.0])
    planner.set_base(T)
    planner.set_static(box)  # half a metre before the base
    near = planner.memory.graph.closed.copy()
    planner.set_base(_at([-4.0, 0.0, 0.0]))
    assert near.any() and not planner.memory.graph.closed.any()
    planner.set_base(np.eye(4))  # a metre before it
    planner.set_base(T)
    assert np.array_equal(planner.memory.graph.closed, near)
    other = odm.ReactivePlanner(small_map)
    other.set_static(odm.Box([0.2, 0.2, 0.2], _at([0.5, 0.0, 0.5])))
    assert np.array_equal(other.memory.graph.closed, near)


def test_is_free_braking_and_approach_are_asked_in_the_world(small_map, rng):
    here, there = (odm.ReactivePlanner(small_map) for _ in range(2))
    T = draw_base(rng)
    there.set_base(T)
    told = set()
    for _ in range(60):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        q_a, q_b = draw_valid(here, rng), draw_valid(here, rng)
        here.step(points, q_a)
        there.step(in_world(T, points), q_a)
        one = here.is_free(q_a, q_b)
        told.add(bool(one))
        assert one.reason == there.is_free(q_a, q_b).reason
        path, shifted = np.array([q_a, q_b]), points + [0.05, 0.0, 0.0]
        want = here.blocked_leg(path, 0.02, shifted)
        assert want == there.blocked_leg(path, 0.02, in_world(T, shifted))
    assert told == {True, False}
    back, pose = 0.2 * HOME + 0.8 * AWAY, tool_pose(small_map.robot, AWAY)
    for planner in (here, there):
        planner.step(NOBODY, back)
    one, other = here.approach(pose, q=back), there.approach(T @ pose, q=back)
    assert bool(one) == bool(other) and one.reason == other.reason


def test_the_callers_points_stay_as_they_are(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    planner.set_base(draw_base(rng))
    points = odm.sample_capsules(draw_arm(rng), 0.03)
    before = points.copy()
    planner.step(points, HOME)
    assert np.array_equal(points, before)


def test_a_point_that_is_not_finite_holds_the_robot_in_any_frame(small_map, rng):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    planner.set_base(draw_base(rng))
    answer = planner.step(np.array([[0.0, np.nan, 0.0]]), HOME)
    assert answer.status == "holding" and "NaN" in answer.reason


@pytest.mark.parametrize(
    "T", [np.eye(3), 2.0 * np.eye(4), np.full((4, 4), np.nan), np.diag([1, 1, -1, 1])]
)
def test_a_base_that_is_not_rigid_is_refused(small_map, T):
    with pytest.raises(BadInput, match="T_world_base"):
        odm.ReactivePlanner(small_map).set_base(T)


def _at(p):
    T = np.eye(4)
    T[:3, 3] = p
    return T


def test_looking_ahead_leaves_the_frames_points_where_they_are(small_map, rng):
    here, there = (odm.ReactivePlanner(small_map) for _ in range(2))
    T = draw_base(rng)
    there.set_base(T)
    points = odm.sample_capsules(draw_arm(rng), 0.03)
    coming = points + [0.4, 0.0, 0.0]
    for planner, frame in ((here, np.eye(4)), (there, T)):
        planner.set_goals([AWAY])
        planner.step(in_world(frame, points), q=HOME)
        planner.evasion(HOME, [(0.2, in_world(frame, coming))], 0.5)
        box = odm.Box([0.1, 0.1, 0.1], frame @ _at([1.0, 0.9, 0.5]))
        planner.set_static(box)
        assert planner.points == pytest.approx(points, abs=1e-9)
    assert here.separation(HOME) == pytest.approx(there.separation(HOME), abs=1e-9)
    legs = np.stack([HOME, AWAY])
    assert here.blocked_leg(legs, 0.05) == there.blocked_leg(legs, 0.05)


def test_the_person_stays_in_the_world_when_the_base_moves(planner, rng):
    points = odm.sample_capsules(draw_arm(rng), 0.03)
    planner.step(points, q=HOME)
    T = _at([0.3, -0.2, 0.0])
    planner.set_base(T)
    moved = planner.separation(HOME)
    planner.step(points, q=HOME)  # of the world now
    assert planner.separation(HOME) == pytest.approx(moved, abs=1e-9)
    planner.step(np.ascontiguousarray(points - T[:3, 3]), q=HOME)
    assert planner.separation(HOME) != pytest.approx(moved, abs=1e-3)
