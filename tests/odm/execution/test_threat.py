"""Where a person can be: capsules that hold whoever keeps to the bounds."""

from dataclasses import replace

import numpy as np
import pytest
from rows import each

import odm
from odm.execution._threat import write_sharpest
from odm.execution.stop_test import BrakingTest
from odm.execution.threat import (
    CloudThreat,
    SteadyParts,
    Threat,
    ThreatSettings,
    Watcher,
)
from roadmap.errors import BadInput
from roadmap.motion.motion import time_path


def beyond(capsules, points):
    """Return how far points (n, 3) are outside the nearest of capsules, at most [m]."""
    off = []
    for row in capsules:
        a, b, r = row[:3], row[3:6], row[6]
        s = np.clip((points - a) @ (b - a) / max(np.dot(b - a, b - a), 1e-12), 0, 1)
        off.append(np.linalg.norm(points - a - s[:, None] * (b - a), axis=1) - r)
    return np.min(off, axis=0).max()


def growth(threat, begin, end):
    """Return by how much each capsule has grown [m]."""
    there, more = threat.between(begin, end)
    return there.capsules[:, 6] + more - threat.capsules[:, 6]


def test_the_ends_move_as_they_did_in_the_last_frame(rng):
    for _ in range(20):
        before = rng.uniform(-0.5, 0.5, (3, 7))
        before[:, 6] = rng.uniform(0.03, 0.08, 3)
        step = rng.normal(0, 0.01, (3, 7))
        step[:, 6] = 0.0
        watcher = Watcher()
        # two frames could show two parts, and a third one that they are the same
        for capsules, now in ((before - step, 0.98), (before, 1.0)):
            assert not watcher.look(capsules, now).known.any()
        threat = watcher.look(before + step, 1.02)
        assert threat.known.all()
        rates = step[:, :6].reshape(-1, 2, 3) / 0.02
        assert np.allclose(threat.velocity, rates, atol=1e-9)
        there, more = threat.between(0.1, 0.1)
        assert more == 0.0
        ahead = before + step + step * 0.1 / 0.02
        assert np.allclose(there.capsules[:, :6], ahead[:, :6])


def test_each_part_grows_by_its_own_speed_and_no_other():
    watcher = Watcher()
    for k in range(4):
        arm = np.array([[0.3, 0, 0.5, 0.3, 0, 0.8, 0.05], [2.0, 0, 0, 2.0, 0, 1, 0.05]])
        arm[1, [0, 3]] -= 0.015 * k
        threat = watcher.look(arm, 0.01 * k)
    slow, fast = growth(threat, 0.0, 0.2)
    assert fast == pytest.approx(slow + 0.1 * 1.5)
    assert threat.fastest == pytest.approx(1.5)


def test_balls_hold_a_point_that_speeds_up_within_the_bound(rng):
    settings = ThreatSettings(acceleration=4.0, jerk=50.0)
    v = np.array([0.7, -0.3, 0.1])
    ball = np.array([[0, 0, 0, 0, 0, 0, 0.01]], float)
    threat = Threat(ball, np.array([[v, v]]), np.zeros(1), 0.01, settings)
    for _ in range(50):
        begin = rng.uniform(0, 0.2)
        end = begin + rng.uniform(0, 0.1)
        row = threat.between(begin, end)[0].capsules[0].copy()
        pushed = rng.normal(size=3)
        pushed /= np.linalg.norm(pushed)
        for t in np.linspace(begin, end, 7) + 0.01:
            at = v * t + (0.5 * 4.0 + 50.0 * t / 6.0) * t * t * pushed
            assert np.linalg.norm(at - row[:3]) <= row[6] - 0.01 + 1e-12


# --- a person within the bounds, measured with noise ------------------------------


