"""What is handed on is the motion: the same set-points, names and times."""

import csv
import json
import os

import numpy as np
import pytest
from moving import draw_path

import roadmap
from roadmap.errors import BadInput
from roadmap.motion.export import sample_times


@pytest.fixture
def motion(panda, rng):
    return roadmap.time_path(panda, draw_path(panda, rng, 4))


def test_a_joint_trajectory_says_the_motion_s_own_set_points(panda, motion):
    told = json.loads(json.dumps(motion.to_joint_trajectory(rate_hz=50.0)))
    assert told["joint_names"] == list(panda.joint_names)
    before = -1.0
    for point in told["points"]:
        stamp = point["time_from_start"]
        assert 0 <= stamp["nanosec"] < 10**9
        t = stamp["sec"] + 1e-9 * stamp["nanosec"]
        assert t > before
        before, at = t, motion.at(t)
        for name, row in zip(("positions", "velocities", "accelerations"), at):
            np.testing.assert_allclose(point[name], row, atol=1e-6)
    assert before == pytest.approx(motion.duration, abs=1e-9)
    assert told["points"][-1]["positions"] == motion.q_end.tolist()


def test_a_csv_holds_the_same_bits_and_the_names(panda, motion, tmp_path):
    file = motion.to_csv(tmp_path / "motion.csv", rate_hz=100.0)
    with open(file, newline="", encoding="utf-8") as opened:
        names, *rows = csv.reader(opened)
    assert names[0] == "time_s" and len(names) == 1 + 3 * panda.dof
    assert names[1 : 1 + panda.dof] == [f"q_{name}" for name in panda.joint_names]
    values = np.array(rows, float)
    expected = motion.sample(values[:, 0])
    assert values[:, 1:].tobytes() == np.concatenate(expected, axis=1).tobytes()
    assert values[-1, 0] == motion.duration
    assert os.listdir(tmp_path) == ["motion.csv"]


def test_times_are_even_and_end_at_the_end():
    assert sample_times(0.0, 100.0).tolist() == [0.0]
    assert sample_times(0.03, 100.0).tolist() == [0.0, 0.01, 0.02, 0.03]
    assert sample_times(0.025, 100.0).tolist() == [0.0, 0.01, 0.02, 0.025]


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, "fast", True])
def test_a_rate_that_is_none_is_refused(motion, rate):
    with pytest.raises(BadInput, match=r"the rate is .* Hz, but must be"):
        motion.to_joint_trajectory(rate)


def test_too_many_rows_and_a_file_that_cannot_be_written_are_refused(motion, tmp_path):
    with pytest.raises(BadInput, match="give a lower rate"):
        sample_times(100.0, 1e6)
    with pytest.raises(BadInput, match="cannot be written.*give another file"):
        motion.to_csv(tmp_path / "none" / "motion.csv")
