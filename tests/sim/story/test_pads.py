"""Which links may touch an object, told by their names."""

import pytest

from roadmap import load_robot
from roadmap.errors import BadInput
from sim.story.cases import pads_of

BALL = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'


def robot_with(tmp_path, names):
    """Return an arm of one joint whose hand carries links of these names."""
    text = '<robot name="arm">'
    text += "".join(f'<link name="{n}">{BALL}</link>' for n in ("base", "hand", *names))
    text += """<joint name="a" type="revolute"><parent link="base"/><child link="hand"/>
        <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>"""
    for name in names:
        text += f"""<joint name="to {name}" type="fixed"><parent link="hand"/>
            <child link="{name}"/><origin xyz="0.1 0 0"/></joint>"""
    path = tmp_path / "arm.urdf"
    path.write_text(text + "</robot>", encoding="utf-8")
    return load_robot(path, tip="hand")


def test_fingers_thumbs_and_pads_are_known_by_their_names(tmp_path):
    robot = robot_with(tmp_path, ("RFinger11", "R_THUMB_2", "left_pad", "camera"))
    assert set(pads_of(robot)) == {"RFinger11", "R_THUMB_2", "left_pad"}


def test_those_that_are_named_count_alone(tmp_path):
    robot = robot_with(tmp_path, ("finger", "camera"))
    assert pads_of(robot, ["camera"]) == ("camera",)


def test_without_any_the_links_are_told(tmp_path):
    with pytest.raises(BadInput, match="--pads LINK`, of camera, hand"):
        pads_of(robot_with(tmp_path, ("camera",)))
