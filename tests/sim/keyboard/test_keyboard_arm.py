"""The arm under keys: a pure function of them, smooth, bounded, never too fast."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rows import each

from roadmap.errors import BadInput
from sim.keyboard.bindings import ARM_KEYS, MOVES, SLIDERS
from sim.keyboard.control import NUDGES, TICK, KeyEvent
from sim.keyboard.key_motion import KeyboardArm
from sim.people.arm import HumanArm
from sim.people.arm_path import Person

STEP = 0.004  # not a divisor of the control's tick [s]

pauses = st.sampled_from([0.0, 0.0, 0.01, 0.03, 0.1, 0.7])
key_lists = st.lists(st.tuples(pauses, st.sampled_from(sorted(ARM_KEYS))), max_size=60)


def events_of(pairs):
    times = np.cumsum([pause for pause, _ in pairs])
    return [KeyEvent(float(t), key) for t, (_, key) in zip(times, pairs, strict=True)]


def held(key, seconds, rate=30.0, start=0.0, size=""):
    """Return a key held down: the terminal repeats it."""
    first = [KeyEvent(start, sign) for sign in size]
    return first + [KeyEvent(start + k / rate, key) for k in range(int(seconds * rate))]


def ends(arm, times):
    capsules = np.array([arm.capsules(t) for t in times])
    return np.concatenate([capsules[:, :, :3], capsules[:, :, 3:6]], axis=1)


def speeds(arm, until):
    # a capsule advances no faster than the ends of its axis
    places = ends(arm, np.arange(0.0, until, STEP))
    return np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1) / STEP


@settings(deadline=None, max_examples=40)
@given(key_lists, st.sampled_from([0.1, 0.5, 1.6]))
def test_no_point_of_the_arm_is_ever_faster_than_stated(pairs, limit):
    events = events_of(pairs)
    arm = KeyboardArm(Person(HumanArm.sized(), max_speed=limit), events)
    until = 1.0 + (events[-1].t if events else 0.0)
    assert speeds(arm, until).max() <= arm.max_speed * (1 + 1e-9)
    assert arm.max_speed == limit


@pytest.mark.parametrize(
    ("before", "swing", "share"),
    [
        ("g", "w", 0.99),  # the straight arm from the shoulder
        ("g", "e", 0.99),
        ("", "t", 0.9),
        ("", "f", 0.9),
        ("", "j", 0.99),
        ("g", "wj", 0.7),  # shoulder and arm together
        ("g", "wd", 0.7),
        ("", "rt", 0.6),
    ],
)
def test_the_fastest_swings_come_near_the_limit_and_stay_below(before, swing, share):
    events = [e for key in before for e in held(key, 2.0, size="++")]
    wide = [e for key in swing for e in held(key, 1.0, start=4.0)]
    size = [KeyEvent(3.9, "+")] * 4
    events += size + sorted(wide, key=lambda event: event.t)
    limit = 0.5  # low, so that the follower alone would be faster
    arm = KeyboardArm(Person(HumanArm.sized(), max_speed=limit), events)
    fastest = speeds(arm, 6.0).max()
    assert share * limit < fastest <= limit * (1 + 1e-9)


@settings(deadline=None, max_examples=40)
@given(key_lists)
def test_the_arm_stays_in_its_box_and_its_joints_in_their_ranges(pairs):
    events = events_of(pairs)
    arm = KeyboardArm(events=events)
    for t in np.arange(0.0, 3.0 + (events[-1].t if events else 0.0), 0.05):
        x = arm.at(t)
        assert (arm.limits.lower <= x).all() and (x <= arm.limits.upper).all()


@settings(deadline=None, max_examples=30)
@given(key_lists)
def test_keys_taken_live_and_the_same_keys_recorded_give_the_same_bytes(pairs):
    live, shown, t = KeyboardArm(), [], 0.0
    for pause, key in pairs:
        frames = round(pause / 0.01)
        for _ in range(frames):
            shown.append((t, live.capsules(t).tobytes()))
            t += 1 / 120
        live.press(key)
    shown.append((t, live.capsules(t).tobytes()))
    again = KeyboardArm(events=live.events)
    assert all(again.capsules(t).tobytes() == seen for t, seen in shown)
    assert again.events == live.events


def test_the_order_of_the_questions_does_not_matter():
    arm = KeyboardArm(events=held("w", 1.0) + held("up", 1.0, start=1.5))
    times = np.linspace(0, 3, 40)
    forward = [arm.capsules(t) for t in times]
    backward = [arm.capsules(t) for t in times[::-1]][::-1]
    np.testing.assert_array_equal(forward, backward)


def test_a_key_after_a_look_back_acts_from_the_latest_moment_on():
    arm = KeyboardArm()
    arm.capsules(1.0)
    arm.capsules(0.2)
    assert arm.press("w").t == pytest.approx(1.0)
    np.testing.assert_array_equal(arm.at(1.0), arm.at(0.0))


def test_the_motion_is_smooth():
    arm = KeyboardArm(events=held("up", 1.0, size="++") + held("w", 1.0, start=1.2))
    places = ends(arm, np.arange(0.0, 4.0, TICK))
    jumps = np.linalg.norm(np.diff(places, n=2, axis=0), axis=2) / TICK
    assert jumps.max() <= 0.2 * arm.max_speed


@each("key", sorted(MOVES))
def test_each_key_moves_its_own_value_by_one_nudge(key):
    axis, sign = MOVES[key]
    arm = KeyboardArm(events=[KeyEvent(0.0, key)])
    moved = arm.at(4.0) - arm.at(0.0)
    nudge = NUDGES[2][int(axis > 2)]
    assert moved[axis] == pytest.approx(sign * nudge, abs=1e-6)
    assert np.count_nonzero(moved) == 1


@pytest.mark.parametrize(
    ("keys", "toward"),
    [("up", (-1, 0, 0)), ("left", (0, -1, 0)), ("u", (0, 0, 1)), ("w", (-1, 0, 1))],
)
def test_the_hand_goes_where_the_person_would_say(keys, toward):
    # "left" and "forward" of a person who looks along -x of the robot's base
    arm = KeyboardArm(events=[KeyEvent(0.0, keys)])
    hand = [arm.capsules(t)[1, 3:6] for t in (0.0, 4.0)]
    assert (hand[1] - hand[0]) @ np.array(toward) > 0.03


def test_d_brings_the_arm_out_and_t_bends_the_elbow():
    for key, sign in (("e", 1.0), ("d", -1.0)):
        arm = KeyboardArm(events=held("w", 1.0) + [KeyEvent(2.0, key)])
        elbow = [arm.capsules(t)[0, 4] for t in (2.0, 5.0)]
        assert sign * (elbow[1] - elbow[0]) > 0  # out is to the right, +y
    arm = KeyboardArm(events=[KeyEvent(0.0, "t")])
    reach = [np.linalg.norm(arm.capsules(t)[1, 3:6] - arm.at(t)[:3]) for t in (0, 4)]
    assert reach[1] < reach[0] - 0.01


def test_a_held_key_goes_at_full_speed_and_stops_soon_after():
    arm = KeyboardArm(events=held("down", 1.0, size="++") + held("up", 0.7, start=3.0))
    speed = speeds(arm, 4.0)
    assert speed.max() > 0.9 * arm.max_speed
    gone = abs(arm.at(3.0)[0] - arm.at(1.0)[0])
    assert gone < 0.6 and speed[round(2.5 / STEP)] < 0.01


def test_a_key_the_other_way_turns_at_once():
    there = held("left", 0.8)
    arm = KeyboardArm(events=[*there, KeyEvent(0.85, "right")])
    ahead = KeyboardArm(events=there).at(5.0)[1]
    now, after = arm.at(0.86)[1], arm.at(5.0)[1]
    assert ahead < now - 0.05 < after  # it does not first go where it was going


def test_home_brings_all_of_it_back():
    keys = [*held("up", 1.0), *held("t", 1.0, start=1.0), KeyEvent(2.5, "h")]
    arm = KeyboardArm(events=keys)
    assert np.abs(arm.at(2.5) - arm.at(0.0)).max() > 0.1
    np.testing.assert_allclose(arm.at(8.0), arm.at(0.0), atol=1e-6)


def test_plus_and_minus_change_the_nudge_within_its_sizes():
    for sizes, nudge in (("+", 0.1), ("-", 0.02), ("++++++", 0.2), ("-" * 9, 0.01)):
        keys = [KeyEvent(0.0, size) for size in sizes] + [KeyEvent(0.0, "right")]
        arm = KeyboardArm(events=keys)
        assert arm.at(5.0)[1] - arm.at(0.0)[1] == pytest.approx(nudge, abs=1e-6)


def test_the_arm_starts_where_the_person_stands_and_its_box_goes_along():
    place = (-1.4, 2.0, 0.9)
    arm = KeyboardArm(Person(HumanArm.sized(), place), held("u", 3.0, size="++"))
    np.testing.assert_allclose(arm.capsules(0.0)[0, :3], place)
    assert arm.at(9.0)[2] == pytest.approx(place[2] + 0.6, abs=1e-6)


def test_every_slider_has_its_place_in_the_state():
    assert len(SLIDERS) == len(KeyboardArm().at(0.0)) == 7


@each(
    ("make", "words"),
    [
        (lambda: KeyboardArm(events=[KeyEvent(0.0, "x")]), "'x' is no key of the arm"),
        (lambda: KeyboardArm(events=[KeyEvent(-1.0, "w")]), "-1.0 s"),
        (lambda: KeyboardArm(events=[KeyEvent(float("nan"), "w")]), "nan s"),
        (lambda: KeyboardArm(events=held("w", 1.0)[::-1]), "does not come after"),
        (lambda: KeyboardArm().press("q"), "'q' is no key of the arm"),
        (lambda: KeyboardArm(events=held("w", 1.0)).press("w"), "recorded"),
        (lambda: KeyboardArm().at(-0.1), "0 s or later"),
        (
            lambda: KeyboardArm(Person(HumanArm.sized(), max_speed=0.0)),
            "speed limit of 0.0",
        ),
    ],
)
def test_what_makes_no_motion_is_refused_in_one_sentence(make, words):
    with pytest.raises(BadInput, match=words):
        make()
