"""Packed lists hold the same cells, in few bytes; maps from before still load."""

import tempfile
from dataclasses import replace

import numpy as np
import pytest
from small import AWAY, HOME, POST
from wrappers import with_wrapper

import odm
from odm.cell_map import _packed as kernels
from odm.cell_map import lists
from odm.cell_map.lists import CellLists, cells_of_item, packed_lists
from roadmap.builds.store import read_folder, write_folder
from roadmap.errors import BadMap, BuildRefused

packed_hit = with_wrapper(kernels.packed_hit)
RIGHT = np.uint64(0xFFFFFFFF)  # half of the cells of a block
BEFORE = ("ptr", "block", "mask", "t_ptr", "t_item", "t_mask")


def by_the_definition(cells: CellLists):
    """Return [(block, mask), ...] of every item, from what a step and a code mean."""
    found = []
    for item in range(len(cells.start) - 1):
        block, own, at = -1, [], int(cells.start[item, 1])
        for k in range(cells.start[item, 0], cells.start[item + 1, 0]):
            block += int(cells.step[k])
            if cells.step[k] == 255:
                continue
            code, at = int(cells.code[at]), at + 1
            if code >> 31:
                mask = int(cells.full[code & 0x7FFFFFFF])
            else:
                low, high = int(cells.half[code & 0x7FFF]), int(cells.half[code >> 15])
                mask = low | high << 32
            own.append((block, mask))
        assert at == cells.start[item + 1, 1]
        found.append(own)
    return found


def drawn_lists(rng, n_blocks, n_items=60, kinds=40):
    """Return ptr, block, mask of random lists: some long, some empty, far and near."""
    words = rng.integers(1, 2**64, kinds, np.uint64, endpoint=False)
    rows = []
    for k in range(n_items):
        size = 0 if k % 7 == 3 else int(rng.integers(1, 80))
        block = np.unique(rng.integers(0, n_blocks if k % 2 else 200, size))
        if k == 0:
            block = np.array([0, 1, 255, 256, 510, 765, 1021, n_blocks - 1])
        rows.append(np.unique(block))
    ptr = np.concatenate([[0], np.cumsum([len(r) for r in rows])])
    block = np.concatenate(rows).astype(np.uint16 if n_blocks <= 65535 else np.uint32)
    return ptr, block, rng.choice(words, len(block))


@pytest.mark.parametrize("share", [True, False])
@pytest.mark.parametrize("n_blocks", [4096, 200_000])
def test_packed_lists_hold_the_cells_they_were_made_of(rng, n_blocks, share):
    ptr, block, mask = drawn_lists(rng, n_blocks)
    cells = packed_lists(ptr, block, mask, n_blocks, share)
    wanted = [
        list(zip(block[a:b].tolist(), mask[a:b].tolist(), strict=True))
        for a, b in zip(ptr[:-1], ptr[1:], strict=True)
    ]
    assert by_the_definition(cells) == wanted
    assert cells.n_entries == len(block) < len(cells.step), "no step is long"
    for ours, given in zip(cells.unpacked(), (ptr, block, mask), strict=True):
        assert ours.dtype == given.dtype and np.array_equal(ours, given)
    for item, own in enumerate(wanted):
        blocks, masks = cells_of_item(*cells.arrays().values(), item)
        assert list(zip(blocks.tolist(), masks.tolist(), strict=True)) == own
    by_block = [[] for _ in range(n_blocks)]
    for item, own in enumerate(wanted):
        for b, word in own:
            by_block[b].append((item, word))
    t_ptr, t_item, t_mask = cells.by_block
    assert t_ptr.tolist() == np.cumsum([0, *map(len, by_block)]).tolist()
    there = list(zip(t_item.tolist(), t_mask.tolist(), strict=True))
    assert there == [entry for entries in by_block for entry in entries]


@pytest.mark.parametrize("share", [True, False])
def test_a_list_is_hit_where_an_entry_of_it_is(rng, share):
    """Any entry, the last one too, and however far from the one before."""
    ptr, block, mask = drawn_lists(rng, 4096)
    cells = packed_lists(ptr, block, mask, 4096, share)
    packed, hit_at = cells.arrays().values(), np.zeros((60, 2), np.uint64)
    for item in range(60):
        words = np.zeros(4096, np.uint64)
        for k in range(ptr[item], ptr[item + 1]):
            words[block[k]] = ~mask[k]  # all cells of the block but those
        assert not packed_hit(words, *packed, item, hit_at)
        for k in range(ptr[item], ptr[item + 1]):
            before = words[block[k]]
            for half in (mask[k] & RIGHT, mask[k] & ~RIGHT):
                words[block[k]] = half
                assert packed_hit(words, *packed, item, hit_at) == (half != 0)
                if half:
                    assert hit_at[item].tolist() == [block[k] + 1, mask[k]]
            words[block[k]] = before


def test_more_steps_than_a_map_can_number_are_refused(monkeypatch):
    monkeypatch.setattr(lists, "_MOST_STEPS", 2)
    one = np.array([0, 1]), np.array([600], np.uint16), np.ones(1, np.uint64)
    with pytest.raises(BuildRefused, match="take 3 steps, more than the 2"):
        packed_lists(*one, 4096)


