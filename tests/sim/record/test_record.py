"""A recorded run, run again: the same bytes, whatever moved the person."""

from dataclasses import replace

import numpy as np
import pytest
from forms import some
from mocap_files import person, write_csv
from recorded import crane_recipe, new_loop, recorded, same_bytes, with_array

import odm
from odm import build_map, load_map
from sim.keyboard.control import KeyEvent
from sim.keyboard.key_motion import KeyboardArm
from sim.loop.loop import LoopSettings, run_frames
from sim.loop.run_result import STATUS
from sim.people.mocap import MocapSettings, load_mocap
from sim.record import (
    Recorder,
    first_difference,
    read_record,
    recording,
    run_again,
    write_record,
)
from sim.record.record_check import BadRecord
from sim.record.recorder import Column


@pytest.fixture(scope="module")
def cell_map(crane_urdf, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map") / "crane"
    return load_map(build_map(crane_recipe(crane_urdf), threads=1).save(folder))


@pytest.fixture(scope="module")
def sweep(cell_map):
    """Return the recording of an arm that sweeps through the crane's work place."""
    return recorded(new_loop(cell_map, duration_s=6.0), cell_map)


def assert_the_same_again(record, cell_map, folder):
    """Read it back, run it again and write that: no byte differs."""
    path = write_record(record, folder / "run.npz")
    again = run_again(read_record(path), cell_map)
    assert first_difference(record, again) is None
    assert write_record(again, folder / "again.npz").read_bytes() == path.read_bytes()
    return again


@pytest.mark.parametrize("execution", ["kinematic", "timed"])
@pytest.mark.parametrize(
    "motion", some(["sweep", "reach", "hover", "intrusion", None], 0, 3, 4)
)
def test_a_run_and_its_replay_are_the_same_bytes(motion, execution, cell_map, tmp_path):
    loop = new_loop(cell_map, motion, execution=execution, duration_s=2.0)
    record = recorded(loop, cell_map)
    assert bool(record.holds) == (motion == "sweep")  # at 0.9 s
    assert np.isfinite(record.arrays["separation"]).all() == (motion is not None)
    assert_the_same_again(record, cell_map, tmp_path)


def test_a_recording_knows_what_the_run_told(cell_map, tmp_path):
    loop = new_loop(cell_map, seed=3, keep_paths=7)
    with recording(tmp_path / "run.npz", loop, cell_map) as recorder:
        result = run_frames(loop, recorder.add)
    record = read_record(tmp_path / "run.npz")
    told = record.result().to_json(timing=False)
    assert told == result.to_json(timing=False)
    assert record.head["outcome"]["trajectory_sha256"] == result.fingerprint()
    assert LoopSettings(**record.head["settings"]) == loop.settings
    assert record.head["map"]["hash"] == cell_map.hash
    assert record.head["map"]["recipe"] == cell_map.recipe.for_map()
    assert record.head["versions"]["numpy"] == np.__version__
    again = run_again(record, cell_map)
    assert again.result().to_json(timing=False) == told


def test_to_record_changes_nothing(cell_map, sweep):
    result = run_frames(new_loop(cell_map, duration_s=3.0))
    np.testing.assert_array_equal(np.array(result.q), sweep.arrays["q"][:300])


def test_every_hold_is_in_it_with_its_reason(cell_map, sweep):
    held = sweep.arrays["status"] == STATUS.index("holding")
    covered = np.zeros(sweep.frames, bool)
    for hold in sweep.holds:
        first, end = (round(hold[k] * sweep.rate_hz) for k in ("start_s", "end_s"))
        covered[first:end] = True
        assert len(hold["reason"]) > 20 and "ask for the reason" not in hold["reason"]
        for time, reason in hold["later"]:
            assert hold["start_s"] < time < hold["end_s"] and reason != hold["reason"]
    assert len(sweep.holds) >= 1
    np.testing.assert_array_equal(covered, held)


def test_a_long_hold_is_asked_again_for_its_reason(cell_map):
    loop = new_loop(cell_map, duration_s=2.0)
    reasons = ["a 1 cm", "a 2 cm", "b 3 cm", "b 4 cm"]
    loop.planner = loop.executor.planner = _Holding(loop.planner, reasons)
    record = recorded(loop, cell_map)
    (hold,) = record.holds
    assert hold["reason"] == "a 1 cm" and hold["later"] == [[1.0, "b 3 cm"]]


class _Holding:
    """Holds for ever; its reason is another one every half second."""

    def __init__(self, planner, reasons):
        self.settings, self.always_replan = planner.settings, False
        self.scene = planner.scene
        self.reasons, self.frames = reasons, 0

    def step(self, points, q, **options):
        self.frames += 1
        reason = self.reasons[(self.frames - 1) // 50]
        return _Answer(reason, q)

    def separation(self, q):
        return 0.0


class _Answer:
    status, retreat, latency_s = "holding", None, {}

    def __init__(self, reason, q):
        self.reason, self.path = reason, q[:0]


def test_braking_is_in_it_with_its_reason(cell_map):
    loop = new_loop(cell_map, "intrusion", execution="timed", duration_s=2.0)
    record = recorded(loop, cell_map)
    assert record.slow
    for stretch in record.slow:
        assert stretch["pace"] in ("slowed", "braked") and stretch["reason"]
        assert stretch["start_s"] < stretch["end_s"]


def test_a_person_moved_by_keys_is_played_without_the_keys(cell_map, tmp_path):
    events = [KeyEvent(0.1 * k, key) for k, key in enumerate(["up"] * 9 + ["w"] * 6)]
    by_keys = new_loop(cell_map, KeyboardArm(events=events), duration_s=2.0)
    record = recorded(by_keys, cell_map)
    still = recorded(new_loop(cell_map, KeyboardArm(), duration_s=2.0), cell_map)
    assert first_difference(record, still) is not None
    again = assert_the_same_again(record, cell_map, tmp_path)
    assert again.head["motion"]["name"] == "keyboard"


@pytest.mark.parametrize("execution", ["kinematic", "timed"])
def test_what_is_seen_and_what_is_guessed_are_both_kept(execution, cell_map, tmp_path):
    joints = person()
    joints["right_hand"][100:180] = np.nan
    clip = write_csv(tmp_path / "clip.csv", joints)
    motion = load_mocap(clip, settings=MocapSettings(stand=(0.9, 0.0, np.pi)))
    loop = new_loop(cell_map, motion, execution=execution, duration_s=2.0)
    record = recorded(loop, cell_map)
    assert (record.arrays["guess"][:90] == record.arrays["capsules"][:90]).all()
    assert (record.arrays["guess"] != record.arrays["capsules"]).any()
    assert_the_same_again(record, cell_map, tmp_path)
    plain = replace(record, arrays=dict(record.arrays))
    del plain.arrays["guess"]
    found = first_difference(record, run_again(plain, cell_map))
    assert found is not None and found.names == ("separation",)


class _Crowd:
    """People who come and go: another number of capsules in every frame."""

    name, max_speed = "crowd", 1.0

    def capsules(self, t):
        arm = np.array([0.55, 0.1, 0.5, 0.9, 0.1, 0.6, 0.05])
        return arm + 0.01 * np.arange(round(100 * t) % 4)[:, None]


@pytest.mark.parametrize("execution", ["kinematic", "timed"])
def test_people_may_come_and_go(execution, cell_map, tmp_path):
    loop = new_loop(cell_map, _Crowd(), execution=execution, duration_s=1.0)
    record = recorded(loop, cell_map)
    counts = np.diff(record.arrays["capsules_at"])
    np.testing.assert_array_equal(counts, np.arange(100) % 4)
    np.testing.assert_array_equal(record.person("capsules", 6), _Crowd().capsules(0.06))
    assert_the_same_again(record, cell_map, tmp_path)


class _Floats:
    """Somebody whose numbers are all numpy's, of 32 bits."""

    name, max_speed = "floats", np.float32(1.5)

    def capsules(self, t):
        return np.array([[0.55, 0.1, 0.5, 0.9, 0.1, 0.6, 0.05]], np.float32)


def test_numbers_of_numpys_are_recorded(cell_map, tmp_path):
    """They ended a recording when it was written: the whole run was lost."""
    settings = {
        "rate_hz": np.float32(100.0),
        "duration_s": np.float32(0.5),
        "seed": np.int64(3),
        "yields": np.bool_(True),
    }
    loop = new_loop(cell_map, _Floats(), **settings)
    assert type(loop.settings.seed) is int and type(loop.settings.yields) is bool
    record = assert_the_same_again(recorded(loop, cell_map), cell_map, tmp_path)
    assert record.head["settings"]["seed"] == 3
    assert record.head["motion"]["max_speed"] == 1.5


def test_the_first_frame_that_differs_is_named_and_what(cell_map, sweep):
    q, status = sweep.arrays["q"].copy(), sweep.arrays["status"].copy()
    q[123, 1] += 1e-15
    status[200] = 1 - status[200]
    found = first_difference(with_array(sweep, q=q, status=status), sweep)
    assert (found.frame, found.names) == (123, ("q",))
    assert "frame 123 (1.230 s)" in found.sentence and "joint luff" in found.sentence
    found = first_difference(with_array(sweep, status=status), sweep)
    assert found.frame == 200 and "status was" in found.sentence
    head = sweep.head | {"outcome": sweep.head["outcome"] | {"trips": 99}}
    found = first_difference(replace(sweep, head=head), sweep)
    assert found.frame is None and "trips was 99" in found.sentence


def test_another_person_is_another_run(cell_map, sweep):
    capsules = sweep.arrays["capsules"].copy()
    capsules[50:, :, [0, 3]] += 0.02
    again = run_again(with_array(sweep, capsules=capsules), cell_map)
    assert first_difference(sweep, again).frame == 50


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_what_was_run_is_written_however_it_ends(error, cell_map, sweep, tmp_path):
    loop = new_loop(cell_map, duration_s=6.0)

    def stop(frame):
        recorder.add(frame)
        if frame.index == 249:
            raise error

    with (
        pytest.raises(error),
        recording(tmp_path / "run.npz", loop, cell_map) as recorder,
    ):
        run_frames(loop, stop)
    record = read_record(tmp_path / "run.npz")
    assert record.frames == 250
    np.testing.assert_array_equal(record.arrays["q"], sweep.arrays["q"][:250])
    assert_the_same_again(record, cell_map, tmp_path)


def test_a_frame_that_is_cut_off_is_left_out(cell_map, sweep, monkeypatch):
    loop = new_loop(cell_map, duration_s=6.0)
    recorder = Recorder(loop, cell_map)
    for _ in range(30):
        recorder.add(loop.frame())
    monkeypatch.setattr(recorder, "_ask", _interrupted)
    with pytest.raises(KeyboardInterrupt):
        recorder.add(loop.frame())
    record = recorder.record()
    assert record.frames == 30
    assert {len(record.arrays[n]) for n in ("q", "status", "capsules")} == {30}


def _interrupted(frame):
    raise KeyboardInterrupt


def test_a_run_that_never_began_writes_nothing(cell_map, tmp_path):
    loop = new_loop(cell_map)
    with (
        pytest.raises(KeyboardInterrupt),
        recording(tmp_path / "r.npz", loop, cell_map),
    ):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_the_bytes_do_not_depend_on_the_day(sweep, tmp_path, monkeypatch):
    path = write_record(sweep, tmp_path / "a.npz")
    before = path.read_bytes()
    monkeypatch.setattr("time.time", lambda: 2e9)
    assert write_record(sweep, path).read_bytes() == before
    assert same_bytes(sweep, read_record(path), tmp_path)


def test_columns_keep_their_values_over_many_blocks():
    rng = np.random.default_rng(1)
    values = [rng.normal(size=(2 + (i > 600) * (i % 2), 7)) for i in range(1500)]
    column = Column(float)
    for value in values:
        column.add(value)
    rows, offsets = column.shapes(1400, 7)
    assert len(offsets) == 1401 and len(rows) == offsets[-1]
    for i in (0, 511, 512, 600, 601, 602, 1399):
        np.testing.assert_array_equal(rows[offsets[i] : offsets[i + 1]], values[i])
    rows, offsets = column.shapes(600, 7)
    assert offsets is None and rows.shape == (600, 2, 7)


def test_what_stood_around_is_recorded_and_heeded_again(cell_map, sweep, tmp_path):
    loop = new_loop(cell_map, duration_s=2.0)
    pose = np.eye(4)
    pose[:3, 3] = 0.0, 0.0, 1.9
    scene = loop.planner.scene
    scene.add("lamp", [odm.Sphere(0.05), odm.Cylinder(0.02, 0.3)], pose)
    wedge = np.vstack([0.1 * np.eye(3), np.zeros(3)])
    faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
    scene.add("wedge", odm.Mesh(wedge, faces), pose)
    scene.test_waiting()
    record = recorded(loop, cell_map)
    assert [row["name"] for row in record.scene] == ["lamp", "wedge"]
    assert_the_same_again(record, cell_map, tmp_path)
    assert sweep.scene == [] and sweep.head["format"] < record.head["format"]
    row = record.scene[0] | {"parts": [{"kind": "Teapot"}]}
    other = replace(record, head=record.head | {"scene": [row]})
    with pytest.raises(BadRecord, match="what is no object"):
        run_again(other, cell_map)
    gone = replace(record, head={k: v for k, v in record.head.items() if k != "scene"})
    assert run_again(gone, cell_map).scene == []  # it is the record that brings it
