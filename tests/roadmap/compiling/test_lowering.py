"""Elements and variables in fewer instructions: the same answers."""

import gc
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, types
from numba.core.lowering import Lower
from numba.core.runtime import _nrt_python, rtsys
from numba.np import arrayobj

from roadmap.compiling import linking
from roadmap.compiling.jit_options import FULL, LEAN

FRESH = {"cache": False}
pytestmark = pytest.mark.skipif(not linking.KNOWN, reason="numba's own pipeline")


def _moved(a, flags, out, k, u):
    """Read and write in every way: by one number, by several, rows, from the end."""
    rows, columns, depth = a.shape
    total = 0.0
    for i in range(rows):
        row = a[i]
        for j in range(columns):
            column = row[j]
            for n in range(depth):
                total += a[i, j, n] * column[n] - row[j, n] + a[i, j][n]
                out[i, j] += k * a[-1 - i, j, -1]
        total += out[i, 0] * flags[i] - row[k, u] + a[i, k][-1]
        flags[i] = not flags[i]
    out[-1, -1] = a[0, k, u] + a.shape[1] + row.shape[0] + flags.shape[0]
    return total + out[u, u]


def _arrays(order):
    rng = np.random.default_rng(4)
    a = rng.random((3, 4, 5))
    if order == "F":
        a = np.asfortranarray(a)
    if order == "A":
        a = rng.random((6, 4, 10))[::2, :, ::2]
    out = np.asarray(np.zeros((3, 4)), order="F" if order == "F" else "C")
    return a, np.array([True, False, True]), out


@pytest.mark.parametrize("said", [LEAN, FULL])
@pytest.mark.parametrize("order", ["C", "F", "A"])
def test_what_is_read_and_written_is_what_python_reads_and_writes(order, said):
    loop = njit(**said | FRESH)(_moved)
    given, same = _arrays(order), _arrays(order)
    for k, u in ((1, np.uint16(2)), (-1, np.uint16(0))):
        assert loop(*given, k, u) == _moved(*same, k, u)
    for one, other in zip(given, same, strict=True):
        assert np.array_equal(one, other)


def test_a_readonly_array_is_read_and_not_written():
    def first(a):
        return a[0, 1] + a[1][0]

    def clear(a):
        a[0, 0] = 0.0

    a = np.arange(4.0).reshape(2, 2)
    a.setflags(write=False)
    assert njit(**LEAN | FRESH)(first)(a) == 3.0
    with pytest.raises(Exception, match="readonly"):
        njit(**LEAN | FRESH)(clear)(a)


def test_a_row_that_is_handed_on_is_counted_as_any_array():
    on = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    try:

        @njit(**FULL | FRESH)
        def rows(n):
            last = np.zeros(3)
            for k in range(n):
                made = np.full((2, 3), k * 1.0)
                last = made[1]
            return last

        rows(2)
        before = rtsys.get_allocation_stats()
        for n in range(1, 5):
            assert rows(n)[0] == n - 1.0
        after = rtsys.get_allocation_stats()
        assert after.alloc - before.alloc == after.free - before.free > 0
    finally:
        if not on:
            _nrt_python.memsys_disable_stats()


def test_numbers_in_plain_arrays_do_without_numbas_array_on_the_stack(monkeypatch):
    loop = njit(**LEAN | FRESH)(_moved)

    def refused(typ):
        raise AssertionError(typ)

    given = _arrays("C")
    with monkeypatch.context() as here:
        here.setattr(arrayobj, "make_array", refused)
        kinds = tuple(map(loop.typeof_pyval, (*given, 1, np.uint16(2))))
        loop.compile(kinds)
    assert loop(*given, 1, np.uint16(2)) == _moved(*_arrays("C"), 1, np.uint16(2))


class Group(NamedTuple):
    """Two arrays."""

    a: np.ndarray
    b: np.ndarray


def _rounds(group, n):
    """Use variables of every kind: of one value, of the round before, of a branch."""
    a, last, late, kept = group.a, -1.0, 0.0, 0.5
    for i in range(n):
        if i > 1:
            late += last * kept  # of the round before
        kept = a[i] + group.b[i]
        if kept > 1.0:
            high = kept * 2.0
            for j in range(i):
                late += high * group.a[j]
            last = high
        elif i % 2:
            last = kept
        if late > 1e6:
            break
    return late + last + group.b.shape[0] + kept


@pytest.mark.parametrize("said", [LEAN, FULL])
def test_variables_have_the_values_that_python_gives_them(said):
    loop, rng = njit(**said | FRESH)(_rounds), np.random.default_rng(2)
    for n in range(1, 8):
        group = Group(rng.random(8), rng.random(8))
        assert loop(group, n) == _rounds(group, n)


