"""The interaction workspace: what it refuses, each in one sentence."""

from dataclasses import replace

import numpy as np
import pytest
from rows import each

from handover import (
    Above,
    Human,
    Inside,
    InteractionWorkspace,
    QualitySettings,
    Upright,
    load_hand,
    total_quality,
    wrench,
)
from roadmap.errors import BadInput


def no_rigid():
    T = np.eye(4)[None].copy()
    T[0, 0, 0] = 2.0
    return T


@pytest.mark.parametrize(
    ("grasps", "says"),
    [
        ([], "no human grasp"),
        (0, "0 of them"),
        (99, "16 human grasps"),
        (np.eye(4), "shape"),
        (no_rigid(), "grasp 0"),
        (np.full((1, 4, 4), np.nan), "NaN"),
    ],
)
def test_grasps_that_are_none_are_refused(grasps, says, meet_of):
    with pytest.raises(BadInput, match=says):
        meet_of(Human(), grasps=grasps)


@each(
    ("settings", "says"),
    [
        ({"cell": 0.05}, "finer than the 0.1"),
        ({"cell": 7.0}, r"cell \[m\] is 7.0"),
        ({"cell": float("nan")}, r"cell \[m\] is nan"),
        ({"rotations": 576}, "more than the 72"),
        ({"rotations": 100}, "no grid has 100"),
        ({"marked_share": 1.0}, "marked_share"),
        ({"side": "both"}, "no 'both' arm"),
        ({"swivel_step": 0.0}, "swivel_step"),
        ({"T_world_base": np.eye(3)}, "T_world_base"),
        ({"T_world_base": np.diag([1.0, 1, 2, 1])}, "not a rigid motion"),
        ({"obstacles": np.zeros((1, 6))}, "obstacles"),
        ({"constraints": ["upright"]}, "no constraint"),
    ],
)
def test_settings_that_are_none_are_refused(settings, says, meet_of):
    with pytest.raises(BadInput, match=says):
        meet_of(Human(), **settings)


def test_maps_in_the_wrong_place_are_refused(robot_map, person_map, meet_of):
    with pytest.raises(BadInput, match="give a robot's map"):
        InteractionWorkspace(person_map, Human(), wrench())
    with pytest.raises(BadInput, match="of a person's arm"):
        InteractionWorkspace(robot_map, Human(), wrench(), human_reach=robot_map)
    meet = meet_of(Human().placed(0.8, 0, np.pi))
    with pytest.raises(BadInput, match="best 0"):
        meet.best(0)
    target = replace(meet.best(1)[0], key=-5)
    with pytest.raises(BadInput, match="key -5"):
        meet.remove(target)


@each(
    ("make", "says"),
    [
        (lambda: Upright(0.0), "tilt of 0.0"),
        (lambda: Upright(0.1, axis=(0, 0, 0)), "is zero"),
        (lambda: Upright(0.1, up=(0, np.nan, 1)), "three finite"),
        (lambda: Above(np.nan), "Above in m is nan"),
        (lambda: Above("high"), "Above in m is .high."),
        (lambda: Inside((0, 0, 1), (1, 1, 0)), "box from"),
        (lambda: wrench().held_by(np.zeros((4, 4))), "T_tool_object"),
        (lambda: replace(wrench(), mass_kg=0.0), "mass of 0.0"),
        (lambda: replace(wrench(), capsules=np.zeros((1, 7))), "radius of 0"),
        (lambda: replace(wrench(), capsules=np.zeros((0, 7))), "shape"),
    ],
)
def test_objects_and_constraints_that_are_none_are_refused(make, says):
    with pytest.raises(BadInput, match=says):
        make()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda meet: meet.rated([0.5]), "keys are .0.5.; give whole numbers"),
        (lambda meet: meet.rated([[1], [2, 3]]), "keys are ..1., .2, 3..; give"),
        (lambda meet: meet.rated([10**400]), "keys are .10+.*; give whole numbers"),
        (lambda meet: meet.remove(None), "target is None .NoneType.; give one"),
        (lambda meet: total_quality("x", 1.0, QualitySettings()), "online must be"),
        (lambda meet: total_quality(1.0, 1.0, None), "settings is None"),
        (lambda meet: load_hand([]), "there is no hand .."),
    ],
)
def test_keys_targets_and_qualities_that_are_none_are_refused(call, says, meet_of):
    meet = meet_of(Human())
    assert meet.rated([]) == []
    with pytest.raises(BadInput, match=says):
        call(meet)


def test_a_constraint_must_judge_every_pose(meet_of):
    class Odd:
        def allows(self, T_world_object, obj):
            return np.ones(3)

    with pytest.raises(BadInput, match="must return"):
        meet_of(Human(), constraints=[Odd()])
