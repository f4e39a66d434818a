"""Values of many frames in blocks: memory grows evenly, and no frame waits for it."""

import numpy as np

_ROWS = 512  # of one block


class Column:
    """One value of every frame, as arrays of one type.

    Args:
        dtype: Type of the numbers.
    """

    def __init__(self, dtype: type) -> None:
        """Hold nothing yet."""
        self._dtype = dtype
        self._full: list[np.ndarray] = []
        self._block: np.ndarray | None = None
        self._used = 0

    def add(self, value: object) -> None:
        """Add the value of one frame; its shape may change from frame to frame."""
        value = np.asarray(value, self._dtype)
        block = self._block
        if block is None or block.shape[1:] != value.shape or self._used == len(block):
            if block is not None:
                whole = self._used == len(block)
                self._full.append(block if whole else block[: self._used].copy())
            block = self._block = np.empty((_ROWS, *value.shape), self._dtype)
            self._used = 0
        block[self._used] = value
        self._used += 1

    def blocks(self, n: int) -> list[np.ndarray]:
        """Return arrays that hold the first `n` frames in order."""
        blocks, left = [], n
        last = [] if self._block is None else [self._block[: self._used]]
        for block in [*self._full, *last]:
            if left > 0:
                blocks.append(block[:left])
                left -= len(block)
        return blocks

    def rows(self, n: int) -> np.ndarray:
        """Return the first `n` frames, (n, ...); their values have one shape."""
        return np.concatenate(self.blocks(n))

    def shapes(self, n: int, width: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the first `n` frames of (k, width) values whose k may change.

        Returns:
            (n, k, width) and None where k is the same in all frames, else
            (sum of k, width) and (n + 1,) offsets: frame i owns the rows from
            offsets[i] to offsets[i + 1].
        """
        blocks = self.blocks(n)
        counts = np.concatenate([np.full(len(b), b.shape[1]) for b in blocks])
        if (counts == counts[0]).all():
            return np.concatenate(blocks), None
        offsets = np.r_[0, np.cumsum(counts)].astype(np.int64)
        return np.concatenate([b.reshape(-1, width) for b in blocks]), offsets
