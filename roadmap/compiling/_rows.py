"""Rows of arrays, number by number: `a[k] = b[j]` would make a copy in between."""

from numba import njit, types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from roadmap.compiling.jit_options import INNER


@njit(**INNER)
def copy_row(source, target):
    """Let `target` (n,) hold the numbers of `source` (n,)."""
    for k in range(target.shape[0]):
        target[k] = source[k]


@njit(**INNER)
def same_row(a, b):
    """Return True if two rows (n,) hold the same numbers; NaN is none."""
    for k in range(a.shape[0]):
        if a[k] != b[k]:
            return False
    return True


@intrinsic
def in_line(typingctx, rows):  # noqa: ANN001, ANN201
    """Return the numbers of a C array as (n,), in place.

    `reshape(-1)` calls a function that looks whether this can be, and takes 15 ns.
    """
    if not isinstance(rows, types.Array) or rows.layout != "C":
        return None
    line = rows.copy(ndim=1)

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        given = make_array(rows)(context, builder, args[0])
        made = make_array(line)(context, builder)
        size = given.itemsize
        populate_array(
            made, given.data, [given.nitems], [size], size, given.meminfo, given.parent
        )
        result = made._getvalue()
        return impl_ret_borrowed(context, builder, line, result)

    return line(rows), codegen