class Wanderer:
    """A rigid capsule whose ends accelerate by no more than a, mostly by all of it."""

    STEP = 1.0 / 600.0

    def __init__(self, rng, acceleration, ball=False):
        self.rng, self.most, self.ball = rng, acceleration, ball
        self.p = rng.uniform(-0.2, 0.2, 3)
        self.v = rng.uniform(-1.0, 1.0, 3)
        axis = rng.normal(size=3)
        self.axis = axis / np.linalg.norm(axis)
        self.side = np.cross(self.axis, rng.normal(size=3))
        self.side /= np.linalg.norm(self.side)
        self.length = 0.0 if ball else rng.uniform(0.1, 0.35)
        # the ends share a: half drives the middle, half the turn about it
        share = 1.0 if ball else 0.5
        self.push_most = share * acceleration
        half = 0.5 * self.length or 1.0
        self.spin = 0.0 if ball else np.sqrt(0.3 * acceleration / half)
        self.spin *= rng.uniform(-1, 1)
        self.angle, self.left = 0.0, 0
        self.push = self.drive = 0.0

    def ends(self):
        c, s = np.cos(self.angle), np.sin(self.angle)
        half = 0.5 * self.length * (c * self.axis + s * self.side)
        return np.stack([self.p - half, self.p + half])

    def move(self):
        if self.left == 0:
            push = self.rng.normal(size=3)
            self.push = self.push_most * push / np.linalg.norm(push)
            self.drive = self.rng.choice([-1.0, 1.0])
            self.left = int(self.rng.integers(6, 240))
        self.left -= 1
        h = self.STEP
        self.p = self.p + h * self.v + 0.5 * h * h * self.push
        self.v = self.v + h * self.push
        if not self.ball:  # centripetal and tangential together stay below a / 2
            half = 0.5 * self.length
            most = np.sqrt(0.35 * self.most / half)
            alpha = 0.3 * self.most / half * self.drive
            spin = np.clip(self.spin + h * alpha, -most, most)
            self.angle += 0.5 * h * (self.spin + spin)
            self.spin = spin


def within(rng, size, shape=3):
    """Draw an error of at most `size`, mostly of all of it."""
    if not size:
        return np.zeros(shape)
    v = rng.normal(size=shape)
    return size * v / np.linalg.norm(v, axis=-1, keepdims=True)


@pytest.mark.parametrize("rate", [30, 60, 100])
@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("ball", [True, False])
def test_balls_hold_whoever_keeps_to_the_bounds(rate, noise, ball):
    rng = np.random.default_rng(1000 * rate + ball)
    settings = ThreatSettings(noise=noise)
    radius, known, worst = 0.05, 0, -np.inf
    for _ in range(12):
        person = Wanderer(rng, settings.acceleration, ball)
        path = [person.ends()]
        for _ in range(600):
            person.move()
            path.append(person.ends())
        every, watcher = 600 // rate, Watcher(settings)
        last = int(rng.integers(6, 12)) * (2 if rate == 100 else 1)
        for k in range(last):
            measured = path[k * every] + within(rng, noise, (2, 3))
            if ball:
                measured[1] = measured[0]
            arm = np.r_[measured.ravel(), radius][None]
            threat = watcher.look(arm, k / rate)
        known += threat.known.all()
        start = (last - 1) * every
        for begin, end in ((0.0, 0.05), (0.0, 0.3), (0.1, 0.2), (0.3, 0.3)):
            there, more = threat.between(begin, end)
            for t in np.linspace(begin, end, 4):
                true = path[start + round(600 * t)]
                surface = odm.sample_capsules(np.r_[true.ravel(), radius][None], 0.01)
                worst = max(worst, beyond(there.capsules, surface) - more)
    assert worst <= 1e-9
    assert known == 12


@pytest.mark.parametrize("rate", [30, 100])
def test_without_noise_the_ball_is_as_large_as_it_must_be_and_no_larger(rate):
    a, period = ThreatSettings().acceleration, 1.0 / rate
    watcher = Watcher(ThreatSettings(jerk=0.0))
    for k in range(4):
        x = 0.5 * a * (k * period) ** 2
        arm = np.array([[x, 0, 0.5, x, 0, 0.5, 0.05]])
        threat = watcher.look(arm, k * period)
    row = threat.between(0.3, 0.3)[0].capsules[0]
    off = 0.5 * a * (3 * period + 0.3) ** 2 - row[0]
    assert row[6] - 0.05 == pytest.approx(off) and off > 0.18


