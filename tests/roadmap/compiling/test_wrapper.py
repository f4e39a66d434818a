"""Wrappers take arrays by one function: the same arguments, a fraction of the code."""

import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, typeof

from roadmap.compiling import linking, wrapper
from roadmap.compiling.jit_options import FULL, LEAN

FRESH = {"cache": False}
pytestmark = pytest.mark.skipif(not linking.KNOWN, reason="numba's own pipeline")


class Inner(NamedTuple):
    """Arrays of several types."""

    a: np.ndarray
    flags: np.ndarray
    scale: float


class Outer(NamedTuple):
    """A group in a group, and numbers."""

    inner: Inner
    b: np.ndarray
    k: int
    on: bool
    pair: tuple


def _given():
    inner = Inner(np.arange(6.0).reshape(2, 3)[:, ::2], np.array([True, False]), 0.5)
    pair = (np.array([7, 8]), np.array([9, 10]))
    return Outer(inner, np.array([1, 2], np.uint16), 4, True, pair), np.ones(3)


def _weighed(group, x):
    inner, total = group.inner, 0.0
    for i in range(inner.a.shape[0]):
        for j in range(inner.a.shape[1]):
            total += inner.scale * inner.a[i, j]
        total += 100.0 * inner.flags[i] + group.b[i] + group.pair[1][i]
    x[0] = total
    return total + 1000.0 * group.k + 1e6 * group.on


def _fresh(said):
    return njit(**said | FRESH)(_weighed)


@pytest.mark.parametrize("said", [LEAN, FULL])
def test_groups_of_arrays_and_numbers_arrive_as_they_are(said):
    group, x = _given()
    loop, begun = _fresh(said), _weighed(group, np.ones(3))
    before = [sys.getrefcount(one) for one in (x, group.b, group.inner.a)]
    for _ in range(50):
        assert loop(group, x) == begun
    assert x[0] == _weighed(group, np.ones(3)) - 1000.0 * 4 - 1e6
    assert [sys.getrefcount(one) for one in (x, group.b, group.inner.a)] == before


@pytest.mark.parametrize("said", [LEAN, FULL])
def test_what_is_no_such_array_is_refused_by_the_wrapper(said):
    group, x = _given()
    loop = _fresh(said)
    loop(group, x)
    (compiled,) = loop.overloads.values()
    enter = compiled.entry_point  # no look at the types before it
    for bad in ("no array", None, np.ones(3, np.float32)):
        with pytest.raises(TypeError, match="can't unbox array"):
            enter(group, bad)
        with pytest.raises(TypeError, match="can't unbox array"):
            enter(group._replace(b=bad), x)
    assert enter(group, x) == _weighed(group, np.ones(3))


def _size_of_wrapper(loop):
    (compiled,) = loop.overloads.values()
    functions = compiled.library._get_module_for_linking().functions
    (found,) = [f for f in functions if f.name.startswith("_ZN7cpython")]
    return sum(1 for block in found.blocks for _ in block.instructions)


def test_a_wrapper_is_small(monkeypatch):
    group, x = _given()
    ours = _fresh(LEAN)
    ours(group, x)
    monkeypatch.setattr(linking, "use_small_wrappers", lambda context: None)
    numbas = _fresh(LEAN)
    numbas(group, x)
    assert _size_of_wrapper(ours) < 0.7 * _size_of_wrapper(numbas)
    assert wrapper._TAKE in str(
        next(iter(ours.overloads.values())).library.get_llvm_str()
    )


def test_a_loop_is_called_without_a_look_at_types():
    @njit(**LEAN | FRESH)
    def first(numbers):
        return numbers[0]

    given = np.array([7]), np.array([0.5])
    calls = [wrapper.without_lookup(first, one) for one in given]
    assert [call(one) for call, one in zip(calls, given, strict=True)] == [7, 0.5]
    assert first.signatures == [(typeof(one),) for one in given]
    assert wrapper.without_lookup(first.py_func, given[0]) is first.py_func