def test_a_group_that_is_assigned_once_is_not_on_the_stack(monkeypatch):
    places, plain = [], Lower.alloca

    def noted(self, name, typ):
        places.append(name)
        return plain(self, name, typ)

    monkeypatch.setattr(Lower, "alloca", noted)
    loop = njit(**LEAN | FRESH)(_rounds)
    loop.compile((loop.typeof_pyval(Group(np.ones(8), np.ones(8))), types.int64))
    assert not {"group", "a", "n"} & set(places)
    assert any("late" in name for name in places)


class Nest(NamedTuple):
    """A group in a group, with a number beside."""

    first: Group
    x: float
    c: np.ndarray


def _sum(nest, k):
    return nest.first.a[k] + 10.0 * nest.first.b[k] + 100.0 * nest.c[k] + nest.x


def _written(nest, k, inner):
    """Hand groups on as they came, put together anew, chosen, returned and nested."""
    total, last = 0.0, nest
    for i in range(3):
        other = Nest(Group(nest.c, nest.first.a), nest.x + i, nest.first.b)
        chosen = other if i == k else nest
        total += inner(chosen, i) + inner(last, k)
        if i > 0:
            total += inner(other, i)
        last, nest = swapped(other), last
        total += inner(last, i) + inner(nest, k) + last.first.b[i]
        nest.c[i] += 1.0
    return total


def _swapped(nest):
    return Nest(Group(nest.first.b, nest.first.a), -nest.x, nest.c)


swapped = _swapped


def _nest():
    a, b, c = np.arange(9.0).reshape(3, 3) ** 2
    return Nest(Group(a, b), 0.5, c)


@pytest.mark.parametrize("said", [LEAN, FULL])
def test_groups_are_handed_on_as_they_are(said, monkeypatch):
    expected = [_written(_nest(), k, _sum) for k in range(3)]
    inner = njit(**said | FRESH)(_sum)
    monkeypatch.setitem(globals(), "swapped", njit(**said | FRESH)(_swapped))
    loop = njit(**said | FRESH)(_written)
    assert [loop(_nest(), k, inner) for k in range(3)] == expected


def test_a_loop_is_handed_the_address_of_a_group():
    loop = njit(**LEAN | FRESH)(_sum)
    loop(_nest(), 1)
    text = next(iter(loop.inspect_llvm().values()))
    head = next(line for line in text.splitlines() if line.startswith("define"))
    assert head.count(",") < 6  # of some thirty numbers


def _counted(first, last, step, seen):
    n = 0
    for i in range(last):
        seen[n] += i
        n += 1
    for i in range(first, last):
        if i == 7:
            break
        for k in range(np.int32(i)):
            seen[n] += k + 1
        n += 1
    for i in range(first, last, step):
        seen[n] += i
        n += 1
    return n


@pytest.mark.parametrize("said", [LEAN, FULL])
@pytest.mark.parametrize("step", [1, 2, -2, -1])
def test_ranges_count_as_pythons_do(said, step):
    loop = njit(**said | FRESH)(_counted)
    for first, last in ((0, 5), (5, 0), (-3, 3), (3, 3), (0, 9), (6, -2)):
        seen, same = np.zeros((2, 60), int)
        assert loop(first, last, step, seen) == _counted(first, last, step, same)
        assert np.array_equal(seen, same)


def _tried(a, k, raises):
    try:
        found = raises(a, k)
    except Exception:
        found = -1.0
    return found


def _ratio(a, k):
    return a[k] / a[0]


@pytest.mark.parametrize("said", [LEAN, FULL])
def test_an_error_is_caught_where_a_loop_tries(said):
    inner = njit(**said | FRESH)(_ratio)
    loop = njit(**said | FRESH)(_tried)
    assert loop(np.array([0.0, 1.0]), 1, inner) == -1.0
    assert loop(np.array([2.0, 1.0]), 1, inner) == 0.5


def _member(numbers, k):
    kept = numbers.first
    for _ in range(k):
        kept = Group(kept.b.copy(), kept.a)
    return kept.a if k else numbers.c


def test_arrays_of_groups_are_counted_one_by_one():
    loop, nest = njit(**FULL | FRESH)(_member), _nest()
    on = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    gc.collect()  # what other tests left behind is not freed meanwhile
    before = rtsys.get_allocation_stats()
    for k in (0, 1, 2, 0, 3):
        assert np.array_equal(loop(nest, k), _member(nest, k))
    alloc, free, mi_alloc, mi_free = np.subtract(rtsys.get_allocation_stats(), before)
    assert alloc == free and mi_alloc == mi_free and alloc > 0
    if not on:
        _nrt_python.memsys_disable_stats()
