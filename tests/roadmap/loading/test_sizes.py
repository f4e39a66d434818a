"""Sizes that no robot has are told at once: mostly millimetres read as metres."""

import time

import numpy as np
import pytest
from urdf_parts import BALL, COARSE, mesh

from roadmap import load_robot
from roadmap.errors import BadRobot
from roadmap.geometry.spheres import robot_solids

TETRAHEDRON = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\n"
TETRAHEDRON += "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


@pytest.fixture
def drawn(tmp_path, arm):
    """Return a function: size and scale of a mesh -> the URDF of an arm with it."""

    def write(size, scale=""):
        (tmp_path / "part.obj").write_text(TETRAHEDRON.format(size))
        return arm(mesh("part.obj", scale))

    return write


def told(path):
    begun = time.perf_counter()
    with pytest.raises(BadRobot) as error:
        load_robot(path)
    assert time.perf_counter() - begun < 5.0
    text = str(error.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize("size", [12.0, 400.0, 3000.0])
def test_a_mesh_in_millimetres_is_refused_with_the_likely_scale(drawn, size):
    text = told(drawn(size))
    assert "'arm'" in text and "part.obj" in text and f"{size:g} m" in text
    assert "5 m" in text and 'scale="0.001 0.001 0.001"' in text


def test_the_scale_that_is_proposed_loads_it(drawn):
    robot = load_robot(drawn(400.0, 'scale="0.001 0.001 0.001"'), **COARSE)
    assert np.ptp(robot_solids(robot)[1].points, axis=0).max() == pytest.approx(0.4)


def test_a_large_mesh_that_states_its_scale_is_meant(drawn):
    text = told(drawn(12.0))
    assert 'scale="1 1 1"' in text
    robot = load_robot(drawn(12.0, 'scale="1 1 1"'), cover_excess=1.0)
    assert len(robot.spheres)
    assert 'scale="1 1 1"' not in told(drawn(80.0, 'scale="1 1 1"'))


def test_a_mesh_that_was_scaled_twice_is_refused(drawn):
    text = told(drawn(0.3, 'scale="0.001 0.001 0.001"'))
    assert "0.3 mm" in text and 'scale="1 1 1"' in text


@pytest.mark.parametrize(
    "shape",
    ['<box size="800 60 60"/>', '<cylinder radius="60" length="400"/>',
     '<sphere radius="70"/>'],
)  # fmt: skip
def test_a_primitive_in_millimetres_is_refused(arm, shape):
    text = told(arm(shape))
    assert "'arm'" in text and "30 m" in text and "millimetres" in text


def test_a_robot_in_kilometres_is_refused(urdf, link, joint):
    body = link("base", '<sphere radius="0.0001"/>')
    body += link("arm", '<box size="0.0004 0.0001 0.0001"/>')
    text = told(urdf(body + joint("turn", "revolute", "base", "arm")))
    assert "0.4 mm" in text and "metres" in text


def test_a_joint_in_millimetres_is_refused(urdf, link, joint):
    body = link("base", BALL) + link("arm", BALL)
    text = told(urdf(body + joint("turn", "revolute", "base", "arm", "0 0 333")))
    assert "'turn'" in text and "333 m" in text


@pytest.mark.parametrize(
    ("kind", "limits", "words"),
    [
        ("revolute", (-10000, 10000), ("10000 rad", "100 rad", 'type="continuous"')),
        ("revolute", (-170, 90), ("-170.0 to 90.0 rad", "degrees")),
        ("prismatic", (0, 800), ("800 m", "100 m", "millimetres")),
    ],
)
def test_limits_of_no_joint_are_refused(urdf, link, joint, kind, limits, words):
    inside = '<limit lower="{}" upper="{}" velocity="1"/>'
    body = link("base", BALL) + link("arm", BALL)
    body += joint("turn", kind, "base", "arm", inside=inside.format(*limits))
    text = told(urdf(body))
    assert "'turn'" in text and all(word in text for word in words), text


def test_limits_of_a_joint_that_is_not_planned_for_may_be_any(urdf, link, joint):
    wheel = '<limit lower="-1e16" upper="1e16" velocity="1"/>'
    body = link("base", BALL) + link("arm", BALL) + link("wheel", BALL)
    body += joint("turn", "revolute", "base", "arm")
    body += joint("roll", "revolute", "base", "wheel", inside=wheel)
    assert load_robot(urdf(body), tip="arm", **COARSE).joint_names == ("turn",)


def test_a_shape_far_off_its_link_is_refused(urdf, link, joint, tmp_path):
    turn = joint("turn", "revolute", "base", "arm")
    text = told(urdf(link("base", BALL) + link("arm", BALL, "1e6 0 0") + turn))
    assert "link 'arm' sits 1e+06 m" in text and "30 m" in text and "<origin>" in text
    lines = [f"v {x} {y} {z}" for x, y, z in ((900, 0, 0), (901, 0, 0), (900, 1, 0))]
    faces = ("v 900 0 1", "f 1 2 3", "f 1 2 4", "f 1 3 4", "f 2 3 4")
    (tmp_path / "far.obj").write_text("\n".join((*lines, *faces)))
    text = told(urdf(link("base", BALL) + link("arm", mesh("far.obj")) + turn))
    assert "mesh of link 'arm' sits 900" in text


def test_a_rail_of_twelve_metres_and_a_marker_of_a_millimetre_are_parts(
    urdf, link, joint
):
    body = link("rail", '<box size="12 0.3 0.2"/>') + link("arm", BALL)
    body += link("mark", '<box size="0.0005 0.0005 0.0005"/>')
    body += joint("turn", "revolute", "rail", "arm")
    body += joint("at", "fixed", "arm", "mark", "0.1 0 0")
    robot = load_robot(urdf(body), tip="mark", cover_excess=0.1)
    assert robot.link_names == ("rail", "arm", "mark")
