"""Behind the hard stop of a joint that its file calls continuous nothing is free."""

import numpy as np
import pytest
from small import planner_of

URDF = """<robot name="scara">
<link name="base"><collision><geometry><box size="0.2 0.2 0.2"/></geometry>
</collision></link>
<link name="upper"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.3 0.1 0.1"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.3 0.08 0.08"/></geometry></collision></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
<limit lower="-2.6" upper="2.6" velocity="1" effort="1"/></joint>
<joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.4 0 0.15"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    return planner_of(tmp_path_factory.mktemp("robot"), URDF, "fore")


def test_no_node_lies_behind_the_stop_and_no_edge_leads_across(planner):
    roadmap = planner.cell_map.roadmap
    turn = roadmap.nodes[:, 0]
    assert np.abs(turn).max() <= 2.6
    ends = turn[np.asarray(roadmap.edges)]
    assert np.abs(ends[:, 0] - ends[:, 1]).max() < np.pi


def test_a_configuration_behind_the_stop_is_not_free(planner):
    inside, behind = np.array([2.5, 0.0]), np.array([2.9, 0.0])
    other = np.array([-2.5, 0.0])
    assert planner.is_free(inside, inside)
    assert not planner.is_free(behind, behind)
    # the short way from one end to the other leads through both stops
    planner.set_goals([other])
    answer = planner.step(np.zeros((0, 3)), q=inside)
    assert answer.status != "holding" and np.abs(answer.path[:, 0]).max() <= 2.6
