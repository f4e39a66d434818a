"""The planner's state as a table of addresses: one argument instead of a hundred.

Handing a hundred arrays to a compiled function costs 5 us a call, and taking them out
of a numba struct as much again, in counted references. The table holds address and
shape of every array; `arm_of(t)` and its like view what they need without a count.
`odm.search.state.Memory` owns the arrays, so they live as long as the planner.

The type of the table tells the type of the block ids: int64 for uint16, uint64 for
uint32 (grids of more than 65535 blocks).
"""

import numpy as np
from numba import carray, njit, types
from numba.extending import intrinsic

from odm.close_test._arm import Arm, Work
from odm.obstacles._cloud import Cloud
from odm.search._types import (
    Beside,
    Direct,
    Goals,
    Graph,
    Own,
    Past,
    Pool,
    Proof,
    Search,
    Shortcuts,
    Starts,
    Way,
)

N_TOLERANCE, N_H, N_TRACK, N_EXTRA = 0, 1, 2, 3  # entries of Own.terms
# first row of each group
ARM = 0
CLOUD = ARM + 7
WORK = CLOUD + 11
GRAPH = WORK + 14
POOL = GRAPH + 13
GOALS = POOL + 6
SEARCH = GOALS + 17
DIRECT = SEARCH + 14
SHORT = DIRECT + 9
FRESH = SHORT + 6
ALONG = FRESH + 7
WAY = ALONG + 7
SPARE = WAY + 4
OWN = SPARE + 4
PICK = OWN + 15
PAST = PICK + 11
PROOF = PAST + 5
BESIDE = PROOF + 3
ROWS = BESIDE + 2


@intrinsic
def pointer(typingctx, address, dtype):  # noqa: ANN001, ANN201
    """Take an address for a pointer to `dtype`."""
    result = types.CPointer(dtype.dtype)

    def codegen(context, builder, _signature, args):  # noqa: ANN001, ANN202
        return builder.inttoptr(args[0], context.get_value_type(result))

    return result(address, dtype), codegen


@intrinsic
def block_pointer(typingctx, address):  # noqa: ANN001, ANN201
    """Take an address for a pointer to block ids; see the module."""
    small = address.signed if hasattr(address, "signed") else True
    result = types.CPointer(types.uint16 if small else types.uint32)

    def codegen(context, builder, _signature, args):  # noqa: ANN001, ANN202
        return builder.inttoptr(args[0], context.get_value_type(result))

    return result(address), codegen


@njit(cache=True, nogil=True)
def f8_1(t, k):
    """View row k as 1-d float64."""
    return carray(pointer(t[k, 0], np.float64), (np.int64(t[k, 1]),))


@njit(cache=True, nogil=True)
def f8_2(t, k):
    """View row k as 2-d float64."""
    shape = (np.int64(t[k, 1]), np.int64(t[k, 2]))
    return carray(pointer(t[k, 0], np.float64), shape)


@njit(cache=True, nogil=True)
def f8_3(t, k):
    """View row k as 3-d float64."""
    shape = (np.int64(t[k, 1]), np.int64(t[k, 2]), np.int64(t[k, 3]))
    return carray(pointer(t[k, 0], np.float64), shape)


@njit(cache=True, nogil=True)
def i8_1(t, k):
    """View row k as 1-d int64."""
    return carray(pointer(t[k, 0], np.int64), (np.int64(t[k, 1]),))


@njit(cache=True, nogil=True)
def i8_2(t, k):
    """View row k as 2-d int64."""
    shape = (np.int64(t[k, 1]), np.int64(t[k, 2]))
    return carray(pointer(t[k, 0], np.int64), shape)


@njit(cache=True, nogil=True)
def i4_1(t, k):
    """View row k as 1-d int32."""
    return carray(pointer(t[k, 0], np.int32), (np.int64(t[k, 1]),))


@njit(cache=True, nogil=True)
def i4_2(t, k):
    """View row k as 2-d int32."""
    shape = (np.int64(t[k, 1]), np.int64(t[k, 2]))
    return carray(pointer(t[k, 0], np.int32), shape)


