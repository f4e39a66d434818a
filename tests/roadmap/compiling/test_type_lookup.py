"""What numba looks up for our loops is remembered, and is what it looks up itself."""

import math
import operator
from collections import namedtuple

import numpy as np
import pytest
from numba import njit, types
from numba.core.compiler import Flags
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack
from numba.core.typing import BaseContext

from roadmap.compiling import type_lookup
from roadmap.compiling.jit_options import BARE, FULL, LEAN
from roadmap.compiling.type_lookup import SharedFlagsPasses, call_type

FRESH = {"cache": False}
_NUMBERS = types.int8, types.int64, types.uint64, types.float32, types.float64
_OPERATORS = (operator.add, operator.truediv, operator.lt, operator.and_, math.sqrt)


@pytest.fixture
def context() -> BaseContext:
    njit(lambda x: x + 1)(2)  # numba has learned its operators
    return cpu_target.typing_context


def _made_of(look_up, context, function, args):
    """Return the types of a call, and what it is lowered by; None if there is none."""
    try:
        signature = look_up(function, context, args, {})
    except Exception as error:
        return type(error)
    return signature, function.get_impl_key(signature)


@pytest.mark.parametrize("function", _OPERATORS)
def test_operators_of_numbers_are_those_of_numba(context, function):
    known, plain = context.resolve_value_type(function), type_lookup._looked_up
    given = [(a, b) for a in _NUMBERS for b in (*_NUMBERS, types.boolean)]
    if function is math.sqrt:
        given = [(a,) for a in _NUMBERS]
    for args in given:
        expected = _made_of(plain, context, known, args)
        for _ in range(2):  # the second time it is remembered, or refused again
            assert _made_of(call_type, context, known, args) == expected


def test_a_sum_is_asked_for_once(context, monkeypatch):
    asked, plain = [], type_lookup._looked_up

    def count(function, *given):
        asked.append(given)
        return plain(function, *given)

    monkeypatch.setattr(type_lookup, "_looked_up", count)
    item, size = map(context.resolve_value_type, (operator.getitem, len))
    odd = types.Array(types.int16, 7, "A")  # nobody has asked for its items
    group = types.NamedTuple((types.intp,), namedtuple("Group", "a"))
    for _ in range(3):
        call_type(item, context, (odd, types.IntegerLiteral(-7)), {})
    assert len(asked) == 1
    for _ in range(3):  # groups are never remembered
        call_type(size, context, (group,), {})
    assert len(asked) == 4


def test_equal_options_are_one_object_while_loops_are_compiled():
    seen = []

    class Passes:
        pipeline_name = "mine"

        def run(self, state):
            seen.append(ConfigStack().top())

    for nrt in (True, False, True):
        flags = Flags()
        flags.nrt = nrt
        with ConfigStack().enter(flags):
            passes = SharedFlagsPasses(Passes())
            assert passes.pipeline_name == "mine"
            passes.run(None)
            assert seen[-1] == flags and flags == seen[-1]
            assert hash(seen[-1]) == hash(flags)
            assert type(seen[-1].copy()) is Flags and seen[-1].copy() == flags
    first, other, again = seen
    assert first is again and first is not other
    assert first != other and not ConfigStack()


def test_what_the_options_say_is_kept_apart():
    """A division by zero is an error for one loop, and infinity for the next."""

    @njit(**LEAN | FRESH)
    def refuses(x):
        return 1.0 / x

    @njit(**BARE | FRESH)
    def infinite(x):
        return 1.0 / x

    @njit(**FULL | FRESH)
    def makes(n):
        return np.full(3, 1.0 / n) + np.arange(3)

    with pytest.raises(ZeroDivisionError):
        refuses(0.0)
    assert infinite(0.0) == math.inf
    assert makes(2.0).tolist() == [0.5, 1.5, 2.5]


def test_numbas_own_compiler_is_left_alone():
    assert type(cpu_target.typing_context).__module__.startswith("numba.")
    assert not ConfigStack()
