"""The clearance overhead is measured, term by term; what is built on holds exactly."""

import numpy as np
import pytest
from robot_audit import audit_robot, volume_points
from small import draw_arm, draw_valid

import odm
from odm.audit.clearance import TERMS, clearance_overhead
from odm.exact.distances import ExactRobot
from roadmap.kinematics.forward import difference
from roadmap.robot.robot import BOX, CYLINDER, SPHERE


@pytest.fixture(scope="module")
def overhead(small_map):
    return clearance_overhead(small_map, 150, seed=2, n_edges=30)


def test_the_terms_add_up_to_the_whole_overhead(overhead):
    assert tuple(overhead.terms) == TERMS
    whole = sum(overhead.terms[name][0] for name in ("cover", "rho", "cells"))
    assert whole == pytest.approx(overhead.by_cells[0], abs=3e-5)
    close = sum(overhead.terms[name][0] for name in ("cover", "rho"))
    assert close == pytest.approx(overhead.by_close_test[0], abs=3e-5)
    assert overhead.lines > 75 and overhead.edge_lines > 10


def test_no_term_takes_more_than_it_may(overhead, small_map):
    safety = small_map.safety
    diagonal = np.sqrt(3) * safety.h
    for name, most in (("cover", 0.02), ("rho", safety.rho), ("cells", diagonal)):
        mean, median, high = overhead.terms[name]
        assert -1e-3 <= mean <= most + 2e-3 and median <= high <= most + 2e-3
    assert overhead.terms["mu"][0] <= 0.5 * safety.mu + safety.h
    assert overhead.by_close_test[0] <= overhead.by_cells[0]
    # shapes pay the cover, and a millimetre of the scan, but no covering radius
    assert overhead.terms["cover"][0] - 1.1e-3 <= overhead.by_shapes[0]
    assert overhead.by_shapes[0] <= overhead.terms["cover"][0] + 2e-3
    assert overhead.edge_by_shapes[0] < overhead.edge_by_close_test[0] - 0.01
    # a frame's samples of them lie below the surface: their cells block later
    assert overhead.by_shapes[0] < overhead.by_shape_cells[0]
    assert overhead.by_shape_cells[0] < overhead.by_cells[0] - 0.01
    assert overhead.edge_by_shape_cells[0] < overhead.edge_by_cells[0] - 0.01
    assert overhead.as_dict()["m"] == safety.m


def test_what_the_roadmap_was_built_on_holds_exactly(small_map):
    found = audit_robot(small_map, points=20_000, configurations=500)
    assert found.passed, found
    assert found.outside == 0 and found.farthest <= 0.0
    assert found.scenery_smallest >= found.m
    assert found.as_dict()["passed"]


def test_volume_points_lie_in_their_solids(small_map):
    robot, rng = small_map.robot, np.random.default_rng(0)
    for i, kind in enumerate(robot.solid_kind):
        T = robot.solid_pose[i]
        local = (volume_points(robot, i, 500, rng) - T[:3, 3]) @ T[:3, :3]
        size = robot.solid_size[i]
        if kind == BOX:
            assert (np.abs(local) <= size / 2 + 1e-12).all()
        elif kind == CYLINDER:
            assert np.hypot(*local[:, :2].T).max() <= size[0] + 1e-12
            assert np.abs(local[:, 2]).max() <= size[1] / 2 + 1e-12
        elif kind == SPHERE:
            assert np.linalg.norm(local, axis=1).max() <= size[0] + 1e-12


def test_what_is_free_calls_free_is_free_exactly(planner, rng):
    """The whole motion, against solids, at least m away and free of itself."""
    robot, m = planner.robot, planner.cell_map.safety.m
    exact, whole = ExactRobot(robot), ExactRobot(robot, base=True)
    free = 0
    for _ in range(60):
        arm = draw_arm(rng)
        q_a, q_b = draw_valid(planner, rng), draw_valid(planner, rng)
        planner.step(odm.sample_capsules(arm, 0.03), q=q_a)
        if not planner.is_free(q_a, q_b):
            continue
        free += 1
        shapes = [odm.Capsule.between(row[:3], row[3:6], row[6]) for row in arm]
        dq = difference(robot, q_a, q_b)
        for t in np.linspace(0, 1, 40):
            q = q_a + t * dq
            assert exact.distance(q, shapes).distance >= m
            assert whole.self_distance(q).distance > 0.0
    assert free >= 10
