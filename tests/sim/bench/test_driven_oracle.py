"""The oracle that drives: perfect sight and planning, but our own dynamics."""

from types import SimpleNamespace

import numpy as np
import pytest

import odm
from odm.obstacles.obstacles import Obstacles
from roadmap.kinematics.forward import tool_pose
from roadmap.motion.motion import time_path
from sim.bench.driven_oracle import ExactPlanner, trips_driven
from sim.bench.trip_oracle import TripOracle
from sim.loop.loop import exact_audit

NOBODY = np.zeros((0, 7))
SECONDS = 6.0


@pytest.fixture(scope="module")
def oracle(small_map):
    """Of two nodes whose tools are far apart, and that a straight motion joins."""
    planner, roadmap = odm.ReactivePlanner(small_map), small_map.roadmap
    tools = [tool_pose(planner.robot, q)[:3, 3] for q in roadmap.nodes]
    a, b = max(roadmap.edges, key=lambda e: np.linalg.norm(tools[e[0]] - tools[e[1]]))
    return TripOracle(planner, roadmap.nodes[[a, b]], 0.5)


def ball_at(oracle, q, off=(0.0, 0.0, 0.0), radius=0.03):
    p = tool_pose(oracle.planner.robot, q)[:3, 3] + off
    return np.r_[p, p, radius][None]


def driven(oracle, capsules):
    return trips_driven(oracle, SimpleNamespace(capsules=capsules), SECONDS)


def test_with_nobody_about_a_trip_takes_what_its_timing_says(oracle):
    robot, blend = oracle.planner.robot, oracle.planner.cell_map.safety.blending
    motion = time_path(robot, oracle.places, blend=blend, speed_scale=0.5)
    trips = trips_driven(oracle, None, SECONDS)
    assert SECONDS / (motion.duration + 0.03) - 0.3 < trips
    assert trips < SECONDS / motion.duration + 0.3
    assert trips < SECONDS / oracle.way_alone(1)  # who is at full speed at once


def test_who_sits_at_a_place_takes_its_trips(oracle):
    at = ball_at(oracle, oracle.places[1])
    assert driven(oracle, lambda t: at) < 1.0
    half = driven(oracle, lambda t: at if t < 0.5 * SECONDS else NOBODY)
    assert 1.0 < half < 0.6 * driven(oracle, lambda t: NOBODY)


def test_a_way_goes_round_where_a_hand_trembles_though_it_is_free_for_now(oracle):
    there = ball_at(oracle, 0.5 * oracle.places.sum(axis=0))
    planner, audit = ExactPlanner(oracle), exact_audit(oracle.planner.robot)
    for k, rows in enumerate((there, there + [0, 0, 3, 0, 0, 3, 0])):
        planner.set_goals(oracle.places[1:])
        shapes = Obstacles(capsules=rows)
        answer = planner.step(shapes, oracle.places[0], 0.1 * k)
    legs = zip(answer.path, answer.path[1:], strict=False)
    near = [
        audit(a + (b - a) * s, there) for a, b in legs for s in np.linspace(0, 1, 9)
    ]
    assert min(near) > oracle.m + 0.02
    planner.step(shapes, oracle.places[0], 1.0)  # much later it is no more
    planner.set_goals(oracle.places[1:])
    assert len(planner.step(shapes, oracle.places[0], 1.1).path) == 2


def test_a_leg_is_blocked_where_a_place_on_it_is_too_near(oracle):
    rng = np.random.default_rng(0)
    planner, audit = ExactPlanner(oracle), exact_audit(oracle.planner.robot)
    nodes = oracle.planner.cell_map.roadmap.nodes
    verdicts = set()
    for _ in range(40):
        path = nodes[rng.integers(len(nodes), size=3)]
        rows = ball_at(oracle, nodes[rng.integers(len(nodes))], rng.normal(0, 0.2, 3))
        found = planner.blocked_leg(path, 0.02, Obstacles(capsules=rows))
        near = [
            min(audit(a + (b - a) * s, rows) for s in np.linspace(0.0, 1.0, 200))
            for a, b in zip(path, path[1:], strict=False)
        ]
        keeps = oracle.m + 0.02
        for k, gap in enumerate(near if found is None else near[:found]):
            assert gap > keeps - 2e-3, k
        assert found is None or near[found] < keeps + 2e-3
        verdicts.add(found)
    assert verdicts == {None, 0, 1}
