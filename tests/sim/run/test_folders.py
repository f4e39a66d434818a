"""A folder's manifest says what it holds: what is found, and what is replaced."""

import json

import pytest

from roadmap.errors import BuildRefused
from sim.run import folders


def kept(folder, **manifest):
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def test_a_map_is_found_by_its_hash_whatever_its_folder_is_called(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(folders, "MAPS", tmp_path)
    kept(tmp_path / "arm", hash="one")
    other = kept(tmp_path / "elsewhere", hash="two")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "manifest.json").write_text("{")
    assert folders.folder_of_map("arm", "two") == other
    assert folders.folder_of_map("arm", "three") is None


def test_only_a_folder_of_the_kind_is_replaced(tmp_path):
    same = kept(tmp_path / "same", kind="reach map")
    folders.check_kind_of(same, "reach map")
    folders.check_kind_of(tmp_path / "not there", "reach map")
    with pytest.raises(BuildRefused, match="holds no grasp set, so it is left alone"):
        folders.check_kind_of(same, "grasp set")
    with pytest.raises(BuildRefused, match="holds no reach map"):
        folders.check_kind_of(tmp_path, "reach map")
