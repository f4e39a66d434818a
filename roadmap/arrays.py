"""Read-only arrays, for dataclasses that never change."""

import numpy as np


def frozen(array: np.ndarray, dtype: np.dtype | type) -> np.ndarray:
    """Return `array` as a read-only C-contiguous array of `dtype`.

    A memory-mapped or already frozen array of the right type is not copied.
    """
    result = np.ascontiguousarray(array, dtype=dtype)
    if result is array and result.flags.writeable:
        result = result.copy()
    result.flags.writeable = False
    return result


def writable(array: np.ndarray) -> np.ndarray:
    """Return `array` C-contiguous and open to be written; a copy where it is not.

    To numba a read-only array is another type, and a loop is compiled again for it.
    """
    result = np.ascontiguousarray(array)
    return result if result.flags.writeable else result.copy()