def test_nobody_is_expected_to_speed_up_to_more_than_the_speed_of_who_is_not_known():
    still = np.zeros((1, 2, 3)), np.zeros(1), 0.0
    ball = np.array([[0, 0, 0, 0, 0, 0, 0.01]], float)
    for s in (ThreatSettings(), ThreatSettings(speed=1.0), ThreatSettings(jerk=0.0)):
        threat = Threat(ball, *still, s)
        for t in (0.05, 0.1, 0.2, 0.3, 0.5, 1.0):
            calm = 0.5 * s.acceleration * t * t
            most = max(calm, min(calm + s.jerk * t**3 / 6.0, s.speed * t))
            assert growth(threat, t, t)[0] == pytest.approx(most)
            assert growth(threat.as_so_far(), t, t)[0] == pytest.approx(calm)


def test_who_moves_may_turn_round_to_be_as_fast_as_who_is_not_known():
    """So farther from where their velocity leads by what they go there meanwhile."""
    ball = np.array([[0, 0, 0, 0, 0, 0, 0.01]], float)
    v, t, s = np.full((1, 2, 3), [1.5, 0.0, 0.0]), 0.5, ThreatSettings()
    threat = Threat(ball, v, np.zeros(1), 0.0, s)
    assert growth(threat, t, t)[0] == pytest.approx((s.speed + 1.5) * t)


def test_of_who_is_not_followed_yet_the_noise_counts_too():
    threat = Watcher(ThreatSettings(noise=0.01)).look(arms_apart(0.4, 0.0), 0.0)
    assert growth(threat, 0.0, 0.1) == pytest.approx(0.01 + 2.0 * 0.1)


# --- names -----------------------------------------------------------------------


def arms_apart(gap, t, v=0.4):
    """Return two upright arms that pass each other, `gap` apart [m]."""
    one = [0.3 + v * t, 0.0, 0.3, 0.3 + v * t, 0.0, 0.6, 0.05]
    other = [0.5 - v * t, gap, 0.3, 0.5 - v * t, gap, 0.6, 0.05]
    return np.array([one, other])


@each("rate", [30, 100])
@each("gap", [0.001, 0.01, 0.05, 0.2])
@each("times", [(4,), (2,), (4, 5), (4, 6)])
def test_parts_that_exchange_their_names_are_of_unknown_speed(rate, gap, times):
    v, passing = 0.4, 0.1 / 0.4  # they meet then
    begin = passing - 4.0 / rate
    watcher, swapped = Watcher(), False
    for k in range(max(times) + 2):
        arms = arms_apart(gap, begin + k / rate, v)
        swapped ^= k in times
        threat = watcher.look(arms[::-1] if swapped else arms, k / rate)
        if k >= times[0]:  # whatever is known of them
            lost = growth(threat, 0.0, 0.2)[~threat.known]
            assert (lost >= 0.2 * ThreatSettings().speed).all()
            arms = arms_apart(gap, begin + k / rate + 0.2, v)
            later = odm.sample_capsules(arms, 0.02)
            there, more = threat.between(0.2, 0.2)
            assert beyond(there.capsules, later) <= more + 1e-9
        if k in times:
            assert not threat.known.all()
    for j in range(3):  # and soon known again
        k += 1
        arms = arms_apart(gap, begin + k / rate, v)
        threat = watcher.look(arms[::-1] if swapped else arms, k / rate)
    assert threat.known.all()


def test_a_loop_that_is_quicker_than_its_tracker_follows_the_same_parts(rng):
    """Each of 30 frames a second is told four times, at another age each time."""
    moves, once, often = rng.normal(0, 0.3, 6), Watcher(), Watcher()
    for k in range(12):
        now = k / 30
        arm = np.concatenate([0.5 + moves * now, [0.05]])[None]
        threat = once.look(arm, now)
        for age in (0.0, 0.01, 0.02, 0.03):
            again = often.look(arm.copy(), now, age)
            assert again.known.all() == (k >= 2) and again.age == age
            held = replace(threat, age=age).between(0.0, 0.1)[0].capsules
            np.testing.assert_array_equal(again.between(0.0, 0.1)[0].capsules, held)
    moved = arm + [0.01, 0, 0, 0.01, 0, 0, 0]
    assert not often.look(moved, now, 0.01).known.any()  # two places at one time


