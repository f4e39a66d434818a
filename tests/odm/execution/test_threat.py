"""Which points are near, and how they move."""

import numpy as np
import pytest

import odm
from odm.execution.stop_test import BrakingTest
from odm.execution.threat import Threat, ThreatSettings, Watcher
from roadmap.errors import BadInput
from roadmap.motion.motion import time_path

CENTERS = np.array([[0.0, 0.0, 0.5], [0.2, 0.0, 0.8]])


def naive_velocity(p, ends, before, passed, radii):
    """Return the velocity of a point above the nearest of some rigid capsules."""
    found = []
    for (a, b), (a0, b0), r in zip(ends, before, radii, strict=True):
        t = np.clip(np.dot(p - a, b - a) / max(np.dot(b - a, b - a), 1e-12), 0, 1)
        on = a + t * (b - a)
        off = abs(np.linalg.norm(p - on) - r)
        u, v = (a - a0) / passed, (b - b0) / passed
        turn = np.cross(b - a, v - u) / max(np.dot(b - a, b - a), 1e-12)
        found.append((off, (1 - t) * u + t * v + np.cross(turn, p - on)))
    return min(found, key=lambda entry: entry[0])[1]


def test_points_move_with_the_capsule_that_they_are_on(rng):
    for _ in range(20):
        before = rng.uniform(-0.5, 0.5, (3, 7))
        before[:, 6] = rng.uniform(0.03, 0.08, 3)
        step = rng.normal(0, 0.01, (3, 7))
        step[:, 6] = 0.0
        before[0, :3], step[0, :3] = before[0, 3:6], step[0, 3:6]  # a ball
        arms = before + step
        points = odm.sample_capsules(arms, 0.03)
        watcher = Watcher()
        # two frames could show two parts, and a third one that they are the same
        for capsules, now in ((before - step, 0.98), (before, 1.0)):
            assert watcher.look(capsules, points, CENTERS, now).velocity is None
        threat = watcher.look(arms, points, CENTERS, 1.02)
        assert np.array_equal(threat.points, points) and not threat.lost
        ends, old = (a[:, :6].reshape(-1, 2, 3) for a in (arms, before))
        for p, v in zip(points, threat.velocity, strict=True):
            slow = naive_velocity(p, ends, old, 0.02, arms[:, 6])
            assert v == pytest.approx(slow, abs=1e-9)


def test_points_that_cannot_come_in_time_are_left_out_and_no_others(rng):
    points = rng.uniform(-4, 4, (500, 3))
    points[7, 1] = np.nan
    arm = np.array([[1.0, 0, 0, 1.0, 0, 0.5, 0.05]])
    settings = ThreatSettings(horizon_s=0.25)
    watcher = Watcher(settings, robot_speed=1.0)
    threat = watcher.look(arm, points, CENTERS, 0.0, age=0.05, margin=0.2)
    far = (settings.speed + 1.0) * 0.3 + 0.2
    low, high = CENTERS.min(axis=0) - far, CENTERS.max(axis=0) + far
    near = ((points > low) & (points < high)).all(axis=1)
    near[7] = True  # what is nowhere is near
    assert 1 < near.sum() < 500
    assert np.array_equal(threat.points, points[near], equal_nan=True)
    early, late = threat.between(0.0, 0.25)[0], threat.between(0.0, 0.26)[0]
    assert len(early) == near.sum() and len(late) == 500


def test_who_comes_fast_is_seen_from_afar():
    for distance in (1.3, 2.0):
        watcher = Watcher(robot_speed=0.5)
        for k in range(4):
            x = 0.2 + distance + 0.04 * (3 - k)
            arm = np.array([[x, 0.0, 0.5, x, 0.0, 0.8, 0.05]])
            points = odm.sample_capsules(arm, 0.03)
            threat = watcher.look(arm, points, CENTERS, 0.01 * k)
        assert len(threat.points) and threat.fastest == pytest.approx(4.0)


