"""Loops are optimised once each, and the answers are those of numba's own compiler."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from numba.core.runtime import _nrt_python, rtsys

from roadmap.compiling import linking
from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.compiling.linking import made

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
    monkeypatch.setattr(linking, "MOST_COST", 60)
    loops = _loops(_FROM_PYTHON, _FROM_LOOPS)
    loops[-1](np.ones(3), 2)
    return loops


def test_the_same_bytes_come_out(small):
    rng = np.random.default_rng(5)
    usual = _loops(_NUMBAS, _NUMBAS | {"no_cpython_wrapper": True})[-1]
    for k in range(1, 5):
        a = rng.random(7)
        assert small[-1](a, k) == usual(a, k)


def _named(loop, names):
    return {n for n in names if f"4{loop.py_func.__name__}" in n and "cpython" not in n}


def test_a_large_callee_has_machine_code_of_its_own_a_small_one_is_gone(small):
    tiny, leaf, top = small
    module = _library(top)._final_module
    names = {f.name for f in module.functions}
    assert not _named(leaf, _defined(module))
    (called,) = _named(leaf, names)
    assert made[called].code and called in _defined(_library(leaf)._final_module)
    assert not any("tiny" in n for n in names)
    for function in module.functions:
        told = b" ".join(function.attributes)
        assert b"optnone" not in told, function.name


def test_a_small_loop_that_python_never_calls_gets_no_machine_code(small):
    tiny, leaf, top = small
    assert isinstance(_library(tiny), linking.LoopLibrary)
    assert _defined(_library(tiny)._final_module) == set()
    assert any("tiny" in n for n in _defined(_library(tiny)._shared_module))
    assert any("top" in n for n in _defined(_library(top)._final_module))


LOOPS = """
import numpy as np
from numba import njit
from roadmap.compiling import linking
from roadmap.compiling.jit_options import INNER, LEAN

linking.MOST_COST = 60

@njit(**INNER)
def leaf(a, k):
    total = 0.0
    for i in range(a.shape[0]):
        if a[i] < 0.0:
            raise ValueError("negative")
        total += a[i] / (1.0 + a[(i + k) % a.shape[0]])
    return total

@njit(**INNER)
def middle(a, k):
    total = 0.0
    for j in range(k):
        total += leaf(a, j) * leaf(a, j + 1) - leaf(a, j + 2)
    return total

@njit(**LEAN)
def top(a, k):
    return middle(a, k) + middle(a, k + 1)

@njit(**LEAN)
def other(a, k):
    return middle(a, k) - leaf(a, k)
"""
CALLS = """
import sys
import numpy as np
from numba.core.registry import cpu_target
from llvmlite.binding import ExecutionEngine

objects, plain = [], ExecutionEngine.add_object_file
def add(self, one):
    objects.append(one)
    plain(self, one)
ExecutionEngine.add_object_file = add

import loops
a = np.array([0.5, 1.5, 2.5])
print(loops.top(a, 3), loops.other(a, 3))
try:
    loops.other(-a, 3)
except ValueError as error:
    print(error)
every = [loops.leaf, loops.middle, loops.top, loops.other]
misses = sum(sum(one.stats.cache_misses.values()) for one in every)
print(misses, len(objects), file=sys.stderr)
"""


def test_what_is_kept_of_a_loop_holds_all_that_it_calls_each_object_once(tmp_path):
    """Another process needs nothing that is kept of the callees."""
    (tmp_path / "loops.py").write_text(LOOPS)
    root = Path(linking.__file__).parents[2]
    env = os.environ | {
        "PYTHONPATH": f"{root}{os.pathsep}{tmp_path}",
        "NUMBA_CACHE_DIR": str(tmp_path / "kept"),
    }

    def run():
        told = subprocess.run(
            [sys.executable, "-c", CALLS], env=env, capture_output=True, text=True
        )
        assert told.returncode == 0, told.stderr
        return told.stdout, told.stderr.split()

    first, (misses, _) = run()
    assert misses == "4" and "negative" in first
    for file in (tmp_path / "kept").rglob("*"):
        if "leaf" in file.name or "middle" in file.name:
            file.unlink()
    again, (misses, objects) = run()
    assert (again, misses, objects) == (first, "0", "2")


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
    monkeypatch.setattr(linking, "MOST_COST", 60)
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


def test_what_our_loops_call_of_numba_is_whole_for_loops_of_others():
    """These are kept without the machine code that ours have beside theirs."""
    a = np.arange(60, 0, -1, dtype=np.int16)

    def first(a):
        return np.argsort(a)[0]

    assert njit(**(_FROM_PYTHON | {"_nrt": True}))(first)(a) == 59
    assert njit(first)(a) == 59
