import re

import numpy as np
import pytest
from mocap_files import BVH_NAMES, STANDING, person, write_bvh, write_csv
from rows import each
from scipy.spatial.transform import Rotation

from sim.people.mocap import BadMocap, load_mocap, read_tracks

AXES = {"X": 0, "Y": 1, "Z": 2}


def altered(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


# Vicon .csv


def test_csv_places_come_back_and_empty_cells_are_gaps(tmp_path):
    joints = person(20)
    joints["right_hand"][5:8] = np.nan
    tracks = read_tracks(write_csv(tmp_path / "a.csv", joints))
    assert tracks.rate_hz == 100 and tracks.metres_per_unit == 1e-3
    hand = tracks.places["right_hand"]
    np.testing.assert_array_equal(np.isnan(hand[:, 0]).nonzero()[0], [5, 6, 7])
    expected = (joints["right_hand"] - [0, 0, 0.9]) * 1000
    np.testing.assert_allclose(hand, expected, atol=1e-5)
    assert "collar" in tracks.places


def test_csv_frames_left_out_are_gaps(tmp_path):
    frames = [0, 1, 2, 6, 7, 8]
    path = write_csv(tmp_path / "a.csv", person(9), frames=frames)
    hip = read_tracks(path).places["hip"]
    assert len(hip) == 9
    np.testing.assert_array_equal(np.isnan(hip[:, 0]).nonzero()[0], [3, 4, 5])


@pytest.mark.parametrize("unit, metres", [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)])
def test_csv_units_are_read(tmp_path, unit, metres):
    tracks = read_tracks(write_csv(tmp_path / "a.csv", person(5), unit=unit))
    assert tracks.metres_per_unit == metres


@pytest.mark.parametrize("mark", ["quoted", "\r", "no unit"])
def test_csv_may_be_quoted_of_an_old_mac_or_without_a_unit(tmp_path, mark):
    path = write_csv(tmp_path / "a.csv", person(60))
    plain, text = load_mocap(path), path.read_text(encoding="utf-8-sig")
    if mark == "quoted":
        text = re.sub("[^,\n]+", r'"\g<0>"', text)
    text = text.replace("\n", "\r") if mark == "\r" else text
    text = text.replace("mm", "") if mark == "no unit" else text
    path.write_bytes(text.encode())
    motion = load_mocap(path)
    np.testing.assert_array_equal(motion.frames, plain.frames)
    assert any(n.startswith("taken as mm") for n in motion.notes) == (mark == "no unit")


def test_csv_of_markers_has_three_columns_a_body(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text(
        "Trajectories\n50\n,,P:hip,,,P:head,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n"
        ",,mm,mm,mm,mm,mm,mm\n1,0,1,2,3,4,5,6\n2,0,1,2,3,,,\n\nModel Outputs\n50\n"
    )
    tracks = read_tracks(path)
    assert tracks.rate_hz == 50 and tracks.n_frames == 2
    np.testing.assert_array_equal(tracks.places["P:head"][0], [4, 5, 6])
    assert np.isnan(tracks.places["P:head"][1]).all()


def test_csv_rotations_may_be_absent_where_places_are_not(tmp_path):
    path = write_csv(tmp_path / "a.csv", person(3))
    altered(path, "1,0,0.000000,0.000000,0.000000", "1,0,,,")
    assert np.isfinite(read_tracks(path).places["hip"]).all()


@each(
    "old, new, words",
    [
        ("\n100\n", "\n0\n", "0 frames per second; a person's motion needs 10 to"),
        ("\n100\n", "\n-5\n", "-5 frames per second"),
        ("\n100\n", "\n\n", "the rate in line 2 of a.csv is '', which is no number"),
        ("\n100\n", "\nfast\n", "'fast', which is no number"),
        ("\n100\n", '\n"99,5"\n', "'99,5', which is no number; write it with a poin"),
        ("\n2,0,", "\n# note\n2,0,", "has 1 of .* cells: .* or a comment stands ther"),
        ("rad,mm", "rad,parsec", "positions in 'parsec'; write m, cm, inch"),
        ("TX,TY,TZ", "A,B,C", None),
        ("\n2,0,", "\n2,0,huh,", "line 7 of a.csv holds 'huh', which is no number"),
        ("\n3,0,", "\n1,0,", "frame '1' after 2; frame numbers must rise"),
        ("\n3,0,", "\n900000,0,", "nearly all are left out"),
        ("Objects", "Object", "a .bvh begins with HIERARCHY, a Vicon"),
    ],
)
def test_csv_with_a_wrong_value_is_refused(tmp_path, old, new, words):
    path = altered(write_csv(tmp_path / "a.csv", person(3)), old, new)
    if words is None:  # one body less
        assert len(read_tracks(path).places) == len(STANDING) - 1
        return
    with pytest.raises(BadMocap, match=words) as caught:
        read_tracks(path)
    assert "\n" not in str(caught.value)


def test_csv_cut_off_in_a_line_or_in_its_header_is_refused(tmp_path):
    path = write_csv(tmp_path / "a.csv", person(3))
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: len(text) - 120], encoding="utf-8")
    with pytest.raises(BadMocap, match="line 8 of a.csv has .* cells: the file is cut"):
        read_tracks(path)
    path.write_text("\n".join(text.split("\n")[:3]), encoding="utf-8")
    with pytest.raises(BadMocap, match="ends after line 3"):
        read_tracks(path)
    path.write_text("\n".join(text.split("\n")[:5]), encoding="utf-8")
    with pytest.raises(BadMocap, match="a header and no frames"):
        read_tracks(path)


