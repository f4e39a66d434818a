"""Lists of swept cells as a map holds them: five bytes an entry and a little more.

An entry is a step and a code. The blocks of an item ascend, so `step` says how many
blocks on from the last one an entry is (the first counts from block -1); step 0 is no
entry but a jump, by `code` blocks. The code names the cells: most words of 64 cells are
two of the 65536 commonest halves, whose numbers are its bits 0 to 14 and 15 to 30;
with bit 31 the other bits are the number of a word that is kept whole.
"""

import numpy as np
from numba import njit

from roadmap.jit_options import INNER, LEAN

LARGEST_STEP = 255
LOW_HALVES, HALVES = 1 << 15, 1 << 16  # that bits 0 to 14, and 15 to 30, can name
WHOLE = 1 << 31
SLOTS = 1 << 17  # of the table that finds a half
_LOW, _BITS, _HALF = np.uint64(LOW_HALVES - 1), np.uint64(15), np.uint64(32)
_WHOLE, _FIRST = np.uint64(WHOLE), np.uint64(1)
_RIGHT, _SPREAD, _SHIFT = np.uint64(0xFFFFFFFF), np.uint64(2654435761), np.uint64(15)


@njit(**INNER)
def word_of(code, half, full):
    """Return the 64 cells that a code names."""
    c = np.uint64(code)
    if c >= _WHOLE:
        return full[c - _WHOLE]
    return np.uint64(half[c & _LOW]) | np.uint64(half[c >> _BITS]) << _HALF


@njit(**INNER)
def packed_hit(words, step, code, half, full, begin, end):
    """Return True if the cells of a list [begin:end] share one with `words`."""
    after = np.uint64(0)  # the block after which the next one comes, counted from 1
    for k in range(begin, end):
        if step[k] == 0:
            after += np.uint64(code[k])
            continue
        after += np.uint64(step[k])
        # few blocks are occupied: most codes need not be fetched
        word = words[after - _FIRST]
        if word != 0 and word & word_of(code[k], half, full) != 0:
            return True
    return False


@njit(**LEAN)
def unpack_lists(start, step, code, half, full, ptr, block, mask):
    """Write lists as ptr, block and mask; their first entry becomes entry 0."""
    end = 0
    ptr[0] = 0
    for item in range(start.shape[0] - 1):
        after = 0
        for k in range(start[item], start[item + 1]):
            if step[k] == 0:
                after += code[k]
                continue
            after += step[k]
            block[end] = after - 1
            mask[end] = word_of(code[k], half, full)
            end += 1
        ptr[item + 1] = end


@njit(**LEAN)
def transpose_packed(start, step, code, half, full, t_ptr, t_item, t_mask):
    """Turn packed item -> cells lists into block -> (item, mask) lists; t_ptr is 0."""
    n_blocks = t_ptr.shape[0] - 1
    for item in range(start.shape[0] - 1):
        after = np.uint64(0)
        for k in range(start[item], start[item + 1]):
            if step[k] == 0:
                after += np.uint64(code[k])
                continue
            after += np.uint64(step[k])
            t_ptr[after] += 1
    for b in range(n_blocks):
        t_ptr[b + 1] += t_ptr[b]
    for item in range(start.shape[0] - 1):
        after = np.uint64(0)
        for k in range(start[item], start[item + 1]):
            if step[k] == 0:
                after += np.uint64(code[k])
                continue
            after += np.uint64(step[k])
            b = after - _FIRST
            at = np.uint64(t_ptr[b])
            t_item[at] = item
            t_mask[at] = word_of(code[k], half, full)
            t_ptr[b] += 1
    for b in range(n_blocks, 0, -1):
        t_ptr[b] = t_ptr[b - 1]
    t_ptr[0] = 0


@njit(**LEAN)
def place_halves(half, slot):
    """Fill the table (SLOTS,), -1 before, that finds halves by what they are."""
    for k in range(half.shape[0]):
        at = (np.uint64(half[k]) * _SPREAD & _RIGHT) >> _SHIFT
        while slot[at] >= 0:
            at = (at + _FIRST) & np.uint64(SLOTS - 1)
        slot[at] = k


@njit(**INNER)
def half_number(value, half, slot):
    """Return the number of a half, or HALVES."""
    at = (value * _SPREAD & _RIGHT) >> _SHIFT
    while slot[at] >= 0:
        if np.uint64(half[slot[at]]) == value:
            return slot[at]
        at = (at + _FIRST) & np.uint64(SLOTS - 1)
    return HALVES


@njit(**LEAN)
def pack_starts(ptr, block, start):
    """Write to `start` where items begin, the jumps in their lists counted."""
    end = 0
    start[0] = 0
    for item in range(ptr.shape[0] - 1):
        last = -1
        for k in range(ptr[item], ptr[item + 1]):
            b = np.int64(block[k])
            end += 2 if b - last > LARGEST_STEP else 1
            last = b
        start[item + 1] = end


@njit(**LEAN)
def pack_lists(ptr, block, mask, half, slot, step, code, full):
    """Write lists of blocks and masks as steps and codes; return how many are whole.

    `step` and `code` have the length that `pack_starts` counts, `full` that of `mask`.
    """
    end, n_full = 0, 0
    for item in range(ptr.shape[0] - 1):
        last = -1
        for k in range(ptr[item], ptr[item + 1]):
            gap = np.int64(block[k]) - last
            if gap > LARGEST_STEP:
                step[end], code[end] = 0, gap - 1
                gap = 1
                end += 1
            last = np.int64(block[k])
            low = half_number(mask[k] & _RIGHT, half, slot)
            high = half_number(mask[k] >> _HALF, half, slot)
            step[end] = gap
            if low < LOW_HALVES and high < HALVES:
                code[end] = low | high << 15
            else:
                full[n_full] = mask[k]
                code[end] = WHOLE | n_full
                n_full += 1
            end += 1
    return n_full
