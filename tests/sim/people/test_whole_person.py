"""One person in a run: the `Human` that the workspace sees is what the planner sees."""

import numpy as np
import pytest
from mocap_files import person, write_csv

from roadmap.errors import BadInput
from sim.people.arm import HumanArm
from sim.people.arm_path import Person
from sim.people.human_motion import make_motion
from sim.people.mocap import load_mocap
from sim.people.whole_person import (
    BASE_HEIGHT,
    RecordedPerson,
    Walk,
    WholePerson,
    scripted_person,
)

TIMES = np.arange(0.0, 40.0, 0.37)


def test_what_the_planner_sees_is_the_human_itself():
    one = scripted_person("reach", 3)
    for t in TIMES[:20]:
        np.testing.assert_array_equal(one.capsules(t), one.human(t).capsules())


@pytest.mark.parametrize("name", ["reach", "sweep", "jitter", "hover", "intrusion"])
def test_the_arm_is_the_scripted_one(name):
    arm = make_motion(name, 1, Person(HumanArm.sized()))
    one = WholePerson(arm)
    for t in TIMES[:40]:
        upper, lower = arm.capsules(t)
        human = one.human(t)
        shoulder, elbow, wrist = (
            human.places[k] for k in _rows("shoulder", "elbow", "hand")
        )
        np.testing.assert_allclose(shoulder, upper[:3], atol=1e-9)
        np.testing.assert_allclose(elbow, upper[3:6], atol=1e-9)
        along = np.cross(wrist - elbow, lower[3:6] - lower[:3])
        np.testing.assert_allclose(along, 0.0, atol=1e-9)


def test_a_walk_keeps_its_distances_and_uses_them_all():
    for seed in range(5):
        one = scripted_person("reach", seed, (0.6, 1.3))
        places = [one.human(t).T_world_pelvis[:3, 3] for t in np.arange(0, 90, 0.5)]
        far = np.linalg.norm(np.array(places)[:, :2], axis=1)
        assert far.min() >= 0.6 - 1e-9 and far.max() <= 1.3 + 1e-9
        assert far.min() < 0.65 and far.max() > 1.25
    still = scripted_person("reach", 0, (0.9, 0.9))
    for t in TIMES:
        place = still.human(t).T_world_pelvis[:2, 3]
        np.testing.assert_allclose(place, [0.9, 0.0], atol=1e-12)


def test_feet_stand_on_the_floor_below_the_base():
    low = min(row[2] - row[6] for row in scripted_person("reach").capsules(2.0))
    assert low == pytest.approx(-BASE_HEIGHT, abs=0.03)  # soles are round


@pytest.mark.parametrize("name", ["reach", "sweep", "intrusion"])
def test_nothing_moves_faster_than_told(name):
    one, step = scripted_person(name, 2), 0.03  # [s] no peak is that short
    rows = np.array([one.capsules(t)[:, :6] for t in np.arange(0.0, 30.0, step)])
    ends = rows.reshape(len(rows), -1, 3)
    fastest = np.linalg.norm(np.diff(ends, axis=0), axis=2).max() / step
    assert 0.2 < fastest <= one.max_speed * 1.001


def test_a_person_looks_at_the_robot_and_faces_it():
    human = scripted_person("reach", 1).human(5.0)
    to_base = -human.p_world_eyes
    assert human.gaze @ to_base > 0.9 * np.linalg.norm(to_base)
    assert human.T_world_chest[:2, 0] @ human.T_world_chest[:2, 3] < 0


def test_the_same_seed_is_the_same_person():
    a, b = scripted_person("reach", 4), scripted_person("reach", 4)
    other = scripted_person("reach", 5)
    np.testing.assert_array_equal(a.capsules(11.3), b.capsules(11.3))
    assert not np.allclose(a.capsules(11.3), other.capsules(11.3))


def test_a_recorded_person_is_a_human_too(tmp_path):
    clip = load_mocap(write_csv(tmp_path / "clip.csv", person()))
    one = RecordedPerson(clip)
    assert one.name == clip.name and one.max_speed == clip.max_speed
    for t in (0.0, 0.5, 2.1):
        np.testing.assert_array_equal(one.capsules(t), clip.capsules(t))
        arms = clip.labels < 6
        seen = one.human(t).capsules()[: len(clip.labels)]
        np.testing.assert_allclose(seen[arms], clip.guess(t)[arms], atol=1e-9)
    assert set(one.sides) == {"left", "right"}


@pytest.mark.parametrize(
    "distances",
    [(1.3, 0.6), (0.1, 1.0), (0.6, 9.0), (float("nan"), 1.0), (0.6, float("inf"))],
)
def test_distances_that_are_none_are_refused(distances):
    with pytest.raises(BadInput, match="give two distances"):
        Walk.drawn(*distances, np.random.default_rng(0))


def test_two_people_are_refused():
    with pytest.raises(BadInput, match="4 capsules"):
        scripted_person("crowding")


def test_an_unknown_motion_is_refused():
    with pytest.raises(BadInput, match="no motion 'dance'"):
        scripted_person("dance")


def _rows(*names):
    from handover.human.body import COLUMN

    return [COLUMN[f"right_{name}"] for name in names]
