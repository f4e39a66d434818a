"""Examples of the docs run as they stand."""

import re
from pathlib import Path

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY

import odm
from roadmap.transforms import pose_of

DOCS = Path(__file__).resolve().parents[3] / "docs"
CELL = "cell\n* post\n1\nsphere\n0.05\n0 2 0\n0 0 0 1\n0 0 0 0\n.\n"


def example(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.search(r"```python\n(.*?)```", text, re.S).group(1)


def test_the_example_of_the_scene_runs(planner, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.scene").write_text(CELL)
    planner.set_goals([AWAY])
    known = {
        "odm": odm,
        "planner": planner,
        "T_world_crate": pose_of([0.0, 0.0, 2.0], np.zeros(3)),
        "T_world_elsewhere": pose_of([0.0, 0.5, 2.0], np.zeros(3)),
        "points": NOBODY,
        "q_now": HOME,
    }
    exec(example("scene.md"), known)
    assert known["answer"].status == "replanned"
    assert list(planner.scene) == ["post"]


def test_the_example_of_two_robots_runs(planner):
    planner.set_goals([AWAY])
    robot, T = planner.robot, pose_of([0.0, 1.2, 0.0], np.zeros(3))
    known = {"planner_a": planner, "robot_b": robot, "T_a_b": T}
    exec(example("two_robots.md"), known | {"q_a": HOME, "q_b": AWAY})
    assert planner.separation(HOME) < 2.0  # an empty room has no such distance


def test_the_example_of_clouds_runs(planner, rng, capsys):
    planner.set_goals([AWAY])
    known = {
        "odm": odm,
        "planner": planner,
        "points": rng.uniform(1.5, 3.0, (20, 30, 3)),
        "T_world_camera": np.eye(4),
        "q_now": HOME,
    }
    exec(example("clouds.md"), known)
    assert known["answer"].status == "replanned"
    assert "left out: 0 NaN" in capsys.readouterr().out


class Ended(Exception):
    """The tracker has no more frames."""


class Tracker:
    """Somebody 2 m away for 30 frames, the last ten of them lost (NaN)."""

    def __init__(self):
        self.stamp, self.frame = 0.0, 0

    def latest(self):
        self.frame += 1
        self.stamp = 0.01 * self.frame
        if self.frame > 30:
            raise Ended
        rows = np.tile([2.0, 0.0, 0.5, 2.0, 0.0, 1.0, 0.1], (17, 1))
        return rows if self.frame <= 20 else rows * np.nan


class Robot:
    """Goes along each path by a twentieth of its first leg, or stops."""

    def __init__(self, q):
        self.here, self.followed, self.stopped = q, 0, 0

    def q(self):
        return self.here

    def follow(self, path):
        self.here = self.here + 0.05 * (path[1] - self.here)
        self.followed += 1

    def stop(self):
        self.stopped += 1


def test_the_loop_of_ones_own_runs(small_map):
    tracker, robot = Tracker(), Robot(HOME.copy())
    known = {"cell_map": small_map, "q_goal": AWAY, "tracker": tracker, "robot": robot}
    with pytest.raises(Ended):
        exec(example("own_loop.md"), known | {"clock": lambda: tracker.stamp + 0.002})
    assert (robot.followed, robot.stopped) == (20, 10)
    assert np.abs(robot.here - AWAY).max() < np.abs(HOME - AWAY).max()