def test_balls_hold_a_point_that_speeds_up_within_the_bound(rng):
    settings = ThreatSettings(acceleration=4.0)
    v = np.array([[0.7, -0.3, 0.1]])
    threat = Threat(np.zeros((1, 3)), v, 0.01, settings)
    for _ in range(50):
        begin = rng.uniform(0, 0.2)
        end = begin + rng.uniform(0, 0.1)
        centers, radius = threat.between(begin, end)
        pushed = rng.normal(size=3)
        pushed *= 4.0 / np.linalg.norm(pushed)
        for t in np.linspace(begin, end, 7) + 0.01:
            at = v[0] * t + 0.5 * pushed * t * t
            assert np.linalg.norm(at - centers[0]) <= radius + 1e-12


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
        every, watcher = 600 // rate, Watcher(settings, covering=0.03)
        last = int(rng.integers(6, 12)) * (2 if rate == 100 else 1)
        for k in range(last):
            measured = path[k * every] + within(rng, noise, (2, 3))
            if ball:
                measured[1] = measured[0]
            arm = np.r_[measured.ravel(), radius][None]
            points = odm.sample_capsules(arm, 0.03)
            threat = watcher.look(arm, points, CENTERS, k / rate)
        known += threat.velocity is not None
        start = (last - 1) * every
        for begin, end in ((0.0, 0.05), (0.0, 0.3), (0.1, 0.2), (0.3, 0.3)):
            at, size = threat.between(begin, end)
            for t in np.linspace(begin, end, 4):
                true = path[start + round(600 * t)]
                surface = odm.sample_capsules(np.r_[true.ravel(), radius][None], 0.01)
                off = np.linalg.norm(surface[:, None] - at, axis=2).min(axis=1).max()
                worst = max(worst, off - size - 0.03)
                if ball:  # each point where it went itself
                    gone = points + true[0] - measured[0]
                    exact = np.linalg.norm(gone - at, axis=1).max() - size
                    worst = max(worst, exact)
    assert worst <= 1e-9
    assert known == 12


@pytest.mark.parametrize("rate", [30, 100])
def test_without_noise_the_ball_is_as_large_as_it_must_be_and_no_larger(rate):
    a, period = ThreatSettings().acceleration, 1.0 / rate
    watcher = Watcher()
    for k in range(4):
        x = 0.5 * a * (k * period) ** 2
        arm = np.array([[x, 0, 0.5, x, 0, 0.5, 0.05]])
        points = odm.sample_capsules(arm, 0.03)
        threat = watcher.look(arm, points, CENTERS, k * period)
    at, radius = threat.between(0.3, 0.3)
    true = points + [0.5 * a * (3 * period + 0.3) ** 2 - x, 0, 0]
    off = np.linalg.norm(true - at, axis=1)
    assert radius == pytest.approx(off.max()) and off.max() > 0.18


# --- names -----------------------------------------------------------------------


def arms_apart(gap, t, v=0.4):
    """Return two upright arms that pass each other, `gap` apart [m]."""
    one = [0.3 + v * t, 0.0, 0.3, 0.3 + v * t, 0.0, 0.6, 0.05]
    other = [0.5 - v * t, gap, 0.3, 0.5 - v * t, gap, 0.6, 0.05]
    return np.array([one, other])


