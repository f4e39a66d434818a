"""Continuous joints with limits in the file: a range is kept, and that is told."""

import numpy as np
import pytest
from urdf_parts import BALL, COARSE

from roadmap import load_robot
from roadmap.errors import BadRobot
from roadmap.graph.sampling import SAMPLERS, draw


@pytest.fixture
def turning(arm):
    """Return a function: attributes of <limit> -> a robot with a continuous joint."""

    def load(limits, **options):
        limit = f'<limit {limits} velocity="1" effort="1"/>'
        return load_robot(arm(BALL, "continuous", limit), **COARSE, **options)

    return load


def remarks(robot):
    return [note for note in robot.notes if note.startswith("turn: ")]


@pytest.mark.parametrize(
    ("low", "high"), [(-2.6, 2.6), (-3.0, -1.0), (-3.1416, 3.1416), (-6.3, 6.3)]
)
def test_a_range_is_kept_and_told(turning, low, high):
    robot = turning(f'lower="{low}" upper="{high}"')
    assert not robot.continuous.any()
    assert (robot.lower[0], robot.upper[0]) == (low, high)
    (text,) = remarks(robot)
    assert f"{low:g} to {high:g}" in text


@pytest.mark.parametrize("sampling", SAMPLERS)
def test_no_sample_lies_behind_the_stop(turning, sampling):
    robot = turning('lower="-2.6" upper="2.6"')
    q = next(draw(robot, sampling, 1, 1000, None))
    assert len(q) > 100 and np.abs(q).max() <= 2.6


@pytest.mark.parametrize("limits", ["", 'lower="0" upper="0"'])
def test_no_range_is_no_limit(turning, limits):
    robot = turning(limits)
    assert robot.continuous.all() and not remarks(robot)


def test_a_stop_too_far_to_be_met_is_none_and_told(turning):
    robot = turning('lower="-1e16" upper="1e16"')
    assert robot.continuous.all() and "1e+16" in remarks(robot)[0]


@pytest.mark.parametrize(
    "limits",
    ['lower="-1"', 'upper="2"', 'lower="1" upper="-1"', 'lower="1" upper="1"',
     'lower="nan" upper="1"', 'lower="-inf" upper="1"'],
)  # fmt: skip
def test_half_a_range_is_refused(turning, limits):
    with pytest.raises(BadRobot, match="'turn'.*both"):
        turning(limits)


def test_it_is_locked_within_its_limits(turning, urdf, link, joint):
    limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    body = link("base", BALL) + link("a", BALL) + link("b", BALL)
    body += joint("turn", "continuous", "base", "a", inside=limit)
    path = urdf(body + joint("next", "revolute", "a", "b"))
    with pytest.raises(BadRobot, match="cannot be locked at 2"):
        load_robot(path, locked={"turn": 2.0}, **COARSE)


def test_a_joint_is_not_locked_in_degrees(arm, urdf, link, joint):
    body = link("base", BALL) + link("a", BALL) + link("b", BALL)
    body += joint("turn", "continuous", "base", "a")
    path = urdf(body + joint("next", "revolute", "a", "b"))
    for locked in ({"turn": 90.0}, {"next": -45.0}):
        with pytest.raises(BadRobot, match="degrees"):
            load_robot(path, tip="b", locked=locked, **COARSE)
    assert load_robot(path, tip="b", locked={"turn": 3.0}, **COARSE).dof == 1


def test_a_known_robot_that_turns_without_end_does():
    pytest.importorskip("pinocchio")
    robot = load_robot("kinova", **COARSE)
    assert list(robot.continuous) == [True, False, False, True, False, True]
