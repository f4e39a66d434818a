"""Scripted motions: seeded, blind, smooth, endless and never too fast."""

import inspect
from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from forms import some

import odm
from roadmap.errors import BadInput
from sim.people import arm_path, human_motion
from sim.people.arm import HumanArm
from sim.people.arm_path import Person, ScriptedMotion
from sim.people.human_motion import TREMBLE, make_motion, motion_names, register_motion
from sim.run.request import RunRequest

# rounds of legs of one arm; of another motion, test the speed beside crowding's
SCRIPTED = ("sweep", "reach", "jitter", "hover", "intrusion", "tremble")


STEP = 0.005  # [s]


def track(motion, step=STEP, end=None):
    times = np.arange(0.0, end or motion.period + 1.0, step)
    return np.array([motion.capsules(t) for t in times])


@cache
def round_of(name):
    """Return a motion, and its first round and a second more, a row each STEP."""
    motion = make_motion(name, 5)
    return motion, track(motion)


def test_these_are_the_rounds_of_legs_of_one_arm():
    found = {n for n in motion_names() if isinstance(make_motion(n), ScriptedMotion)}
    assert found == set(SCRIPTED)


def ends(capsules):
    return np.concatenate([capsules[:, :, :3], capsules[:, :, 3:6]], axis=1)


def test_every_motion_can_be_asked_of_a_run():
    option = next(f for f in fields(RunRequest) if f.name == "motion")
    taken = option.metadata["option"].metavar.split("|")
    assert set(motion_names()) <= set(taken), "add it in sim/run/request.py"


@pytest.mark.parametrize("name", SCRIPTED)
def test_no_point_of_the_surface_is_faster_than_stated(name):
    motion, capsules = round_of(name)
    places = ends(capsules)
    speed = np.linalg.norm(np.diff(places, axis=0), axis=2) / STEP
    # the surface of a capsule advances no faster than the ends of its axis
    assert 0.6 * motion.max_speed <= speed.max() <= motion.max_speed


@pytest.mark.parametrize("name", SCRIPTED)
def test_a_speed_limit_of_the_person_is_respected(name):
    motion = make_motion(name, 3, Person(HumanArm.sized(), max_speed=0.4))
    places = ends(track(motion, end=15.0))
    speed = np.linalg.norm(np.diff(places, axis=0), axis=2) / STEP
    assert speed.max() <= motion.max_speed == 0.4


@pytest.mark.parametrize("name", SCRIPTED)
def test_the_motion_is_smooth_also_where_the_round_begins_again(name):
    motion, capsules = round_of(name)
    places = ends(capsules)
    velocity = np.diff(places, axis=0) / STEP
    jumps = np.linalg.norm(np.diff(velocity, axis=0), axis=2)
    assert jumps.max() <= 0.2 * motion.max_speed


@pytest.mark.parametrize("name", SCRIPTED)
def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not(name):
    one, two, other = (track(make_motion(name, s), 0.1) for s in (7, 7, 8))
    assert one.tobytes() == two.tobytes()
    length = min(len(one), len(other))
    assert np.abs(one[:length] - other[:length]).max() > 0.05


@pytest.mark.parametrize("name", SCRIPTED)
def test_the_round_repeats_without_end(name):
    motion = make_motion(name, 2)
    for t in (0.3, 4.0, 11.7):
        later = motion.capsules(t + 5 * motion.period)
        np.testing.assert_allclose(later, motion.capsules(t), atol=1e-9)


def test_the_order_of_the_questions_does_not_matter():
    motion = make_motion("sweep", 0)
    times = np.linspace(0, 20, 50)
    forward = [motion.capsules(t) for t in times]
    backward = [motion.capsules(t) for t in times[::-1]][::-1]
    np.testing.assert_array_equal(forward, backward)


def test_the_scripts_are_blind_to_the_robot():
    for module in (human_motion, arm_path):
        source = inspect.getsource(module)
        assert "roadmap.robot.robot" not in source and "odm" not in source
    assert list(inspect.signature(make_motion("reach").capsules).parameters) == ["t"]


@pytest.mark.parametrize("name", SCRIPTED)
def test_shoulder_and_lengths_stay(name):
    capsules = round_of(name)[1]
    np.testing.assert_allclose(capsules[:, 0, :3] - capsules[0, 0, :3], 0, atol=1e-12)
    lengths = np.linalg.norm(capsules[:, :, 3:6] - capsules[:, :, :3], axis=2)
    np.testing.assert_allclose(lengths - lengths[0], 0, atol=1e-9)


