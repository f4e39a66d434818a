"""The swept cells of nodes and edges, by item and by block.

A map's folder holds the cells by item, packed (`_packed.py`): about six bytes an entry,
and frames read them as they are. The same by block, 12 bytes an entry, is derived when
a planner first asks for it. Where that would take more than half of the free memory,
it is derived into a temporary file that is mapped, as the others are.
"""

import tempfile
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from odm._groups import block_type
from odm.cell_map import _packed as packed
from odm.cell_map._sweep import ItemCells
from odm.cell_map.estimate import free_memory
from roadmap.arrays import freeze
from roadmap.errors import BuildRefused

_MOST_STEPS = 2**32 - 1
_SHARE = 0.5  # of the free memory that a derived view may take
EDGE_MAJOR = ("ptr", "block", "mask")  # as maps held it until format 1 was packed
BLOCK_MAJOR = ("t_ptr", "t_item", "t_mask")
STORED = ("start", "step", "code", "half", "full")


class ByBlock(NamedTuple):
    """Which items sweep which cells of a block.

    Attributes:
        t_ptr: (n_blocks + 1,) block b owns entries t_ptr[b]:t_ptr[b + 1].
        t_item: (n,) items of a block, ascending.
        t_mask: (n,) their cells.
    """

    t_ptr: np.ndarray
    t_item: np.ndarray
    t_mask: np.ndarray