@njit(cache=True, nogil=True)
def u8_1(t, k):
    """View row k as 1-d uint64."""
    return carray(pointer(t[k, 0], np.uint64), (np.int64(t[k, 1]),))


@njit(cache=True, nogil=True)
def b1_1(t, k):
    """View row k as 1-d bool_."""
    return carray(pointer(t[k, 0], np.bool_), (np.int64(t[k, 1]),))


@njit(cache=True, nogil=True)
def b1_2(t, k):
    """View row k as 2-d bool_."""
    shape = (np.int64(t[k, 1]), np.int64(t[k, 2]))
    return carray(pointer(t[k, 0], np.bool_), shape)


@njit(cache=True, nogil=True)
def blocks(t, k):
    """View row k as block ids."""
    return carray(block_pointer(t[k, 0]), (np.int64(t[k, 1]),))


@njit(cache=True, nogil=True)
def arm_of(t):
    """Return the group `Arm`."""
    at = ARM
    return Arm(
        i4_2(t, at + 0),
        f8_2(t, at + 1),
        f8_2(t, at + 2),
        i4_1(t, at + 3),
        f8_2(t, at + 4),
        i8_1(t, at + 5),
        f8_2(t, at + 6),
    )


@njit(cache=True, nogil=True)
def cloud_of(t):
    """Return the frame's points."""
    return cloud_at(t, CLOUD)


@njit(cache=True, nogil=True)
def cloud_at(t, at):
    """Return the group `Cloud` that begins at row `at`."""
    return Cloud(
        f8_1(t, at + 0),
        f8_1(t, OWN + 1)[N_H],
        i8_1(t, at + 1),
        u8_1(t, at + 2),
        i4_1(t, at + 3),
        i4_1(t, at + 4),
        i4_1(t, at + 5),
        f8_2(t, at + 6),
        f8_2(t, at + 7),
        i4_1(t, at + 8),
        i4_1(t, at + 9),
        i8_1(t, at + 10),
    )


@njit(cache=True, nogil=True)
def work_of(t):
    """Return the group `Work`."""
    at = WORK
    return Work(
        f8_3(t, at + 0),
        f8_1(t, at + 1),
        f8_1(t, at + 2),
        f8_1(t, at + 3),
        f8_2(t, at + 4),
        f8_1(t, at + 5),
        f8_1(t, at + 6),
        i8_1(t, at + 7),
        i8_1(t, at + 8),
        i8_2(t, at + 9),
        b1_2(t, at + 10),
        f8_2(t, at + 11),
        i8_1(t, at + 12),
        f8_1(t, at + 13),
    )


@njit(cache=True, nogil=True)
def graph_of(t):
    """Return the group `Graph`."""
    at = GRAPH
    return Graph(
        i8_1(t, at + 0),
        i4_1(t, at + 1),
        i4_1(t, at + 2),
        f8_1(t, at + 3),
        i4_2(t, at + 4),
        f8_2(t, at + 5),
        i8_1(t, at + 6),
        blocks(t, at + 7),
        u8_1(t, at + 8),
        b1_1(t, at + 9),
        i4_1(t, at + 10),
        u8_1(t, at + 11),
        u8_1(t, at + 12),
    )


@njit(cache=True, nogil=True)
def pool_of(t):
    """Return the group `Pool`."""
    at = POOL
    return Pool(
        i8_1(t, at + 0),
        i8_1(t, at + 1),
        blocks(t, at + 2),
        u8_1(t, at + 3),
        u8_1(t, at + 4),
        i8_1(t, at + 5),
    )


