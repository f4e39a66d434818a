"""`odm run --plan`: to the tuple of a plan, beside its receiver, early or elsewhere."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import one_sentence
from planned import plan_by_hand
from small import AWAY, HOME

from handover.scenes.plan_file import write_plan
from odm import ReactivePlanner
from sim.loop.loop import Loop, LoopSettings, run_frames
from sim.people.receiver import PlannedReceiver


@pytest.fixture(scope="module")
def map_dir(small_map, tmp_path_factory):
    return small_map.save(tmp_path_factory.mktemp("planned") / "arm3")


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return write_plan(tmp_path_factory.mktemp("plan") / "plan.json", plan_by_hand())


def beside(small_map, seconds, **how):
    settings = LoopSettings(rate_hz=30.0, duration_s=seconds, once=True)
    person, planner = PlannedReceiver(plan_by_hand(), **how), ReactivePlanner(small_map)
    places = np.array([HOME, AWAY])
    return run_frames(Loop(planner, small_map.robot, places, person, settings))


def test_the_giver_hands_over_and_replans_when_the_receiver_comes_early(small_map):
    planned, early = beside(small_map, 4.0), beside(small_map, 7.0, early_s=5.0)
    told = planned.summary(), early.summary()
    assert [run["trips"] for run in told] == [1, 1]
    assert [run["contacts"] for run in told] == [0, 0]
    assert [run["path_changes"] for run in told] == [0, 1]
    assert early.separation.min() > 0.0
    for run in (planned, early):  # it stays where it offers the object
        assert np.abs(run.q[-1] - AWAY).max() < 1e-9
        there = np.abs(run.q - AWAY).max(axis=1) < 1e-9
        assert there[there.argmax() :].all()


def test_a_run_of_a_plan_is_recorded_and_replayed(odm, map_dir, plan, tmp_path):
    record, out = tmp_path / "run.npz", tmp_path / "run.json"
    code, _, err = odm(
        "run", "--map", map_dir, "--plan", plan, "--early", 4.5, "--elsewhere", 0.02,
        "--seconds", 2.0, "--rate", 15, "--record", record, "--json", out,
    )  # fmt: skip
    assert code == 0, err
    data = json.loads(out.read_text())
    assert data["plan"]["file"] == str(plan) and data["plan"]["early_s"] == 4.5
    assert data["plan"]["receiver_is_there_s"] == 1.5
    assert data["run"]["contacts"] == 0
    assert any("4.5 s sooner" in note for note in data["notes"])
    assert any("cm from where it was planned" in note for note in data["notes"])
    again = tmp_path / "again.json"
    code, _, err = odm("replay", record, "--map", map_dir, "--json", again)
    assert code == 0, err
    with np.load(record) as arrays:
        assert len(arrays["places"]) == 2 and np.array_equal(arrays["places"][1], AWAY)


def changed(tmp_path, **parts):
    record = plan_by_hand()
    for who, more in parts.items():
        record[who] = record[who] | more
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(record))
    return path


def test_what_is_no_plan_of_this_robot_is_refused(odm, map_dir, plan, tmp_path):
    other = changed(tmp_path, giver={"urdf": str(Path("maps/person.urdf").resolve())})
    text = tmp_path / "text.json"
    text.write_text("{]")
    figures = tmp_path / "figures.json"
    figures.write_text('{"run": 1}')
    short = tmp_path / "short.json"
    short.write_text('{"format": "odm hand-over plan", "version": 1}')
    for words, said in (
        (("--plan", other), "the map is of arm3, but the plan's giver is arm3, which"),
        (("--plan", tmp_path / "none.json"), "there is no plan"),
        (("--plan", text), "is no JSON file"),
        (("--plan", figures), "this is no odm hand-over plan"),
        (("--plan", short), "lacks 'giver'"),
        (("--early", 1.0), "--early goes with --plan JSON"),
        (("--plan", plan, "--motion", "reach"), "leave --motion"),
        (("--plan", plan, "--targets", "meet"), "leave --motion"),
        (("--plan", plan, "--elsewhere", -1.0), "elsewhere"),
    ):
        code, _, err = odm("run", "--map", map_dir, *words)
        assert code != 0 and said in err, (words, err)
        assert one_sentence(err), (words, err)