@pytest.mark.parametrize("rate", [30, 100])
@pytest.mark.parametrize("gap", [0.001, 0.01, 0.05, 0.2])
@pytest.mark.parametrize("times", [(4,), (2,), (4, 5), (4, 6)])
def test_parts_that_exchange_their_names_are_of_unknown_speed(rate, gap, times):
    v, passing = 0.4, 0.1 / 0.4  # they meet then
    begin = passing - 4.0 / rate
    watcher, swapped = Watcher(), False
    for k in range(max(times) + 2):
        arms = arms_apart(gap, begin + k / rate, v)
        swapped ^= k in times
        points = odm.sample_capsules(arms, 0.03)
        threat = watcher.look(
            arms[::-1] if swapped else arms, points, CENTERS, k / rate
        )
        if k >= times[0] and not (threat.velocity is not None and not threat.lost):
            _, radius = threat.between(0.0, 0.2)
            assert radius >= 0.2 * ThreatSettings().speed
        if k >= times[0]:  # whatever is known of them
            arms = arms_apart(gap, begin + k / rate + 0.2, v)
            later = odm.sample_capsules(arms, 0.02)
            at, radius = threat.between(0.2, 0.2)
            off = np.linalg.norm(later[:, None] - at, axis=2).min(axis=1)
            assert off.max() <= radius + 0.03
        if k in times:
            assert threat.velocity is None or threat.lost
    for j in range(3):  # and soon known again
        k += 1
        arms = arms_apart(gap, begin + k / rate, v)
        points = odm.sample_capsules(arms, 0.03)
        threat = watcher.look(
            arms[::-1] if swapped else arms, points, CENTERS, k / rate
        )
    assert threat.velocity is not None and not threat.lost


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
            points = odm.sample_capsules(arm, 0.03)
            threat = watcher.look(arm, points, CENTERS, 0.01 * k)
        assert threat.lost and threat.velocity is not None
        near = points[:, 1] > 0.3
        assert (np.abs(threat.velocity[near, 0] + 0.4) < 1e-6).all()
        _, radius = threat.between(0.1, 0.2)
        assert radius == pytest.approx(0.2 * ThreatSettings().speed)


def test_a_hand_that_trembles_is_still_followed():
    watcher, lost = Watcher(), 0
    for k in range(200):
        x = 0.3 + 0.02 * np.sin(2 * np.pi * 5.0 * 0.01 * k)
        arm = np.array([[x, 0.0, 0.4, 0.6, 0.0, 0.4, 0.05]])
        points = odm.sample_capsules(arm, 0.03)
        threat = watcher.look(arm, points, CENTERS, 0.01 * k)
        lost += threat.velocity is None or threat.lost
    assert lost < 15


# --- what is not known -------------------------------------------------------------


@pytest.mark.parametrize("age", [None, np.nan, np.inf, -0.1])
def test_an_age_that_is_not_known_makes_the_person_be_anywhere(age):
    points = np.zeros((1, 3))
    for velocity in (None, np.zeros((1, 3))):
        threat = Threat(points, velocity, age, ThreatSettings())
        assert threat.between(0.0, 0.1)[1] == np.inf
        assert threat.likely(0.1) is None
    assert Threat(points, None, 0.0, ThreatSettings()).between(0.0, np.nan)[1] == np.inf


@pytest.mark.parametrize("age", [None, np.nan])
def test_a_stop_beside_a_person_of_unknown_age_does_not_pass(small_map, age):
    planner = odm.ReactivePlanner(small_map)
    q = np.array([1.2, 0.9, 0.0])
    planner.step(np.zeros((0, 3)), q=q)
    motion = time_path(small_map.robot, np.stack([q, q - 0.3]))
    for points in (np.zeros((0, 3)), np.array([[0.3, 0.1, 0.4]])):
        threat = Threat(points, None, age, ThreatSettings())
        test = BrakingTest(planner)
        assert not test.passes(motion, 0.0, 0.01, motion.stop(0.01), threat)


@pytest.mark.parametrize(
    ("name", "value"), [("noise", -0.1), ("speed", np.nan), ("acceleration", np.inf)]
)
def test_settings_that_bound_nothing_are_refused(name, value):
    with pytest.raises(BadInput, match=name):
        ThreatSettings(**{name: value})


def test_a_part_that_was_fast_and_is_lost_is_bounded_by_how_fast_it_was():
    watcher = Watcher()
    centers = np.zeros((1, 3))
    speed, rate, hand = 3.0, 100.0, np.array([[0.0, 0, 1, 0, 0, 1.2, 0.05]])
    for k in range(12):
        jumped = 0.5 if k >= 10 else 0.0
        at = hand + [*np.tile([speed * k / rate, jumped, 0.0], 2), 0.0]
        threat = watcher.look(at, odm.sample_capsules(at), centers, k / rate)
        if k == 0:  # nobody was seen before
            assert threat.between(0.0, 0.2)[1] == pytest.approx(0.4)
        if k >= 10:
            assert threat.between(0.0, 0.2)[1] >= 0.2 * speed
