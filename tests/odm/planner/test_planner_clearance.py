"""Every path the planner gives keeps its distance, over its whole length."""

import numpy as np
import pytest
from naive_cells import smallest_gap
from small import AWAY, HOME, draw_arm, draw_valid, wrapped

import odm
from roadmap.kinematics.forward import sphere_centers


def test_every_piece_of_a_path_keeps_its_distance(small_map, planner, rng):
    keep = small_map.safety.rho + small_map.safety.m
    paths = 0
    for _ in range(60):
        q = draw_valid(planner, rng)
        planner.set_goals([draw_valid(planner, rng)])
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        answer = planner.step(points, q=q)
        if answer.status == "holding":
            continue
        paths += 1
        assert np.array_equal(answer.path[0], q)
        inside = points[(small_map.grid.locate(points) >= 0).all(axis=1)]
        for a, b in zip(answer.path, answer.path[1:], strict=False):
            assert smallest_gap(small_map, a, b - a, inside, 100) >= keep - 1e-9
            assert planner.is_free(wrapped(small_map, a), wrapped(small_map, b))
    assert paths > 25


@pytest.mark.parametrize("rounding", [None, 0.04])
def test_paths_keep_the_clearance_from_the_exact_arm(small_map, planner, rng, rounding):
    from odm.exact.distances import ExactRobot, obstacles_of

    robot = small_map.robot
    exact, paths = ExactRobot(robot), 0
    moving = robot.link_body[robot.solid_link] > 0
    for _ in range(40):
        q = draw_valid(planner, rng)
        planner.set_goals([draw_valid(planner, rng)])
        arm = draw_arm(rng)
        shapes = obstacles_of([capsule_of(row) for row in arm])
        points = odm.sample_capsules(arm, 0.03)
        if not (small_map.grid.locate(points) >= 0).all():
            continue
        answer = planner.step(points, q=q, rounding=rounding)
        for a, b in zip(answer.path, answer.path[1:], strict=False):
            paths += 1
            for t in np.linspace(0, 1, 12):
                nearest = exact.distance_of(moving, a + t * (b - a), shapes)
                assert nearest.distance >= small_map.safety.m - 1e-9
    assert paths > 15


def test_a_known_rounding_or_dense_points_cost_less_space(small_map, planner):
    planner.set_goals([AWAY])
    arm = np.array([[0.0, 0.3, 0.5, 0.0, 0.4, 0.5, 0.05]])
    points = odm.sample_capsules(arm, 0.03)
    planner.step(points, q=HOME)
    plain = planner.frame.radii.copy()
    planner.step(points, q=HOME, rounding=0.05)
    assert (planner.frame.radii < plain - 0.005).all()
    planner.step(points, q=HOME, covering_radius=0.01)
    assert np.allclose(planner.frame.radii, plain - 0.02)
    planner.step(points, q=HOME)
    assert np.allclose(planner.frame.radii, plain, atol=1e-12)


def test_braking_sees_points_outside_the_grid(small_map, planner):
    # stretched out, the hand is near the grid's top; who is above it comes in
    q = np.array([0.0, 0.0, 0.0])
    grid, keep = small_map.grid, planner.keep
    balls = sphere_centers(planner.robot, q)[planner.robot.moving]
    radii = planner.robot.spheres[planner.robot.moving, 3]
    far = int(np.argmax(balls[:, 2] + radii))
    point = np.array([[*balls[far, :2], grid.upper[2] + 0.02]])
    gap = (np.linalg.norm(point - balls, axis=1) - radii).min()
    assert (grid.locate(point) < 0).any()
    assert planner.blocked_leg(q[None], gap - keep - 1e-6, point) is None
    assert planner.blocked_leg(q[None], gap - keep + 1e-6, point) == 0
    planner.step(point + [0.0, 0.0, 0.1], q=q)  # who is looked for anew in each frame
    assert planner.separation(q) > gap + 0.05
    planner.step(point, q=q)
    assert planner.blocked_leg(q[None], gap - keep + 1e-6) == 0
    assert planner.separation(q) == pytest.approx(gap)


def test_less_distance_from_a_rounded_surface_is_no_touch(small_map, planner):
    """A ball inside the last sphere, no sample within rho of where it is deepest."""
    robot, safety, radius = small_map.robot, small_map.safety, 0.2
    tip, ball = sphere_centers(robot, HOME)[-1], robot.spheres[-1, 3]
    out = tip / np.linalg.norm(tip)
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    across = np.linalg.svd(out[None])[2][1:]
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ across
    for gap, leg in ((-0.0002, 0), (0.03, None)):
        centre = tip + (ball + gap + radius) * out
        rim, depth = 0.999 * safety.rho, 0.5 * (0.999 * safety.rho) ** 2 / radius
        points = centre - (radius - depth) * out + (rim**2 - depth**2) ** 0.5 * ring
        planner.step(points, q=HOME, rounding=radius)
        assert planner.blocked_leg(HOME[None], -safety.m) == leg


def test_a_point_that_is_no_number_blocks_every_leg(planner):
    nan = np.array([[5.0, np.nan, 0.0]])
    assert planner.blocked_leg(np.stack([HOME, AWAY]), 0.0, nan) == 0


def test_braking_agrees_with_a_slow_twin_wherever_points_are(small_map, planner, rng):
    found = {True: 0, False: 0}
    for _ in range(200):
        q, end = draw_valid(planner, rng), draw_valid(planner, rng)
        dq = 0.2 * (end - q)
        points = rng.uniform(-1.2, 1.2, (6, 3))  # many lie outside the grid
        extra = rng.uniform(0.0, 0.5)
        gap = smallest_gap(small_map, q, dq, points, 200)
        blocked = planner.blocked_leg(np.stack([q, q + dq]), extra, points) is not None
        if gap < planner.keep + extra - 1e-9:
            assert blocked
        elif gap > planner.keep + extra + 0.03:
            assert not blocked
        found[blocked] += 1
    assert min(found.values()) > 30


def capsule_of(row):
    a, b = row[:3], row[3:6]
    z = (b - a) / np.linalg.norm(b - a)
    x = np.cross(z, [1.0, 0.2, 0.3])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = (a + b) / 2
    return odm.Capsule(row[6], np.linalg.norm(b - a), pose)
