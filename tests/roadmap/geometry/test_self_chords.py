"""Motions proved along chords: the same verdicts, and a sag that is never exceeded."""

import numpy as np
import pytest
from wrappers import with_wrapper

from roadmap.geometry import _self_collision as kernels
from roadmap.geometry._self_chords import write_sags
from roadmap.geometry.self_collision import (
    FINEST,
    MARGIN,
    TOLERANCE,
    configuration_free,
    self_collision,
)
from roadmap.kinematics.forward import body_frames
from roadmap.loading.held_link import extended_collision, with_payload

write_sags = with_wrapper(write_sags)

ROBOTS = ["panda", "gantry", "loaded"]
BALLS = np.array([[0.0, 0.0, 0.1, 0.05], [0.0, 0.05, 0.2, 0.04]])


@pytest.fixture
def tested(request):
    """Return a robot by name, and its model of self-collision."""
    if request.param != "loaded":
        robot = request.getfixturevalue(request.param)
        return robot, self_collision(robot)
    bare = request.getfixturevalue("panda")
    robot = with_payload(bare, BALLS)
    return robot, extended_collision(self_collision(bare), robot)


def motions(robot, n, rng):
    """Return n motions of all lengths, q and dq (n, dof) each."""
    q, to = rng.uniform(robot.lower, robot.upper, (2, n, robot.dof))
    return q, (to - q) * rng.choice([0.02, 0.1, 0.3, 1.0], n)[:, None]


@pytest.mark.parametrize("tested", ROBOTS, indirect=True)
def test_chords_say_what_halving_says(tested, rng):
    robot, known = tested
    refused = free = met_between = 0
    scratch = known.scratch()
    for q, dq in zip(*motions(robot, 1500, rng), strict=True):
        asked = known.model, q, dq, MARGIN, TOLERANCE, FINEST, scratch
        pair, _ = kernels.motion_clear(*asked)
        assert kernels.motion_apart(*asked) == (pair < 0)
        free += pair < 0
        if pair >= 0:
            refused += 1
            ends = [configuration_free(robot, x)[0] for x in (q, q + dq)]
            met_between += all(ends)
    assert free > 300 and refused > 50
    if robot.dof == 7:
        assert met_between > 5


@pytest.mark.parametrize("tested", ROBOTS, indirect=True)
def test_no_point_of_a_pair_leaves_its_chord_by_more_than_the_sag(tested, rng):
    robot, known = tested
    model, nearly = known.model, 0.0
    chords = known.scratch().chords
    for q, dq in zip(*motions(robot, 60, rng), strict=True):
        write_sags(model, dq, chords)
        at = [body_frames(robot, q + t * dq) for t in (0.0, 0.3, 0.5, 1.0)]
        for p, row in enumerate(model.pairs):
            off = 0.0
            for side in range(2):
                points = model.points[row[4 + 2 * side] : row[5 + 2 * side]]
                x0, x3, x5, x1 = (
                    seen_from(T[model.carrier[p]], T[row[2 + side]], points) for T in at
                )
                sides = [x3 - 0.7 * x0 - 0.3 * x1, x5 - 0.5 * (x0 + x1)]
                off += max(np.linalg.norm(s, axis=1).max() for s in sides)
            assert off <= chords.sags[p] + 1e-9
            if chords.sags[p] > 1e-3:
                nearly = max(nearly, off / chords.sags[p])
    assert nearly > 0.3  # the bound is one that counts


def seen_from(T_base_carrier, T_base_body, points):
    """Return points (n, 3) of a body in the frame of another."""
    T = np.linalg.inv(T_base_carrier) @ T_base_body
    return points @ T[:3, :3].T + T[:3, 3]


def test_the_rods_contain_their_shells(panda):
    model = self_collision(panda).model
    for k, (ax, ay, az, bx, by, bz, radius) in enumerate(model.rods):
        points = panda.shell_points[panda.shell_ptr[k] : panda.shell_ptr[k + 1]]
        a, b = np.array([ax, ay, az]), np.array([bx, by, bz])
        along = (points - a) @ (b - a) / max(1e-12, (b - a) @ (b - a))
        nearest = a + np.clip(along, 0.0, 1.0)[:, None] * (b - a)
        assert np.linalg.norm(points - nearest, axis=1).max() <= radius
        assert radius < 0.14


def test_a_configuration_that_is_not_finite_is_never_free(panda):
    known = self_collision(panda)
    for value in (np.nan, np.inf):
        q, dq = np.zeros(7), np.full(7, 0.5)
        q[3] = value
        asked = known.model, q, dq, MARGIN, TOLERANCE, FINEST, known.scratch()
        assert not kernels.motion_apart(*asked)
