"""Pictures of grasp sets that cannot be drawn."""

from dataclasses import replace

import pytest

from handover import GraspSettings, build_grasps, load_object
from roadmap.errors import BadInput
from sim.draw.grasp_picture import write_grasp_plot


def test_a_set_of_a_hand_of_ones_own_says_why_it_is_not_drawn(tmp_path):
    few = GraspSettings(samples=24, rolls=8)
    grasps = replace(build_grasps(load_object("box"), "panda", few), hand="mine")
    with pytest.raises(BadInput, match="hand 'mine' of this set .*; draw a plan"):
        write_grasp_plot(grasps, tmp_path / "mine.png")
    assert not list(tmp_path.iterdir())
