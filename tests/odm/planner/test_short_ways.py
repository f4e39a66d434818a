"""Corners are joined by the shorter turn of a continuous joint, whoever tests them."""

import numpy as np
import pytest
from small import planner_of

import odm
from roadmap.errors import BadInput
from roadmap.kinematics.forward import unwrapped
from roadmap.motion.motion import time_path

URDF = """<robot name="bar">
<link name="base"><collision><origin xyz="0 0 0.05"/><geometry>
<box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="bar"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.4 0.06 0.06"/></geometry></collision></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="bar"/>
<origin xyz="0 0 0.2"/><axis xyz="0 0 1"/><limit velocity="2" effort="1"/></joint>
</robot>
"""
OVER_PI = np.array([[2.4], [-2.4]])  # 1.5 rad the short way, 4.8 the long one
BEHIND = odm.Obstacles(spheres=np.array([[-0.35, 0.0, 0.2, 0.05]]))
ELBOW = """<link name="fore"><collision><origin xyz="0.1 0 0"/><geometry>
<box size="0.2 0.06 0.06"/></geometry></collision></link>
<joint name="elbow" type="continuous"><parent link="bar"/><child link="fore"/>
<origin xyz="0.4 0 0.08"/><axis xyz="0 0 1"/><limit velocity="2" effort="1"/></joint>
</robot>"""
BEFORE = odm.Obstacles(spheres=np.array([[0.35, 0.0, 0.2, 0.05]]))


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    return planner_of(tmp_path_factory.mktemp("robot"), URDF, "bar", 40)


def test_braking_looks_where_the_robot_turns(planner):
    assert planner.blocked_leg(OVER_PI, points=BEHIND) == 0
    assert planner.blocked_leg(OVER_PI, points=BEFORE) is None
    planner.step(BEHIND, q=OVER_PI[0])
    assert not planner.is_free(*OVER_PI) and planner.blocked_leg(OVER_PI) == 0


def test_a_motion_turns_where_braking_looks(planner):
    motion = time_path(planner.robot, OVER_PI)
    turns = [motion.path.at(s)[0][0] for s in np.linspace(0.0, motion.length, 9)]
    assert min(turns) >= 2.4 - 1e-9 and max(turns) <= 2.0 * np.pi - 2.4 + 1e-9
    path = unwrapped(planner.robot, OVER_PI)
    assert path.ravel() == pytest.approx([2.4, 2.0 * np.pi - 2.4])


def test_the_first_leg_that_is_blocked_is_told(planner):
    path = np.array([[0.3], [2.0], [2.4], [-2.4], [-1.0]])
    assert planner.blocked_leg(path, points=BEHIND) == 2
    assert planner.blocked_leg(path[::-1], points=BEHIND) == 1
    path[1] = np.nan
    assert planner.blocked_leg(path, points=BEFORE) == 0


@pytest.mark.parametrize("extra", [None, "1", np.zeros(2)])
def test_an_extra_that_is_no_number_is_refused(planner, extra):
    with pytest.raises(BadInput, match="extra is"):
        planner.blocked_leg(OVER_PI, extra)


@pytest.fixture
def the_long_way(tmp_path):
    """Return a planner whose path goes the long way round, and by a detour."""
    urdf = URDF.replace("</robot>", ELBOW)
    planner = planner_of(tmp_path, urdf, "fore", 40)
    corners = np.array([[1.9, 0.0], [0.8, 2.0], [-0.8, 2.0], [-1.9, 0.0]])
    planner.set_goals(corners[-1:])
    planner.step(BEHIND, q=corners[0])
    attacher = planner.smoother.attacher
    item = attacher.sweep(corners[:-1], np.diff(corners, axis=0))
    vertices = [attacher.new_vertex() for _ in corners]
    planner.path.lead(0, vertices, corners, range(item, item + 3))
    assert len(planner.step(BEHIND, q=corners[0]).path) == 4
    return planner, corners[0]


def test_a_straight_motion_to_the_goal_is_tested_where_it_turns(the_long_way):
    planner, q = the_long_way
    planner.smoother.look_straight()
    planner.improve(8)
    assert planner.blocked_leg(planner.step(BEHIND, q=q).path) is None


def test_cuts_are_tested_where_they_turn(the_long_way, monkeypatch):
    planner, _ = the_long_way
    tried = []
    told = planner.smoother, "_try", lambda change, *_: tried.append(change) or 0
    monkeypatch.setattr(*told)
    planner.improve(8)
    turns = [np.abs(np.diff(change.corners, axis=0)).max() for change in tried]
    assert len(turns) > 3 and max(turns) <= np.pi
