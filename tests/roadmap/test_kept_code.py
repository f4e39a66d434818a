"""Code that numba keeps is loaded ahead, for all types that it was compiled for."""

from pathlib import Path

from odm.cell_map import _packed
from roadmap.kept_code import KeptTypes, load_kept


def test_what_is_kept_of_a_loop_is_loaded_without_a_call(small_map):
    assert small_map.arm_cells.by_block  # it was called, or its code lies on disk
    loop = _packed.transpose_packed
    kept = KeptTypes(loop).on(loop.targetctx.codegen().magic_tuple())
    assert kept
    hits = sum(loop.stats.cache_hits.values())
    loop.overloads.clear()
    assert load_kept([loop]) == len(kept) == len(loop.overloads)
    assert sum(loop.stats.cache_hits.values()) == hits + len(kept)


def test_what_cannot_be_loaded_is_left_to_the_first_call():
    assert load_kept([Path]) == 0