@pytest.mark.parametrize(
    "line, written, words",
    [
        (2, "", "names no body in line 3"),
        (5, "1e300,0" + ",0" * 54, "frame '1e300' after the header; frame numbers"),
        (5, '1,0,"' + "," * 140_000, "is no .csv: field larger than field limit"),
    ],
)
def test_csv_with_a_line_of_something_else_is_refused(tmp_path, line, written, words):
    path = write_csv(tmp_path / "a.csv", person(3))
    lines = path.read_text(encoding="utf-8").split("\n")
    lines[line:] = [written, *lines[line + 1 :][: 5 - line]]
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(BadMocap, match=words):
        read_tracks(path)


def test_csv_without_positions_is_refused(tmp_path):
    path = write_csv(tmp_path / "a.csv", person(3))
    text = path.read_text(encoding="utf-8").replace("TX,TY,TZ", "A,B,C")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadMocap, match="names no body in line 3"):
        read_tracks(path)


# files that are neither


@pytest.mark.parametrize(
    "content, words",
    [
        (b"", "is empty"),
        (b" \n\n", "is empty"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x01\xff", "is not text"),
        (b"x,y\n1,2\n", "begins with 'x,y'"),
    ],
)
def test_another_format_is_refused(tmp_path, content, words):
    path = tmp_path / "clip.csv"
    path.write_bytes(content)
    with pytest.raises(BadMocap, match=words):
        read_tracks(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(BadMocap, match="there is no file .*none.bvh"):
        read_tracks(tmp_path / "none.bvh")
    with pytest.raises(BadMocap, match="is a folder"):
        read_tracks(tmp_path)


# .bvh


def random_bvh(rng, path):
    """Write a chain of random channels; return its places, by another library."""
    text, rows, expected = "", [], {}
    R, p = Rotation.identity(4), np.zeros((4, 3))
    depth = 4
    for k in range(depth):
        offset = rng.normal(size=3)
        order = "".join(rng.permutation(list("XYZ")))
        n_turns = 3 if k else int(rng.integers(1, 4))
        angles = rng.uniform(-180, 180, (4, n_turns))
        channels = [f"{a}rotation" for a in order[:n_turns]]
        columns = [*angles.T]
        local = np.tile(offset, (4, 1))
        if k != 1:  # positions of some axes, before, between or after the turns
            for axis in rng.permutation(list("XYZ"))[: rng.integers(1, 4)]:
                at = int(rng.integers(0, len(channels) + 1))
                values = rng.normal(size=4)
                channels.insert(at, f"{axis}position")
                columns.insert(at, values)
                local[:, AXES[axis]] = values
        p = p + R.apply(local) if k else local
        turn = Rotation.from_euler(order[:n_turns], angles, degrees=True)
        R = R * turn
        expected[f"J{k}"] = p
        word = "JOINT" if k else "ROOT"
        text += f"{word} J{k}\n{{\nOFFSET {' '.join(map(repr, map(float, offset)))}\n"
        text += f"CHANNELS {len(channels)} {' '.join(channels)}\n"
        rows += columns
    end = rng.normal(size=3)
    expected["J3_end"] = p + R.apply(np.tile(end, (4, 1)))
    text += f"End Site\n{{\nOFFSET {' '.join(map(repr, map(float, end)))}\n}}\n"
    data = "\n".join(" ".join(map(repr, map(float, row))) for row in np.transpose(rows))
    head = f"HIERARCHY\n{text}{'}' * depth}\nMOTION\nFrames:\t4\nFrame Time: 0.02\n"
    path.write_text(head + data)
    return expected


@each("seed", range(12))
def test_any_channel_order_poses_the_chain_like_another_library(tmp_path, seed):
    rng = np.random.default_rng(seed)
    expected = random_bvh(rng, tmp_path / "r.bvh")
    tracks = read_tracks(tmp_path / "r.bvh")
    assert tracks.rate_hz == pytest.approx(50) and set(tracks.places) == set(expected)
    for name, places in expected.items():
        np.testing.assert_allclose(tracks.places[name], places, atol=1e-9)


def test_bvh_survives_tabs_crlf_and_names_with_spaces(tmp_path):
    path = write_bvh(tmp_path / "a.bvh", person(4), rename={"rHand": "Bip01 R Hand"})
    text = path.read_text().replace("  ", "\t").replace("\n", "\r\n")
    path.write_bytes(text.encode())
    assert "Bip01 R Hand" in read_tracks(path).places


def test_bvh_of_a_person_gives_the_joints_back(tmp_path):
    joints = person(6)
    tracks = read_tracks(write_bvh(tmp_path / "a.bvh", joints, up="z"))
    for joint, name in BVH_NAMES.items():
        expected = joints[joint] * 100
        np.testing.assert_allclose(tracks.places[name], expected, atol=1e-4)


@each(
    "old, new, words",
    [
        ("Frame Time: 0.01000000", "Frame Time: 0.0", "frame time of 0 s, so no rate"),
        ("Frame Time: 0.01000000", "Frame Time: -1", "frame time of -1 s"),
        ("Frame Time: 0.01000000", "Frame Time: 10", "0.1 frames per second"),
        ("Frame Time: 0.01000000", "Frame Time: soon", "'soon', which is no number"),
        ("Frame Time: 0.01000000", "", "does not give 'frame time'"),
        ("Frames: 6", "Frames: 0", "says it holds 0 frames"),
        ("Frames: 6", "Frames: 7", "frames of 54 values, but 6 are there: .* cut off"),
        ("Frames: 6", "Frames: 5", "but 6 are there"),
        ("MOTION", "MOTIONLESS", "no line MOTION"),
        ("Xposition", "Wposition", "has a channel 'Wposition'"),
        ("CHANNELS 6", "CHANNELS 5", "announces 5 channels and lists 6"),
        ("CHANNELS 6", "CHANNELS 1 Xposition\nCHANNELS 6", "two lines CHANNELS"),
        ("OFFSET ", "OFFSET a ", "'a', which is no number"),
        ("OFFSET ", "OFFSET 1 ", "it must be three numbers"),
        ("ROOT hip", "ROOT hip\nWING", "has the line 'WING' in its skeleton"),
        ("}\nMOTION", "MOTION", "skeleton of a.bvh is not complete"),
        ("\n0.000000 ", "\nzero ", "'zero', which is no number"),
        ("\n0.000000 ", "\n1.#QNAN ", "'1.#QNAN', which is no number; write nan for"),
        ("\n0.000000 ", "\n-1.#IND ", "'-1.#IND', which is no number; write nan for"),
    ],
)
def test_bvh_with_a_wrong_value_is_refused(tmp_path, old, new, words):
    path = altered(write_bvh(tmp_path / "a.bvh", person(6)), old, new)
    with pytest.raises(BadMocap, match=words) as caught:
        read_tracks(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5, 0.9])
def test_bvh_cut_off_anywhere_is_refused(tmp_path, share):
    path = write_bvh(tmp_path / "a.bvh", person(30))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BadMocap):
        read_tracks(path)


