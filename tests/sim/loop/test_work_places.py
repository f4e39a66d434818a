"""Work places: free, left and right, pointing down where the tool can."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from roadmap import load_robot
from roadmap.kinematics.forward import tool_pose
from sim.loop.work_places import NoWorkPlaces, WorkPlaceSettings, reach_of, work_places

CANDIDATES = WorkPlaceSettings().candidates

ARM = """<robot name="scara"><link name="base"/>{links}{joints}</robot>"""
LINK = """<link name="l{i}"><collision><origin xyz="{half} 0 0"/><geometry>
<box size="{length} 0.05 0.05"/></geometry></collision></link>"""
JOINT = """<joint name="j{i}" type="revolute"><parent link="{parent}"/>
<child link="l{i}"/><origin xyz="{x} 0 {z}"/><axis xyz="{axis}"/>
<limit lower="-2.9" upper="2.9" velocity="1" effort="1"/></joint>"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Return a six-joint arm whose tool can point anywhere."""
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
    lengths = (0.0, 0.4, 0.35, 0.05, 0.05, 0.05)
    parents, x, parts = ["base"], 0.0, ([], [])
    for i, (axis, length) in enumerate(zip(axes, lengths, strict=True)):
        size = max(length, 0.06)
        parts[0].append(LINK.format(i=i, half=length / 2, length=size))
        z = 0.3 if i == 0 else 0.0
        joint = JOINT.format(i=i, parent=parents[-1], x=x, z=z, axis=axis)
        parts[1].append(joint)
        parents.append(f"l{i}")
        x = length
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM.format(links="".join(parts[0]), joints="".join(parts[1])))
    return load_robot(path, tip="l5")


@pytest.fixture(scope="module")
def roadmap(arm):
    rng = np.random.default_rng(0)
    return SimpleNamespace(nodes=rng.uniform(arm.lower, arm.upper, (300, arm.dof)))


def anywhere(q_a, q_b):
    return True


def test_the_places_are_left_and_right_and_the_tool_points_down(arm, roadmap):
    places = work_places(arm, roadmap, anywhere)
    left, right = (tool_pose(arm, q) for q in places)
    assert left[1, 3] > 0.1 and right[1, 3] == pytest.approx(-left[1, 3], abs=1e-4)
    assert left[0, 3] > 0.1 and right[0, 3] == pytest.approx(left[0, 3], abs=1e-4)
    np.testing.assert_allclose(left[:3, 2], [0, 0, -1], atol=1e-4)


def test_only_free_configurations_are_taken(arm, roadmap):
    def is_free(q_a, q_b):
        assert np.array_equal(q_a, q_b)
        return q_a[1] > 0.2

    assert (work_places(arm, roadmap, is_free)[:, 1] > 0.2).all()


def test_a_robot_whose_tool_cannot_point_down_gets_nodes(crane):
    rng = np.random.default_rng(0)
    nodes = rng.uniform(crane.lower, crane.upper, (300, 2))
    places = work_places(crane, SimpleNamespace(nodes=nodes), anywhere)
    assert all((nodes == q).all(axis=1).any() for q in places)
    left, right = (tool_pose(crane, q)[:3, 3] for q in places)
    assert left[1] > 0.1 > -0.1 > right[1]


def test_first_nodes_that_keep_the_arm_folded_are_not_the_last_word(crane):
    rng = np.random.default_rng(0)
    spread = rng.uniform(crane.lower, crane.upper, (300, 2))
    # a roadmap is sorted by place: its first nodes may be those of one side
    folded = crane.lower + 0.02 * rng.uniform(size=(CANDIDATES, 2))
    nodes = np.vstack([folded, spread])
    left, right = work_places(crane, SimpleNamespace(nodes=nodes), anywhere)
    tools = [tool_pose(crane, q)[:3, 3] for q in (left, right)]
    assert tools[0][1] > 0.1 > -0.1 > tools[1][1]


def test_an_arm_that_cannot_go_sideways_goes_up_and_down(arm):
    rng = np.random.default_rng(0)
    nodes = rng.uniform(arm.lower, arm.upper, (300, arm.dof))
    nodes[:, [0, 3, 5]] = 0.0  # all in the plane y = 0
    flat = replace(arm, lower=np.where([1, 0, 0, 1, 0, 1], -1e-9, arm.lower))
    flat = replace(flat, upper=np.where([1, 0, 0, 1, 0, 1], 1e-9, arm.upper))
    places = work_places(flat, SimpleNamespace(nodes=nodes), anywhere)
    tools = np.array([tool_pose(arm, q)[:3, 3] for q in places])
    assert np.abs(tools[:, 1]).max() < 1e-6
    assert np.linalg.norm(tools[0] - tools[1]) > 0.3


def test_two_places_that_are_one_are_refused(crane):
    nodes = np.full((CANDIDATES + 5, 2), crane.lower)
    with pytest.raises(NoWorkPlaces, match="further than 0 cm.*more nodes or a region"):
        work_places(crane, SimpleNamespace(nodes=nodes), anywhere)


def test_the_same_input_gives_the_same_places(arm, roadmap):
    one, two = (work_places(arm, roadmap, anywhere) for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_no_free_place_is_an_error_that_says_where(arm, roadmap):
    with pytest.raises(NoWorkPlaces, match="no free configuration reaches"):
        work_places(arm, roadmap, lambda q_a, q_b: False)


def test_the_reach_is_measured_to_the_side(arm, roadmap):
    assert 0.3 < reach_of(arm, roadmap.nodes) < 0.95
