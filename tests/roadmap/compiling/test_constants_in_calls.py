"""Constants in calls of loops do not make numba compile the callee for each of them."""

import numpy as np
import pytest
from numba import njit, types

from roadmap.compiling import linking
from roadmap.compiling.jit_options import INNER, LEAN

FRESH = {"cache": False}
LAST, HUGE = 4, 2**63 + 1
pytestmark = pytest.mark.skipif(not linking.KNOWN, reason="numba's own pipeline")


@njit(**INNER | FRESH)
def entry(a, k, doubled):
    if doubled:
        return 2.0 * a[k]
    return a[k]


@njit(**LEAN | FRESH)
def some_entries(a):
    second = 1
    total = 0.0
    for k in range(2):
        total += entry(a, k, True)
    total += entry(a, 0, False) + 10.0 * entry(a, second, False)
    return total + 100.0 * entry(a, LAST, doubled=False) + entry(a, -2, True)


def test_a_loop_is_compiled_once_whatever_constants_it_is_called_with():
    a = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert some_entries(a) == 2 + 4 + 1 + 20 + 500 + 8
    array = types.Array(types.float64, 1, "C")
    assert entry.signatures == [(array, types.int64, types.boolean)]


@njit(**INNER | FRESH)
def top_bit(word):
    return word >> np.uint64(63)


@njit(**LEAN | FRESH)
def top_bit_of_huge():
    return top_bit(HUGE)


def test_a_constant_beyond_64_bits_with_sign_keeps_its_value():
    assert top_bit_of_huge() == 1


@njit(**INNER | FRESH)
def product(a, b):
    return a * b


@njit(**LEAN | FRESH)
def one_of_two(x, flag):
    k = 3 if flag else 5
    return product(x, k)


def test_a_variable_of_two_values_is_no_constant():
    assert one_of_two(2, True) == 6 and one_of_two(2, False) == 10


@njit(**LEAN | FRESH)
def sums_up(a):
    at, total = 0, 0.0  # constants until the round below: numba looks at both
    while at < a.shape[0]:
        total += entry(a, at, False)
        at += 1
    return total


def test_a_variable_that_begins_as_a_constant_is_a_number_from_the_start():
    assert sums_up(np.array([1.0, 2.0])) == 3.0
    assert len(entry.signatures) == 1


@njit(**INNER | FRESH)
def twice(k):
    return 2 * k


@njit(**LEAN | FRESH)
def twice_of_each(short, long, sizes):
    return twice(short[0]) + twice(long[0]) + twice(np.int16(3)) + twice(sizes[0])


def test_a_loop_is_compiled_once_for_whole_numbers_with_sign():
    short, long = np.array([2**31 - 1], np.int32), np.array([-(2**40)])
    sizes = np.array([5], np.uint32)
    expected = 2 * (2**31 - 1) - 2**41 + 6 + 10
    assert twice_of_each(short, long, sizes) == expected
    # with a sign one would become a float beside others of 64 bits without
    assert twice.signatures == [(types.int64,), (types.uint32,)]
