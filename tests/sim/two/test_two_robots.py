"""Two robots in one space: what they may still sweep never meets."""

from dataclasses import replace

import numpy as np
import pytest
from forms import size
from rows import each

from roadmap.errors import BadInput
from roadmap.transforms import pose_of
from sim.loop.run_result import STATUS
from sim.two.two_members import TwoSettings
from sim.two.two_result import TwoResult
from sim.two.two_robots import TwoRobots, run_two

FACING = pose_of((0.9, 0.0, 0.0), (0.0, 0.0, np.pi))
BRIEF = TwoSettings(duration_s=8.0)


@pytest.fixture(scope="module")
def result(small_map):
    return run_two((small_map, small_map), FACING, BRIEF)


def poses_of(intent, step=0.03):
    """Return configurations along all that a robot may still do."""
    rows = []
    for stretch in intent:
        end = max(stretch.begin, stretch.end)
        times = np.linspace(stretch.begin, end, 2 + int((end - stretch.begin) / step))
        rows += [stretch.motion.at(t).q for t in times]
    return rows


def test_both_work_and_never_touch(result):
    assert result.contacts == 0
    assert result.separation.min() > 0.0
    assert min(result.trips) >= 2
    # they are in each other's way: one has to wait for the other
    assert result.separation.min() < 0.10
    assert (result.moving(0) & result.moving(1)).any()


def test_the_same_input_gives_the_same_run(small_map, result):
    again = run_two((small_map, small_map), FACING, replace(BRIEF, duration_s=2.5))
    n = len(again.separation)
    assert n == 250 and len(result.separation) == 800
    for k in range(2):
        assert np.array_equal(again.q[k], result.q[k][:n])
    assert np.array_equal(again.separation, result.separation[:n])


def intents_meet(two, frames):
    """Return in how many frames something the two may still sweep would touch."""
    meet = 0
    for _ in range(frames):
        two.frame()
        one, other = (poses_of(robot.intent()) for robot in two.robots)
        meet += any(two.exact.distance(a, b) <= 0.0 for a in one for b in other)
    return meet


def test_what_they_may_still_sweep_is_apart_in_every_frame(small_map):
    two = TwoRobots((small_map, small_map), FACING, TwoSettings())
    assert intents_meet(two, size(150, 300)) == 0


def test_braking_is_what_keeps_them_apart(small_map):
    near = pose_of((0.8, 0.0, 0.0), (0.0, 0.0, np.pi))
    swift = TwoSettings(duration_s=3.0, speed_scale=1.0)
    heeded = run_two((small_map, small_map), near, swift)
    assert heeded.contacts == 0 and heeded.separation.min() > 0.0
    blind = replace(swift, duration_s=1.0, braking=False)
    blind = run_two((small_map, small_map), near, blind)
    assert blind.contacts > 0


def test_a_scripted_robot_is_heeded_by_its_joints_alone(small_map):
    settings = TwoSettings(duration_s=12.0, other="scripted")
    result = run_two((small_map, small_map), FACING, settings)
    assert result.contacts == 0
    assert result.trips[1] > 0 and result.moving(0).any()


def test_two_robots_that_cannot_meet_do_as_if_alone(small_map):
    far = pose_of((10.0, 0.0, 0.0))
    result = run_two((small_map, small_map), far, TwoSettings(duration_s=4.0))
    assert result.trips[0] == result.trips[1] > 0
    assert not (result.status == STATUS.index("holding")).any()


@each(
    ("maps", "T", "words"),
    [
        (1, np.eye(4), "there are 1 maps; give two"),
        (["panda", "panda"], np.eye(4), "a map is 'panda' .str.; give"),
        (2, np.zeros((4, 4)), "T_world_base"),
        (2, "beside", "T_world_base"),
        (2, np.full((4, 4), np.nan), "T_world_base"),
    ],
)
def test_what_are_no_two_maps_and_no_base_is_refused(small_map, maps, T, words):
    given = [small_map] * maps if isinstance(maps, int) else maps
    with pytest.raises(BadInput, match=words):
        TwoRobots(given, T)


def test_bases_that_always_meet_are_refused(small_map):
    with pytest.raises(BadInput, match="always be in contact"):
        TwoRobots((small_map, small_map), pose_of((0.1, 0.0, 0.0)))


def test_a_base_that_leaves_no_place_is_refused(small_map):
    with pytest.raises(BadInput, match="move the second base away"):
        across = pose_of((0.18, 0.0, 0.0), (0.0, 0.0, np.pi / 2))
        TwoRobots((small_map, small_map), across)


def test_bad_settings_are_refused():
    for bad in ({"rate_hz": 0.0}, {"duration_s": np.nan}, {"speed_scale": 1.5},
                {"script_scale": 0.0}, {"other": "absent"}):  # fmt: skip
        with pytest.raises(BadInput, match=next(iter(bad))):
            TwoSettings(**bad)


def test_only_touches_of_a_robot_that_plans_and_moves_count():
    still, moves = np.zeros((4, 1)), np.array([[0.0], [0.1], [0.2], [0.2]])
    common = {
        "rate_hz": 100.0, "trips": (0, 0), "T_world_base": np.eye(4),
        "place": np.zeros((4, 2)), "status": np.zeros((4, 2)),
        "wall_s": np.zeros((4, 2)), "places": (still, still), "reasons": ({}, {}),
    }  # fmt: skip
    touch = np.array([1.0, 0.0, 0.0, 1.0])

    def contacts(other, first, second):
        return TwoResult(other=other, q=(first, second), separation=touch, **common
                         ).contacts  # fmt: skip

    assert contacts("planned", moves, still) == 1
    assert contacts("planned", still, moves) == 1
    assert contacts("scripted", still, moves) == 0
    assert contacts("planned", still, still) == 0
