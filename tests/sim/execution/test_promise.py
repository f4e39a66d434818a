"""What a passed braking test promises, against where robot and person truly are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from forms import some

import odm
from odm.exact.distances import ExactRobot, capsule_obstacles
from odm.execution.executor import Executor
from odm.execution.threat import Threat
from sim.loop.loop import Loop, LoopSettings

PLACES = np.array([[-1.2, 0.6, 0.2], [1.2, 0.6, 0.2]])
CLOSE = 0.10  # [m] so near they come, or nothing is tested
BETWEEN = Threat.between


class Swaying:
    """Two balls that sway about the arm's way, at no more than 3.8 m/s2."""

    name, max_speed = "swaying", 1.3

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.middle = np.array([[0.55, 0.0, 0.3], [0.35, 0.35, 0.35]])
        self.rate, self.phase = rng.uniform(2.0, 3.5, (2, 3)), rng.uniform(0, 6, (2, 3))
        self.most = np.minimum(2.2 / self.rate**2, 0.35)

    def capsules(self, t):
        off = self.most * np.sin(self.rate * t + self.phase)
        place = self.middle + off
        return np.hstack([place, place, np.full((2, 1), 0.05)])


class Promise:
    """Remembers who was held where by the last test that passed, and what it kept."""

    def __init__(self, loop, late=(0.0,)):
        self.loop, self.exact, self.late = loop, ExactRobot(loop.robot), late
        self.told, self.least, self.nearest, self.looks = None, np.inf, np.inf, 0
        executor, safety = loop.executor, loop.planner.cell_map.safety
        stop_free, shells = executor._stop_free, executor._shells.passes

        def watched_stop(motion, t, threat, delay=0.0, closer=0.0):
            free = stop_free(motion, t, threat, delay, closer)
            if free:
                self.told = loop.index, threat, safety.m - closer - safety.blending
            return free

        def watched_shells(motion, t, begin, stop, threat, least):
            free = shells(motion, t, begin, stop, threat, least)
            if free:
                self.told = loop.index, threat, least
            return free

        executor._stop_free, executor._shells = (
            watched_stop,
            SimpleNamespace(passes=watched_shells),
        )

    def look(self):
        """Look at four moments of the period that has passed."""
        loop, executor, period = (
            self.loop,
            self.loop.executor,
            self.loop.executor.period,
        )
        if self.told is None or executor.t - period >= executor.motion.duration:
            return
        index, threat, keeps = self.told
        for share in (1.0, 0.75, 0.5, 0.25):
            t = executor.t + (share - 1.0) * period
            if not 0.0 <= t <= executor.motion.duration:
                continue
            now = (loop.index + share - 1.0) * period
            q = executor.motion.at(t).q
            gaps = [self.gap(q, now + late, now + late - index * period, threat)
                    for late in self.late]  # fmt: skip
            self.looks += 1
            self.nearest = min(self.nearest, *gaps, np.inf)
            self.least = min(self.least, min(gaps) - keeps)
            if min(gaps) > CLOSE:
                return

    def gap(self, q, now, since, threat):
        """Return how far q is from who keeps within what was assumed of them."""
        person, (held, _) = (
            self.loop.motion.capsules(now),
            BETWEEN(threat, since, since),
        )
        off = np.linalg.norm(person[:, :3] - held.capsules[:, :3], axis=1)
        inside = off + person[:, 6] <= held.capsules[:, 6] + 1e-9
        return self.exact.distance(q, capsule_obstacles(person[inside])).distance


def promised(cell_map, seed, rate, speed, late=(0.0,), told_s=0.0):
    planner = odm.ReactivePlanner(cell_map)
    how = {"rate_hz": rate, "speed_scale": speed, "execution": "timed"}
    loop = Loop(planner, planner.robot, PLACES, Swaying(seed), LoopSettings(**how))
    how = replace(loop.executor.settings, latency_s=told_s)
    loop.executor = Executor(planner.robot, planner, PLACES[0], 1.0 / rate, how)
    promise = Promise(loop, late)
    for _ in range(round(5.0 * rate)):
        loop.frame()
        promise.look()
    return promise


@pytest.mark.parametrize(("rate", "speed"), [(50.0, 1.0), (100.0, 0.5), (100.0, 1.0)])
def test_a_moving_robot_keeps_from_everybody_what_its_last_test_kept(
    small_map, rate, speed
):
    for seed in some((0, 1), 0):
        promise = promised(small_map, seed, rate, speed)
        assert promise.looks > 100 and promise.nearest < CLOSE
        assert promise.least >= -1e-6


def test_so_does_one_that_follows_late_if_that_is_told(small_map):
    late = (0.0, 0.02, 0.04)  # [s] anywhere between
    told = promised(small_map, 0, 100.0, 1.0, late, 0.04)
    assert told.looks > 100 and told.nearest < CLOSE
    assert told.least >= -1e-6
    untold = (promised(small_map, seed, 100.0, 1.0, late, 0.0) for seed in (0, 7))
    assert any(one.least < -0.003 for one in untold)


def test_a_test_that_forgets_that_they_move_on_breaks_it(small_map, monkeypatch):
    monkeypatch.setattr(Threat, "between", lambda self, begin, end: BETWEEN(self, 0, 0))
    assert promised(small_map, 1, 100.0, 1.0).least < -0.005
