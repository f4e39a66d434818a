"""A recorded hand-over is read as it was, and our quality is judged by it."""

import json

import numpy as np
import pytest
from command_line import one_sentence
from handover_files import OBJECT, RELEASED, TAKEN, two_people, write_handover

from roadmap.errors import BadInput
from sim.bench.command import markdown_of
from sim.bench.handover import handover_recording as bench
from sim.bench.handover.recorded_handover import read_handover


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_handover(tmp_path_factory.mktemp("shared") / "cup", "missing")


@pytest.fixture(scope="module")
def recording(folder):
    return read_handover(folder)


def test_people_come_back_as_they_were(recording):
    for who, pair in zip(("giver", "taker"), two_people(), strict=True):
        for frame, real in zip((0, TAKEN), pair, strict=True):
            found = recording.person(who, frame)
            off = found.T_world_hand("right")[:3, 3] - real.T_world_hand("right")[:3, 3]
            # the hand is taken to be in line with the forearm
            assert np.linalg.norm(off) < (0.02 if frame == 0 else 0.15)
            for side in ("left", "right"):
                np.testing.assert_allclose(
                    found.T_world_shoulder(side)[:3, 3],
                    real.T_world_shoulder(side)[:3, 3],
                    atol=1e-6,
                )


def test_a_missing_wrist_follows_from_the_forearm(recording, tmp_path):
    whole = read_handover(write_handover(tmp_path / "whole"))
    for who in ("giver", "taker"):
        for frame in (0, 7, TAKEN):
            np.testing.assert_allclose(
                recording.wrist(who, "right", frame),
                whole.wrist(who, "right", frame),
                atol=1e-6,
            )


def test_a_hand_copied_from_the_other_one_is_left_out_and_told(tmp_path, recording):
    copied = read_handover(write_handover(tmp_path / "copied", "copied"))
    assert len(copied.notes) == 2 and "giver RHand" in copied.notes[0]
    np.testing.assert_allclose(
        copied.wrist("taker", "right", TAKEN),
        recording.wrist("taker", "right", TAKEN),
        atol=1e-9,
    )


def test_grip_forces_tell_when_it_changes_hands(recording):
    assert (recording.taken, recording.released) == (TAKEN, RELEASED)
    assert recording.hand("giver") == recording.hand("taker") == "right"


