"""What a frame may do of the work that can wait."""

import numpy as np
import pytest
from meet_people import person, workspace

import odm
from handover.targets.allowance import Allowance
from handover.targets.live_targets import LiveTargets
from handover.targets.node_index import NodeIndex
from handover.targets.settings import LiveSettings


def test_a_frame_has_what_others_left_and_the_next_one_all_of_it():
    allowance = Allowance(1000)
    allowance.spend(400)
    assert allowance.grants(500) and allowance.left == 100
    assert not allowance.grants(500) and allowance.left == 100
    allowance.begin()
    assert allowance.left == 1000


def test_work_that_goes_on_over_frames_never_stands_still():
    allowance = Allowance(1000)
    assert allowance.share(600) == 600
    assert allowance.share(600) == 400
    least = allowance.share(600)
    assert 0 < least < 400 and allowance.left == -least


def test_what_is_more_than_a_frame_has_is_done_in_one_that_did_nothing():
    allowance = Allowance(1000)
    allowance.spend(1)
    assert not allowance.grants(5000)
    allowance.begin()
    assert allowance.grants(5000)


def test_what_was_put_off_several_times_is_done_in_a_busy_frame_too():
    allowance, granted = Allowance(1000), []
    for _ in range(20):
        allowance.begin()
        allowance.spend(900)
        granted.append(allowance.grants(500))
    assert granted.index(True) == 4 and sum(granted) == 4


@pytest.mark.parametrize("hertz", [100, 50, 20, 10])
def test_frames_that_come_slowly_join_goals_though_each_looks_out(hertz):
    """With as much as at 100 Hz none was ever joined: small things are done before."""
    allowance, joined = Allowance.lasting(1.0 / hertz), False
    takes = allowance.takes
    for frame in range(10):
        allowance.begin()
        if hertz <= 50 or frame % 2:
            allowance.spend(takes.look_out)
        joined = joined or allowance.grants(takes.prepare)
        allowance.grants(takes.tell)
    assert joined


def test_frames_that_come_fast_have_what_they_had():
    assert Allowance.lasting(0.002).units == Allowance.lasting(0.01).units
    assert Allowance.lasting(0.02).units == 2 * Allowance().units
    periods = (0.002, 0.01, 0.02, 0.05, 0.1)
    assert [Allowance.lasting(p).frames for p in periods] == [1, 1, 2, 5, 10]


@pytest.mark.parametrize("busy", [0, 1000])
def test_a_ranking_of_busy_frames_ends_in_the_same_targets(cell_map, robot_map, busy):
    human, planner = person(0.9), odm.ReactivePlanner(cell_map)
    index = NodeIndex(cell_map.robot, cell_map.roadmap.nodes)
    q = np.array(cell_map.roadmap.nodes[0])
    found, frames = [], []
    for allowance in (None, Allowance(1000)):
        meet = workspace(robot_map, human)
        settings = LiveSettings(rank_budget=1000, choices=1)
        live = LiveTargets(planner, meet, q, index, settings)
        for frame in range(1, 500):
            if allowance is not None:
                allowance.begin()
                allowance.spend(busy)
            live.look(human, q, allowance)
            if live.targets:
                break
        found.append([t.key for t in live.targets])
        frames.append(frame)
    assert found[0] and found[0] == found[1]
    assert frames[1] > frames[0] if busy else frames[1] == frames[0]