@pytest.mark.parametrize("place", [(0.85, 0.15, 0.5), (1.1, -0.3, 0.9), (0.6, 0, 0.1)])
def test_the_hand_stays_in_front_of_the_shoulder_wherever_that_is(place):
    for name in SCRIPTED:
        capsules = track(make_motion(name, 0, Person(HumanArm.sized(), place)), 0.05)
        assert np.isfinite(capsules).all()
        assert (capsules[:, 1, 3] < place[0]).all()


def test_the_reaches_peak_near_one_metre_per_second_and_the_thrust_near_two():
    for name, peak in (("reach", 1.0), ("intrusion", 2.0)):
        hand = round_of(name)[1][:, 1, 3:6]
        speed = np.linalg.norm(np.diff(hand, axis=0), axis=1) / STEP
        assert 0.7 * peak < speed.max() <= peak


def test_the_thrust_of_the_intrusion_is_straight():
    motion = make_motion("intrusion", 0)
    thrust = motion.legs[0]
    times = np.linspace(0, thrust.duration, 9)
    hand = np.array([motion.capsules(t)[1, 3:6] for t in times])
    way = (hand[-1] - hand[0]) / np.linalg.norm(hand[-1] - hand[0])
    off = hand - hand[0] - np.outer((hand - hand[0]) @ way, way)
    np.testing.assert_allclose(off, 0.0, atol=1e-9)


def test_the_trembling_hand_swings_two_centimetres_at_five_hertz():
    motion = make_motion("jitter", 0)
    start = motion.legs[0].duration  # the hand rests now, but for the tremble
    times = start + np.arange(0.0, 1.0, 0.002)
    hand = np.array([motion.capsules(t)[1, 3:6] for t in times])
    swing = np.linalg.norm(hand - hand.mean(axis=0), axis=1)
    assert swing.max() == pytest.approx(0.02, rel=0.02)
    along = (hand - hand.mean(axis=0)) @ motion.tremble
    crossings = np.sum(np.diff(np.sign(along)) != 0)
    assert 9 <= crossings <= 11


def test_the_hovering_hand_rests_for_seconds():
    hand = round_of("hover")[1][:, 1, 3:6]
    still = np.linalg.norm(np.diff(hand, axis=0), axis=1) < 1e-12
    assert still.mean() > 0.4


def test_a_further_source_can_be_registered():
    sources = dict(human_motion._SOURCES)
    register_motion("statue", lambda person, rng: make_motion("hover", 0, person))
    try:
        assert "statue" in motion_names() and make_motion("statue").capsules(0).shape
    finally:
        human_motion._SOURCES.clear()
        human_motion._SOURCES.update(sources)


def test_an_unknown_name_is_refused_with_the_choices():
    with pytest.raises(BadInput, match="no motion 'dance'; choose one of sweep, reach"):
        make_motion("dance")


def test_a_speed_limit_of_zero_is_refused():
    with pytest.raises(BadInput, match="not positive"):
        make_motion("reach", 0, Person(HumanArm.sized(), max_speed=0.0))


def test_two_people_crowd_the_space_each_within_the_limit():
    motion = make_motion("crowding", 2)
    one = make_motion("reach", 2)
    places = np.array([motion.capsules(t) for t in np.arange(0.0, 20.0, STEP)])
    assert places.shape[1] == 2 * one.capsules(0.0).shape[0]
    speed = np.linalg.norm(np.diff(ends(places), axis=0), axis=2) / STEP
    assert 0.3 < speed.max() <= motion.max_speed
    half = places.shape[1] // 2
    for person in (places[:, :half], places[:, half:]):
        assert np.ptp(person[:, -1, 3:6], axis=0).max() > 0.2  # it moves


def test_a_trembling_hand_stays_where_it_is():
    motion = make_motion("tremble", 4)
    times = np.arange(0.0, 12.0, 0.005)
    hand = np.array([motion.capsules(t)[-1, 3:6] for t in times])
    assert np.ptp(hand, axis=0).max() <= 2.2 * TREMBLE + 0.002
    along = (hand - hand.mean(axis=0)) @ motion.tremble / np.linalg.norm(motion.tremble)
    swings = np.count_nonzero(np.diff(np.sign(along)) != 0) / 2.0
    assert swings == pytest.approx(5.0 * 12.0, rel=0.1)  # 5 Hz


@pytest.mark.parametrize("name", motion_names())
@pytest.mark.parametrize("rate", some([30, 100], 0))
def test_no_scripted_person_is_taken_for_a_wrong_unit_or_a_lost_one(
    small_map, name, rate
):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    motion, q = make_motion(name, 1), np.array([1.2, 0.6, 0.0])
    places = set()
    for k in range(20 * rate):
        points = odm.sample_capsules(motion.capsules(k / rate), 0.03)
        answer = planner.step(points, q=q, stamp=k / rate, now=k / rate)
        assert planner.trouble is None
        places.add(answer.work.outside < len(points))
    assert True in places
