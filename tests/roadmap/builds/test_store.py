"""Map folders: damage is one sentence, and verified arrays are nobody else's."""

import json
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from rows import each

from roadmap.builds import store
from roadmap.builds.store import read_folder, write_folder
from roadmap.errors import BadMap

ARRAYS = {
    "counts": np.arange(40, dtype=np.int32).reshape(8, 5),
    "lengths": np.linspace(0, 1, 7),
    "none": np.zeros((0, 3)),
}
_PLACES = [None, True, -1, 1e400, "", "text", [], [[]], {}, {"a": []}]


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "map", {"kind": "test"}, ARRAYS)


def rewritten(folder, change):
    """Change the manifest and make its hash fit again."""
    file = folder / "manifest.json"
    manifest = json.loads(file.read_text())
    manifest = change(manifest) or manifest
    if isinstance(manifest, dict):
        manifest["hash"] = store._manifest_hash(manifest)
    file.write_text(json.dumps(manifest))


def test_others_may_read_a_map_where_they_may_read_what_else_is_made(folder, tmp_path):
    (tmp_path / "else").mkdir()
    assert folder.stat().st_mode == (tmp_path / "else").stat().st_mode


@pytest.mark.parametrize("verify", [True, False])
def test_arrays_come_back_read_only_and_as_they_were(folder, verify):
    _, arrays = read_folder(folder, verify)
    assert arrays.keys() == ARRAYS.keys()
    for name, array in arrays.items():
        assert array.dtype == ARRAYS[name].dtype
        np.testing.assert_array_equal(array, ARRAYS[name])
        assert not array.flags.writeable or not array.size
        assert array.flags.aligned and array.flags.c_contiguous


def test_a_verified_array_does_not_change_with_its_file(folder):
    arrays = read_folder(folder)[1]
    file = folder / "counts.npy"
    data = file.read_bytes()
    with open(file, "r+b") as stream:
        stream.write(data[:128] + bytes(len(data) - 128))
        stream.flush()
        np.testing.assert_array_equal(arrays["counts"], ARRAYS["counts"])
        stream.truncate(0)  # touched by a map of the file this ends in SIGBUS
    np.testing.assert_array_equal(arrays["counts"], ARRAYS["counts"])


def test_the_bytes_that_are_verified_are_the_bytes_that_are_used(folder, monkeypatch):
    """Between the digest and the use nobody comes in: the file is read once."""
    file, plain = folder / "counts.npy", store.hashlib.sha256
    data = file.read_bytes()

    def exchanged(content=b"", **more):
        found = plain(content, **more)
        if len(content) == len(data):
            file.write_bytes(data[:128] + bytes(len(data) - 128))
        return found

    monkeypatch.setattr(store.hashlib, "sha256", exchanged)
    arrays = read_folder(folder)[1]
    monkeypatch.undo()
    np.testing.assert_array_equal(arrays["counts"], ARRAYS["counts"])
    with pytest.raises(BadMap, match="altered"):
        read_folder(folder)


def test_a_folder_that_is_replaced_leaves_mapped_arrays_as_they_were(folder):
    arrays = read_folder(folder, verify=False)[1]
    write_folder(folder, {"kind": "test"}, {"counts": np.zeros((8, 5), np.int32)})
    np.testing.assert_array_equal(arrays["counts"], ARRAYS["counts"])


@pytest.mark.parametrize("verify", [True, False])
def test_damaged_headers_are_refused_in_one_sentence_or_read_as_they_were(
    folder, verify
):
    rng, file = np.random.default_rng(14), folder / "counts.npy"
    whole = file.read_bytes()
    refused = 0
    for _ in range(600):
        data = bytearray(whole)
        for at in rng.integers(0, 128, rng.integers(1, 6)):
            data[at] = rng.integers(256)
        file.write_bytes(data)
        try:
            array = read_folder(folder, verify)[1]["counts"]
        except BadMap as error:
            refused += 1
            assert "counts" in str(error) and "build the map again" in str(error)
            assert "\n" not in str(error)
        else:  # a blank that became another one
            np.testing.assert_array_equal(array, ARRAYS["counts"])
    assert refused > 400


