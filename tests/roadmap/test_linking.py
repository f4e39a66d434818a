"""Loops are optimised once each, and the answers are those of numba's own compiler."""

import numpy as np
import pytest
from numba import njit
from numba.core.runtime import _nrt_python, rtsys

from roadmap import linking
from roadmap.jit_options import INNER, LEAN

_FROM_PYTHON = {k: v for k, v in LEAN.items() if k != "cache"}
_FROM_LOOPS = {k: v for k, v in INNER.items() if k != "cache"}
_NUMBAS = {k: v for k, v in _FROM_PYTHON.items() if k != "pipeline_class"}


def _loops(from_python, from_loops):
    """Return three loops, each of which calls the ones before."""

    @njit(**from_loops)
    def tiny(x):
        return 2.0 * x + 0.1

    @njit(**from_loops)
    def leaf(a, k):
        total = 0.0
        for i in range(a.shape[0]):
            if a[i] < 0.0:
                raise ValueError("negative")
            total += a[i] / (1.0 + a[(i + k) % a.shape[0]])
        return total

    @njit(**from_python)
    def top(a, k):
        total = 0.0
        for j in range(k):
            total += tiny(leaf(a, j))
        return total + leaf(a, k)

    return tiny, leaf, top


def _library(loop):
    return next(iter(loop.overloads.values())).library


def _defined(module):
    return {f.name for f in module.functions if not f.is_declaration}


@pytest.fixture
def small(monkeypatch):
    """Loops where the middle one is too large to be written into its caller."""
    monkeypatch.setattr(linking, "MOST_INSTRUCTIONS", 12)
    loops = _loops(_FROM_PYTHON, _FROM_LOOPS)
    loops[-1](np.ones(3), 2)
    return loops


def test_the_same_bytes_come_out(small):
    rng = np.random.default_rng(5)
    usual = _loops(_NUMBAS, _NUMBAS | {"no_cpython_wrapper": True})[-1]
    for k in range(1, 5):
        a = rng.random(7)
        assert small[-1](a, k) == usual(a, k)


def test_a_large_callee_is_linked_as_it_was_optimised_a_small_one_is_gone(small):
    tiny, leaf, top = small
    module = _library(top)._final_module
    names = _defined(module)
    assert {n.split("B")[0] for n in names if "leaf" in n} != set()
    assert not any("tiny" in n for n in names)
    for function in module.functions:
        told = b" ".join(function.attributes)
        assert b"optnone" not in told, function.name


def test_a_loop_that_python_never_calls_gets_no_machine_code(small):
    tiny, leaf, top = small
    assert isinstance(_library(leaf), linking.LoopLibrary)
    assert _defined(_library(leaf)._final_module) == set()
    assert any("leaf" in n for n in _defined(_library(leaf)._shared_module))
    assert any("top" in n for n in _defined(_library(top)._final_module))


def test_an_error_is_raised_out_of_a_callee(small):
    with pytest.raises(ValueError, match="negative"):
        small[-1](np.array([1.0, -1.0]), 2)


@pytest.fixture
def arrays_are_counted():
    on = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    yield
    if not on:
        _nrt_python.memsys_disable_stats()


@pytest.mark.usefixtures("arrays_are_counted")
@pytest.mark.parametrize("raises", [False, True])
def test_a_loop_that_counts_references_gives_back_every_array(raises, monkeypatch):
    """What is not pruned is counted; by a caller of ours as by numba's own."""
    monkeypatch.setattr(linking, "MOST_INSTRUCTIONS", 12)
    counted = _FROM_PYTHON | {"_nrt": True}

    @njit(**(counted | {"no_cpython_wrapper": True}))
    def makes(n):
        if n > 40:
            raise ValueError("too long")
        return np.ones(n)

    @njit(**counted)
    def total(n):
        kept = makes(1)
        for k in range(n):
            one = makes(k)
            if one.sum() > kept.sum():
                kept = one
        return kept

    n = 50 if raises else 30
    total(3)
    before = rtsys.get_allocation_stats()
    for _ in range(5):
        if raises:
            with pytest.raises(ValueError, match="too long"):
                total(n)
        else:
            assert total(n).sum() == n - 1
    after = rtsys.get_allocation_stats()
    assert isinstance(_library(total), linking.LoopLibrary)
    if not raises:  # numba itself gives nothing back where an error passes
        assert after.alloc - before.alloc == after.free - before.free > 0
