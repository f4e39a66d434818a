"""Tubes: a motion that is measured anew is judged as the close test judges it."""

import numpy as np
import pytest
from naive_cells import smallest_gap
from shapes_drawn import smallest_solid_gap
from small import HOME, draw_arm, draw_valid

import odm
from odm.search import _judge as judge
from odm.search import _tubes as tubes

FRAMES = 60


def drifting(rng, frames=FRAMES):
    """Yield an arm (2, 7) that moves a little from frame to frame."""
    rods, speed = draw_arm(rng), rng.normal(0.0, 0.012, (2, 6))
    for _ in range(frames):
        speed = 0.9 * speed + rng.normal(0.0, 0.005, (2, 6))
        rods[:, :6] += speed
        yield rods


def as_seen(rods, shapes):
    """Return the arm as the frame's input: shapes, or points."""
    if not shapes:
        return odm.sample_capsules(rods, 0.03)
    obstacles = odm.Obstacles(capsules=2)
    obstacles.capsules[:] = rods
    return obstacles


def gap(cell_map, q, dq, rods, shapes):
    """Return how much farther than asked the spheres stay, by dense samples [m]."""
    if shapes:
        solids = [odm.Capsule.between(r[:3], r[3:6], r[6]) for r in rods]
        return smallest_solid_gap(cell_map, q, dq, solids, 40) - cell_map.safety.m
    points = odm.sample_capsules(rods, 0.03)
    return smallest_gap(cell_map, q, dq, points, 80) - cell_map.safety.m - 0.03


@pytest.mark.parametrize("shapes", [True, False])
def test_a_motion_is_judged_as_from_scratch(small_map, planner, rng, shapes):
    memory, seen = planner.memory, []
    for _ in range(6):
        ends = [(draw_valid(planner, rng), draw_valid(planner, rng)) for _ in range(5)]
        motions = [(a, planner.frame.difference(a, b)) for a, b in ends]
        planner.reset()
        for k, rods in enumerate(drifting(rng)):
            planner.step(as_seen(rods, shapes), q=HOME)
            planner.frame.sort()
            for q, dq in motions:
                known = tubes.find_tube(memory.table, q, dq)[0] != tubes.NOT_KEPT
                free = judge.near_free_again(memory.table, memory.cloud, q, dq)
                fresh = judge.near_free(memory.table, memory.cloud, q, dq)
                assert free == fresh
                seen.append((known, free))
                if free and known and k % 10 == 0:
                    assert gap(small_map, q, dq, rods, shapes) > -1e-9
    known, free = np.array(seen).T
    assert (known & free).sum() > 100 and (known & ~free).sum() > 20


def test_the_rest_of_a_motion_is_found_and_what_lies_behind_left_out(
    small_map, planner, rng
):
    memory, ahead, behind = planner.memory, 0, 0
    for _ in range(40):
        q, goal = draw_valid(planner, rng), draw_valid(planner, rng)
        dq = planner.frame.difference(q, goal)
        planner.reset()
        for rods in drifting(rng, 12):
            planner.step(as_seen(rods, True), q=HOME)
            whole = judge.near_free_again(memory.table, memory.cloud, q, dq)
            share = rng.uniform(0.0, 0.9)
            begin, rest = q + share * dq, (1.0 - share) * dq
            tube, at, off = tubes.find_tube(memory.table, begin, rest)
            free = judge.near_free_again(memory.table, memory.cloud, begin, rest)
            assert free or not whole
            if tube != tubes.NOT_KEPT:
                assert off <= tubes.SAME
                ahead, behind = ahead + free, behind + (free and not whole)
            if free:
                assert gap(small_map, begin, rest, rods, True) > -1e-9
    assert ahead > 50 and behind > 3


def test_no_tube_is_kept_for_another_motion_or_another_hand(planner, rng):
    memory = planner.memory
    q, goal = draw_valid(planner, rng), draw_valid(planner, rng)
    dq = planner.frame.difference(q, goal)
    for rods in drifting(rng, 300):
        planner.step(as_seen(rods, True), q=HOME)
        judge.near_free_again(memory.table, memory.cloud, q, dq)
        if tubes.find_tube(memory.table, q, dq)[0] != tubes.NOT_KEPT:
            break
    assert tubes.find_tube(memory.table, q, dq)[0] != tubes.NOT_KEPT
    beside = np.array([1e-5, 0.0, 0.0])
    assert tubes.find_tube(memory.table, q + beside, dq - beside)[0] == tubes.NOT_KEPT
    assert tubes.find_tube(memory.table, q, dq - beside)[0] == tubes.NOT_KEPT
    assert tubes.find_tube(memory.table, q + np.nan, dq)[0] == tubes.NOT_KEPT
    planner.frame.hand_changed()
    assert tubes.find_tube(memory.table, q, dq)[0] == tubes.NOT_KEPT
