"""`odm run --targets meet --record`: recorded with its targets, and run again."""

from dataclasses import replace

import numpy as np
import pytest
from keyboard_pty import User
from mocap_files import person, write_csv
from recorded import tampered, with_array

from handover import load_reach_map
from handover.targets.live_targets import THERE, UNDER_WAY
from odm import build_map, load_map
from sim.record import first_difference, read_record, write_record
from sim.run.meet import reach_map_of
from sim.run.meet_record import STATES, targets_again
from sim.run.request import RunRequest
from sim.run.runner import run
from sim.view.sources import Recorded

MET = ("--targets", "meet", "--seconds", 3, "--rate", 50)


@pytest.fixture(scope="module")
def file(meet_maps, tmp_path_factory):
    """Return a recorded run of three seconds; nobody changes it."""
    record = tmp_path_factory.mktemp("met") / "run.npz"
    asked = {"targets": "meet", "reach": meet_maps[1], "json": "-", "record": record}
    asked |= {"seconds": 3.0, "rate": 50.0, "between": (0.9, 0.9), "seed": 1}
    run(RunRequest(meet_maps[0], "reach", **asked))
    return record


def replayed(odm, maps, file, *words):
    return odm("replay", file, "--map", maps[0], "--reach", maps[1], *words)


def test_the_replay_of_a_run_to_targets_is_the_same_bytes(
    odm, meet_maps, file, tmp_path
):
    again = tmp_path / "again.npz"
    code, out, err = replayed(odm, meet_maps, file, "--record", again)
    assert code == 0 and out.startswith("same: 150 frames of reach"), err
    assert again.read_bytes() == file.read_bytes()


def test_a_board_in_which_nothing_is_handed_over_is_known_to_the_replay(
    meet_maps, tmp_path
):
    bare = load_map(meet_maps[0])
    board = {"type": "box", "size": [0.3, 0.9, 0.02], "position": [0.55, 0.0, 0.35]}
    recipe = replace(bare.recipe, name="board", scenery=(board,))
    folder = build_map(recipe, threads=2).save(tmp_path / "map")
    asked = {"targets": "meet", "reach": meet_maps[1], "json": "-", "seconds": 2.0}
    asked |= {"rate": 50.0, "between": (0.9, 0.9), "record": tmp_path / "run.npz"}
    run(RunRequest(folder, "reach", **asked))
    cell_map, record = load_map(folder), read_record(tmp_path / "run.npz")
    reach = load_reach_map(meet_maps[1])
    again = targets_again(record, cell_map, reach)
    assert first_difference(record, again) is None


def test_a_recorded_person_who_is_measured_anew_is_met_again(odm, meet_maps, tmp_path):
    clip = write_csv(tmp_path / "clip.csv", person())
    record, again = tmp_path / "run.npz", tmp_path / "again.npz"
    words = ("--map", meet_maps[0], "--reach", meet_maps[1], "--motion", "mocap")
    words += ("--file", clip, "--execution", "timed", "--dwell", 0.2)
    code, _, err = odm("run", *words, *MET, "--record", record)
    assert code == 0 and "150 frames in" in err, err
    assert "person.body.height" in read_record(record).arrays
    code, _, err = replayed(odm, meet_maps, record, "--record", again)
    assert code == 0 and again.read_bytes() == record.read_bytes(), err


def test_a_recording_tells_what_became_of_the_targets(file):
    record = read_record(file)
    arrays, told = record.arrays, record.head["targets"]
    assert told["states"] == list(STATES) and told["held"]["name"]
    going = np.isin(
        arrays["targets.state"], [STATES.index(s) for s in (THERE, UNDER_WAY)]
    )
    assert going.mean() > 0.3 and (arrays["targets.quality"][going] > 0).all()
    assert (arrays["targets.best"] >= 0.99 * arrays["targets.quality"])[
        going
    ].mean() > 0.5


def test_its_page_shows_the_targets_by_quality(file):
    shown = Recorded(read_record(file))
    begin, end = shown.span()
    rows = [shown.at(t).targets for t in np.linspace(begin, end, 40)]
    rated = [r for r in rows if len(r) and np.isfinite(r[:, 3]).all()]
    assert len(rated) > 20 and max(len(r) for r in rated) > 2
    assert any(r[:, 4].sum() == 1.0 for r in rated)


def test_another_person_is_another_run(meet_maps, file):
    record, cell_map = read_record(file), load_map(meet_maps[0])
    reach = reach_map_of(cell_map.robot, meet_maps[1], lambda *progress: None)
    pelvis = record.arrays["person.pelvis"].copy()
    pelvis[:, 0, 3] += 0.1  # their capsules stay, the targets do not
    other = with_array(record, **{"person.pelvis": pelvis})
    again = targets_again(other, cell_map, reach)
    assert "targets." in first_difference(record, again).sentence


def test_what_is_told_wrong_of_the_targets_is_found(odm, meet_maps, file, tmp_path):
    def better(quality):
        quality[20] += 0.5

    path = tampered(file, tmp_path / "bad.npz", "targets.quality.npy", better)
    code, _, err = replayed(odm, meet_maps, path)
    assert code == 1 and "frame 20" in err and "targets.quality was" in err


@pytest.mark.parametrize(
    ("member", "change", "told"),
    [
        ("person.pelvis.npy", lambda a: a + 1e-9, "was altered"),
        ("person.arms.npy", lambda a: a[:-1], "a clip of 149 frames"),
        ("targets.shown_at.npy", lambda a: a[::-1].copy(), "must ascend"),
        ("person.bend.npy", lambda a: a * np.nan, "NaN"),
    ],
)
def test_a_damaged_recording_is_refused(
    member, change, told, odm, meet_maps, file, tmp_path
):
    path = tampered(file, tmp_path / "bad.npz", member, change)
    code, _, err = replayed(odm, meet_maps, path)
    assert code == 2 and told in err and err.count("odm: ") == 1


def test_another_reach_map_or_setting_is_refused(odm, meet_maps, file, tmp_path):
    record = read_record(file)
    for change, told in (
        ({"reach": "0" * 64}, "reach map 000000000000"),
        ({"live": record.head["targets"]["live"] | {"magic": 1}}, "sets magic = 1"),
    ):
        head = record.head | {"targets": record.head["targets"] | change}
        path = write_record(replace(record, head=head), tmp_path / "other.npz")
        code, _, err = replayed(odm, meet_maps, path)
        assert code == 2 and told in err


def test_who_is_moved_by_keys_is_met_again(odm, meet_maps, tmp_path):
    record, again = tmp_path / "run.npz", tmp_path / "again.npz"
    words = ("--map", meet_maps[0], "--reach", meet_maps[1], "--motion", "keyboard")
    words = ("-m", "sim", "run", "--targets", "meet", *words, "--record", record)
    with User(*words, columns=100, lines=40, warm={"exercised": True}) as user:
        user.see("0:0[1-9]")
        user.type(b"\x1b[A" * 6)
        user.look(0.3)
        user.type(b"wwww")
        user.see("0:0[3-9]")  # a second of frames and more, however long they take
        user.type(b"q")
        assert user.end() == 0 and user.restored
    arms = read_record(record).arrays["person.arms"]
    assert len(np.unique(arms[:, 1], axis=0)) > 5
    code, _, err = replayed(odm, meet_maps, record, "--record", again)
    assert code == 0 and again.read_bytes() == record.read_bytes(), err