def test_bvh_with_a_value_missing_says_how_many_are_there(tmp_path):
    path = write_bvh(tmp_path / "a.bvh", person(6))
    path.write_text(path.read_text().rstrip().rpartition(" ")[0])
    words = "6 frames of 54 values, but 5 are there and 53 values of another: the file"
    with pytest.raises(BadMocap, match=words):
        read_tracks(path)


@pytest.mark.parametrize("write", [write_csv, write_bvh])
@pytest.mark.filterwarnings("error")
def test_a_place_out_of_this_world_is_not_seen(tmp_path, write):
    joints = person(30)
    joints["right_hand"][4] = 1e290
    motion = load_mocap(write(tmp_path / "a", joints))
    assert "right hand: not seen in 1 of 30 frames" in motion.notes


def test_one_frame_is_no_motion(tmp_path):
    with pytest.raises(BadMocap, match="holds 1 frames; a motion needs 2"):
        read_tracks(write_bvh(tmp_path / "a.bvh", person(1)))


@pytest.mark.parametrize("mark", [";", "\t"])
def test_columns_separated_by_something_else_are_refused_as_that(tmp_path, mark):
    path = write_csv(tmp_path / "a.csv", person(10))
    path.write_text(path.read_text().replace(",", mark))
    with pytest.raises(BadMocap, match="not separated by commas"):
        read_tracks(path)
