"""Large maps hold one view of their lists; the other is derived, and is the same."""

import json
import tempfile

import numpy as np
import pytest
from small import AWAY, HOME, POST

import odm
from odm.cell_map import lists
from odm.cell_map.lists import BLOCK_MAJOR, DerivedLists
from roadmap.errors import BadMap


@pytest.fixture
def one_view(small_map, tmp_path, monkeypatch):
    """The folder of a map that counts as large."""
    monkeypatch.setattr(lists, "BOTH_VIEWS", 0)
    return small_map.save(tmp_path / "map")


@pytest.mark.parametrize("verify", [True, False])
def test_a_map_with_one_view_answers_as_one_with_both(small_map, one_view, verify):
    held = json.loads((one_view / "manifest.json").read_text())["arrays"]
    assert not {f"arm.{name}" for name in BLOCK_MAJOR} & set(held)
    loaded = odm.load_map(one_view, verify=verify)
    assert not set(BLOCK_MAJOR) & set(vars(loaded.arm_cells)), "derived too early"
    both = small_map.arm_cells.bytes_by_view()
    assert loaded.arm_cells.bytes_by_view() == both
    for name, array in small_map.arm_cells.arrays().items():
        other = loaded.arm_cells.arrays()[name]
        assert array.dtype == other.dtype and np.array_equal(array, other), name
        assert not other.flags.writeable
    points = odm.sample_capsules(POST, 0.03)
    paths, blocked = [], []
    for cell_map in (small_map, loaded):
        planner = odm.ReactivePlanner(cell_map)
        planner.set_goals([AWAY])
        paths.append(planner.step(points, q=HOME).path)
        blocked.append(planner.invalid_edges())
    assert np.array_equal(*paths) and np.array_equal(*blocked) and len(blocked[0])


def test_a_view_too_large_for_the_memory_is_derived_into_a_file(
    small_map, one_view, tmp_path, monkeypatch
):
    monkeypatch.setattr(lists, "free_memory", lambda: 100)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cells = odm.load_map(one_view, verify=False).arm_cells
    for name in BLOCK_MAJOR:
        assert np.array_equal(getattr(cells, name), getattr(small_map.arm_cells, name))
    mapped = [a for a in (cells.t_item, cells.t_mask) if isinstance(a.base, np.memmap)]
    assert len(mapped) == 2 and not [p for p in tmp_path.iterdir() if p.is_file()]


def test_a_map_that_lacks_half_of_a_view_is_refused(small_map, one_view, monkeypatch):
    monkeypatch.setattr(
        lists.CellLists, "stored", lambda self: {"ptr": self.ptr, "block": self.block}
    )
    small_map.save(one_view)
    with pytest.raises(BadMap, match="lacks"):
        odm.load_map(one_view)


def test_derived_lists_have_no_other_names():
    cells = DerivedLists(*(np.zeros(1, np.int64) for _ in range(3)), 1)
    with pytest.raises(AttributeError):
        cells.nothing