def test_words_beyond_the_commonest_halves_are_kept_whole(rng):
    n = 100_000
    mask = rng.integers(1, 2**64, n, np.uint64, endpoint=False)  # 200 000 halves
    mask[: n // 2] = mask[: n // 2] % 40_000 + 1  # the commonest by far: high half 0
    ptr, block = np.arange(n + 1), np.zeros(n, np.uint16)
    cells = packed_lists(ptr, block, mask, 1)
    assert len(cells.half) == kernels.HALVES and cells.half[0] == 0
    counted = np.unique(mask.view(np.uint32), return_counts=True)
    most = dict(zip(*(c.tolist() for c in counted), strict=True))
    times = [most[half] for half in cells.half.tolist()]
    assert times == sorted(times, reverse=True)
    assert 0.2 * n < len(cells.full) < 0.8 * n
    assert np.array_equal(cells.unpacked().mask, mask)
    again = packed_lists(ptr, block, mask, 1)
    for name, array in cells.arrays().items():
        assert array.tobytes() == again.arrays()[name].tobytes(), name


def test_halves_are_named_up_to_the_last_of_their_bits(monkeypatch):
    low, every = kernels.LOW_HALVES, kernels.HALVES
    halves = np.arange(every, dtype=np.uint32)  # each has itself for its number
    monkeypatch.setattr(lists, "_common_halves", lambda mask: halves)
    ends = np.array([0, low - 1, low, low + 1, every - 1, every], np.uint64)
    mask = (ends[:, None] | ends << np.uint64(32)).ravel()
    ptr, block = np.arange(len(mask) + 1), np.zeros(len(mask), np.uint16)
    cells = packed_lists(ptr, block, mask, 1)
    assert np.array_equal(cells.unpacked().mask, mask)
    assert len(cells.full) == len(mask) - 2 * 5


def test_a_map_takes_less_than_two_thirds_of_ten_bytes_an_entry(small_map):
    by_item, by_block = small_map.arm_cells.bytes_by_view()
    stored = small_map.arm_cells.arrays().values()
    assert by_item == sum(a.nbytes for a in stored)
    assert by_block == sum(a.nbytes for a in small_map.arm_cells.by_block)
    assert by_item < 6.67 * small_map.arm_cells.n_entries


@pytest.fixture(params=["both views", "one view"])
def from_before(request, small_map, tmp_path):
    """The folder of the small map as it was written before lists were packed."""
    folder = small_map.save(tmp_path / "map")
    manifest, arrays = read_folder(folder)
    kept = {k: a for k, a in arrays.items() if not k.startswith("arm.")}
    cells = small_map.arm_cells
    names = BEFORE if request.param == "both views" else BEFORE[:3]
    views = dict(zip(BEFORE, (*cells.unpacked(), *cells.by_block), strict=True))
    kept |= {f"arm.{name}": views[name] for name in names}
    return write_folder(folder, manifest, kept)


@pytest.mark.parametrize("verify", [True, False])
def test_a_map_from_before_answers_as_ever(small_map, from_before, verify):
    loaded = odm.load_map(from_before, verify=verify)
    cells, whole = loaded.arm_cells, small_map.arm_cells
    for mine, other in (
        (cells.by_item, whole.by_item),
        (cells.by_block, whole.by_block),
    ):
        for a, b in zip(mine, other, strict=True):
            assert a.dtype == b.dtype and np.array_equal(a, b)
            assert not a.flags.writeable
    points = odm.sample_capsules(POST, 0.03)
    paths, blocked = [], []
    for cell_map in (small_map, loaded):
        planner = odm.ReactivePlanner(cell_map)
        planner.set_goals([AWAY])
        paths.append(planner.step(points, q=HOME).path)
        blocked.append(planner.invalid_edges())
    assert np.array_equal(*paths) and np.array_equal(*blocked) and len(blocked[0])
    again = replace(loaded, arm_cells=packed_lists(*cells.unpacked(), cells.n_blocks))
    for name, array in again.arm_cells.arrays().items():
        assert np.array_equal(array, whole.arrays()[name]), name


def test_a_map_is_derived_from_once_and_not_before_it_is_asked(small_map, tmp_path):
    cells = odm.load_map(small_map.save(tmp_path / "map")).arm_cells
    assert not {"by_block", "by_item"} & set(vars(cells)), "derived too early"
    odm.ReactivePlanner(odm.load_map(tmp_path / "map"))
    assert cells.by_block is cells.by_block


def test_a_view_too_large_for_the_memory_is_derived_into_a_file(
    small_map, tmp_path, monkeypatch
):
    folder = small_map.save(tmp_path / "map")
    monkeypatch.setattr(lists, "free_memory", lambda: 100)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cells = odm.load_map(folder, verify=False).arm_cells
    for mine, other in zip(cells.by_block, small_map.arm_cells.by_block, strict=True):
        assert np.array_equal(mine, other)
    mapped = [a for a in cells.by_block if isinstance(a.base, np.memmap)]
    assert len(mapped) == 2 and not [p for p in tmp_path.iterdir() if p.is_file()]


@pytest.mark.parametrize("missing", lists.STORED)
def test_a_map_that_lacks_a_part_of_its_lists_is_refused(small_map, tmp_path, missing):
    folder = small_map.save(tmp_path / "map")
    manifest, arrays = read_folder(folder)
    del arrays[f"arm.{missing}"]
    write_folder(folder, manifest, arrays)
    with pytest.raises(BadMap, match="lacks"):
        odm.load_map(folder)
