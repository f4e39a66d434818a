"""Recorded people, who speed up by more than is assumed: do the balls hold them?"""

from pathlib import Path

import numpy as np
import pytest

from odm.execution.threat import ThreatSettings, Watcher
from sim.people.mocap import load_mocap

CLIP = Path(__file__).parents[4] / "shared/data/mocap/CMU_62_07.bvh"
PERIOD, STOP = 0.01, 8  # [s], and frames that a stop takes
YIELD_GAP = 0.005  # [m] that an evasion keeps from the links


def strays(person, lately, rise=1.5):
    """Return the share of the parts that leave their balls by more than the gap."""
    watcher, beyond = Watcher(ThreatSettings(rise=rise)), []
    frames = [person.capsules(PERIOD * k) for k in range(600)]
    for k, capsules in enumerate(frames[:-STOP]):
        threat = watcher.look(capsules, PERIOD * k)
        threat = threat.as_lately() if lately else threat
        if k < 20:
            continue
        for j in (STOP // 2, STOP):
            rows = threat.between(PERIOD * j, PERIOD * j)[0].capsules
            ends = (frames[k + j][:, :6] - rows[:, :6]).reshape(-1, 2, 3)
            grown = rows[:, 6] - capsules[:, 6]
            off = np.linalg.norm(ends, axis=2).max(axis=1) - grown
            beyond.append(off[threat.known] > YIELD_GAP)
    return np.concatenate(beyond).mean()


@pytest.mark.skipif(not CLIP.exists(), reason="the shared recordings are not here")
def test_a_recorded_person_is_held_while_a_robot_that_evades_them_stops():
    person = load_mocap(CLIP)
    assert strays(person, lately=False) > 0.05  # 4 m/s2 do not hold them
    assert strays(person, lately=True) < 0.002
    assert strays(person, lately=True, rise=1.0) > 0.005
