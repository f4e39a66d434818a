"""The scripted person stands before the work places of every robot."""

import numpy as np

from sim.people.human_motion import make_motion
from sim.people.placed import Placed
from sim.people.scenes import SCRIPTED_FOR, before_work_places


class Recorded:
    """A motion that is not scripted."""

    name, max_speed = "clip", 1.0

    def capsules(self, t):
        return np.zeros((1, 7))


def tools_of(robot, places):
    from roadmap.kinematics.forward import tool_pose

    return np.array([tool_pose(robot, q)[:3, 3] for q in places])


def test_the_person_moves_along_with_the_work_places(crane, places):
    motion = make_motion("sweep", 1)
    moved = before_work_places(motion, crane, places)
    offset = tools_of(crane, places).mean(axis=0) - SCRIPTED_FOR
    assert isinstance(moved, Placed) and np.linalg.norm(offset) > 0.1
    assert (moved.name, moved.max_speed) == (motion.name, motion.max_speed)
    for t in (0.0, 0.7, 3.1):
        here, there = motion.capsules(t), moved.capsules(t)
        assert np.allclose(there[:, :3] - here[:, :3], offset)
        assert np.allclose(there[:, 3:6] - here[:, 3:6], offset)
        assert np.array_equal(there[:, 6], here[:, 6])


def test_near_the_place_it_was_written_for_nothing_changes(crane, places, monkeypatch):
    middle = tools_of(crane, places).mean(axis=0)
    monkeypatch.setattr("sim.people.scenes.SCRIPTED_FOR", middle + 0.05)
    motion = make_motion("reach", 1)
    assert before_work_places(motion, crane, places) is motion


def test_a_person_who_was_told_where_to_stand_stays(crane, places):
    recorded = Recorded()
    assert before_work_places(recorded, crane, places) is recorded


def test_who_stands_elsewhere_is_guessed_to_be_there_too():
    class Remembered(Recorded):
        def guess(self, t):
            return np.array([[1.0, 0, t, 2.0, 0, t, 0.05]])

    moved = Placed(Remembered(), np.pi / 2, np.array([0.0, 0.0, 1.0]))
    assert np.allclose(moved.guess(0.5), [[0, 1.0, 1.5, 0, 2.0, 1.5, 0.05]])
    assert Placed(Recorded()).guess is None
