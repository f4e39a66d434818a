"""A person who is dragged: fast enough to tease, never faster than is said."""

import numpy as np
import pytest

from sim.people.human_motion import make_motion
from sim.people.placed import Placed
from sim.view.dragged import SPEED, DraggedPerson


class Hand:
    """Where somebody drags the hand to."""

    place = None

    def __call__(self):
        return self.place


@pytest.fixture
def hand():
    return Hand()


@pytest.mark.parametrize("name", ["jitter", "crowding"])
def test_a_person_who_was_never_touched_is_the_motion_to_the_byte(name, hand):
    dragged, motion = DraggedPerson(make_motion(name, 3), hand), make_motion(name, 3)
    for i in range(150):
        t = i / 47
        assert dragged.capsules(t).tobytes() == motion.capsules(t).tobytes()
    assert dragged.name == motion.name and dragged.max_speed == motion.max_speed


def test_who_is_placed_and_guesses_nothing_guesses_nothing_when_dragged(hand):
    placed = Placed(make_motion("sweep", 3), 0.5)
    assert getattr(DraggedPerson(placed, hand), "guess", None) is None


@pytest.mark.parametrize("name", ["reach", "crowding"])
def test_the_hand_goes_where_it_is_dragged_and_back(name, hand):
    dragged = DraggedPerson(make_motion(name, 1), hand)
    before = dragged.capsules(0.5).copy()
    hand.place = before[-1, 3:6] + [-0.15, 0.1, 0.05]
    for i in range(50, 150):
        after = dragged.capsules(i / 100)
    np.testing.assert_allclose(after[-1, 3:6], hand.place, atol=1e-6)
    hand.place = None
    for i in range(150, 250):
        last = dragged.capsules(i / 100)
        if np.allclose(last, before, atol=0.02):
            break
    assert i < 200  # it came back to where it was taken, and goes on from there
    later = dragged.capsules(i / 100 + 0.7)
    assert not np.allclose(later, before, atol=1e-3)


@pytest.mark.parametrize("name", ["reach", "crowding", "intrusion"])
def test_no_point_is_faster_than_the_bound(name, hand):
    dragged = DraggedPerson(make_motion(name, 2), hand)
    rng = np.random.default_rng(0)
    last, fastest = dragged.capsules(0.0), 0.0
    for i in range(1, 400):
        if i % 40 == 0:
            hand.place = rng.uniform([0.1, -0.8, -0.2], [1.2, 0.8, 1.2])
        if i % 170 == 0:
            hand.place = None
        now = dragged.capsules(i / 100)
        ends = (now - last)[:, :6].reshape(-1, 3)
        fastest = max(fastest, 100 * np.linalg.norm(ends, axis=1).max())
        last = now
    assert 0.5 * SPEED < fastest <= dragged.max_speed * (1 + 1e-6)


def test_a_scripted_arm_keeps_its_shoulder_and_its_length(hand):
    dragged = DraggedPerson(make_motion("reach", 0), hand)
    start = dragged.capsules(0.0)
    hand.place = np.array([0.3, 0.1, 0.3])
    for i in range(200):
        rows = dragged.capsules(i / 100)
        np.testing.assert_allclose(rows[0, :3], start[0, :3], atol=1e-9)
        length = np.linalg.norm(rows[:, 3:6] - rows[:, :3], axis=1)
        np.testing.assert_allclose(
            length, np.linalg.norm(start[:, 3:6] - start[:, :3], axis=1), atol=1e-6
        )
