"""Archives from elsewhere: what they unpack to is known before it is unpacked."""

import io
import subprocess
import sys
import textwrap
import zipfile

import numpy as np
import pytest

from sim.loop.recording import BadRecording, read_recording
from sim.record import read_record
from sim.terminal.npz import MOST_BYTES, TooLarge, array_of, read_members


def npy(array):
    """Return an array as the bytes of a .npy file."""
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


def archive(path, kind=zipfile.ZIP_DEFLATED, **members):
    """Write an archive of members of any bytes."""
    with zipfile.ZipFile(path, "w", kind) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return path


@pytest.fixture
def frames(small_map, tmp_path):
    """Two recorded frames, as bytes by name."""
    rows = np.zeros((2, 1, 7))
    rows[:, :, :6], rows[:, :, 6] = [0.5, 0, 0.9, 0.5, 0, 1.2], 0.05
    return {
        "capsules": npy(rows),
        "q_start": npy(np.zeros(3)),
        "q_goal": npy(np.ones(3)),
        "rate_hz": npy(np.array(100.0)),
    }


@pytest.mark.parametrize("kind", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_sound_archives_are_read(small_map, tmp_path, frames, kind):
    path = archive(tmp_path / "run.npz", kind, **frames)
    assert read_recording(path, small_map).n_frames == 2
    np.savez_compressed(tmp_path / "other.npz", a=np.arange(5), b=np.eye(3).T)
    found = read_members(tmp_path / "other.npz")
    np.testing.assert_array_equal(array_of(found["b.npy"]), np.eye(3))
    for array in (np.asfortranarray(np.ones((2, 3))), np.zeros((0, 3)), np.array(7.0)):
        np.testing.assert_array_equal(array_of(npy(array)), array)


def test_a_small_file_that_unpacks_to_much_is_refused_before_it_is_unpacked(tmp_path):
    """0.3 MB became 0.3 GB and more: the limit stands in the sentence."""
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        with file.open("capsules.npy", "w", force_zip64=True) as stream:
            for _ in range(MOST_BYTES // (1 << 22) + 1):
                stream.write(bytes(1 << 22))
    assert path.stat().st_size < 1e6
    program = f"""
        import resource
        from pathlib import Path
        from sim.terminal.npz import TooLarge
        from sim.loop.recording import BadRecording, _load
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            _load(Path({str(path)!r}))
        except BadRecording as error:
            print(error)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True
    )
    told, grown = done.stdout.strip().split("\n")
    assert "unpacks to 273 MB, more than the 268 MB" in told
    assert int(grown) < 20_000  # kB
    with pytest.raises(BadRecording, match="cut it into shorter ones"):
        read_record(path)
    with pytest.raises(TooLarge):
        read_members(path)


def test_a_header_that_claims_any_shape_allocates_nothing():
    data = npy(np.zeros((4, 3)))
    for shape in (b"(40000000000, 3)", b"(-4, -3)", b"(4, 3, 1 ", b"(4, 4)"):
        claimed = data.replace(b"(4, 3)" + b" " * (len(shape) - 6), shape, 1)
        claimed = claimed if claimed != data else data.replace(b"(4, 3)", shape, 1)
        with pytest.raises(ValueError, match="header"):
            array_of(claimed)
    with pytest.raises(ValueError, match="header"):
        array_of(npy(np.zeros(1)).replace(b"'<f8'", b"'|O' "))


def test_damaged_headers_end_in_one_kind_of_error(rng):
    whole = npy(np.arange(12.0).reshape(4, 3))
    for _ in range(2000):
        data = bytearray(whole)
        for at in rng.integers(0, 128, rng.integers(1, 6)):
            data[at] = rng.integers(256)
        try:
            array_of(bytes(data))
        except ValueError:
            pass


def test_damaged_archives_are_refused_in_one_sentence(small_map, tmp_path, frames, rng):
    whole = archive(tmp_path / "run.npz", **frames).read_bytes()
    refused = 0
    for k in range(400):
        data = bytearray(whole)
        for at in rng.integers(0, len(whole), rng.integers(1, 4)):
            data[at] = rng.integers(256)
        path = tmp_path / "damaged.npz"
        path.write_bytes(data[: len(data) - (k % 5) * 40])
        for read in (lambda p: read_recording(p, small_map), read_record):
            try:
                read(path)
            except BadRecording as error:
                refused += 1
                assert str(error)
    assert refused > 600


@pytest.mark.parametrize("kind", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_ways_to_pack_are_refused(small_map, tmp_path, frames, kind):
    path = archive(tmp_path / "run.npz", kind, **frames)
    with pytest.raises(BadRecording, match="packed in no way numpy does"):
        read_recording(path, small_map)


@pytest.mark.parametrize("size", [50.0, 1e6, 1e200])
def test_capsules_as_large_as_houses_are_refused(small_map, tmp_path, frames, size):
    rows = np.zeros((2, 1, 7))
    rows[:, :, 3], rows[:, :, 6] = 1.0, size
    path = archive(tmp_path / "run.npz", **{**frames, "capsules": npy(rows)})
    with pytest.raises(BadRecording, match="give metres"):
        read_recording(path, small_map)
