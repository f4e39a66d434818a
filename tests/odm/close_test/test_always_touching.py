"""Links that stand in the scenery by construction, and what is fixed to them."""

import pytest

from odm.cell_map.recipe import parse_recipe
from odm.close_test.static import always_touching
from odm.obstacles.scenery import parse_scenery
from roadmap import load_robot

TABLE = {"type": "box", "name": "table", "size": [2.0, 0.6, 0.1]}


def _robot(tmp_path, reach):
    """Return a turning post, and a bracket fixed to it that far beside and low."""

    def link(name, shape, xyz):
        at = f'<collision><origin xyz="{xyz}"/><geometry>{shape}</geometry></collision>'
        return f'<link name="{name}">{at}</link>'

    text = '<robot name="r"><link name="base"/>'
    text += link("post", '<cylinder radius="0.05" length="0.4"/>', "0 0 0.2")
    text += link("bracket", '<sphere radius="0.05"/>', f"0 {reach} {reach - 0.4}")
    text += '<joint name="turn" type="revolute"><parent link="base"/>'
    text += '<child link="post"/><limit lower="-0.5" upper="2" velocity="1" '
    text += 'effort="1"/><axis xyz="0 0 1"/></joint><joint name="f" type="fixed">'
    text += '<parent link="post"/><child link="bracket"/></joint></robot>'
    (tmp_path / "r.urdf").write_text(text)
    return load_robot(tmp_path / "r.urdf", tip="post", cover_excess=0.02)


@pytest.mark.parametrize(("reach", "dropped"), [(0.45, False), (0.9, True)])
def test_a_link_that_comes_to_touch_is_tested_whatever_else_its_body_stands_in(
    tmp_path, reach, dropped
):
    robot = _robot(tmp_path, reach)
    safety = parse_recipe({}, "x").safety
    found = always_touching(robot, parse_scenery((TABLE,)), safety)
    assert (("post", "table") in found.dropped) is dropped
    assert (("bracket", "table") in found.dropped) is dropped
