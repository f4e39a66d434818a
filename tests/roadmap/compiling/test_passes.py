"""What numba's passes would find in our loops is found with fewer of them."""

from functools import reduce

import numpy as np
import pytest
from numba import njit
from numba.core import compiler, ir, postproc
from numba.core.errors import TypingError

from roadmap.compiling import passes
from roadmap.compiling.jit_options import FULL

FRESH = FULL | {"cache": False}


def _closure(a):
    def twice(x):
        return 2.0 * x

    return twice(a[0])


def _comprehension(a):
    return np.array([x + 1.0 for x in a]).sum()


def _filled(a):
    found = []
    for x in a:
        found.append(2.0 * x)
    return np.array(found)[1]


def _sum_of_arrays(a):
    return (a * a + 2.0 * a - 1.0)[-1]


def _yielding(a):
    for x in a:
        if x > 1.0:
            yield x


def _reduced(a):
    return reduce(lambda x, y: x + y, a)


@pytest.mark.parametrize(
    "loop", [_closure, _comprehension, _filled, _sum_of_arrays, _reduced]
)
def test_loops_that_a_pass_was_made_for_are_compiled(loop):
    a = np.array([1.0, 2.0, 4.0])
    assert njit(**FRESH)(loop)(a) == loop(a)


def test_a_generator_keeps_what_lives_between_its_steps():
    a = np.array([1.0, 2.0, 4.0])
    assert list(njit(**FRESH)(_yielding)(a)) == [2.0, 4.0]


def test_an_instruction_names_the_variables_that_numba_finds():
    plain, found = ir.Stmt.list_vars, 0
    code = compiler.run_frontend(_bent)
    for block in code.blocks.values():
        for one in block.body:
            expected = plain(one)
            with passes.quick():
                assert ir.Stmt.list_vars is not plain
                assert one.list_vars() == expected
            found += len(expected)
    assert found > 30


def _bent(a, *more):
    for k in range(len(a)):
        a[k, 0:2] = (a[k], [k, {"x": k}], f"{k}")
    if a.any(1, axis=k):
        raise ValueError(a, k)
    return -a


def test_numba_is_as_it_was_after_a_loop_that_cannot_be_compiled():
    before = postproc.PostProcessor.run, ir.Expr.list_vars
    with pytest.raises(TypingError):
        njit(**FRESH)(lambda a: a.nothing)(1.0)
    assert (postproc.PostProcessor.run, ir.Expr.list_vars) == before
