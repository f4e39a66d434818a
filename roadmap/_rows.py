"""Rows of arrays, number by number: `a[k] = b[j]` would make a copy in between."""

from numba import njit

from roadmap.jit_options import INNER


@njit(**INNER)
def copy_row(source, target):
    """Let `target` (n,) hold the numbers of `source` (n,)."""
    for k in range(target.shape[0]):
        target[k] = source[k]
