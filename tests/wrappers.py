"""Loops that only loops call, opened to Python for a test."""

from numba import jit
from numba.core.dispatcher import Dispatcher

from roadmap.compiling.linking import LoopCompiler


def with_wrapper(loop: Dispatcher) -> Dispatcher:
    """Return the same loop, compiled in this process, as Python can call it.

    Nothing of it is kept on disk: `odm warmup` compiles no wrapper for tests, and the
    code of a loop without one must not be found under its name.
    """
    options = loop.targetoptions | {"no_cpython_wrapper": False}
    return jit(pipeline_class=LoopCompiler, cache=False, **options)(loop.py_func)