@njit(cache=True, nogil=True)
def goals_of(t):
    """Return the group `Goals`."""
    at = GOALS
    return Goals(
        f8_2(t, at + 0),
        f8_1(t, at + 1),
        f8_2(t, at + 2),
        i4_2(t, at + 3),
        i8_2(t, at + 4),
        f8_2(t, at + 5),
        i8_2(t, at + 6),
        i8_2(t, at + 7),
        f8_2(t, at + 8),
        i8_1(t, at + 9),
        i8_1(t, at + 10),
        i8_1(t, at + 11),
        f8_1(t, at + 12),
        i8_1(t, at + 13),
        i8_1(t, at + 14),
        f8_1(t, at + 15),
        i8_1(t, at + 16),
    )


@njit(cache=True, nogil=True)
def search_of(t):
    """Return the group `Search`."""
    at = SEARCH
    return Search(
        i8_1(t, at + 0),
        i8_1(t, at + 1),
        i8_1(t, at + 2),
        i8_1(t, at + 3),
        i8_1(t, at + 4),
        f8_1(t, at + 5),
        i4_1(t, at + 6),
        i4_1(t, at + 7),
        i4_1(t, at + 8),
        f8_1(t, at + 9),
        f8_1(t, at + 10),
        i4_1(t, at + 11),
        u8_1(t, at + 12),
        i8_1(t, at + 13),
    )


@njit(cache=True, nogil=True)
def direct_of(t):
    """Return the group `Direct`."""
    at = DIRECT
    return Direct(
        i8_1(t, at + 0),
        i4_1(t, at + 1),
        u8_1(t, at + 2),
        u8_1(t, at + 3),
        i4_1(t, at + 4),
        i4_1(t, at + 5),
        u8_1(t, at + 6),
        i4_1(t, at + 7),
        i8_1(t, at + 8),
    )


@njit(cache=True, nogil=True)
def past_of(t):
    """Return the group `Past`."""
    at = PAST
    return Past(
        i8_1(t, at + 0),
        i4_2(t, at + 1),
        i4_2(t, at + 2),
        f8_2(t, at + 3),
        i8_1(t, at + 4),
    )


@njit(cache=True, nogil=True)
def short_of(t):
    """Return the group `Shortcuts`."""
    at = SHORT
    return Shortcuts(
        i8_1(t, at + 0),
        i8_1(t, at + 1),
        i8_1(t, at + 2),
        f8_1(t, at + 3),
        i8_1(t, at + 4),
        i8_1(t, at + 5),
    )


@njit(cache=True, nogil=True)
def starts_at(t, at):
    """Return the group `Starts` that begins at row `at`."""
    return Starts(
        i8_1(t, at + 0),
        f8_1(t, at + 1),
        i8_1(t, at + 2),
        i8_1(t, at + 3),
        i8_1(t, at + 4),
        f8_1(t, at + 5),
        i8_1(t, at + 6),
    )


@njit(cache=True, nogil=True)
def way_at(t, at):
    """Return the group `Way` that begins at row `at`."""
    return Way(
        i8_1(t, at + 0),
        i8_1(t, at + 1),
        f8_2(t, at + 2),
        i8_1(t, at + 3),
    )


@njit(cache=True, nogil=True)
def proof_of(t):
    """Return the group `Proof`."""
    return Proof(f8_2(t, PROOF), f8_2(t, PROOF + 1), f8_1(t, PROOF + 2))


@njit(cache=True, nogil=True)
def beside_of(t):
    """Return the group `Beside`."""
    return Beside(f8_2(t, BESIDE), i8_1(t, BESIDE + 1))


@njit(cache=True, nogil=True)
def own_of(t):
    """Return the group `Own`."""
    at = OWN
    return Own(
        f8_1(t, at + 0),
        f8_1(t, at + 1),
        f8_1(t, at + 2),
        f8_1(t, at + 3),
        b1_1(t, at + 4),
        f8_1(t, at + 5),
        i8_1(t, at + 6),
        f8_1(t, at + 7),
        f8_1(t, at + 8),
        f8_1(t, at + 9),
        f8_1(t, at + 10),
        f8_1(t, at + 11),
        f8_1(t, at + 12),
        f8_1(t, at + 13),
        f8_1(t, at + 14),
    )
