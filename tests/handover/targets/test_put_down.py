"""Places for an object are tried in turn, and are on the surface that carries it."""

import numpy as np
import pytest

import handover
from handover.targets.put_down import BESET, BLOCKED, UNREACHED, Places, carries
from odm.obstacles.scenery import parse_scenery
from roadmap.transforms import pose_of

RODS = handover.wrench().capsules
KEEP = 0.01


def test_its_own_place_comes_first_then_those_farthest_from_the_person():
    places, gaps = Places(4), np.array([0.0, 0.3, 0.9, 0.5])
    order = []
    while places.begin_next(gaps, KEEP) is not None:
        order.append(places.now)
        places.leave(BLOCKED)
    assert order == [0, 2, 3, 1] and places.now is None
    assert not places.unreached and not places.beset


def test_a_place_that_the_person_is_in_is_left_out_until_they_have_moved_off():
    places = Places(3)
    places.begin_next(np.array([0.5, 0.005, 0.7]), KEEP)
    places.leave(UNREACHED)
    assert places.begin_next(np.array([0.5, 0.005, 0.7]), KEEP) == 2
    places.leave(BESET)
    assert places.begin_next(np.array([0.5, 0.005, 0.7]), KEEP) is None
    assert places.beset and not places.unreached
    places.forget()  # what is out of reach stays so
    assert places.begin_next(np.array([0.5, 0.6, 0.7]), KEEP) == 2
    places.leave(BLOCKED)
    assert places.begin_next(np.array([0.5, 0.6, 0.7]), KEEP) == 1


def test_who_reaches_none_says_so():
    places = Places(2)
    for _ in range(2):
        places.begin_next(np.full(2, 1.0), KEEP)
        places.leave(UNREACHED)
    assert places.begin_next(np.full(2, 1.0), KEEP) is None and places.unreached


def standing(x, y, z=0.132):
    return pose_of((x, y, z), (0.0, 0.5 * np.pi, 0.0))


TABLE = {"type": "box", "size": [0.6, 0.4, 0.5], "position": [0.5, 0.0, -0.25]}
TURNED = {"type": "box", "size": [0.5, 0.4, 0.6], "position": [0.5, 0.0, -0.25]}
TURNED["rpy"] = [0.0, 0.5 * np.pi, 0.0]


@pytest.mark.parametrize("table", [TABLE, TURNED])
def test_an_object_stands_on_a_box_where_all_of_it_is_above(table):
    scenery = parse_scenery((table,))
    assert carries(scenery, RODS, standing(0.5, 0.1)) == 0
    assert carries(scenery, RODS, standing(0.79, 0.0)) is None  # half of it beyond
    assert carries(scenery, RODS, standing(0.9, 0.0)) is None
    assert carries(scenery, RODS, standing(0.5, 0.1, 0.16)) is None  # in the air
    assert carries(scenery, RODS, standing(0.5, 0.1, 0.10)) is None  # in the table


def test_a_level_floor_carries_and_a_wall_or_a_ball_does_not():
    floor, wall = {"type": "plane"}, {"type": "plane", "normal": [1.0, 0.0, 0.0]}
    wall["offset"] = -3.0
    ball = {"type": "sphere", "radius": 0.3, "position": [0.5, 0.0, -0.3]}
    assert carries(parse_scenery((wall, floor)), RODS, standing(0.5, 0.0)) == 1
    assert carries(parse_scenery((wall, ball)), RODS, standing(0.5, 0.0)) is None
    assert carries(parse_scenery(()), RODS, standing(0.5, 0.0)) is None
