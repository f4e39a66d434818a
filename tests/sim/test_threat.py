"""Which points are near, and how they move."""

import numpy as np
import pytest

import odm
from sim.threat import Threat, ThreatSettings, Watcher

CENTERS = np.array([[0.0, 0.0, 0.5], [0.2, 0.0, 0.8]])


def naive_velocity(p, ends, before, passed, radii):
    """Return the velocity of a point above the nearest of some capsules."""
    found = []
    for (a, b), (a0, b0), r in zip(ends, before, radii, strict=True):
        t = np.clip(np.dot(p - a, b - a) / max(np.dot(b - a, b - a), 1e-12), 0, 1)
        off = abs(np.linalg.norm(p - (a + t * (b - a))) - r)
        found.append((off, ((1 - t) * (a - a0) + t * (b - b0)) / passed))
    return min(found, key=lambda entry: entry[0])[1]


def test_points_move_as_the_place_of_the_axis_that_they_stand_above(rng):
    for _ in range(20):
        before = rng.uniform(-0.5, 0.5, (3, 7))
        before[:, 6] = rng.uniform(0.03, 0.08, 3)
        arms = before + np.r_[rng.normal(0, 0.01, 6), 0.0]
        arms[0, :3] = arms[0, 3:6]  # a ball
        points = odm.sample_capsules(arms, 0.03)
        watcher = Watcher()
        assert watcher.look(before, points, CENTERS, 1.0).velocity is None
        threat = watcher.look(arms, points, CENTERS, 1.02)
        assert np.array_equal(threat.points, points)
        ends, old = (a[:, :6].reshape(-1, 2, 3) for a in (arms, before))
        for p, v in zip(points, threat.velocity, strict=True):
            slow = naive_velocity(p, ends, old, 0.02, arms[:, 6])
            assert v == pytest.approx(slow, abs=1e-9)


def test_points_far_from_the_robot_are_left_out_and_no_others(rng):
    points = rng.uniform(-4, 4, (500, 3))
    arm = np.array([[1.0, 0, 0, 1.0, 0, 0.5, 0.05]])
    settings = ThreatSettings(far=0.7)
    threat = Watcher(settings).look(arm, points, CENTERS, 0.0)
    low, high = CENTERS.min(axis=0) - 0.7, CENTERS.max(axis=0) + 0.7
    near = ((points > low) & (points < high)).all(axis=1)
    assert 0 < near.sum() < 500
    assert np.array_equal(threat.points, points[near])


def test_balls_hold_a_point_that_speeds_up_within_the_bound(rng):
    settings = ThreatSettings(acceleration=4.0)
    v = np.array([[0.7, -0.3, 0.1]])
    threat = Threat(np.zeros((1, 3)), v, 0.01, settings)
    for _ in range(50):
        begin = rng.uniform(0, 0.3)
        end = begin + rng.uniform(0, 0.1)
        centers, radius = threat.between(begin, end)
        pushed = rng.normal(size=3)
        pushed *= 4.0 / np.linalg.norm(pushed)
        for t in np.linspace(begin, end, 7) + 0.01:
            at = v[0] * t + 0.5 * pushed * t * t
            assert np.linalg.norm(at - centers[0]) <= radius + 1e-12