def test_people_look_where_their_heads_point(recording):
    np.testing.assert_allclose(recording.gaze("giver", 3), [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(recording.gaze("taker", 3), [-1, 0, 0], atol=1e-6)


def test_the_percentile_counts_the_places_that_are_worse(recording):
    found = bench.judged(recording, "body", 0.08, 72)
    values = found.quality.best["online"]
    worse = sum(v < values[-1] for v in values[:-1])
    same = sum(v == values[-1] for v in values[:-1])
    share = 100 * (worse + 0.5 * same) / len(found.places)
    assert found.percentile("online") == pytest.approx(share)
    best = max(range(len(found.places)), key=lambda i: values[i])
    off = 100 * np.linalg.norm(found.places[best] - OBJECT)
    assert found.off_cm("online") == pytest.approx(off)


def test_every_place_is_reached_by_both(recording):
    from handover.meet.places import qualities_at

    found = bench.judged(recording, "body", 0.08, 72)
    grips = [p.T_world_hand("right")[:3, 3] for p in _gripping(recording)]
    for person, grip in zip((found.giver, found.taker), grips, strict=True):
        at = found.places + (grip - OBJECT)
        assert (qualities_at(person, "right", at, rotations=72).reached > 0).all()
    assert found.reaches == (True, True) and found.missing_m == 0.0


def _gripping(recording):
    return [recording.person(who, TAKEN) for who in ("giver", "taker")]


def test_with_the_arm_already_there_the_way_is_none(recording):
    """The 'after' moment is no prediction: its spatial part is perfect at the place."""
    after = bench.judged(recording, "after", 0.08, 72)
    body = bench.judged(recording, "body", 0.08, 72)
    assert after.quality.best["spatial"][-1] == pytest.approx(1.0)
    assert after.percentile("spatial") == 100.0
    assert body.quality.best["spatial"][-1] < 0.8


def test_the_bench_tells_and_draws(odm, folder, tmp_path):
    file, picture = tmp_path / "b.json", tmp_path / "b.png"
    words = ("bench", "handover-recording", "--file", folder, "--short")
    code, out, _ = odm(*words, "--json", file, "--plot", picture)
    result = json.loads(file.read_text())
    assert code == 0 and picture.read_bytes().startswith(b"\x89PNG")
    rows = {row["name"]: row for row in result["rows"]}
    for quality in ("q_total", "q_online"):
        share = rows[f"cup: percentile of the real place, {quality}"]
        assert 0.0 <= share["value"] <= 100.0 and share["met"] is None  # it is short
        off = rows[f"cup: our best from the real place, {quality}"]
        assert off["asked"] == {"most": 15} and off["met"] is None
    moments = result["recordings"][0]["moments"]
    assert set(moments) == {"body", "before", "after"}
    assert moments["body"]["by"]["total"]["off_cm"] is not None
    assert "| joint |" in markdown_of(result)


def test_a_place_out_of_reach_is_no_number(tmp_path):
    """A taker who steps up by a metre: at first nobody reaches, and it is said."""
    folder = write_handover(tmp_path / "far")
    for file in folder.glob("taker_*"):
        head, *rows = file.read_text().splitlines()
        rows = [[float(v) for v in row.split(",")] for row in rows]
        moved = [
            ",".join(map(str, [row[0] + (i < TAKEN), *row[1:]]))
            for i, row in enumerate(rows)
        ]
        file.write_text("\n".join([head, *moved]) + "\n")
    recording = read_handover(folder)
    found = bench.judged(recording, "before", 0.08, 72)
    assert not found.reaches[0] and found.missing_m > 0.2
    assert np.isnan(found.percentile("total"))
    facts = bench._moment(found)
    assert facts["places"] == 0 and facts["best_m"] is None
    assert facts["by"]["total"] == {"percentile": None, "off_cm": None}


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("baton_pose_saved.csv", None, "has no baton_pose"),
        ("taker_neck_pose_saved.csv", "x,y\n1,2\n", "has no column z"),
        ("taker_neck_pose_saved.csv", "x,y,z,q0,q1,q2,q3\n1,2\n", "is cut off"),
        ("taker_neck_pose_saved.csv", "", "has no column x"),
        ("giver_hip_pose_saved.csv", "x,y,z,q0,q1,q2,q3\n" + "0,0,1,nan,0,0,1\n" * 40,
         "is cut off or holds what is no number"),
        ("giver_hip_pose_saved.csv", "x,y,z,q0,q1,q2,q3\n" + "0,0,1,0,0,0,2\n" * 40,
         "not of length 1"),
        ("giver_hip_pose_saved.csv", "x,y,z,q0,q1,q2,q3\n" + "0,0,1,0,0,0,1\n" * 39,
         "39, 40 rows"),
        ("Wrench_taker_saved.csv", "Fx,Fy,Fz\n" + "0,0,0\n" * 40, "nobody takes"),
    ],
)  # fmt: skip
def test_files_that_are_no_handover_are_refused(tmp_path, odm, name, text, said):
    folder = write_handover(tmp_path / "bad")
    if text is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(text)
    with pytest.raises(BadInput, match=said):
        read_handover(folder)
    code, _, err = odm("bench", "handover-recording", "--file", folder, "--short")
    assert code == 2 and one_sentence(err) and said in err


def test_the_bench_needs_a_folder(odm, tmp_path):
    code, _, err = odm("bench", "handover-recording")
    assert code == 2 and "needs --file" in err
    code, _, err = odm("bench", "handover-recording", "--file", tmp_path / "none")
    assert code == 2 and "is no folder" in err
