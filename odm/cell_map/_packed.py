"""Lists of swept cells as a map holds them: five bytes an entry and a little more.

An entry is a step and a code. The blocks of an item ascend, so `step` says how many
blocks on from the last one an entry is (the first counts from block -1); a step of 255
is no entry and has no code: so far on, and on. The code names the cells: most words of
64 cells are two of the 65536 commonest halves, whose numbers are its bits 0 to 14 and
15 to 30; with bit 31 the other bits are the number of a word that is kept whole. Item i
has the steps from start[i, 0] to start[i + 1, 0], and the codes from start[i, 1] on.
"""

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN

ON = 255  # the step that is no entry
LOW_HALVES, HALVES = 1 << 15, 1 << 16  # that bits 0 to 14, and 15 to 30, can name
WHOLE = 1 << 31
SLOTS = 1 << 17  # of the table that finds a half
_LOW, _BITS, _HALF = np.uint64(LOW_HALVES - 1), np.uint64(15), np.uint64(32)
_WHOLE, _ONE = np.uint64(WHOLE), np.uint64(1)
_RIGHT, _SPREAD, _SHIFT = np.uint64(0xFFFFFFFF), np.uint64(2654435761), np.uint64(15)


@njit(**INNER)
def word_of(code, half, full):
    """Return the 64 cells that a code names."""
    c = np.uint64(code)
    if c >= _WHOLE:
        return full[c - _WHOLE]
    return np.uint64(half[c & _LOW]) | np.uint64(half[c >> _BITS]) << _HALF


@njit(**INNER)
def packed_hit(words, start, step, code, half, full, item, hit_at):
    """Return True if the cells of an item share one with `words`.

    Then hit_at[item] (2,) gets the block, counted from 1, and the item's cells there.
    """
    after = np.uint64(0)  # the block after which the next one comes, counted from 1
    no_entry = np.uint64(start[item, 0]) - np.uint64(start[item, 1])
    for k in range(start[item, 0], start[item + 1, 0]):
        after += np.uint64(step[k])
        if step[k] == ON:
            no_entry += _ONE
            continue
        # few blocks are occupied: most codes need not be fetched
        word = words[after - _ONE]
        if word != 0:
            own = word_of(code[k - no_entry], half, full)
            if word & own != 0:
                hit_at[item, 0], hit_at[item, 1] = after, own
                return True
    return False


@njit(**LEAN)
def unpack_lists(start, step, code, half, full, ptr, block, mask):
    """Write lists as ptr, block and mask."""
    at = np.uint64(0)
    for item in range(start.shape[0] - 1):
        ptr[item] = at
        after = np.uint64(0)
        for k in range(start[item, 0], start[item + 1, 0]):
            after += np.uint64(step[k])
            if step[k] != ON:
                block[at] = after - _ONE
                mask[at] = word_of(code[at], half, full)
                at += _ONE
    ptr[start.shape[0] - 1] = at


@njit(**LEAN)
def transpose_packed(start, step, code, half, full, t_ptr, t_item, t_mask):
    """Turn packed item -> cells lists into block -> (item, mask) lists; t_ptr is 0."""
    n_blocks = t_ptr.shape[0] - 1
    for item in range(start.shape[0] - 1):
        after = np.uint64(0)
        for k in range(start[item, 0], start[item + 1, 0]):
            after += np.uint64(step[k])
            if step[k] != ON:
                t_ptr[after] += 1
    for b in range(n_blocks):
        t_ptr[b + 1] += t_ptr[b]
    own = np.uint64(0)
    for item in range(start.shape[0] - 1):
        after = np.uint64(0)
        for k in range(start[item, 0], start[item + 1, 0]):
            after += np.uint64(step[k])
            if step[k] == ON:
                continue
            b = after - _ONE
            at = np.uint64(t_ptr[b])
            t_item[at] = item
            t_mask[at] = word_of(code[own], half, full)
            t_ptr[b] += 1
            own += _ONE
    for b in range(n_blocks, 0, -1):
        t_ptr[b] = t_ptr[b - 1]
    t_ptr[0] = 0


@njit(**LEAN)
def place_halves(half, slot):
    """Fill the table (SLOTS,), -1 before, that finds halves by what they are."""
    for k in range(half.shape[0]):
        at = (np.uint64(half[k]) * _SPREAD & _RIGHT) >> _SHIFT
        while slot[at] >= 0:
            at = (at + _ONE) & np.uint64(SLOTS - 1)
        slot[at] = k


@njit(**INNER)
def half_number(value, half, slot):
    """Return the number of a half, or HALVES."""
    at = (value * _SPREAD & _RIGHT) >> _SHIFT
    while slot[at] >= 0:
        if np.uint64(half[slot[at]]) == value:
            return slot[at]
        at = (at + _ONE) & np.uint64(SLOTS - 1)
    return HALVES


@njit(**LEAN)
def count_steps(ptr, block):
    """Return how many steps lists of blocks take."""
    count = block.shape[0]
    for item in range(ptr.shape[0] - 1):
        last = -1
        for k in range(ptr[item], ptr[item + 1]):
            count += (np.int64(block[k]) - last) // ON
            last = np.int64(block[k])
    return count


@njit(**LEAN)
def pack_lists(ptr, block, mask, half, slot, start, step, code, full):
    """Write lists of blocks and masks as steps and codes; return how many are whole.

    `step` has the length that `count_steps` gives, `code` and `full` that of `mask`.
    """
    end, n_full = 0, 0
    start[0, 0], start[0, 1] = 0, 0
    for item in range(ptr.shape[0] - 1):
        last = -1
        for k in range(ptr[item], ptr[item + 1]):
            gap = np.int64(block[k]) - last
            last = np.int64(block[k])
            while gap >= ON:
                step[end] = ON
                gap -= ON
                end += 1
            step[end] = gap
            end += 1
            low = half_number(mask[k] & _RIGHT, half, slot)
            high = half_number(mask[k] >> _HALF, half, slot)
            if low < LOW_HALVES and high < HALVES:
                code[k] = low | high << 15
            else:
                full[n_full] = mask[k]
                code[k] = WHOLE | n_full
                n_full += 1
        start[item + 1, 0], start[item + 1, 1] = end, ptr[item + 1]
    return n_full
