"""Where robot, table and ladder stand: the Panda on a table, ARMAR-III beside one."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

import odm
from odm.frame.last_phase import gripper_links
from roadmap.errors import BadInput
from sim.maintenance import cases
from sim.maintenance.cases import LadderCase
from sim.story.cases import AT_PLACE, BACK
from sim.story.grasping import Reaches
from sim.story.request import ARMAR3, DemoRequest
from sim.story.robot_hand import box_of, quarter_turns

ARMAR = cases.WORK_PLACES[ARMAR3]
SECOND_STEP = 0.56  # [m] above the floor


@pytest.fixture(scope="module")
def beside_armar():
    """ARMAR-III's tools on their table, on a small map; no reach map is needed."""
    recipe = odm.load_recipe(ARMAR.recipe)
    roadmap = replace(recipe.roadmap, nodes=1200)
    robot = replace(recipe.robot, cover_excess=0.05)
    cell_map = odm.build_map(replace(recipe, roadmap=roadmap, robot=robot))
    return cases.tools_of(cell_map, None, (), ARMAR)


def test_armar_takes_each_tool_from_its_place_in_any_turn(beside_armar):
    for setup in beside_armar:
        assert setup.pads == ("hand",) and setup.table == ARMAR.table
        planner = setup.planner()
        for grasp in quarter_turns(setup.obj.T_tool_object, setup.obj.turns):
            told = grasp[None], BACK, None, setup.obj.capsules, 0.0, None, AT_PLACE
            reaches = Reaches(planner, setup.index, *told)
            reaches.begin(setup.T_place, setup.rest)
            while not reaches.over and not reaches.found:
                reaches.work()
            assert reaches.found


def test_the_robot_rests_clear_of_all_tools_however_it_holds_one(beside_armar):
    """At a rest above the table it could not come back with a tool turned round."""
    first = beside_armar[0]
    standing = (*first.others, (first.obj, first.T_place))
    planner = replace(first, T_place=None, others=standing).planner()
    for setup in beside_armar:
        assert np.array_equal(setup.rest, first.rest)
        thing = odm.carried_object(box_of(setup.obj))
        for grasp in quarter_turns(setup.obj.T_tool_object, setup.obj.turns):
            held = planner.carrier.test_with(thing, grasp)
            assert held.motion_free(first.rest, np.zeros_like(first.rest))


def test_people_stand_on_the_floor_that_the_base_stands_on():
    for at in cases.WORK_PLACES.values():
        case = LadderCase.drawn_at(3, at=at)
        rows = case.body().capsules()
        feet = float((rows[:, [2, 5]] - rows[:, 6:7]).min()) + at.base_height
        assert feet == pytest.approx(SECOND_STEP, abs=0.03)
        assert at.distances[0] <= case.distance <= at.distances[1]
        assert at.bearings[0] <= np.degrees(case.bearing) <= at.bearings[1]


def test_a_work_place_comes_back_from_a_recording():
    for at in cases.WORK_PLACES.values():
        kept = json.loads(json.dumps(asdict(at)))
        assert cases.WorkPlace.told(kept) == at


def test_the_demo_is_played_with_either_robot_and_no_other():
    for robot in (None, *cases.WORK_PLACES):
        assert DemoRequest("maintenance", robot=robot).robot == robot


def test_the_map_of_another_robot_is_refused_at_armars_work_place(small_map):
    own, at = sorted(gripper_links(small_map.robot)), replace(ARMAR, pads=("claw",))
    told = rf"map is of {small_map.robot.name}.*'claw'.*armar3_tools.*leave --robot"
    with pytest.raises(BadInput, match=told):
        cases.pads_at(small_map.robot, (), at)
    assert cases.pads_at(small_map.robot, own[:1], at) == tuple(own[:1])