@each(
    "header",
    [
        b"{'descr': '<i4', 'fortran_order': False, 'shape': (8, 5), }",
        b"{'descr': '<i4', 'fortran_order': True, 'shape': (8, 5), }",
        b"{'descr': '<i4', 'fortran_order': False, 'shape': (1 << 62, 5), }",
        b"{'descr': '<i4', 'fortran_order': False, 'shape': (8, 5)",
        b"{'descr': '|O', 'fortran_order': False, 'shape': (8, 5), }",
        b"{'descr': [('a', '<i4')], 'fortran_order': False, 'shape': (8, 5), }",
        b"'''",
        b"(" * 90,
        b"\xff" * 60,
        b"",
    ],
)
@each("version", [b"\x01\x00", b"\x02\x00", b"\x09\x07"])
def test_headers_that_numpy_cannot_read_are_refused(tmp_path, header, version):
    folder = write_folder(tmp_path / "map", {"kind": "test"}, ARRAYS)
    file = folder / "counts.npy"
    whole = file.read_bytes()
    told = header.ljust(117) + b"\n"
    file.write_bytes(b"\x93NUMPY" + version + whole[8:10] + told + whole[128:])
    good = version == b"\x01\x00" and header.endswith(b"(8, 5), }")
    if good and b"False" in header and b"<i4'," in header:
        read_folder(folder, verify=False)
        return
    with pytest.raises(BadMap, match="build the map again"):
        read_folder(folder, verify=False)


@each("wrong", _PLACES)
@each("key", ["arrays", "dtype", "shape", "sha256", "format"])
def test_fields_of_a_wrong_type_are_refused(tmp_path, key, wrong):
    folder = write_folder(tmp_path / "map", {"kind": "test"}, ARRAYS)

    def change(manifest):
        if key in manifest:
            manifest[key] = wrong
        else:
            manifest["arrays"]["counts"][key] = wrong

    rewritten(folder, change)
    if key == "arrays" and wrong == {}:
        assert read_folder(folder)[1] == {}
        return
    with pytest.raises(BadMap, match="map"):
        read_folder(folder)


@each(
    "text", ["", "[]", "3", "null", '"x"', "[" * 100_000, "{" * 500, '{"format": NaN}']
)
def test_a_manifest_that_is_none_is_refused(folder, text):
    (folder / "manifest.json").write_text(text)
    with pytest.raises(BadMap, match="map"):
        read_folder(folder)
    (folder / "manifest.json").write_bytes(b"\xff\xfe" + text.encode())
    with pytest.raises(BadMap, match="map"):
        read_folder(folder)


def test_an_array_elsewhere_is_not_read(folder):
    def change(manifest):
        manifest["arrays"]["../secret"] = manifest["arrays"]["counts"]

    rewritten(folder, change)
    os.link(folder / "counts.npy", folder.parent / "secret.npy")
    with pytest.raises(BadMap, match="no map holds"):
        read_folder(folder)


def test_a_loaded_map_survives_its_files(small_map, tmp_path):
    """712 invalid edges became none, or the process ended with SIGBUS."""
    folder = small_map.save(tmp_path / "map")
    program = f"""
        import pathlib
        import numpy as np
        import odm
        planner = odm.ReactivePlanner(odm.load_map({str(folder)!r}))
        ball = odm.sample_capsules(np.array([[.3, 0, .4, .3, 0, .4, .2]]), 0.03)
        planner.step(ball, q=np.zeros(3))
        edges = len(planner.invalid_edges())
        for file in pathlib.Path({str(folder)!r}).glob("*.npy"):
            with open(file, "r+b") as stream:
                stream.truncate(64)
        planner.direct.clear()
        print(edges, len(planner.invalid_edges()))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    before, after = done.stdout.split()
    assert before == after != "0"


@pytest.mark.parametrize(
    "given, told",
    [
        ("map/manifest.json", "a file of a map; give the map, its folder"),
        ("map/counts.npy", "a file of a map; give the map, its folder"),
        (".", "holds no map itself but map; give one of these"),
        ("note.txt", "is a file and holds no map"),
        ("nowhere", "odm build RECIPE"),
    ],
)
def test_what_lies_where_no_map_does_is_told(folder, given, told):
    folder.with_name("note.txt").touch()
    with pytest.raises(BadMap, match=told):
        read_folder(folder.parent / given)