def test_ends_that_change_places_and_parts_that_jump_are_of_unknown_speed():
    for change in ([3, 4, 5, 0, 1, 2, 6], "jump"):
        watcher = Watcher()
        for k in range(5):
            arm = arms_apart(0.4, 0.01 * k)
            if k == 4:
                if change == "jump":
                    arm[0, [0, 3]] += 0.2
                else:
                    arm[0] = arm[0, change]
            threat = watcher.look(arm, 0.01 * k)
        assert threat.known.tolist() == [False, True]
        assert np.allclose(threat.velocity[1, :, 0], -0.4, atol=1e-6)
        assert growth(threat, 0.1, 0.2)[0] == pytest.approx(0.4)


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_who_speeds_up_as_nobody_can_is_of_unknown_speed(noise):
    """Either part stands; one is 3 cm on in 10 ms, the other goes at 8 m/s."""
    watcher = Watcher(ThreatSettings(noise=noise))
    for k in range(12):
        arms = arms_apart(0.4, 0.0)
        arms[0, [0, 3]] += 0.03 * (k >= 6)
        arms[1, [0, 3]] += 0.08 * max(0, k - 6)
        threat = watcher.look(arms, 0.01 * k)
        if k >= 6:
            assert threat.known.tolist() == [k > 7, k == 6]


def test_a_short_part_whose_ends_change_places_is_of_unknown_speed():
    watcher, part = Watcher(), np.array([[0.3, 0, 0, 0.303, 0, 0, 0.05]])
    for k in range(6):
        threat = watcher.look(part if k < 5 else part[:, [3, 4, 5, 0, 1, 2, 6]], k / 50)
    assert not threat.known.any()


def test_a_hand_that_trembles_is_still_followed():
    watcher, lost = Watcher(), 0
    for k in range(200):
        x = 0.3 + 0.02 * np.sin(2 * np.pi * 5.0 * 0.01 * k)
        arm = np.array([[x, 0.0, 0.4, 0.6, 0.0, 0.4, 0.05]])
        lost += not watcher.look(arm, 0.01 * k).known.all()
    assert lost < 15


# --- what is not known -------------------------------------------------------------


BALL = np.array([[0.3, 0.1, 0.4, 0.3, 0.1, 0.4, 0.05]])
RESTS = np.zeros((1, 2, 3))


def threats(age):
    """Return all kinds of threats of a ball, seen so long ago."""
    settings = ThreatSettings()
    for error in (0.0, np.inf):
        yield Threat(BALL, RESTS, np.array([error]), age, settings)
    yield Threat(BALL[:0], RESTS[:0], np.zeros(0), age, settings)
    yield CloudThreat(BALL[:, :3], age, settings)


def test_at_a_time_that_is_none_nobody_has_a_known_speed():
    watcher, person = Watcher(), np.array([[0.0, 0, 1, 0, 0, 1.3, 0.05]])
    with np.errstate(all="raise"):
        for now in np.array([0.0, 0.01, 0.02, np.inf, np.inf, -np.inf, np.nan, 0.03]):
            person = person + [0.01, 0, 0, 0.01, 0, 0, 0]
            threat = watcher.look(person, now)
    assert (threat.error == np.inf).all()


@pytest.mark.parametrize("age", [None, np.nan, np.inf, -0.1])
def test_an_age_that_is_not_known_makes_the_person_be_anywhere(age):
    for threat in threats(age):
        assert threat.between(0.0, 0.1)[1] == threat.displacement_bound(0.1) == np.inf
        assert isinstance(threat, CloudThreat) or threat.likely(0.1) is None
    for threat in threats(0.0):
        assert threat.between(0.0, np.nan)[1] == np.inf
        assert threat.between(0.0, 1e6)[1] > 0.0 or not len(threat.capsules)


