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
    find_handover,
    load_hand,
    total_quality,
    wrench,
)
from handover.meet.constraints import ClearOf
from handover.meet.held_object import fist_grasps
from handover.meet.places import qualities_at
from odm.obstacles.scenery import Scenery
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
        ({"constraints": None}, "constraints is None"),
        ({"marked_share": None}, "marked_share is None"),
        ({"rotations": np.zeros(2)}, "no grid has array"),
        ({"side": np.zeros(2)}, "no array.* arm; choose left or right"),
        ({"quality": "best"}, r"quality is .* give QualitySettings\("),
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
    with pytest.raises(BadInput, match="human_reach is 'coarse'"):
        InteractionWorkspace(robot_map, Human(), wrench(), human_reach="coarse")
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
        (lambda: Inside("abc", (1, 1, 0)), "corners must be an array of real"),
        (lambda: Inside((0, 0, 0), (1, 1, 1), np.ones(2)), "outside is array"),
        (lambda: Upright("steep"), "tilt of 'steep'"),
        (lambda: Upright(0.1, axis={}), "axis must be an array of real"),
        (lambda: ClearOf("table"), "scenery is 'table'"),
        (lambda: ClearOf(Scenery(), np.zeros((4, 4))), "T_world_base"),
        (lambda: QualitySettings(weights="even"), "weights must be an array of real"),
        (lambda: QualitySettings(joint_weights={}), "joint_weights must be"),
        (lambda: QualitySettings(absent_gaze=np.ones(2)), "no way array"),
        (lambda: replace(wrench(), name=3.0), "name is 3.0"),
        (lambda: fist_grasps(None), "places must be an array of real"),
        (lambda: fist_grasps([np.nan]), "give a list of finite"),
        (lambda: qualities_at(Human(), "right", "here"), "places must be an array"),
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
        (lambda meet: meet.takeable(None), "targets is None"),
        (lambda meet: meet.takeable([3]), "a target is 3"),
        (lambda meet: meet.takeable([], "table"), "scene is 'table'"),
        (lambda meet: meet.restore(3), "targets is 3"),
        (lambda meet: [meet.begin(1), meet.go_on(np.nan)], "budget of nan"),
        (lambda meet: [meet.begin(1), meet.go_on("all")], "budget of 'all'"),
        (lambda meet: find_handover(None, None, bool), "meet is None"),
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
