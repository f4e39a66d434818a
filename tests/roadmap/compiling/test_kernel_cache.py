"""Compiled loops are dropped when any text they were compiled from has changed."""

import os
from pathlib import Path

import pytest
from numba import config
from numba.core import caching

from roadmap.compiling.kernel_cache import Sources, check_kept, drop_stale_code, kept_in
from roadmap.errors import PlanningError

ROOT = Path(__file__).resolve().parents[3]
KERNEL = (
    "from numba import njit\n{imports}\n\n@njit(cache=True)\ndef {name}(x):\n    ...\n"
)


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


@pytest.fixture(autouse=True)
def nowhere_else(tmp_path, monkeypatch):
    """Let there be no machine code but beside the sources."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))


@pytest.fixture
def tree(tmp_path):
    """Three packages: `above` calls `middle`, which reads a constant; `apart` none."""
    write(tmp_path / "roadmap/deep/limits.py", "MOST = 3\n")
    middle = "from roadmap.deep.limits import (\n    MOST,\n)"
    write(
        tmp_path / "odm/inner/_middle.py", KERNEL.format(imports=middle, name="middle")
    )
    above = "from odm.inner import _middle as kernels"
    write(tmp_path / "sim/new/_above.py", KERNEL.format(imports=above, name="above"))
    write(tmp_path / "handover/_apart.py", KERNEL.format(imports="", name="apart"))
    write(tmp_path / "handover/plain.py", "SIZE = 1\n")
    drop_stale_code(tmp_path)
    for file in Sources(tmp_path).compiled():
        for end in ("nbi", "1.nbc"):
            name = f"{file.stem}.{file.stem[1:]}-4.py311.{end}"
            write(file.parent / "__pycache__" / name, "machine code")
    return tmp_path


def compiled(tree):
    return {p.name.partition(".")[0] for p in tree.rglob("*.nb[ic]")}


def test_nothing_is_dropped_while_nothing_changes(tree):
    assert drop_stale_code(tree) == []
    assert compiled(tree) == {"_middle", "_above", "_apart"}


def test_a_changed_constant_drops_all_that_was_compiled_with_it(tree):
    write(tree / "roadmap/deep/limits.py", "MOST = 4\n")
    dropped = {file.stem for file in drop_stale_code(tree)}
    assert dropped == {"_middle", "_above"}
    assert compiled(tree) == {"_apart"}
    assert drop_stale_code(tree) == []


def test_a_file_without_loops_drops_nothing(tree):
    write(tree / "handover/plain.py", "SIZE = 2\n")
    assert drop_stale_code(tree) == []
    assert compiled(tree) == {"_middle", "_above", "_apart"}


def test_code_of_a_file_that_is_gone_goes_with_the_next_change(tree):
    (tree / "handover/_apart.py").rename(tree / "handover/_moved.py")
    drop_stale_code(tree)
    assert compiled(tree) == {"_middle", "_above"}


def test_a_damaged_stamp_drops_everything_beside_it(tree):
    write(tree / "sim/new/__pycache__/kernels.json", "[1, 2")
    assert [file.stem for file in drop_stale_code(tree)] == ["_above"]
    assert compiled(tree) == {"_middle", "_apart"}


def test_a_new_folder_is_protected_as_soon_as_it_has_a_loop(tree):
    text = KERNEL.format(imports="from odm.inner._middle import middle", name="new")
    write(tree / "handover/later/_new.py", text)
    assert [file.stem for file in drop_stale_code(tree)] == ["_new"]
    write(tree / "handover/later/__pycache__/_new.new-4.py311.nbi", "machine code")
    write(tree / "roadmap/deep/limits.py", "MOST = 5\n")
    assert {f.stem for f in drop_stale_code(tree)} == {"_middle", "_above", "_new"}
    assert compiled(tree) == {"_apart"}


@pytest.mark.parametrize("whose", ["told", "user's"])
def test_code_that_is_kept_elsewhere_is_dropped_too(tree, tmp_path, monkeypatch, whose):
    if whose == "told":
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    else:  # the sources belong to somebody else
        monkeypatch.setattr(os, "access", lambda *_: False)
    drop_stale_code(tree)
    for folder, loop in (("odm/inner", "_middle"), ("handover", "_apart")):
        place = kept_in(tree / folder)[-1]
        assert not place.is_relative_to(tree / folder)
        write(place / f"{loop}.one-4.py311.nbi", "machine code")
        (tree / folder / "__pycache__" / f"{loop}.{loop[1:]}-4.py311.nbi").unlink()
    assert drop_stale_code(tree) == []
    write(tree / "roadmap/deep/limits.py", "MOST = 4\n")
    assert {file.stem for file in drop_stale_code(tree)} == {"_middle", "_above"}
    left = {p.name for p in tmp_path.rglob("*.nbi")}
    assert "_middle.one-4.py311.nbi" not in left and "_apart.one-4.py311.nbi" in left


def test_numba_looks_in_these_places(tree, tmp_path, monkeypatch):
    file = tree / "odm/inner/_middle.py"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(os, "access", lambda *_: False)
    kinds = "InTreeCacheLocator", "UserProvidedCacheLocator", "UserWideCacheLocator"
    found = []
    for name in kinds:  # older numbas hide them
        kind = getattr(caching, name, None) or getattr(caching, f"_{name}")
        found.append(kind(nothing, str(file)).get_cache_path())
    assert [str(place) for place in kept_in(file.parent)] == found


def test_who_can_keep_compiled_loops_nowhere_is_told_what_to_do(
    tree, tmp_path, monkeypatch
):
    monkeypatch.setattr(os, "access", lambda path, mode: "writable" in str(path))
    with pytest.raises(PlanningError, match="set NUMBA_CACHE_DIR"):
        check_kept(tree / "odm/inner")
    (tmp_path / "writable").mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "writable" / "new"))
    check_kept(tree / "odm/inner")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "writable"))
    check_kept(tree / "odm/inner")


def nothing():
    """Stand for a loop."""


def test_every_loop_of_this_project_is_found_with_what_it_calls():
    sources = Sources(ROOT)
    found = {str(f.relative_to(ROOT)) for f in sources.compiled()}
    marked = {
        str(f.relative_to(ROOT))
        for package in ("roadmap", "odm", "handover", "sim")
        for f in (ROOT / package).rglob("*.py")
        if "@njit" in f.read_text(encoding="utf-8")
    }
    assert len(marked) > 40
    assert found >= marked
    called = sources.imported("odm/close_test/_close.py")
    assert "roadmap/kinematics/_forward.py" in called