@pytest.mark.parametrize("column", range(6))
def test_an_end_that_is_not_known_makes_the_person_be_anywhere(column):
    arms = np.array([[0.5, 0.0, 0.3, 0.5, 0.2, 0.5, 0.05], [0, 1, 0, 0, 1, 1, 0.1]])
    watcher = Watcher()
    for k in range(8):
        arms = arms + [0.01, 0.002, 0.0, 0.01, 0.003, 0.0, 0.0]
        seen = watcher.look(arms, 0.01 * k)
    assert seen.known.all() and seen.between(0.0, 0.1)[1] == 0.0
    for part in (0, 1):
        velocity = seen.velocity.copy()
        velocity[part, column // 3, column % 3] = np.nan
        for end in (0.0, 0.1):
            threat = replace(seen, velocity=velocity)
            assert threat.between(0.0, end)[1] == threat.displacement_bound(end)
            assert threat.displacement_bound(end) == np.inf
    arms[0, column] = np.nan  # of a part that is not followed the shape says it
    there, more = watcher.look(arms, 0.08).between(0.0, 0.1)
    assert more == np.inf or not np.isfinite(there.capsules[0]).all()


@pytest.mark.parametrize("age", [None, np.nan])
def test_a_stop_beside_a_person_of_unknown_age_does_not_pass(small_map, age):
    planner = odm.ReactivePlanner(small_map)
    q = np.array([1.2, 0.9, 0.0])
    planner.step(np.zeros((0, 3)), q=q)
    motion = time_path(small_map.robot, np.stack([q, q - 0.3]))
    test = BrakingTest(planner)
    for threat in threats(age):
        assert not test.passes(motion, 0.0, 0.01, motion.stop(0.01), threat)


def test_a_cloud_comes_as_fast_as_it_may():
    cloud = CloudThreat(BALL[:, :3], 0.05, ThreatSettings(speed=1.5, noise=0.01))
    points, more = cloud.between(0.1, 0.2)
    assert np.array_equal(points, BALL[:, :3]) and cloud.fastest == 1.5
    assert more == pytest.approx(0.01 + 1.5 * 0.25)


@pytest.mark.parametrize(
    ("name", "value"), [("noise", -0.1), ("speed", np.nan), ("acceleration", np.inf)]
)
def test_settings_that_bound_nothing_are_refused(name, value):
    with pytest.raises(BadInput, match=name):
        ThreatSettings(**{name: value})


def test_a_part_that_was_fast_and_is_lost_is_bounded_by_how_fast_it_was():
    watcher = Watcher()
    speed, rate, hand = 3.0, 100.0, np.array([[0.0, 0, 1, 0, 0, 1.2, 0.05]])
    for k in range(12):
        jumped = 0.5 if k >= 10 else 0.0
        at = hand + [*np.tile([speed * k / rate, jumped, 0.0], 2), 0.0]
        threat = watcher.look(at, k / rate)
        if k == 0:  # nobody was seen before
            assert growth(threat, 0.0, 0.2)[0] == pytest.approx(0.4)
        if k >= 10:
            sped_up = ThreatSettings().acceleration * (k - 9) / rate
            assert growth(threat, 0.0, 0.2)[0] >= 0.2 * (speed + sped_up) - 1e-9


@pytest.mark.parametrize("back", [0.1, 3.0])
def test_how_fast_a_part_was_is_known_behind_a_frame_that_is_older(back):
    """One that came late, or the first one of a clock that was set back."""
    watcher, hand = Watcher(), np.array([[0.0, 0, 1, 0, 0, 1.2, 0.05]])
    for k in range(12):
        at = hand + [*np.tile([0.03 * k, 0.0, 0.0], 2), 0.0]
        threat = watcher.look(at, 0.01 * k)
    assert threat.known.all()
    for k in range(2):
        threat = watcher.look(at, 0.11 - back + 0.01 * k)
        assert not threat.known.any()
        assert growth(threat, 0.0, 0.2)[0] >= 0.2 * 3.0 - 1e-9


def test_who_lately_sped_up_by_more_than_is_assumed_may_do_half_as_much_again():
    for a, most in ((2.0, 4.0), (12.0, 18.0), (45.0, 60.0)):
        watcher = Watcher()
        rows = np.array(
            [[1.0, 0, 0, 1.0, 0, 0.2, 0.05], [2.0, 0, 0, 2.0, 0, 0.2, 0.05]]
        )
        for k in range(20):
            now = rows.copy()
            spurt = max(0.0, 0.01 * k - 0.08)  # the other one rests
            now[0, [0, 3]] -= 0.5 * a * spurt**2
            threat = watcher.look(now, 0.01 * k)
        lately = threat.as_lately()
        assert np.allclose(lately.most, [most, 4.0], atol=1e-6)
        more = growth(lately, 0.1, 0.1) - growth(threat.as_so_far(), 0.1, 0.1)
        beyond = 0.5 * (most - 4.0) * (0.1**2 + 0.01 * 0.1)  # the velocity's error, too
        assert np.allclose(more, [beyond, 0.0], atol=1e-9)
        one, where = lately.of(np.array([1])), lately.between(0.1, 0.2)[0].capsules
        assert np.array_equal(one.between(0.1, 0.2)[0].capsules, where[1:])
        soon = lately.likely(0.1).capsules
        assert np.array_equal(one.likely(0.1).capsules, soon[1:])
        assert np.array_equal(one.as_lately().most, lately.most[1:])
        two = lately.of(np.array([1, 0])).as_lately()
        assert np.array_equal(two.most, lately.most[::-1])
    layouts = {s[1].layout for s in write_sharpest.signatures}
    assert layouts == {"C"}  # another would be compiled while the robot moves
    assert watcher.look(now[:1], 0.2).as_lately().most is None  # seen anew


def sway(k):
    """Return where a trunk is that slows down at 9 m/s2, and soon comes at 14 [m]."""
    times = np.arange(0.0, k + 0.5) * 0.01
    spurts = np.interp(
        times, [0.0, 0.06, 0.08, 0.20, 0.23, 0.40], [-9.0, -9.0, 0.0, 0.0, 14.0, 14.0]
    )
    speeds = 1.0 + np.concatenate([[0.0], np.cumsum(0.01 * spurts[:-1])])
    return np.concatenate([[0.0], np.cumsum(0.01 * speeds[:-1])])[-1]


@pytest.mark.parametrize(("rise", "held"), [(1.5, True), (1.0, False)])
def test_who_comes_harder_than_they_braked_is_held_while_a_robot_stops(rise, held):
    watcher = Watcher(ThreatSettings(rise=rise))
    off = -np.inf
    for k in range(28):
        at = sway(k)
        body = np.array([[at, 0, 0, at, 0, 0.4, 0.1]])
        threat = watcher.look(body, 0.01 * k).as_lately()
        if k < 3:
            continue
        for j in range(1, 9):  # the 80 ms of a stop
            row = threat.between(0.01 * j, 0.01 * j)[0].capsules[0]
            off = max(off, abs(sway(k + j) - row[0]) - (row[6] - 0.1))
    assert (off <= 0.005) == held  # what an evasion keeps from the links


def test_noise_is_no_speeding_up(rng):
    watcher = Watcher(ThreatSettings(noise=0.002))
    rows = np.array([[1.0, 0, 0, 1.0, 0, 0.2, 0.05]])
    for k in range(40):
        off = rng.normal(size=(2, 3))
        off *= 0.002 / np.linalg.norm(off, axis=1, keepdims=True)
        now = rows + np.r_[off.ravel(), 0.0]
        most = watcher.look(now, 0.01 * k).as_lately().most
        assert most is None or np.allclose(most, 4.0)


# --- not seen --------------------------------------------------------------------


def shown(t, lost, v, growing=1.6):
    """Return what a tracker shows of a ball that it does not see from `lost` on [s]."""
    age = max(t - lost, 0.0)
    place = np.array([0.3, 0.0, 0.4]) + min(t, lost) * v
    return np.array([[*place, *place, 0.05 + growing * age]])


@pytest.mark.parametrize("rate", [30, 50, 100])
def test_a_part_that_is_not_seen_is_held_wherever_it_may_have_come(rate, rng):
    """It goes on as it did; what is shown stays where it was, and grows."""
    worst, without = -np.inf, -np.inf
    for _ in range(20):
        v = within(rng, 1.5)
        lost = rng.uniform(5, 6) / rate  # between two frames
        watcher = Watcher()
        for k in range(12):
            threat = watcher.look(shown(k / rate, lost, v), k / rate)
            if k < 5:
                continue
            for t in (0.02, 0.08, 0.2):
                true = np.array([0.3, 0.0, 0.4]) + (k / rate + t) * v
                for told in (threat, replace(threat, widening=None)):
                    there, more = told.between(t, t)
                    row = there.capsules[0]
                    off = np.linalg.norm(true - row[:3]) + 0.05 - row[6] - more
                    if told is threat:
                        worst = max(worst, off)
                    else:
                        without = max(without, off)
    assert worst <= 1e-9
    assert without > 0.05


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("rate", [20, 50, 100])
def test_a_part_that_is_seen_again_is_held(rate, noise, rng):
    """It goes on as it did: that it seems to rest and to jump meanwhile is no speed."""
    known = 0
    for _ in range(30):
        v, missed = within(rng, 1.5), int(rng.integers(1, 5))
        watcher = Watcher(ThreatSettings(noise=noise))
        for k in range(20):
            place = np.array([0.3, 0.0, 0.4]) + k / rate * v
            row = np.array([[*place, *place, 0.05]])
            if 5 <= k < 5 + missed:
                row = shown(k / rate, 4 / rate, v, growing=2.0)
            threat = watcher.look(row, k / rate)
            for t in (0.02, 0.1, 0.3):
                there, more = threat.between(t, t)
                far = np.linalg.norm(place + t * v - there.capsules[0, :3]) + 0.05
                assert far <= there.capsules[0, 6] + more + 1e-9, (k, missed, v)
        known += threat.known.all()
    assert known == 30


def test_a_part_that_nobody_has_seen_yet_comes_as_fast_as_it_grows():
    """Not as fast as parts of unknown speed do, where that is less."""
    watcher, v = Watcher(), np.array([3.9, 0.0, 0.0])
    for k in range(6):
        threat = watcher.look(shown(0.01 * k, 0.0, v, growing=4.0), 0.01 * k)
        for t in (0.02, 0.2) if k else ():
            there, more = threat.between(t, t)
            row = there.capsules[0]
            true = np.array([0.3, 0.0, 0.4]) + (0.01 * k + t) * v
            assert np.linalg.norm(true - row[:3]) + 0.05 <= row[6] + more, (k, t)


def test_a_part_that_grows_alone_grows(rng):
    arms = arms_apart(0.3, 0.0)
    watcher = Watcher()
    for k in range(4):
        arms[1, 6] += 0.01
        threat = watcher.look(arms, 0.01 * k)
    grown = threat.between(0.1, 0.1)[0].capsules[:, 6] - arms[:, 6]
    assert grown[1] == pytest.approx(grown[0] + 0.1 * 1.0)
    assert threat.displacement_bound(0.1) == pytest.approx(grown[1])
    arms[1, 6] -= 0.03  # it is seen again
    assert watcher.look(arms, 0.04).widening is None
    arms[1, 6] += 3.0  # no part grows so fast: it is a fault
    assert watcher.look(arms, 0.05).widening.tolist() == [0.0, 5.0]
    assert watcher.look(arms, 0.06).of([1]).widening is None


def test_some_of_the_parts_grow_as_they_did_among_all():
    arms = arms_apart(0.3, 0.0)
    watcher = Watcher()
    for k in range(4):
        arms[1, 6] += 0.01
        threat = watcher.look(arms, 0.01 * k)
    for these in ([1], slice(1, 2)):
        (alone,) = threat.of(these).between(0.1, 0.1)[0].capsules
        assert alone == pytest.approx(threat.between(0.1, 0.1)[0].capsules[1])


def test_of_who_is_partly_calm_some_speed_up_no_harder_and_all_are_told():
    two = BALL.repeat(2, axis=0), RESTS.repeat(2, axis=0), np.zeros(2)
    threat = Threat(*two, 0.0, ThreatSettings())
    whole, calm = growth(threat, 0.0, 0.3), growth(threat.as_so_far(), 0.0, 0.3)
    assert (calm < whole).all()
    these = np.arange(len(whole)) == 0
    partly = SteadyParts(threat, these)
    there, more = partly.between(0.0, 0.3)
    grown = there.capsules[:, 6] + more - threat.capsules[:, 6]
    assert np.array_equal(grown, np.where(these, calm, whole))
    assert (partly.fastest, partly.displacement_bound(0.3)) == (
        threat.fastest,
        threat.displacement_bound(0.3),
    )
    swift = replace(threat, velocity=np.full((2, 2, 3), [2.0, 0.0, 0.0]))
    assert swift.as_so_far().between(1.2, 1.2)[1] == 0.0
    assert SteadyParts(swift, these).between(1.2, 1.2)[1] == np.inf  # one may be so far


def rod(x, z=0.4):
    return [x, 0.0, z, x, 0.0, z + 0.2, 0.02]


def stood(noise, frames=40, settings=ThreatSettings):
    """Return the threat of a person who comes and of an object that stands."""
    watcher = Watcher(settings(noise=noise))
    for k in range(frames):
        threat = watcher.look(np.array([rod(2.0 - 0.01 * k), rod(0.5)]), 0.01 * k)
    return threat


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_what_is_left_alone_holds_who_starts_to_push_it_only_then(noise, rng):
    before = stood(noise).as_so_far()
    alone, now, least = before.left_alone(slice(1, None), 0.3), 0.8, 0.0
    assert growth(alone, 0.0, 0.3)[1] == pytest.approx(
        noise + (2.0 * noise / alone.window[1]) * 0.3
    )
    assert growth(alone, 0.0, now)[1] < growth(before, 0.0, now)[1]
    assert growth(alone, 0.0, now)[0] == growth(before, 0.0, now)[0]
    for _ in range(200):  # pushed from 0.3 s on, as hard as anybody can
        push = rng.normal(size=3)
        push *= 4.0 / np.linalg.norm(push)
        end = rng.uniform(0.0, now)
        shift = 0.5 * push * max(0.0, end - 0.3) ** 2
        row = alone.capsules[1]
        points = np.array([row[:3], row[3:6]]) + shift
        there, more = alone.between(0.0, end)
        least = max(least, beyond(there.capsules[1:], points) + row[6])
    assert more == 0.0 and least <= 1e-9


def test_of_what_is_left_alone_no_lately_makes_it_faster_and_parts_stay_theirs():
    alone = stood(0.0).left_alone(slice(1, None), 0.3)
    lately = replace(alone, settings=replace(alone.settings, rise=50.0)).as_lately()
    assert growth(lately, 0.0, 0.3)[1] == 0.0 < growth(lately, 0.0, 0.3)[0]
    assert growth(alone.of(slice(1, None)), 0.0, 0.3)[0] == 0.0
    assert alone.of(slice(0, 1)).displacement_bound(0.3) == growth(alone, 0.3, 0.3)[0]


def test_what_was_just_seen_is_not_known_to_stand_and_nothing_makes_it_so():
    watcher = Watcher()
    threat = watcher.look(np.array([rod(2.0), rod(0.5)]), 0.0)
    alone = threat.left_alone(slice(1, None), 0.3)
    assert growth(alone, 0.0, 0.3)[1] == growth(threat, 0.0, 0.3)[1] > 0.5


@pytest.mark.parametrize(
    ("capsules", "now", "age", "told"),
    [
        (np.zeros((2, 6)), 0.0, 0.0, r"shape \(2, 6\)"),
        (np.zeros(7), 0.0, 0.0, r"shape \(7,\)"),
        ([["a"] * 7], 0.0, 0.0, "real numbers"),
        (np.zeros((1, 7)), "0", 0.0, "now is '0'"),
        (np.zeros((1, 7)), 0.0, "0", "age of the capsules is '0'"),
    ],
)
def test_what_nobody_can_be_followed_by_is_refused(capsules, now, age, told):
    with pytest.raises(BadInput, match=told):
        Watcher().look(capsules, now, age)
