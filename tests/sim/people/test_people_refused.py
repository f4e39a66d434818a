"""Arguments of another kind are told in a sentence where people are made and played."""

import numpy as np
import pytest
from mocap_files import write_bvh
from rows import each

from roadmap.errors import BadInput
from sim.loop.loop import Loop, LoopSettings
from sim.people.arm_path import Person
from sim.people.human_motion import make_motion
from sim.people.mocap import BadMocap, MocapSettings, load_mocap

HUGE = 10**400  # no float can hold it
WRONG = (None, "x", np.zeros(2), np.array("x"), np.nan, HUGE)


def told_of(call):
    with pytest.raises(BadInput) as caught:
        call()
    return str(caught.value)


@each("value", WRONG)
def test_a_setting_of_a_recording_of_another_kind_is_told(value):
    for name in ("base_height", "height", "smooth_s"):
        with pytest.raises(BadMocap, match=name.partition("_")[0]):
            MocapSettings(**{name: value})
    for name in ("floor", "stand"):
        if value is not None:
            with pytest.raises(BadMocap, match=f"^{name} is"):
                MocapSettings(**{name: value})
    for name in ("loop", "accept_defects"):
        with pytest.raises(BadMocap, match="give True or False"):
            MocapSettings(**{name: value})


@each("stand", ([[1, 2], [3]], (1.0, 2.0), (1.0, "2", 3.0), {1: 2}, (0, 0, np.inf)))
def test_a_stand_that_is_no_place_is_told(stand):
    with pytest.raises(BadMocap, match="^stand is"):
        MocapSettings(stand=stand)
    assert MocapSettings(stand=np.ones(3), floor=0, height=2).smooth_s == 0.05


def test_a_recording_of_no_path_and_a_time_that_is_none_are_told(tmp_path):
    assert told_of(lambda: load_mocap(None)).startswith("path is None")
    path = write_bvh(tmp_path / "a.bvh")
    for mapping in (np.nan, b"x", 3):
        told = told_of(lambda mapping=mapping: load_mocap(path, mapping=mapping))
        assert told.startswith("the mapping is") and "joint -> name" in told
    for t in (*WRONG, -1.0):
        told = told_of(lambda t=t: load_mocap(path).capsules(t))
        assert "was asked for t =" in told


@each("value", WRONG)
def test_a_scripted_person_of_another_kind_is_told(value):
    assert told_of(lambda: make_motion(value)).startswith("no motion")
    assert told_of(lambda: make_motion("sweep", value)).startswith("the seed of a")
    if value is not None:
        told = told_of(lambda: make_motion("sweep", 0, value))
        assert told.startswith("person is")
    motion = make_motion("sweep")
    slow = Person(motion.person.arm, max_speed=value)
    if value is not None:
        assert "speed limit" in told_of(lambda: make_motion("sweep", 0, slow))
    told = told_of(lambda: motion.capsules(value))
    assert told.startswith("the time of a motion")
    for seed in (-1, 1.5):
        assert told_of(lambda: make_motion("sweep", seed)).startswith("the seed")


@each("value", (None, "x", np.zeros(2), 3, HUGE, [[1, 2], [3]]))
def test_a_loop_of_another_kind_is_told(value):
    class Robot:
        max_velocity, dof = np.ones(2), 2

    class Planner:
        step = set_goals = None

    assert "execution is" in told_of(lambda: LoopSettings(execution=value))
    places = np.zeros((2, 2))
    told = told_of(lambda: Loop(value, Robot, places, None))
    assert told.startswith("planner is")
    told = told_of(lambda: Loop(Planner, value, places, None))
    assert told.startswith("a robot is")
    told = told_of(lambda: Loop(Planner, Robot, value, None))
    assert told.startswith("work places")
