"""Clocks that go back, rates that are none and files that are something else."""

import numpy as np
import pytest
from command_line import one_sentence
from small import AWAY, HOME, POST, small_recipe

import odm as planning
from odm.execution.threat import ThreatSettings, Watcher
from roadmap.errors import BadInput
from sim.loop.loop import LoopSettings
from sim.loop.warmup import tiny_recipe

ARM = np.array([[0.6, 0.0, 0.0, 0.9, 0.0, 0.0, 0.05]])


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    return planning.build_map(tiny_recipe(folder), threads=1).save(folder / "sample")


@pytest.fixture(scope="module")
def arm3():
    return planning.build_map(small_recipe(), threads=1)


def answers(planner, times):
    planner.set_goals([AWAY])
    points = planning.sample_capsules(POST, 0.03)
    return [planner.step(points, q=HOME, stamp=t, now=t) for t in times]


def test_a_clock_set_back_neither_holds_the_robot_nor_changes_its_way(arm3):
    going = answers(planning.ReactivePlanner(arm3), [10.0, 10.01, 10.02])
    back = answers(planning.ReactivePlanner(arm3), [10.0, 10.01, 3.0])
    assert [a.status for a in back] == [a.status for a in going]
    assert "holding" not in [a.status for a in back]
    np.testing.assert_array_equal(back[-1].path, going[-1].path)


def test_data_of_the_future_hold_and_the_next_good_frame_goes_on(arm3):
    planner = planning.ReactivePlanner(arm3)
    planner.set_goals([AWAY])
    points = planning.sample_capsules(POST, 0.03)
    assert planner.step(points, q=HOME, stamp=5.0, now=5.0).status != "holding"
    answer = planner.step(points, q=HOME, stamp=5.0, now=4.5)  # only now went back
    assert answer.status == "holding" and "500 ms in the future" in answer.reason
    assert planner.step(points, q=HOME, stamp=4.51, now=4.51).status != "holding"


@pytest.mark.parametrize("now", [0.99, 1.0, -3.0])
def test_a_watcher_whose_clock_does_not_advance_expects_the_worst(now):
    watcher = Watcher()
    watcher.look(ARM, 1.0)
    threat = watcher.look(ARM + 0.001, now)
    assert not threat.known.any()
    grown = threat.between(0.0, 0.1)[0].capsules[:, 6] - threat.capsules[:, 6]
    assert grown == pytest.approx(0.1 * ThreatSettings().speed)
    for passed in (0.01, 0.02):
        later = watcher.look(ARM + 0.001, now + passed)
    assert later.fastest == pytest.approx(0.0)  # from here on it is followed again


@pytest.mark.parametrize("rate", [0, -100.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused_before_any_work(odm, map_dir, tmp_path, rate):
    out = tmp_path / "run.npz"
    words = ("--motion", "sweep", "--rate", rate, "--record", out)
    code, shown, err = odm("run", "--map", map_dir, *words)
    assert code == 2 and "--rate is" in err and "from 1 to 10000 Hz" in err
    assert one_sentence(err) and not shown and not out.exists()
    with pytest.raises(BadInput, match="rate_hz"):
        LoopSettings(rate_hz=rate)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("clip.txt", b"walked to the door\n", "clip.txt"),
        ("clip.bvh", b"time,right_hand_x\n0,1\n", "clip.bvh"),
        ("clip.csv", b"HIERARCHY\nROOT hips\n", "clip.csv"),
        ("clip.csv", bytes(range(256)), "clip.csv"),
        ("clip.bvh", b"", "clip.bvh"),
    ],
)
def test_a_file_of_another_format_is_one_sentence(
    odm, map_dir, tmp_path, name, content, words
):
    clip = tmp_path / name
    clip.write_bytes(content)
    code, shown, err = odm("run", "--map", map_dir, "--motion", "mocap", "--file", clip)
    assert code == 2 and words in err and "Traceback" not in err
    assert one_sentence(err) and not shown


@pytest.mark.parametrize("motion", ["hold", "backoff", "escape"])
def test_scenes_play_in_a_run(odm, map_dir, motion):
    words = ("--motion", motion, "--seconds", 0.5, "--json")
    code, shown, _ = odm("run", "--map", map_dir, *words)
    assert code == 0 and f'"motion": "{motion}"' in shown
