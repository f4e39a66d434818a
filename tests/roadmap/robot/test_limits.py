"""Limits of velocity, acceleration and jerk that a URDF lacks or that a user knows."""

import numpy as np
import pytest
from rows import each
from small import DATA, small_recipe
from urdf_parts import BALL, COARSE

import roadmap
from odm.cell_map.build import robot_of
from odm.cell_map.recipe import parse_recipe
from roadmap.errors import BadRobot

ARM = DATA / "arm3.urdf"


def test_given_limits_take_the_place_of_the_file_s_and_of_the_defaults():
    plain = roadmap.load_robot(ARM, tip="tool")
    robot = roadmap.load_robot(
        ARM,
        tip="tool",
        velocity={"bend": 0.7},
        acceleration={"turn": 5.0},
        jerk={"twist": 123.0},
    )
    assert np.allclose(robot.max_velocity, [1.5, 0.7, 2.0])
    assert robot.max_acceleration[0] == 5.0 and robot.max_jerk[2] == 123.0
    assert np.array_equal(robot.max_acceleration[1:], plain.max_acceleration[1:])
    assert np.array_equal(robot.max_jerk[:2], plain.max_jerk[:2])


@each("kind", ["velocity", "acceleration", "jerk"])
@each(
    ("values", "word"),
    [({"elbow": 1.0}, "elbow"), ({"bend": 0.0}, "0"), ({"bend": np.nan}, "nan")],
)
def test_a_limit_of_no_joint_or_that_is_none_is_refused(kind, values, word):
    with pytest.raises(BadRobot, match=word):
        roadmap.load_robot(ARM, tip="tool", **{kind: values})


def test_a_recipe_carries_limits_to_its_robot_and_into_its_table():
    table = small_recipe().as_dict()
    table["robot"] |= {"acceleration": {"bend": 4.0}, "jerk": {"bend": 44.0}}
    recipe = parse_recipe(table, "quick")
    robot = robot_of(recipe)
    assert robot.max_acceleration[1] == 4.0 and robot.max_jerk[1] == 44.0
    assert recipe.as_dict()["robot"]["jerk"] == {"bend": 44.0}


def test_the_panda_has_its_maker_s_limits(panda):
    # https://frankaemika.github.io/docs/control_parameters.html
    assert np.allclose(panda.max_acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])
    assert np.allclose(panda.max_jerk, [7500, 3750, 5000, 6250, 7500, 10000, 10000])


@pytest.mark.parametrize("stop", [170, 20])
def test_limits_in_degrees_are_refused(arm, stop):
    limit = f'<limit lower="-{stop}" upper="{stop}" velocity="120" effort="1"/>'
    with pytest.raises(BadRobot, match="'turn' .*looks like degrees; give radians"):
        roadmap.load_robot(arm(BALL, "revolute", limit), **COARSE)


@pytest.mark.parametrize(
    ("stop", "kind"),
    [(6.28, "revolute"), (12.6, "revolute"), (62.8, "continuous"), (2.0, "prismatic")],
)
def test_several_turns_are_no_degrees(arm, stop, kind):
    limit = f'<limit lower="-{stop}" upper="{stop}" velocity="1" effort="1"/>'
    assert roadmap.load_robot(arm(BALL, kind, limit), **COARSE).upper[0] == stop


def test_a_velocity_that_is_none_is_told_as_the_file_has_it(arm):
    limit = '<limit lower="-1" upper="1" velocity="-3" effort="1"/>'
    notes = roadmap.load_robot(arm(BALL, inside=limit), **COARSE).notes
    assert "turn: velocity limit taken as 1.0 rad/s (-3 in the file)" in notes