@dataclass(frozen=True, eq=False)
class CellLists:
    """One layer of a map: which cells each item sweeps, and by block which items.

    An *item* is a node (its number) or an edge (n_nodes + its number). An edge's
    list holds only the cells that neither of its end nodes sweeps.

    Attributes:
        start: (n_items + 1, 2) item i owns the steps start[i, 0]:start[i + 1, 0] and
            the codes start[i, 1]:start[i + 1, 1].
        step: (k,) how many blocks on from the last one; 255: so many, and no entry.
        code: (n,) which cells of the block that an entry names.
        half: (at most 65536,) words of 32 cells, the commonest first.
        full: (j,) words of 64 cells that are not two of those.
        n_blocks: Of the grid.
    """

    start: np.ndarray
    step: np.ndarray
    code: np.ndarray
    half: np.ndarray
    full: np.ndarray
    n_blocks: int

    def __post_init__(self) -> None:
        freeze(self, **{name: a.dtype for name, a in self.arrays().items()})

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, for the store."""
        return {name: getattr(self, name) for name in STORED}

    def unpacked(self) -> ItemCells:
        """Return the cells by item as blocks and masks, made anew.

        Returns:
            ptr (n_items + 1,), block (n,), ascending within an item, and mask (n,).
        """
        n = self.n_entries
        ptr = np.empty(len(self.start), np.int64)
        made = ptr, _room(n, block_type(self.n_blocks)), _room(n, np.uint64)
        packed.unpack_lists(*self.arrays().values(), *made)
        return ItemCells(*map(_kept, made))

    @cached_property
    def by_item(self) -> ItemCells:
        """The cells by item as blocks and masks; see `unpacked`."""
        return self.unpacked()

    @cached_property
    def by_block(self) -> ByBlock:
        """The cells by block, derived when this is first asked for."""
        n = self.n_entries
        t_ptr = np.zeros(self.n_blocks + 1, np.int64)
        made = t_ptr, _room(n, np.uint32), _room(n, np.uint64)
        packed.transpose_packed(*self.arrays().values(), *made)
        return ByBlock(*map(_kept, made))

    @property
    def n_entries(self) -> int:
        """How many blocks all lists name together."""
        return len(self.code)

    def bytes_by_view(self) -> tuple[int, int]:
        """Return the bytes by item, in files and memory, and by block, in memory."""
        by_item = sum(array.nbytes for array in self.arrays().values())
        return by_item, 8 * (self.n_blocks + 1) + 12 * self.n_entries


def cells_of_item(
    start: np.ndarray,
    step: np.ndarray,
    code: np.ndarray,
    half: np.ndarray,
    full: np.ndarray,
    item: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the blocks (k,) and masks (k,) of one item of packed lists."""
    (first, first_code), (end, end_code) = start[item : item + 2].tolist()
    steps, codes = step[first:end], code[first_code:end_code].astype(np.int64)
    blocks = np.cumsum(steps, dtype=np.int64)[steps != packed.ON] - 1
    whole = codes >= packed.WHOLE
    masks = np.empty(len(codes), np.uint64)
    masks[whole] = full[codes[whole] - packed.WHOLE]
    pairs = codes[~whole]
    low, high = half[pairs % packed.LOW_HALVES], half[pairs // packed.LOW_HALVES]
    masks[~whole] = np.stack([low, high], axis=1).view(np.uint64)[:, 0]
    return blocks, masks


def lists_of(arrays: dict[str, np.ndarray], n_blocks: int) -> CellLists:
    """Return the lists that a map's folder holds, packed or as maps were before.

    `arrays` are by name, as `CellLists.arrays` gives them; or `EDGE_MAJOR`, alone or
    with `BLOCK_MAJOR`. A KeyError names one that is missing.
    """
    if "start" in arrays or not arrays:
        return CellLists(*(arrays[name] for name in STORED), n_blocks)
    lists = packed_lists(*(arrays[name] for name in EDGE_MAJOR), n_blocks, share=False)
    if len(arrays) > len(EDGE_MAJOR):  # what is there need not be derived
        vars(lists)["by_block"] = ByBlock(*(arrays[name] for name in BLOCK_MAJOR))
    return lists


def packed_lists(
    ptr: np.ndarray,
    block: np.ndarray,
    mask: np.ndarray,
    n_blocks: int,
    share: bool = True,
) -> CellLists:
    """Pack cells by item; the same cells give the same bytes.

    Item i owns entries ptr[i]:ptr[i + 1] of `block`, ascending, and `mask`. Without
    `share` the commonest halves are not looked for: a tenth of the time, and twice the
    memory afterwards. BuildRefused where there are too many.
    """
    half = _common_halves(mask) if share else np.zeros(0, np.uint32)
    slot = np.full(packed.SLOTS, -1, np.int32)
    packed.place_halves(half, slot)
    n_steps, n = packed.count_steps(ptr, block), len(mask)
    if n_steps > _MOST_STEPS:
        raise BuildRefused(
            f"the cells of all nodes and edges take {n_steps} steps, more than the "
            f"{_MOST_STEPS} that a map can number; take larger cells or fewer nodes"
        )
    start = np.empty((len(ptr), 2), np.uint32)
    step, code = _room(n_steps, np.uint8), _room(n, np.uint32)
    full = _room(n, np.uint64)
    end = packed.pack_lists(ptr, block, mask, half, slot, start, step, code, full)
    made = start, step, code, half, full[:end].copy() if share else mask
    return CellLists(*map(_kept, made), n_blocks)


def _common_halves(mask: np.ndarray) -> np.ndarray:
    """Return the words of 32 cells that occur most, the commonest first."""
    halves = np.sort(np.ascontiguousarray(mask).view(np.uint32))
    first = np.flatnonzero(np.diff(halves, prepend=~halves[:1]) != 0)
    counts = np.diff(first, append=len(halves))
    order = np.argsort(-counts, kind="stable")[: packed.HALVES]
    return halves[first[order]]


def _kept(array: np.ndarray) -> np.ndarray:
    """Return an array that nobody need copy to be sure of it."""
    array.flags.writeable = False
    return array


def _room(n: int, dtype: type) -> np.ndarray:
    """Return an array for n numbers: memory, or a temporary file that is mapped."""
    size = n * np.dtype(dtype).itemsize
    if size < _SHARE * free_memory():
        return np.empty(n, dtype)
    with tempfile.TemporaryFile() as file:  # it lives on while it is mapped
        return np.asarray(np.memmap(file, dtype, "w+", shape=(n,)))
