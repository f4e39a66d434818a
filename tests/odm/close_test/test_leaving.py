"""A robot that stands hardly clear of itself, or of the floor, is proved to leave."""

import numpy as np
import pytest

from odm.close_test.safety import Safety
from odm.close_test.static import StaticTest
from odm.obstacles.scenery import parse_scenery
from roadmap import load_robot
from roadmap.geometry.self_collision import FINEST, TOLERANCE, configuration_free

HARDLY = 2e-5  # [m] more than it must
TIMES = np.linspace(0.0, 1.0, 60)
SETTINGS = Safety()
FLOOR = parse_scenery(({"type": "plane", "normal": [0.0, 0.0, 1.0], "offset": 0.05},))
NOTHING = parse_scenery(())


@pytest.fixture(scope="module")
def panda():
    """Return the Panda that comes with pybullet."""
    pytest.importorskip("pybullet_data", reason="the Panda comes with pybullet")
    return load_robot("panda")


def last_free(test, free, met):
    """Return the configuration on the way from `free` to `met` that is hardly free."""
    still = np.zeros_like(free)
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if test.motion_free(free + middle * (met - free), still, more=HARDLY):
            low = middle
        else:
            high = middle
    return free + low * (met - free)


def hardly_free(robot, test, itself, rng, n):
    """Return n configurations (n, dof) that are free by HARDLY."""
    found = []
    while len(found) < n:
        a, b = rng.uniform(robot.lower, robot.upper, (2, robot.dof))
        still = np.zeros_like(a)
        if not test.motion_free(a, still, more=0.01):
            continue
        met = not configuration_free(robot, b)[0]
        if test.motion_free(b, still, more=HARDLY) or met != itself:
            continue
        q = last_free(test, a, b)
        if configuration_free(robot, q, 2e-3)[0] != itself:
            found.append(q)
    return np.array(found)


@pytest.mark.parametrize("itself", [True, False])
def test_whoever_is_hardly_free_may_leave(panda, rng, itself):
    """Half of all motions lead away; nearly all that are free there are proved."""
    scenery = NOTHING if itself else FLOOR
    test, coarse = (
        StaticTest(panda, scenery, SETTINGS, threads=1, finest=finest)
        for finest in (FINEST, TOLERANCE)
    )
    away = proved = before = wrong = 0
    for q in hardly_free(panda, test, itself, rng, 12):
        assert test.motion_free(q, np.zeros_like(q))
        for _ in range(25):
            dq = rng.normal(size=panda.dof)
            dq *= rng.uniform(0.05, 0.4) / np.linalg.norm(dq)
            places = q + TIMES[:, None] * dq
            free = test.motions_free(places, np.zeros_like(places)).all()
            away += bool(free)
            proved += test.motion_free(q, dq)
            before += coarse.motion_free(q, dq)
            wrong += test.motion_free(q, dq) and not free
            # from the other end it is the same motion
            assert test.motion_free(q + dq, -dq) == test.motion_free(q, dq)
    assert wrong == 0 and away > 60
    assert proved > 0.85 * away
    assert before < 0.5 * proved
