"""The swept cells of nodes and edges, by item and by block.

The two views hold the same entries. Up to `BOTH_VIEWS` bytes a map's folder holds both,
so that all of it is mapped in milliseconds. Of larger maps it holds the edge-major view
alone, 10 of 22 bytes an entry; the block-major one is derived from it when it is first
asked for, which takes about 20 ns an entry. Where it would take more than half of the
free memory, it is derived into a temporary file that is mapped, as the other view is.
"""

import tempfile
import threading
from dataclasses import dataclass

import numpy as np

from odm.cell_map import _sweep as sweep
from odm.cell_map.estimate import free_memory
from roadmap.arrays import frozen

BOTH_VIEWS = 400_000_000  # [bytes] of larger lists only the edge-major view is stored
_SHARE = 0.5  # of the free memory that a derived view may take
EDGE_MAJOR = ("ptr", "block", "mask")
BLOCK_MAJOR = ("t_ptr", "t_item", "t_mask")
ALL = (*EDGE_MAJOR, *BLOCK_MAJOR)


@dataclass(frozen=True, eq=False)
class CellLists:
    """One layer of a map, in both views.

    An *item* is a node (its number) or an edge (n_nodes + its number). An edge's
    list holds only the cells that neither of its end nodes sweeps.

    Attributes:
        ptr: (n_items + 1,) item i owns entries ptr[i]:ptr[i + 1].
        block: (n,) block of each entry, ascending within an item.
        mask: (n,) swept cells of that block.
        t_ptr: (n_blocks + 1,) the same by block.
        t_item: (n,) items of a block, ascending.
        t_mask: (n,) their cells.
    """

    ptr: np.ndarray
    block: np.ndarray
    mask: np.ndarray
    t_ptr: np.ndarray
    t_item: np.ndarray
    t_mask: np.ndarray

    def __post_init__(self) -> None:
        """Freeze the arrays, keeping their types."""
        for name in ALL:
            array = getattr(self, name)
            object.__setattr__(self, name, frozen(array, array.dtype))

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, for the store."""
        return {name: getattr(self, name) for name in ALL}

    def stored(self) -> dict[str, np.ndarray]:
        """Return what a map's folder holds: of large lists one view, see BOTH_VIEWS."""
        names = EDGE_MAJOR if sum(self.bytes_by_view()) > BOTH_VIEWS else ALL
        return {name: getattr(self, name) for name in names}

    def bytes_by_view(self) -> tuple[int, int]:
        """Return the bytes of the edge-major and of the block-major view."""
        edge_major = self.ptr.nbytes + self.block.nbytes + self.mask.nbytes
        return edge_major, self.t_ptr.nbytes + self.t_item.nbytes + self.t_mask.nbytes


class DerivedLists(CellLists):
    """Lists whose block-major view is derived when it is first asked for.

    Args:
        ptr, block, mask: The edge-major view, see `CellLists`.
        n_blocks: Of the grid.
    """

    def __init__(
        self, ptr: np.ndarray, block: np.ndarray, mask: np.ndarray, n_blocks: int
    ) -> None:
        """Take the edge-major view; nothing is derived yet."""
        for name, array in zip(EDGE_MAJOR, (ptr, block, mask), strict=True):
            object.__setattr__(self, name, frozen(array, array.dtype))
        object.__setattr__(self, "_n_blocks", n_blocks)
        object.__setattr__(self, "_deriving", threading.Lock())

    def __getattr__(self, name: str) -> np.ndarray:
        """Derive the block-major view, once."""
        if name not in BLOCK_MAJOR:
            raise AttributeError(name)
        with self._deriving:
            if name not in vars(self):
                view = transposed(self.ptr, self.block, self.mask, self._n_blocks)
                for each, array in zip(BLOCK_MAJOR, view, strict=True):
                    object.__setattr__(self, each, frozen(array, array.dtype))
        return vars(self)[name]

    def bytes_by_view(self) -> tuple[int, int]:
        """Return the bytes of both views, without deriving one."""
        edge_major = self.ptr.nbytes + self.block.nbytes + self.mask.nbytes
        return edge_major, 8 * (self._n_blocks + 1) + 12 * len(self.block)


def lists_of(arrays: dict[str, np.ndarray], n_blocks: int) -> CellLists:
    """Return the lists that a map's folder holds in both views, or in one.

    Args:
        arrays: By name, as `CellLists.stored` gives them.
        n_blocks: Of the grid.
    """
    if set(arrays) == set(EDGE_MAJOR):
        return DerivedLists(n_blocks=n_blocks, **arrays)
    return CellLists(**arrays)


def both_views(
    ptr: np.ndarray, block: np.ndarray, mask: np.ndarray, n_blocks: int
) -> CellLists:
    """Return the lists with their transpose."""
    return CellLists(ptr, block, mask, *transposed(ptr, block, mask, n_blocks))


def transposed(
    ptr: np.ndarray, block: np.ndarray, mask: np.ndarray, n_blocks: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t_ptr, t_item and t_mask of an edge-major view."""
    t_ptr, n = np.zeros(n_blocks + 1, np.int64), len(block)
    t_item, t_mask = _room(n, np.uint32), _room(n, np.uint64)
    sweep.transpose_lists(ptr, block, mask, t_ptr, t_item, t_mask)
    for array in (t_ptr, t_item, t_mask):
        array.flags.writeable = False  # so that nobody copies it to be sure
    return t_ptr, t_item, t_mask


def _room(n: int, dtype: type) -> np.ndarray:
    """Return an array for n numbers: memory, or a temporary file that is mapped."""
    size = n * np.dtype(dtype).itemsize
    if size < _SHARE * free_memory():
        return np.empty(n, dtype)
    with tempfile.TemporaryFile() as file:  # it lives on while it is mapped
        return np.asarray(np.memmap(file, dtype, "w+", shape=(n,)))
