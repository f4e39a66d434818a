"""Signatures: which of 256 regions an item sweeps, for a first look at 32 bytes.

A region is 2 x 2 x 2 blocks; regions that any item uses share the 256 bits round
robin. Where signature and frame have no bit in common, the item is free and its list
need not be fetched from memory.
"""

import numpy as np
from numba import njit

from odm.obstacles._cloud import N_OCCUPIED


@njit(cache=True, nogil=True)
def sign_items(ptr, block, region, sign):
    """Write the signatures of items to `sign` (4 per item), zero before."""
    for i in range(ptr.shape[0] - 1):
        for k in range(ptr[i], ptr[i + 1]):
            bit = region[block[k]]
            sign[4 * i + (bit >> 6)] |= np.uint64(1) << np.uint64(bit & 63)


@njit(cache=True, nogil=True)
def sign_frame(cloud, region, sign):
    """Write the signature of the occupied blocks to `sign` (4,)."""
    for k in range(4):
        sign[k] = 0
    for k in range(cloud.counts[N_OCCUPIED]):
        bit = region[cloud.occupied[k]]
        sign[bit >> 6] |= np.uint64(1) << np.uint64(bit & 63)


@njit(cache=True, nogil=True)
def apart(sign, item, frame):
    """Return True if an item's signature has no bit in common with the frame's."""
    at = 4 * item
    common = (sign[at] & frame[0]) | (sign[at + 1] & frame[1])
    common |= (sign[at + 2] & frame[2]) | (sign[at + 3] & frame[3])
    return common == 0
